//! What a vehicle reports of its flight (`HEARTBEAT`, `EXTENDED_SYS_STATE`, `MISSION_CURRENT`, severe `STATUSTEXT`), and how well its samples
//! arrive. Sans I/O; times are those of reception.

use super::modes;
use super::{AUTOPILOT_COMPONENT, Converter, vehicle_kind};
use crate::engine::situation::{FlightMode, FlightReport};
use crate::link::frame::Frame;
use gaware_wire::heartbeat::{ARDUPILOT, Heartbeat};
use std::collections::VecDeque;

const MISSION_CURRENT: u32 = 42;
const EXTENDED_SYS_STATE: u32 = 245;
const STATUSTEXT: u32 = 253;
/// `MAV_STATE_STANDBY`: ArduPilot reports it, armed or not, until it flies (`vehicle_system_status`); PX4 while it is disarmed.
const STANDBY: u8 = 3;
/// `MAV_STATE_ACTIVE`.
const ACTIVE: u8 = 4;
/// `MAV_LANDED_STATE`.
const ON_GROUND: u8 = 1;
const IN_AIR: u8 = 2;
const TAKING_OFF: u8 = 3;
const LANDING: u8 = 4;
/// `MAV_SEVERITY_CRITICAL`; what is more severe has lower numbers.
const CRITICAL: u8 = 2;
/// A severe text counts for so long, µs.
const ALARM_US: u64 = 15_000_000;
/// Losses are counted over the last so many µs, in steps of …
const LOSS_WINDOW_US: u64 = 5_000_000;
const LOSS_STEP_US: u64 = 500_000;
/// Fewer samples than this say nothing of losses.
const ENOUGH_SAMPLES: u64 = 20;
/// Fewer lost samples may be scheduling.
const SOME_LOSS: f64 = 0.02;

/// What came and what did not, so far.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    samples: u64,
    samples_lost: u64,
    frames: u64,
    frames_missing: u64,
}

impl Counts {
    fn of(converter: &Converter) -> Self {
        let (time, stats) = (converter.time(), converter.stats());
        Self {
            samples: time.counts().imu_samples,
            samples_lost: time.imu_lost(),
            frames: stats.frames.saturating_sub(stats.foreign),
            frames_missing: stats.frames_missing,
        }
    }

    /// Share of the samples that were lost. A router may leave frames out for good reason; where samples are lost as well the frames give
    /// the better figure, as the usual spacing of samples is not known any more when every other one is missing.
    fn loss_since(&self, then: &Self) -> f64 {
        let since = |of: fn(&Self) -> u64| of(self).saturating_sub(of(then));
        let (came, lost) = (since(|c| c.samples), since(|c| c.samples_lost));
        if came + lost < ENOUGH_SAMPLES {
            return 0.0;
        }
        let share = |lost: u64, came: u64| lost as f64 / (lost + came).max(1) as f64;
        let samples = share(lost, came);
        if samples < SOME_LOSS {
            return samples;
        }
        samples.max(share(since(|c| c.frames_missing), since(|c| c.frames)))
    }
}

/// Follows one vehicle.
#[derive(Debug, Clone, Default)]
pub struct FlightWatch {
    system_id: Option<u8>,
    report: FlightReport,
    /// `MAV_LANDED_STATE`; 0 where it is not reported.
    landed: u8,
    /// What the heartbeat says, before `EXTENDED_SYS_STATE` has its say.
    heartbeat: (FlightMode, bool),
    alarm_until_us: u64,
    /// Counts at these times.
    counts: VecDeque<(u64, Counts)>,
    last_sample: Option<(u64, u64)>,
}

impl FlightWatch {
    /// Takes a frame that the converter has just taken, at its time of reception.
    pub fn feed(&mut self, t_us: u64, frame: &Frame, converter: &Converter) {
        if converter.vehicle() != self.system_id {
            *self = Self { system_id: converter.vehicle(), ..Self::default() };
        }
        self.report.several = converter.several_vehicles();
        if self.system_id != Some(frame.system_id) || frame.component_id != AUTOPILOT_COMPONENT {
            return;
        }
        if let Some(heartbeat) = Heartbeat::of(frame) {
            self.heartbeat(&heartbeat);
        }
        // MAVLink 2 leaves zeros at the end out.
        let at = |k: usize| frame.payload().get(k).copied().unwrap_or(0);
        match frame.message_id {
            MISSION_CURRENT => self.report.item = Some(u16::from_le_bytes([at(0), at(1)])),
            EXTENDED_SYS_STATE => self.landed = at(1),
            STATUSTEXT if at(0) <= CRITICAL && at(53) == 0 => {
                let text = frame.payload().get(1..51.min(frame.payload().len())).unwrap_or_default();
                let end = text.iter().position(|b| *b == 0).unwrap_or(text.len());
                self.report.alarm =
                    String::from_utf8_lossy(text.get(..end).unwrap_or_default()).trim().to_owned();
                self.alarm_until_us = t_us + ALARM_US;
            }
            _ => {}
        }
        if t_us >= self.alarm_until_us || t_us + ALARM_US < self.alarm_until_us {
            self.report.alarm.clear();
        }
        self.combine();
        self.report.no_fix = converter.has_fix() == Some(false);
        self.count(t_us, Counts::of(converter));
    }

    fn heartbeat(&mut self, heartbeat: &Heartbeat) {
        let report = &mut self.report;
        let (mode, name) = modes::of_heartbeat(heartbeat);
        report.has_heartbeat = true;
        let (armed, status) = (heartbeat.is_armed(), heartbeat.status);
        let ardupilot = heartbeat.autopilot == ARDUPILOT;
        report.flown &= report.armed || !armed;
        report.armed = armed;
        report.mode_name = name;
        report.failsafe = heartbeat.is_failsafe();
        report.kind = vehicle_kind(heartbeat.mav_type);
        self.heartbeat = (mode, ardupilot && status == STANDBY);
        // ArduPilot's status is ACTIVE from take-off to landing, PX4's as soon as it is armed.
        report.flown |= armed && ardupilot && status == ACTIVE;
    }

    fn combine(&mut self) {
        let (mode, stands_by) = self.heartbeat;
        let by_pilot = mode == FlightMode::Pilot;
        self.report.on_ground = self.landed == ON_GROUND || (self.landed == 0 && stands_by);
        self.report.in_air = matches!(self.landed, IN_AIR | TAKING_OFF | LANDING);
        self.report.flown |= self.report.armed && self.landed == IN_AIR;
        self.report.mode = match self.landed {
            TAKING_OFF if !by_pilot => FlightMode::TakeOff,
            LANDING if mode != FlightMode::Return => FlightMode::Landing,
            _ => mode,
        };
    }

    fn count(&mut self, t_us: u64, now: Counts) {
        match self.last_sample {
            Some((before, _)) if before == now.samples => {}
            _ => self.last_sample = Some((now.samples, t_us)),
        }
        let age_us = self.last_sample.map_or(0, |(_, since)| t_us.saturating_sub(since));
        self.report.samples_age_s = if now.samples > 0 { age_us as f64 * 1e-6 } else { 0.0 };
        let newest = self.counts.back().map(|(t, _)| *t);
        if newest.is_some_and(|t| t_us < t) {
            self.counts.clear();
        } else if newest.is_some_and(|t| t_us - t < LOSS_STEP_US) {
            return;
        }
        self.counts.push_back((t_us, now));
        while self.counts.front().is_some_and(|(t, _)| t_us - t > LOSS_WINDOW_US) {
            self.counts.pop_front();
        }
        let first = self.counts.front().map_or(now, |(_, first)| *first);
        self.report.loss = now.loss_since(&first);
    }

    /// What is known.
    pub fn report(&self) -> &FlightReport {
        &self.report
    }
}

#[cfg(test)]
mod tests;
