//! The messages that read and set rates, with the habits of each autopilot.

use super::message::{Message, Present};
use super::{GET_MESSAGE_INTERVAL, GPS_RAW_INT, HIGHRES_IMU};
use crate::sensors::{AUTOPILOT_COMPONENT, Autopilot, ImuSource};
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
#[expect(deprecated, reason = "for firmware that knows nothing newer")]
use mavlink::dialects::ardupilotmega::{MavDataStream, REQUEST_DATA_STREAM_DATA};

/// PX4 looks at its streams when a sample is published: every 4 ms in its own configuration (measured: 200 Hz asked for
/// gives 125 Hz).
const PX4_STEP_US: f64 = 4000.0;
/// `SET_MESSAGE_INTERVAL` with this brings the default back.
const DEFAULT_INTERVAL: f32 = 0.0;
/// … and with this it stops the message.
const STOP: f32 = -1.0;

/// Whom requests are for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    pub system_id: u8,
    pub autopilot: Autopilot,
}

impl Target {
    fn command(&self, command: MavCmd, tries: u32, param1: f32, param2: f32) -> MavMessage {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command,
            target_system: self.system_id,
            target_component: AUTOPILOT_COMPONENT,
            confirmation: u8::try_from(tries.saturating_sub(1)).unwrap_or(u8::MAX),
            param1,
            param2,
            ..Default::default()
        })
    }

    /// Asks which interval is set.
    pub fn query(&self, message_id: u32, tries: u32) -> MavMessage {
        self.command(GET_MESSAGE_INTERVAL, tries, message_id as f32, 0.0)
    }

    /// Asks for a rate. ArduPilot wants whole milliseconds and zeros in the parameters it does not use.
    pub fn set_rate(&self, message_id: u32, rate_hz: u16, inertial: bool, tries: u32) -> MavMessage {
        let exact_us = 1e6 / f64::from(rate_hz.max(1));
        let interval_us = match self.autopilot {
            // Half a step before the sample that is meant, so that jitter does not cost one; where no sample comes so early, each is sent.
            Autopilot::Px4 if inertial => ((exact_us / PX4_STEP_US).floor().max(1.0) - 0.5) * PX4_STEP_US,
            Autopilot::Px4 => exact_us.round(),
            Autopilot::Ardupilot | Autopilot::Unknown => (exact_us / 1e3).floor().max(1.0) * 1e3,
        };
        self.set_interval(message_id, interval_us as f32, tries)
    }

    fn set_interval(&self, message_id: u32, interval_us: f32, tries: u32) -> MavMessage {
        self.command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, tries, message_id as f32, interval_us)
    }

    /// Asks for the stream that holds the message; a rate of 0 stops it.
    #[expect(deprecated, reason = "for firmware that knows nothing newer")]
    pub fn stream(&self, message_id: u32, rate_hz: u16) -> MavMessage {
        let stream = match message_id {
            GPS_RAW_INT => MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS,
            30 => MavDataStream::MAV_DATA_STREAM_EXTRA1,
            _ => MavDataStream::MAV_DATA_STREAM_RAW_SENSORS,
        };
        MavMessage::REQUEST_DATA_STREAM(REQUEST_DATA_STREAM_DATA {
            target_system: self.system_id,
            target_component: AUTOPILOT_COMPONENT,
            req_stream_id: stream,
            req_message_rate: rate_hz,
            start_stop: u8::from(rate_hz > 0),
        })
    }
}

/// Whether this message carries inertial samples.
pub(super) fn is_inertial(message_id: u32) -> bool {
    message_id == HIGHRES_IMU || ImuSource::ALL.iter().any(|s| s.message_id() == message_id)
}

/// The request that puts a message back to how it came before.
pub(super) fn to_give_back(target: &Target, m: &Message, old_way: bool) -> MavMessage {
    let id = m.wanted.message_id;
    let measured_hz = m.present_hz().filter(|hz| hz.is_finite()).unwrap_or(0.0);
    if old_way {
        return target.stream(id, measured_hz.round() as u16);
    }
    let interval_us = match m.present {
        Present::Interval(us) => us as f32,
        // PX4 has no other way to say "as configured", and a stopped stream there is its default.
        Present::Stopped if target.autopilot != Autopilot::Px4 => STOP,
        Present::Measured(hz) if hz >= 1.0 => (1e3 / hz).round() as f32 * 1e3,
        _ => DEFAULT_INTERVAL,
    };
    target.set_interval(id, interval_us, 1)
}
