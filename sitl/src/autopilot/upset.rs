//! What goes wrong on board and on its link: restarts, jumps of the clock, a station that takes the rates, a gimbal.

use super::Autopilot;
use super::streams::Streams;
use crate::faults::Fault;
use gaware_wire::framer::Framer;
use mavlink::dialects::ardupilotmega::*;

/// How long a restart takes, s.
const REBOOT_S: f64 = 2.0;
/// How long PX4 denies the rate of a message of which a new instance has seen nothing, s.
const NOTHING_NEW_S: f64 = 5.0;
/// Component of the gimbal that may share the link (`MAV_COMP_ID_GIMBAL`).
pub(super) const GIMBAL_COMPONENT: u8 = 154;

impl Autopilot {
    /// Lets the faults happen whose time has come.
    pub(super) fn meet_faults(&mut self) {
        let now = self.now_s;
        let mut reboot = false;
        let mut away_until_s = None;
        let (mut jump, mut theft) = (0.0, false);
        self.pending.retain(|fault| match *fault {
            Fault::Reboot { at_s } if at_s <= now => {
                reboot = true;
                false
            }
            Fault::InstanceRestart { from_s, to_s } if from_s <= now => {
                away_until_s = Some(to_s);
                false
            }
            Fault::ClockJump { at_s, by_s } if at_s <= now => {
                jump += by_s;
                false
            }
            Fault::RateTheft { at_s } if at_s <= now => {
                theft = true;
                false
            }
            _ => true,
        });
        self.booted_s -= jump;
        if theft {
            let group = MavDataStream::MAV_DATA_STREAM_RAW_SENSORS;
            self.streams.request_group(group, 2, true, now);
        }
        if let Some(to_s) = away_until_s {
            self.restart_streams(to_s);
            self.denies_until_s = to_s + NOTHING_NEW_S;
        }
        if reboot {
            self.reboot();
        }
    }

    /// The link is silent until then and starts with its defaults.
    fn restart_streams(&mut self, until_s: f64) {
        self.silent_until_s = until_s;
        self.framer = Framer::new();
        let config = &self.config;
        self.streams = Streams::new(config.flavour, config.loop_rate_hz, config.has_highres_imu, until_s)
            .with_sim_state(config.has_sim_state)
            .with_filter_status(config.navigates, until_s);
    }

    pub(super) fn reboot(&mut self) {
        self.booted_s = self.now_s + REBOOT_S;
        self.sequence = [0; 2];
        self.fix = None;
        self.mission.restart();
        self.restart_streams(self.booted_s);
        self.start_navigation();
    }

    /// A gimbal on the same link, whose inertial unit must not be taken for the vehicle's.
    pub(super) fn send_gimbal(&mut self) {
        let heartbeat = HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_GIMBAL,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
            ..Default::default()
        };
        self.send_as(GIMBAL_COMPONENT, &MavMessage::HEARTBEAT(heartbeat));
        let imu = RAW_IMU_DATA { time_usec: 77, xacc: 700, yacc: -700, zgyro: 900, ..Default::default() };
        self.send_as(GIMBAL_COMPONENT, &MavMessage::RAW_IMU(imu));
    }
}
