//! Which messages are sent how often, with the habits of each autopilot (FIELD_NOTES, "Rates and links").

use super::Flavour;
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::*;
use std::collections::BTreeMap;

/// ArduPilot sends everything this much slower while a mission is uploaded.
pub const SLOW_DOWN: f64 = 4.0;
/// Rate at which the status of the navigation filter is sent unasked, Hz.
const FILTER_STATUS_HZ: f64 = 1.0;
/// Rate of pressures and airspeed, Hz.
const AIR_HZ: f64 = 10.0;
/// Slack when due times are compared with loop times, s.
const SLACK_S: f64 = 1e-7;

/// Messages that can be streamed at all.
const COMMON: &[u32] = &[
    HEARTBEAT_DATA::ID,
    SYSTEM_TIME_DATA::ID,
    GPS_RAW_INT_DATA::ID,
    SCALED_IMU_DATA::ID,
    ATTITUDE_DATA::ID,
    GLOBAL_POSITION_INT_DATA::ID,
    MISSION_CURRENT_DATA::ID,
    VFR_HUD_DATA::ID,
    SYS_STATUS_DATA::ID,
    SERVO_OUTPUT_RAW_DATA::ID,
];

#[derive(Debug, Clone, Copy)]
struct Entry {
    interval_s: f64,
    next_s: f64,
}

/// The table of streams.
#[derive(Debug, Clone)]
pub struct Streams {
    flavour: Flavour,
    has_highres_imu: bool,
    has_sim_state: bool,
    /// Whether it has a navigation filter of its own to report.
    has_filter_status: bool,
    /// Highest rate of one message, Hz.
    cap_hz: f64,
    entries: BTreeMap<u32, Entry>,
}

/// The shortest interval that ArduPilot grants to one message: 1.25 of its loops, cut to whole milliseconds
/// (`GCS_MAVLINK::cap_message_interval`): 40 Hz with 50 loops a second, 166 with 200, 333 with 400.
fn ardupilot_cap_hz(loop_rate_hz: f64) -> f64 {
    1e3 / (1250.0 / loop_rate_hz).floor().max(1.0)
}

impl Streams {
    /// The table after a start at `now_s`.
    pub fn new(flavour: Flavour, loop_rate_hz: f64, has_highres_imu: bool, now_s: f64) -> Self {
        let cap_hz = match flavour {
            Flavour::ArduPilot => ardupilot_cap_hz(loop_rate_hz),
            Flavour::Px4 => loop_rate_hz,
        };
        let mut streams = Self {
            flavour,
            has_highres_imu,
            has_sim_state: true,
            has_filter_status: false,
            cap_hz,
            entries: BTreeMap::new(),
        };
        for (id, rate_hz) in streams.defaults() {
            streams.put(id, 1.0 / rate_hz, now_s);
        }
        streams
    }

    /// The same table, with or without the truth among what can be streamed.
    #[must_use]
    pub fn with_sim_state(self, has_sim_state: bool) -> Self {
        Self { has_sim_state, ..self }
    }

    /// The same table, with or without the status of the navigation filter.
    #[must_use]
    pub fn with_filter_status(self, has_filter_status: bool, now_s: f64) -> Self {
        let mut streams = Self { has_filter_status, ..self };
        if has_filter_status {
            streams.put(streams.filter_status(), 1.0 / FILTER_STATUS_HZ, now_s);
        }
        streams
    }

    /// The same table, with throttle, battery and outputs sent unasked: many autopilots are set up so, and who simulates an effect that goes with
    /// them wants them in the log.
    #[must_use]
    pub fn with_reports(self, reports: bool, now_s: f64) -> Self {
        let mut streams = self;
        if reports {
            for (id, rate_hz) in
                [(SYS_STATUS_DATA::ID, 4.0), (VFR_HUD_DATA::ID, 4.0), (SERVO_OUTPUT_RAW_DATA::ID, 4.0)]
            {
                streams.put(id, 1.0 / rate_hz, now_s);
            }
        }
        streams
    }

    /// The same table, with what its barometers and its pitot tube measure sent unasked.
    #[must_use]
    pub fn with_air(mut self, sensors: &[u32], now_s: f64) -> Self {
        sensors.iter().for_each(|id| self.put(*id, 1.0 / AIR_HZ, now_s));
        self
    }

    fn filter_status(&self) -> u32 {
        match self.flavour {
            Flavour::ArduPilot => EKF_STATUS_REPORT_DATA::ID,
            Flavour::Px4 => ESTIMATOR_STATUS_DATA::ID,
        }
    }

    fn defaults(&self) -> Vec<(u32, f64)> {
        let mut rates = vec![
            (HEARTBEAT_DATA::ID, 1.0),
            (GPS_RAW_INT_DATA::ID, 2.0),
            (ATTITUDE_DATA::ID, 4.0),
            (GLOBAL_POSITION_INT_DATA::ID, 2.0),
            (SYSTEM_TIME_DATA::ID, 1.0),
            (MISSION_CURRENT_DATA::ID, 1.0),
        ];
        rates.push(match self.flavour {
            Flavour::ArduPilot => (RAW_IMU_DATA::ID, 2.0),
            Flavour::Px4 => (HIGHRES_IMU_DATA::ID, 50.0),
        });
        rates
    }

    /// Whether this autopilot can send the message.
    pub fn supports(&self, id: u32) -> bool {
        COMMON.contains(&id)
            || (self.has_filter_status && id == self.filter_status())
            || match self.flavour {
                Flavour::ArduPilot => {
                    id == RAW_IMU_DATA::ID
                        || (id == SIM_STATE_DATA::ID && self.has_sim_state)
                        || (id == HIGHRES_IMU_DATA::ID && self.has_highres_imu)
                }
                Flavour::Px4 => id == HIGHRES_IMU_DATA::ID,
            }
    }

    fn put(&mut self, id: u32, interval_s: f64, now_s: f64) {
        self.entries.insert(id, Entry { interval_s, next_s: now_s });
    }

    /// `MAV_CMD_SET_MESSAGE_INTERVAL`. −1 stops a message, 0 gives its default back.
    pub fn set_interval(&mut self, params: &[f32; 7], now_s: f64) -> MavResult {
        let (id, interval_us) = (params[0] as u32, f64::from(params[1]));
        let refused = match self.flavour {
            Flavour::ArduPilot => MavResult::MAV_RESULT_DENIED,
            Flavour::Px4 => MavResult::MAV_RESULT_FAILED,
        };
        if !self.supports(id) {
            return refused;
        }
        if self.flavour == Flavour::ArduPilot && params[2..6].iter().any(|p| *p != 0.0) {
            return MavResult::MAV_RESULT_DENIED;
        }
        if interval_us < 0.0 {
            self.entries.remove(&id);
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        if interval_us == 0.0 {
            match self.defaults().into_iter().find(|(i, _)| *i == id) {
                Some((_, rate_hz)) => self.put(id, 1.0 / rate_hz, now_s),
                None => _ = self.entries.remove(&id),
            }
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        let interval_s = match self.flavour {
            Flavour::ArduPilot => (interval_us / 1000.0).floor().max(1.0) * 1e-3,
            Flavour::Px4 => interval_us * 1e-6,
        };
        if self.flavour == Flavour::ArduPilot && 1.0 / interval_s > self.cap_hz + SLACK_S {
            return refused;
        }
        self.put(id, interval_s, now_s);
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// The answer to `MAV_CMD_GET_MESSAGE_INTERVAL`, µs: −1 = off, 0 = not available; PX4 says 0 of both.
    pub fn interval_us(&self, id: u32) -> i32 {
        match self.entries.get(&id) {
            Some(entry) => (entry.interval_s * 1e6).round() as i32,
            None if self.supports(id) && self.flavour == Flavour::ArduPilot => -1,
            None => 0,
        }
    }

    /// `REQUEST_DATA_STREAM`, the old way that other stations use; silently capped. PX4 does not know it.
    pub fn request_group(&mut self, group: MavDataStream, rate_hz: u16, start: bool, now_s: f64) {
        if self.flavour == Flavour::Px4 {
            return;
        }
        let raw = [RAW_IMU_DATA::ID];
        let status = [SYS_STATUS_DATA::ID, GPS_RAW_INT_DATA::ID, MISSION_CURRENT_DATA::ID];
        let position = [GLOBAL_POSITION_INT_DATA::ID];
        let extra1 = [ATTITUDE_DATA::ID, SIM_STATE_DATA::ID];
        let extra2 = [VFR_HUD_DATA::ID];
        let extra3 = [SYSTEM_TIME_DATA::ID];
        let channels = [SERVO_OUTPUT_RAW_DATA::ID];
        let groups: &[&[u32]] = match group {
            MavDataStream::MAV_DATA_STREAM_ALL => {
                &[&raw, &status, &position, &extra1, &extra2, &extra3, &channels]
            }
            MavDataStream::MAV_DATA_STREAM_RAW_SENSORS => &[&raw],
            MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS => &[&status],
            MavDataStream::MAV_DATA_STREAM_POSITION => &[&position],
            MavDataStream::MAV_DATA_STREAM_EXTRA1 => &[&extra1],
            MavDataStream::MAV_DATA_STREAM_EXTRA2 => &[&extra2],
            MavDataStream::MAV_DATA_STREAM_EXTRA3 => &[&extra3],
            MavDataStream::MAV_DATA_STREAM_RC_CHANNELS => &[&channels],
            _ => &[],
        };
        for id in
            groups.iter().copied().flatten().copied().filter(|id| self.supports(*id)).collect::<Vec<_>>()
        {
            if start && rate_hz > 0 {
                let rate = f64::from(rate_hz).min(self.cap_hz);
                self.put(id, 1.0 / rate, now_s);
            } else {
                self.entries.remove(&id);
            }
        }
    }

    /// Messages due at this loop, in order of their ids; `slower` stretches the intervals.
    pub fn due(&mut self, now_s: f64, slower: f64) -> Vec<u32> {
        let mut due = Vec::new();
        for (id, entry) in &mut self.entries {
            if entry.next_s > now_s + SLACK_S {
                continue;
            }
            due.push(*id);
            let interval = entry.interval_s * slower;
            entry.next_s += interval;
            // A message that the loop cannot serve in time is not sent twice to make up for it. PX4 counts every interval from the
            // last sending, so that rates between the divisors of the loop rate come out lower.
            if entry.next_s <= now_s || self.flavour == Flavour::Px4 {
                entry.next_s = now_s + interval;
            }
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(streams: &mut Streams, id: u32, interval_us: f32) -> MavResult {
        streams.set_interval(&[id as f32, interval_us, 0.0, 0.0, 0.0, 0.0, 0.0], 0.0)
    }

    #[test]
    fn ardupilot_denies_more_than_its_share_of_the_loop() {
        let mut plane = Streams::new(Flavour::ArduPilot, 50.0, false, 0.0);
        assert_eq!(set(&mut plane, RAW_IMU_DATA::ID, 20_000.0), MavResult::MAV_RESULT_DENIED);
        assert_eq!(set(&mut plane, RAW_IMU_DATA::ID, 25_000.0), MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(plane.interval_us(RAW_IMU_DATA::ID), 25_000);
        assert_eq!(set(&mut plane, HIGHRES_IMU_DATA::ID, 50_000.0), MavResult::MAV_RESULT_DENIED);
        assert_eq!(plane.interval_us(HIGHRES_IMU_DATA::ID), 0);
        // 4.7-dev with loops of 200 Hz: 7 and 6 ms are granted, 5 ms are "too fast".
        let mut faster = Streams::new(Flavour::ArduPilot, 200.0, true, 0.0);
        let answers = [6_000.0, 5_000.0].map(|us| set(&mut faster, HIGHRES_IMU_DATA::ID, us));
        assert_eq!(answers, [MavResult::MAV_RESULT_ACCEPTED, MavResult::MAV_RESULT_DENIED]);
    }

    #[test]
    fn ardupilot_counts_whole_milliseconds() {
        let mut copter = Streams::new(Flavour::ArduPilot, 400.0, true, 0.0);
        assert_eq!(set(&mut copter, RAW_IMU_DATA::ID, 6_700.0), MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(copter.interval_us(RAW_IMU_DATA::ID), 6_000);
        let with_extra = [RAW_IMU_DATA::ID as f32, 10_000.0, 1.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(copter.set_interval(&with_extra, 0.0), MavResult::MAV_RESULT_DENIED);
    }

    #[test]
    fn px4_has_no_raw_imu_and_no_stream_groups() {
        let mut px4 = Streams::new(Flavour::Px4, 250.0, true, 0.0);
        assert_eq!(set(&mut px4, RAW_IMU_DATA::ID, 10_000.0), MavResult::MAV_RESULT_FAILED);
        assert_eq!(set(&mut px4, HIGHRES_IMU_DATA::ID, 5_000.0), MavResult::MAV_RESULT_ACCEPTED);
        px4.request_group(MavDataStream::MAV_DATA_STREAM_ALL, 50, true, 0.0);
        assert_eq!(px4.interval_us(VFR_HUD_DATA::ID), 0);
    }

    #[test]
    fn px4_gives_125_hz_where_200_are_asked_for() {
        let mut px4 = Streams::new(Flavour::Px4, 250.0, true, 0.0);
        let mut count = |interval_us| {
            set(&mut px4, SCALED_IMU_DATA::ID, interval_us);
            (0..250).filter(|k| px4.due(f64::from(*k) / 250.0, 1.0).contains(&SCALED_IMU_DATA::ID)).count()
        };
        assert_eq!([count(5000.0), count(1000.0)], [125, 250]);
    }

    #[test]
    fn a_truth_that_is_not_told_cannot_be_asked_for() {
        let mut blind = Streams::new(Flavour::ArduPilot, 400.0, true, 0.0).with_sim_state(false);
        assert_eq!(set(&mut blind, SIM_STATE_DATA::ID, 20_000.0), MavResult::MAV_RESULT_DENIED);
        blind.request_group(MavDataStream::MAV_DATA_STREAM_ALL, 50, true, 0.0);
        assert_eq!(blind.interval_us(SIM_STATE_DATA::ID), 0);
        assert_eq!(blind.interval_us(ATTITUDE_DATA::ID), 20_000);
    }

    #[test]
    fn another_station_can_overwrite_a_rate() {
        let mut copter = Streams::new(Flavour::ArduPilot, 400.0, true, 0.0);
        set(&mut copter, RAW_IMU_DATA::ID, 5_000.0);
        copter.request_group(MavDataStream::MAV_DATA_STREAM_RAW_SENSORS, 2, true, 0.0);
        assert_eq!(copter.interval_us(RAW_IMU_DATA::ID), 500_000);
    }

    #[test]
    fn messages_come_at_their_rate_and_slower_during_an_upload() {
        let mut copter = Streams::new(Flavour::ArduPilot, 400.0, true, 0.0);
        set(&mut copter, RAW_IMU_DATA::ID, 5_000.0);
        let mut count = |from: u32, slower: f64| {
            (from..from + 400)
                .filter(|k| copter.due(f64::from(*k) / 400.0, slower).contains(&RAW_IMU_DATA::ID))
                .count()
        };
        assert_eq!(count(0, 1.0), 200);
        let slow = count(400, SLOW_DOWN);
        assert!((50..=51).contains(&slow), "{slow}");
    }
}
