//! Who is spoken to, and the commands that every autopilot answers.

use super::{Autopilot, Flavour, RELEASE_AFTER_S};
use mavlink::dialects::ardupilotmega::*;
use mavlink::{MavHeader, Message, MessageData};

impl Autopilot {
    pub(super) fn handle(&mut self, from: &MavHeader, message: &MavMessage) {
        let for_me = |id: Option<u8>, mine: u8| id.is_none_or(|t| t == 0 || t == mine);
        if !for_me(message.target_system_id(), self.config.system_id)
            || !for_me(message.target_component_id(), 1)
        {
            return;
        }
        match message {
            MavMessage::COMMAND_LONG(c) => {
                let params = [c.param1, c.param2, c.param3, c.param4, c.param5, c.param6, c.param7];
                self.command(from, c.command, &params);
            }
            MavMessage::COMMAND_INT(c) => {
                let params = [c.param1, c.param2, c.param3, c.param4, c.x as f32, c.y as f32, c.z];
                self.command(from, c.command, &params);
            }
            MavMessage::REQUEST_DATA_STREAM(r) => {
                let start = r.start_stop != 0;
                self.streams.request_group(r.req_stream_id, r.req_message_rate, start, self.now_s);
                self.station_asked();
            }
            MavMessage::TIMESYNC(t) if t.tc1 == 0 => {
                let tc1 = (self.boot_s() * 1e9) as i64;
                self.send(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1, ts1: t.ts1, ..Default::default() }));
            }
            MavMessage::PARAM_REQUEST_READ(_)
            | MavMessage::PARAM_REQUEST_LIST(_)
            | MavMessage::PARAM_SET(_) => {
                self.handle_parameters(message);
            }
            _ => self.handle_flight(from, message),
        }
    }

    /// The first request of a station lets a waiting flight begin soon.
    fn station_asked(&mut self) {
        if self.release_s.is_infinite() {
            self.release_s = self.now_s + RELEASE_AFTER_S;
        }
    }

    fn command(&mut self, from: &MavHeader, command: MavCmd, params: &[f32; 7]) {
        let id = params[0] as u32;
        let mut then = None;
        let result = match command {
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                self.station_asked();
                if self.config.flavour == Flavour::ArduPilot && !self.streams.supports(id) {
                    self.say_to_pilot(&format!("No ap_message for mavlink id ({id})"));
                }
                let unseen = self.now_s < self.denies_until_s && self.streams.interval_us(id) == 0;
                if unseen && self.config.flavour == Flavour::Px4 {
                    MavResult::MAV_RESULT_DENIED
                } else {
                    self.streams.set_interval(params, self.now_s)
                }
            }
            MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL => {
                then = Some(MavMessage::MESSAGE_INTERVAL(MESSAGE_INTERVAL_DATA {
                    message_id: id as u16,
                    interval_us: self.streams.interval_us(id),
                }));
                MavResult::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_REQUEST_MESSAGE if id == AUTOPILOT_VERSION_DATA::ID => {
                then = Some(self.version());
                MavResult::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_REQUEST_MESSAGE if self.has_nothing_new(id) => MavResult::MAV_RESULT_DENIED,
            MavCmd::MAV_CMD_REQUEST_MESSAGE if self.streams.supports(id) => {
                then = self.stream_message(id);
                MavResult::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES => {
                then = Some(self.version());
                MavResult::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
                if params[0] == 1.0 && self.vehicle().is_none_or(|v| !v.is_armed()) =>
            {
                self.acknowledge(from, command, MavResult::MAV_RESULT_ACCEPTED);
                self.reboot();
                return;
            }
            _ => self.flight_command(command, params),
        };
        self.acknowledge(from, command, result);
        if let Some(message) = then {
            self.send(&message);
        }
    }

    /// PX4 denies a message of which nothing was published since it last looked (`MavlinkStream::request_message`); here the first request of
    /// each. `MISSION_CURRENT` is no stream there: it comes once a second by itself.
    fn has_nothing_new(&mut self, id: u32) -> bool {
        self.config.flavour == Flavour::Px4
            && (id == MISSION_CURRENT_DATA::ID || self.streams.supports(id) && self.requested.insert(id))
    }

    /// A text that every ground station shows.
    fn say_to_pilot(&mut self, text: &str) {
        let severity = MavSeverity::MAV_SEVERITY_INFO;
        self.send(&MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            severity,
            text: text.into(),
            ..Default::default()
        }));
    }

    fn acknowledge(&mut self, to: &MavHeader, command: MavCmd, result: MavResult) {
        let ack = COMMAND_ACK_DATA {
            command,
            result,
            target_system: u8::try_from(to.system_id).unwrap_or(0),
            target_component: to.component_id,
            ..Default::default()
        };
        self.send(&MavMessage::COMMAND_ACK(ack));
    }
}
