//! Whether the inertial unit still measures, within its range, and whether its stamps belong to one clock. What is found is reported once.

use super::clipped::ClipWatch;
use super::notice::Notice;
use super::stuck::StuckWatch;
use gaware_nav::math::hypot;
use gaware_nav::sample::{GnssFix, ImuSample};

/// Inertial messages over which stamps are judged.
const STAMPS_JUDGED: u32 = 250;
/// So many of them with a stamp out of place are reported.
const STAMPS_WRONG: u64 = 5;
/// After a sensor fault stamps are judged again from so many samples on: fixes that came without samples had no place.
const STAMPS_SETTLE: u32 = 10;
/// By their fixes vehicles move from here on, m/s.
const MOVING_M_PER_S: f64 = 3.0;

/// What a sample is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It is used.
    Good,
    /// Its sensor no longer measures; true where that was just found.
    Stuck(bool),
    /// A value is at the end of the range; true where that was just found.
    AtLimit(bool),
}

/// The watch over one source.
#[derive(Debug, Clone, Default)]
pub(super) struct Health {
    stuck: StuckWatch,
    is_stuck: bool,
    clip: ClipWatch,
    moving: bool,
    /// Messages since stamps were judged last, and those out of place until then.
    counted: u32,
    misplaced: u64,
    /// Samples until stamps are judged again.
    settling: u32,
    disagree: bool,
}

impl Health {
    /// Takes a fix: whether the vehicle moves.
    pub(super) fn fix(&mut self, fix: &GnssFix) {
        self.moving = fix.velocity.horizontal().is_some_and(|[n, e]| hypot(n, e) > MOVING_M_PER_S);
    }

    /// Takes the attitude that the autopilot reports, rad.
    pub(super) fn attitude(&mut self, [roll, pitch, _]: [f64; 3]) {
        self.stuck.attitude([roll, pitch]);
    }

    /// Judges a sample at this time, µs.
    pub(super) fn judge(&mut self, t_us: u64, sample: &ImuSample, notices: &mut Vec<Notice>) -> Verdict {
        let (w, f) = (sample.gyro, sample.accel);
        let values = [w.x, w.y, w.z, f.x, f.y, f.z];
        let clipped = self.clip.push(values);
        // A value at the end of its range does not change either.
        let stuck = self.stuck.push(t_us, values, self.moving).filter(|_| !clipped.at_limit);
        let was_stuck = std::mem::replace(&mut self.is_stuck, stuck.is_some());
        match (stuck, was_stuck) {
            (Some(sensor), false) => notices.push(Notice::SensorStuck { sensor }),
            (None, true) => notices.push(Notice::SensorMeasures),
            _ => {}
        }
        if let Some((sensor, limit)) = clipped.new {
            notices.push(Notice::SensorClipped { sensor, limit });
        }
        if stuck.is_some() || clipped.at_limit {
            self.settling = STAMPS_SETTLE;
        }
        match (stuck, clipped.at_limit) {
            (Some(_), _) => Verdict::Stuck(!was_stuck),
            (None, true) => Verdict::AtLimit(clipped.new.is_some()),
            (None, false) => Verdict::Good,
        }
    }

    /// Takes the count of stamps out of place after another message. Many of them mean that two autopilots share an identity, that
    /// a clock is damaged, or that the link holds frames back for seconds.
    pub(super) fn stamps(&mut self, misplaced: u64, notices: &mut Vec<Notice>) {
        if self.settling > 0 {
            self.settling -= 1;
            (self.counted, self.misplaced) = (0, misplaced);
            return;
        }
        self.counted += 1;
        if self.counted < STAMPS_JUDGED {
            return;
        }
        let wrong = misplaced.saturating_sub(self.misplaced);
        (self.counted, self.misplaced) = (0, misplaced);
        if wrong >= STAMPS_WRONG && !self.disagree {
            self.disagree = true;
            notices.push(Notice::StampsDisagree { refused: wrong, of: u64::from(STAMPS_JUDGED) });
        } else if wrong == 0 && self.disagree {
            self.disagree = false;
            notices.push(Notice::StampsAgree);
        }
    }
}
