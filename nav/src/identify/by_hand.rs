//! A unit that people turn by hand: where its recording shows it at rest, and what its place then says in a receiver's stead.
//!
//! The same as the live filter has on the ground (`ground`): the place where no fix is, and rest as it is recognised there. Rest counts for
//! recordings alone in which the unit rested on sides far apart: a parked vehicle learns nothing of its constants from it.

use super::stationary::{self, Block};
use crate::earth::STANDARD_GRAVITY;
use crate::estimator::Estimator;
use crate::ground::REFERENCE_ERROR;
use crate::model::Model;
use crate::sample::{GnssFix, ImuSample, Sample};

/// Sides differ by at least this angle (its cosine).
const APART: f64 = 0.7;
/// A side is one that is held for so many blocks …
const HELD: usize = 5;
/// … with mean rates below this, rad/s, and specific forces this near to gravity, m/s².
const QUIET: (f64, f64) = (0.1, 1.0);
/// Rest is recognised after four seconds of it and ends up to one too late, s.
const LATE_S: (f64, f64) = (3.0, 1.0);
/// Shorter rests say nothing, s.
const SHORT_S: f64 = 3.0;
/// 1-sigma of the velocity of a unit at rest, m/s: hands and tables give way.
const REST_SPEED: f64 = 0.05;

/// 1-sigma of gravity where no fix gives the height, m/s²: 300 m of height, or an anomaly of 100 mGal.
const GRAVITY: f64 = 1e-3;

/// What the ground says of a recording.
#[derive(Debug, Clone, Default)]
pub(super) struct ByHand {
    /// From when to when the unit rested, s, in order.
    rests: Vec<(f64, f64)>,
    /// Times of what the place said, s, in order.
    placed_s: Vec<f64>,
    /// Variances that an unknown place or heading leaves of a rest's mean rate and specific force.
    unknown: [f64; 2],
}

/// Whether the samples show two sides held still.
fn is_turned(samples: &[ImuSample]) -> bool {
    let blocks = stationary::means(samples);
    let quiet = |b: &Block| b.0.norm() < QUIET.0 && (b.1.norm() - STANDARD_GRAVITY).abs() < QUIET.1;
    let held = blocks.windows(HELD).filter(|w| {
        w.iter().all(quiet) && w.iter().all(|b| b.1.normalize().dot(&w[0].1.normalize()) > 0.999)
    });
    let sides: Vec<_> = held.map(|w| w[0].1.normalize()).collect();
    sides.first().is_some_and(|first| sides.iter().any(|side| side.dot(first) < APART))
}

impl ByHand {
    /// Of a stretch with its samples; and the fixes that the place gives. `before` is what was said before it began.
    pub(super) fn of<'a>(
        before: impl Iterator<Item = &'a Sample>,
        stretch: &[Sample],
        raw: &[ImuSample],
        model: &Model,
    ) -> (Self, Vec<GnssFix>) {
        let (mut own, mut fixes) = (Self::default(), Vec::<GnssFix>::new());
        if !is_turned(raw) {
            return (own, fixes);
        }
        let mut estimator = Estimator::new(model.clone());
        // Nobody turns an armed vehicle. With a reversed axis the filter refuses the place after each turn; the place is right all the same
        // once the unit rests again.
        estimator.set_flight(false, false);
        before.for_each(|s| {
            let _ = estimator.feed(s);
        });
        let mut since_s = None;
        let mut last_s = 0.0;
        for sample in stretch {
            let _ = estimator.feed(sample);
            let Sample::Imu(imu) = sample else { continue };
            last_s = imu.t_s;
            let rests = estimator.rests_in_hands();
            match (since_s, rests) {
                (None, true) => since_s = Some(last_s - LATE_S.0),
                (Some(from_s), false) => {
                    own.rests.push((from_s, last_s - LATE_S.1));
                    since_s = None;
                }
                _ => {}
            }
            if let Some(fix) =
                estimator.place_fix().filter(|f| own.placed_s.last().is_none_or(|t| f.t_s > *t))
            {
                let sigma = if rests { Some([REST_SPEED; 3]) } else { fix.velocity_sigma_m_per_s };
                own.placed_s.push(fix.t_s);
                fixes.push(GnssFix { velocity_sigma_m_per_s: sigma, ..fix });
            }
            if estimator.on_ground_without_fixes() == Some(false) {
                own.unknown = REFERENCE_ERROR;
            }
        }
        if !fixes.is_empty() {
            own.unknown[1] += GRAVITY * GRAVITY;
        }
        own.rests.extend(since_s.map(|from_s| (from_s, last_s)));
        own.rests.retain(|(from_s, to_s)| to_s - from_s > SHORT_S);
        (own, fixes)
    }

    /// Whether a fix is the place's.
    pub(super) fn gave(&self, fix: &GnssFix) -> bool {
        let k = self.placed_s.partition_point(|t| *t < fix.t_s);
        self.placed_s.get(k) == Some(&fix.t_s)
    }

    /// What rest leaves unknown between these times of one and the same rest: variances per hertz that a constant error over all of it
    /// amounts to.
    pub(super) fn rests(&self, from_s: f64, to_s: f64) -> Option<[f64; 2]> {
        let k = self.rests.partition_point(|r| r.1 < to_s);
        let (from, to) = self.rests.get(k).filter(|r| r.0 <= from_s)?;
        Some(self.unknown.map(|v| v * (to - from)))
    }

    /// The same at another time.
    pub(super) fn move_by(&mut self, by_s: f64) {
        self.rests.iter_mut().for_each(|(from, to)| (*from, *to) = (*from + by_s, *to + by_s));
        self.placed_s.iter_mut().for_each(|t| *t += by_s);
    }
}
