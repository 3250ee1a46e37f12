//! Frames into samples: which vehicle, which inertial message, which units, which time.
//!
//! The [`Converter`] is deterministic: the same frames give the same samples, live or replayed. It knows the habits of
//! autopilots (a file each) and nothing of links, clocks or filters. Whatever it refuses is counted, and what matters
//! to the user becomes a [`Notice`].

mod ardupilot;
pub mod clock;
pub mod gnss;
pub mod imu;
pub mod notice;
mod px4;
pub mod source;
pub mod truth;

use crate::link::frame::Frame;
use clock::{Stamp, VehicleClock, Verdict};
use gaware_nav::sample::{AttitudeHint, ImuSample, RestartReason, Sample};
use imu::Unusable;
use mavlink::dialects::ardupilotmega::{GPS_RAW_INT_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType};
pub use notice::{Notice, Severity};
use serde::{Deserialize, Serialize};
pub use source::{Autopilot, ImuSource};
use source::{SourceChoice, Window};

/// Component of an autopilot.
pub const AUTOPILOT_COMPONENT: u8 = 1;
/// After so much message time without a heartbeat a vehicle is taken as it is, µs.
const HEARTBEAT_PATIENCE_US: u64 = 3_000_000;
/// Below this rate a maneuver cannot be followed, Hz.
const LOW_RATE_HZ: f64 = 20.0;
/// Seconds in a row of a low rate before the user is told.
const LOW_RATE_PATIENCE: u32 = 5;
/// Notices that wait to be fetched; more are dropped, oldest first.
const MAX_NOTICES: usize = 256;

/// What the user may set.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ConverterOptions {
    /// Listen to this system only; otherwise the first autopilot that sends a heartbeat.
    pub vehicle: Option<u8>,
    /// Take this message whatever else arrives.
    pub source: Option<ImuSource>,
}

/// What came of the frames so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ConverterStats {
    /// Frames fed.
    pub frames: u64,
    /// Of other systems, gimbals, ground stations, companions.
    pub foreign: u64,
    /// Payloads that could not be read.
    pub undecodable: u64,
    /// Inertial samples given out.
    pub imu_samples: u64,
    /// Inertial messages before a source was chosen.
    pub imu_before_choice: u64,
    /// Inertial messages of sources not in use.
    pub imu_other_source: u64,
    /// Same stamp twice.
    pub imu_duplicates: u64,
    /// Late by less than a second.
    pub imu_backward: u64,
    /// Far away in time and not confirmed by the next sample, or the first of two that were.
    pub imu_unconfirmed: u64,
    /// Without new gyro and accelerometer values.
    pub imu_not_updated: u64,
    /// With values or a time that are no numbers.
    pub imu_invalid: u64,
    /// Given out with a value at the end of the integer range.
    pub imu_clipped: u64,
    /// Fixes given out.
    pub fixes: u64,
    /// GNSS messages without a 3-D fix.
    pub no_fix: u64,
    /// The same fix again.
    pub fix_duplicates: u64,
    /// Fixes before the first inertial sample: there is no time base to put them on.
    pub fix_before_imu: u64,
    /// Fixes whose time fits no inertial sample.
    pub fix_misplaced: u64,
    /// Attitude hints given out.
    pub attitudes: u64,
    /// Fresh starts.
    pub restarts: u64,
}

impl ConverterStats {
    /// Inertial messages of the source in use that were refused.
    pub fn imu_dropped(&self) -> u64 {
        self.imu_duplicates
            + self.imu_backward
            + self.imu_unconfirmed
            + self.imu_not_updated
            + self.imu_invalid
    }
}

/// Turns the frames of one vehicle into samples.
#[derive(Debug, Clone)]
pub struct Converter {
    options: ConverterOptions,
    vehicle: Option<u8>,
    autopilot: Autopilot,
    heartbeat_seen: bool,
    /// A system that sends inertial messages, and when it began, while no heartbeat came.
    silent: Option<(u8, u64)>,
    clock: VehicleClock,
    choice: SourceChoice,
    absent_windows: u32,
    slow_windows: u32,
    last_fix: Option<GPS_RAW_INT_DATA>,
    height: gnss::HeightReference,
    has_fix: Option<bool>,
    stats: ConverterStats,
    notices: Vec<Notice>,
}

impl Converter {
    /// A converter that has seen nothing.
    pub fn new(options: ConverterOptions) -> Self {
        Self {
            options,
            vehicle: options.vehicle,
            autopilot: Autopilot::Unknown,
            heartbeat_seen: false,
            silent: None,
            clock: VehicleClock::default(),
            choice: SourceChoice::new(options.source),
            absent_windows: 0,
            slow_windows: 0,
            last_fix: None,
            height: gnss::HeightReference::default(),
            has_fix: None,
            stats: ConverterStats::default(),
            notices: Vec::new(),
        }
    }

    /// Takes the next frame and appends the samples that come of it. The time of reception is part of the record of
    /// a flight, but the samples follow the autopilot's time alone: a replay at any speed gives the same.
    pub fn feed(&mut self, _received_us: u64, frame: &Frame, out: &mut Vec<Sample>) {
        self.stats.frames += 1;
        let ours = frame.component_id == AUTOPILOT_COMPONENT
            && self.vehicle.is_none_or(|system| system == frame.system_id);
        if !ours {
            self.stats.foreign += 1;
            return;
        }
        // Ids of HEARTBEAT, SYSTEM_TIME, GPS_RAW_INT, SCALED_IMU, RAW_IMU, ATTITUDE, HIGHRES_IMU, SCALED_IMU2 and 3.
        if !matches!(frame.message_id, 0 | 2 | 24 | 26 | 27 | 30 | 105 | 116 | 129) {
            return;
        }
        let Ok(message) = frame.decode() else {
            self.stats.undecodable += 1;
            return;
        };
        if let MavMessage::HEARTBEAT(m) = &message {
            self.heartbeat(frame.system_id, m);
        } else if self.vehicle.is_none() {
            self.without_heartbeat(frame.system_id, &message);
        } else {
            self.measurement(&message, out);
        }
    }

    fn heartbeat(&mut self, system_id: u8, m: &HEARTBEAT_DATA) {
        let not_a_vehicle = matches!(
            m.mavtype,
            MavType::MAV_TYPE_GCS | MavType::MAV_TYPE_GIMBAL | MavType::MAV_TYPE_ONBOARD_CONTROLLER
        );
        if m.autopilot == MavAutopilot::MAV_AUTOPILOT_INVALID || not_a_vehicle {
            return;
        }
        let autopilot = match m.autopilot {
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Autopilot::Ardupilot,
            MavAutopilot::MAV_AUTOPILOT_PX4 => Autopilot::Px4,
            _ => Autopilot::Unknown,
        };
        if !self.heartbeat_seen || self.autopilot != autopilot {
            self.heartbeat_seen = true;
            self.vehicle = Some(system_id);
            self.autopilot = autopilot;
            self.tell(Notice::Vehicle { system_id, autopilot });
        }
    }

    /// A vehicle whose heartbeat never comes (an extract of a log, a one-way bridge) is taken after a while.
    fn without_heartbeat(&mut self, system_id: u8, message: &MavMessage) {
        let Some(Ok(reading)) = imu::reading(message) else { return };
        self.stats.imu_before_choice += 1;
        let t_us = match reading.stamp {
            Stamp::Usec(t) => t,
            Stamp::BootMs(t) => u64::from(t) * 1000,
        };
        match self.silent {
            Some((system, since)) if system == system_id && t_us >= since => {
                if t_us - since >= HEARTBEAT_PATIENCE_US {
                    self.vehicle = Some(system_id);
                    self.tell(Notice::Vehicle { system_id, autopilot: Autopilot::Unknown });
                }
            }
            _ => self.silent = Some((system_id, t_us)),
        }
    }

    fn measurement(&mut self, message: &MavMessage, out: &mut Vec<Sample>) {
        match message {
            MavMessage::SYSTEM_TIME(m) => self.clock.learn(m.time_unix_usec, m.time_boot_ms),
            MavMessage::GPS_RAW_INT(m) => self.fix(m, out),
            MavMessage::ATTITUDE(m) => {
                let values = [m.roll, m.pitch, m.yaw].map(f64::from);
                // Before the first inertial sample there is no base to put it on.
                let t_us = self.clock.now_us().and_then(|_| self.clock.place(Stamp::BootMs(m.time_boot_ms)));
                if let Some(t_us) = t_us.filter(|_| values.iter().all(|v| v.is_finite())) {
                    self.stats.attitudes += 1;
                    out.push(Sample::Attitude(AttitudeHint { t_s: seconds(t_us), roll_pitch_yaw: values }));
                }
            }
            other => self.inertial(other, out),
        }
    }

    fn inertial(&mut self, message: &MavMessage, out: &mut Vec<Sample>) {
        let reading = match imu::reading(message) {
            None => return,
            Some(Ok(reading)) => reading,
            Some(Err(why)) => {
                match why {
                    Unusable::OtherInstance => self.stats.imu_other_source += 1,
                    Unusable::NotUpdated => self.stats.imu_not_updated += 1,
                    Unusable::NotFinite => self.stats.imu_invalid += 1,
                }
                return;
            }
        };
        let Some(t_us) = self.clock.place_imu(reading.stamp) else {
            self.stats.imu_invalid += 1;
            return;
        };
        if let Some(window) = self.choice.count(reading.source, t_us, self.autopilot) {
            self.window(window, out);
        }
        match self.choice.current() {
            None => self.stats.imu_before_choice += 1,
            Some(current) if current != reading.source => self.stats.imu_other_source += 1,
            Some(_) => {
                if self.in_time(t_us, out) {
                    self.stats.imu_clipped += u64::from(reading.clipped);
                    self.stats.imu_samples += 1;
                    out.push(Sample::Imu(ImuSample {
                        t_s: seconds(t_us),
                        gyro: reading.gyro,
                        accel: reading.accel,
                        temperature_degc: reading.temperature_degc,
                    }));
                }
            }
        }
    }

    /// Counts a sample that does not fit in time; announces a fresh start.
    fn in_time(&mut self, t_us: u64, out: &mut Vec<Sample>) -> bool {
        match self.clock.judge(t_us) {
            Verdict::Accept => return true,
            Verdict::Duplicate => self.stats.imu_duplicates += 1,
            Verdict::Backward => self.stats.imu_backward += 1,
            Verdict::Unconfirmed => self.stats.imu_unconfirmed += 1,
            Verdict::Restart(reason) => {
                self.last_fix = None;
                self.stats.restarts += 1;
                if reason == RestartReason::Reboot {
                    self.height = gnss::HeightReference::default();
                    self.tell(Notice::Reboot);
                } else {
                    self.tell(Notice::ClockJump);
                }
                out.push(Sample::Restart(reason));
                return true;
            }
        }
        false
    }

    fn window(&mut self, window: Window, out: &mut Vec<Sample>) {
        if let Some(source) = window.change {
            out.push(Sample::Stream(source.stream()));
            if self.stats.imu_samples > 0 {
                self.stats.restarts += 1;
                out.push(Sample::Restart(RestartReason::SourceChange));
            }
            self.tell(Notice::SourceChosen { source, autopilot: self.autopilot });
        }
        if let (Some(source), None) = (self.options.source, self.choice.current()) {
            self.absent_windows += 1;
            if self.absent_windows == LOW_RATE_PATIENCE {
                self.tell(Notice::SourceAbsent { source });
            }
        }
        match window.rate_hz {
            Some(rate_hz) if rate_hz < LOW_RATE_HZ => {
                self.slow_windows += 1;
                if self.slow_windows == LOW_RATE_PATIENCE {
                    self.tell(Notice::RateTooLow { rate_hz });
                }
            }
            Some(rate_hz) if self.slow_windows >= LOW_RATE_PATIENCE => {
                self.slow_windows = 0;
                self.tell(Notice::RateGood { rate_hz });
            }
            _ => self.slow_windows = 0,
        }
    }

    fn fix(&mut self, m: &GPS_RAW_INT_DATA, out: &mut Vec<Sample>) {
        let has_fix = gnss::has_fix(m);
        if self.has_fix != Some(has_fix) {
            self.has_fix = Some(has_fix);
            self.tell(if has_fix { Notice::FixGained } else { Notice::NoFix });
        }
        if !has_fix {
            self.stats.no_fix += 1;
            return;
        }
        let repeated = match &self.last_fix {
            // A receiver without a clock can still repeat itself.
            Some(last) if m.time_usec == 0 => last == m,
            Some(last) => last.time_usec == m.time_usec,
            None => false,
        };
        if repeated {
            self.stats.fix_duplicates += 1;
            return;
        }
        self.last_fix = Some(m.clone());
        let t_us = match m.time_usec {
            0 => self.clock.now_us(),
            t => self.clock.place_fix(Stamp::Usec(t)),
        };
        match t_us {
            Some(t_us) => {
                self.stats.fixes += 1;
                out.push(Sample::Fix(gnss::fix(m, seconds(t_us), &mut self.height)));
            }
            None if self.clock.now_us().is_none() => self.stats.fix_before_imu += 1,
            None => self.stats.fix_misplaced += 1,
        }
    }

    fn tell(&mut self, notice: Notice) {
        if self.notices.len() >= MAX_NOTICES {
            self.notices.remove(0);
        }
        self.notices.push(notice);
    }

    /// Takes the notices since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }

    /// What came of the frames so far.
    pub fn stats(&self) -> &ConverterStats {
        &self.stats
    }

    /// The vehicle listened to.
    pub fn vehicle(&self) -> Option<u8> {
        self.vehicle
    }

    /// Its firmware.
    pub fn autopilot(&self) -> Autopilot {
        self.autopilot
    }

    /// The inertial message in use.
    pub fn source(&self) -> Option<ImuSource> {
        self.choice.current()
    }

    /// Time of the latest inertial sample, s.
    pub fn now_s(&self) -> Option<f64> {
        self.clock.now_us().map(seconds)
    }
}

fn seconds(t_us: u64) -> f64 {
    t_us as f64 * 1e-6
}

#[cfg(test)]
mod tests;
