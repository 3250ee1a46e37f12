//! Differences and refusals in words that name the item.

use crate::compare::Difference;
use crate::item::{Autopilot, Mission, MissionItem, MissionKind, command};
use crate::transfer::{MissionResult, TransferError};

/// What to do where the link was lost.
pub(super) const LINK: &str = "Do not arm in or switch to the mission mode. Restore the link: the previous state is then put back by itself; \
                               or upload again and read it back before flying it";
/// What to do where the vehicle must not be changed now.
pub(super) const HELD: &str = "Nothing more is sent to it in this state. Leave the mission mode and disarm: the previous one is then put back by \
                               itself while this program waits, or by \"gaware mission restore\"";
/// What to do where it is not certain who answers.
pub(super) const ABANDONED: &str =
    "Nothing more was sent. Connect the vehicle that was meant, alone, and run \"gaware mission restore\"";

/// The first difference and the number of the others.
pub(super) fn summary(found: &[Difference]) -> String {
    match found {
        [] => "no difference".to_owned(),
        [one] => one.to_string(),
        [first, rest @ ..] => format!("{first}, and {} more", rest.len()),
    }
}

/// Why an upload failed; a refusal names the item, its command, the parameter with its value, and whom the plan was made for.
pub(super) fn failure(
    error: &TransferError,
    sent: &Mission,
    kind: MissionKind,
    vehicle: Autopilot,
    planned_for: Option<Autopilot>,
) -> String {
    let TransferError::Refused { result, seq: Some(seq) } = error else { return error.to_string() };
    let number = match (kind, vehicle) {
        (MissionKind::Mission, Autopilot::ArduPilot) => usize::from(*seq),
        _ => usize::from(*seq) + 1,
    };
    let Some(item) = number.checked_sub(1).and_then(|k| sent.items.get(k)) else { return error.to_string() };
    if !result.is_final() || *result == MissionResult::NO_SPACE {
        return error.to_string();
    }
    let mut text = format!(
        "the vehicle refused item {number} ({}, command {}): {}",
        command::describe(item.command),
        item.command,
        reason(*result, item)
    );
    if let Some(other) = planned_for.filter(|a| *a != vehicle) {
        text.push_str(&format!("; the plan was made for {other}, this vehicle runs {vehicle}"));
    }
    text
}

/// What is wrong with the item (`MAV_MISSION_RESULT`).
fn reason(result: MissionResult, item: &MissionItem) -> String {
    let number =
        |value: f32| if value.is_nan() { "not a number (NaN)".to_owned() } else { value.to_string() };
    match result.0 {
        2 => format!("it does not support coordinate frame {}", item.frame.0),
        3 => "it does not support this command".to_owned(),
        n @ 6..=9 => {
            let value = item.params.get(usize::from(n) - 6).copied().unwrap_or(0.0);
            format!("parameter {} is invalid, its value is {}", n - 5, number(value))
        }
        10 => format!("parameter 5 is invalid, its value is {}", item.x),
        11 => format!("parameter 6 is invalid, its value is {}", item.y),
        12 => format!("parameter 7 is invalid, its value is {}", number(item.z)),
        _ => {
            let values = item.params.map(number).join(", ");
            format!("it does not accept its parameters {values} at altitude {}", number(item.z))
        }
    }
}
