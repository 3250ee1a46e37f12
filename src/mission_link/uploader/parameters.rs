//! The setting of parameters while `run` goes on.

use super::super::param_delivery::{self, ParamOrder, phase_words};
use super::super::pinned::Pinned;
use super::super::run_wire::RunWire;
use super::super::wire::News;
use super::{PATIENCE_S, Vehicle, stamp};
use crate::figures::counted;
use crate::sinks::status::{MissionState, ParametersView, SinkStatus};
use gaware_mission::change::Phase;
use gaware_mission::params::apply::ApplyOutcome;

fn name(order: &ParamOrder) -> String {
    order.path().file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

pub(super) fn ready(order: &ParamOrder) -> String {
    let parameters = counted(order.entries().len(), "parameter");
    format!("{parameters} of {} can be set while the vehicle is disarmed", name(order))
}

pub(super) fn show(status: &SinkStatus, order: &ParamOrder, state: MissionState, text: String) {
    let values = order.entries().iter().map(|e| format!("{} {}", e.name, e.value)).collect();
    status.set_parameters(ParametersView { state, name: name(order), values, text });
}

/// Sets them; an armed vehicle is refused by the transfer itself.
pub(super) async fn set(
    order: &ParamOrder,
    wire: &mut Pinned<RunWire>,
    others: &[Vehicle],
    status: &SinkStatus,
) -> Result<String, String> {
    let refuse = |why: String| {
        show(status, order, MissionState::Ready, format!("not set: {why}"));
        Err(why)
    };
    if let Some(other) = others.first() {
        let id = other.address.system;
        return refuse(format!("system {id} is on the link as well; start gaware with --vehicle ID"));
    }
    let tell = |event| match event {
        News::Phase(Phase::Finished) | News::Checked(_) | News::Said(_) | News::Progress(..) => {}
        News::Phase(phase) => {
            show(status, order, MissionState::Uploading, phase_words(phase).to_owned());
        }
        News::Stranded(text) => show(status, order, MissionState::Unknown, text),
    };
    // The old values lie beside the new ones.
    let backup = order.path().with_file_name(format!("params-backup-{}.param", stamp()));
    let delivered = match param_delivery::deliver(wire, order, backup, PATIENCE_S, tell).await {
        Ok(delivered) => delivered,
        Err(error) => return refuse(error.to_string()),
    };
    let state = match delivered.outcome {
        ApplyOutcome::Verified { .. } => MissionState::OnVehicle,
        ApplyOutcome::Previous { .. } => MissionState::NotOnVehicle,
        ApplyOutcome::Mixed { .. } => MissionState::Unknown,
    };
    show(status, order, state, delivered.text.clone());
    if state == MissionState::OnVehicle { Ok(delivered.text) } else { Err(delivered.text) }
}
