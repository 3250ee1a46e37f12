//! How noisy the velocities of a receiver are, against what it claims of them.
//!
//! Receivers and autopilots state figures of caution: on public logs the mean NIS was below 0.3 per degree of freedom in 163 of 164, on firmware
//! flights 0.01 to 0.1. A filter that believes them learns ten times as slowly as it could, and another estimate than one that fits the
//! noise. What fixes show beside the samples says how large it is: E[ν νᵀ] = H P Hᵀ + R (covariance matching: Mehra 1972, "Approaches to adaptive
//! filtering"). The share of the state is not taken off: it is small, and where it is not, the filter's word for it would make the noise smaller and the
//! filter surer (3 h of cruise then ended with a NEES of 2.3 instead of 1.0). Errors of a receiver are correlated over a second or two, so that the mean of some seconds is looked at as well as the single
//! fix: it may keep the noise from being taken for less than claimed, but not make more of it, since errors of positions move the velocity that they are
//! compared with. Only velocities are judged: errors of positions stay for minutes, and what a
//! few minutes show of them says nothing about their size.

use crate::filter::FixOutcome;
use crate::model::GnssModel;
use crate::sample::{FixVelocity, GnssFix};
use std::collections::VecDeque;

/// Memory, s: longer than a maneuver that an unmodelled effect disturbs.
const MEMORY_S: f64 = 120.0;
/// What was claimed counts as so many seconds of fixes.
const CLAIM_S: f64 = 20.0;
/// Length of the means, s: those of receivers have left their correlation behind.
const BLOCK_S: f64 = 4.0;
/// An innovation beyond so many of its sigmas is taken for as many: an outlier is no noise.
const MOST_SIGMAS: f64 = 3.0;
/// Factor on the claimed sigma: errors of a second that fixes seldom have (a touchdown, samples that miss a blow) are larger than their usual noise.
/// With a tenth of the claim the touchdown of a clean flight passed for a drift of the gyros, and the sigmas of G became five times as wide …
const SMALLEST: f64 = 0.33;
/// … and noise that is larger by more is something that the model lacks, for the innovation test to show.
const LARGEST: f64 = 2.0;
/// What differs by less than this factor on the variance is believed: the means of two minutes scatter by 15 %, and a noise that is always found
/// anew follows the errors that it should weigh.
const BELIEVED: f64 = 1.5;
/// However good velocities are, the model is not: sub-sample delays leave centimetres per second (`identify::noise` has the same floor), m/s.
const FLOOR: f64 = 0.04;
/// Fixes further apart than this begin a new mean, s.
const APART_S: f64 = 1.5;
/// Claims of fixes that wait for what becomes of them.
const MOST_WAITING: usize = 64;

/// A mean that forgets.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mean {
    value: f64,
    seconds: f64,
}

impl Mean {
    fn push(&mut self, value: f64, seconds: f64) {
        self.seconds = (self.seconds + seconds).min(MEMORY_S);
        self.value += (value - self.value) * seconds / self.seconds;
    }
}

/// Innovations of some seconds, over the claimed sigma.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Block {
    began_s: f64,
    fixes: f64,
    /// Axis by axis.
    sum: [f64; 3],
    /// How many innovations, and the variances that state and stamps add to them.
    count: f64,
    state: f64,
    stamp: f64,
}

impl Block {
    fn take(&mut self, axis: usize, innovation: f64, of_state: f64, of_stamp: f64) {
        self.sum[axis] += innovation;
        self.count += 1.0;
        self.state += of_state;
        self.stamp += of_stamp;
    }

    /// Variance of white noise with this mean over the block: all fixes have the same error of the state, each one of its own stamp.
    fn shown(&self) -> f64 {
        let count = self.count.max(1.0);
        let square: f64 = self.sum.iter().map(|s| s * s).sum();
        (square - self.fixes * self.state - self.stamp) / count
    }
}

/// The noise of a receiver's velocities.
#[derive(Debug, Clone)]
pub struct ReceiverMeter {
    /// Variance over the claimed one: of single fixes, and of the means of some seconds times their number.
    single: Mean,
    means: Mean,
    block: Block,
    last_s: f64,
    /// Stamps and claims of the fixes under way.
    waiting: VecDeque<(f64, [f64; 3])>,
}

impl Default for ReceiverMeter {
    fn default() -> Self {
        let claimed = Mean { value: 1.0, seconds: CLAIM_S };
        Self {
            single: claimed,
            means: claimed,
            block: Block::default(),
            last_s: f64::NEG_INFINITY,
            waiting: VecDeque::new(),
        }
    }
}

impl ReceiverMeter {
    /// Factor on a sigma that a receiver claims for a velocity, m/s.
    pub fn factor(&self, claimed: f64) -> f64 {
        let (single, means) = (self.single.value, self.means.value);
        let shown = if means > BELIEVED * single { means.min(single.max(1.0)) } else { single };
        if (BELIEVED.recip()..BELIEVED).contains(&shown) {
            return 1.0;
        }
        let least = SMALLEST.max(FLOOR / claimed.max(1e-3)).min(1.0);
        shown.max(0.0).sqrt().clamp(least, LARGEST)
    }

    /// A fix of the receiver with the sigma of its velocity as those before it have shown it.
    #[must_use]
    pub fn judge(&mut self, fix: &GnssFix, gnss: &GnssModel) -> GnssFix {
        if fix.velocity == FixVelocity::None {
            return *fix;
        }
        let claimed = fix.velocity_sigma_m_per_s.unwrap_or(gnss.velocity_sigma_m_per_s);
        if self.waiting.len() == MOST_WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back((fix.t_s, claimed));
        GnssFix { velocity_sigma_m_per_s: Some(claimed.map(|s| s * self.factor(s))), ..*fix }
    }

    /// Takes what became of a fix that was judged.
    pub fn learn(&mut self, outcome: &FixOutcome) {
        while self.waiting.pop_front_if(|(stamp, _)| *stamp < outcome.stamp_s).is_some() {}
        let Some((_, claimed)) = self.waiting.pop_front_if(|(stamp, _)| *stamp == outcome.stamp_s) else {
            return;
        };
        let group = &outcome.velocity;
        if !group.used || group.recovered {
            return;
        }
        let since_s = outcome.stamp_s - self.last_s;
        self.last_s = outcome.stamp_s;
        if !(0.0..APART_S).contains(&since_s) {
            self.block = Block { began_s: outcome.stamp_s, ..Block::default() };
            return;
        }
        let mut single = 0.0;
        for k in (0..group.dof).filter(|k| group.normalised[*k] != 0.0) {
            let (innovation, normalised) = (group.innovation[k] / claimed[k], group.normalised[k]);
            let own = group.noise[k] / claimed[k].powi(2);
            // The predicted sigma is what the innovation was divided by.
            let of_state = ((innovation / normalised).powi(2) - own).max(0.0);
            let of_stamp = (own - self.factor(claimed[k]).powi(2)).max(0.0);
            let innovation = innovation * (MOST_SIGMAS / normalised.abs()).min(1.0);
            single += innovation * innovation;
            self.block.take(k, innovation, of_state, of_stamp);
        }
        self.block.fixes += 1.0;
        self.single.push(single / group.dof as f64, since_s);
        let length_s = outcome.stamp_s - self.block.began_s;
        if length_s >= BLOCK_S {
            self.means.push(self.block.shown(), length_s);
            self.block = Block { began_s: outcome.stamp_s, ..Block::default() };
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::math::exp;

    use super::*;
    use crate::earth::Geodetic;
    use crate::filter::Group;
    use crate::testing::Normal;

    const CLAIMED: f64 = 0.5;

    /// What the meter makes of a receiver that claims half a metre per second and whose errors have this sigma, and stay for so many fixes.
    fn judged(sigma: f64, correlation: f64) -> f64 {
        let mut meter = ReceiverMeter::default();
        let mut random = Normal(7);
        let keep = if correlation > 0.0 { exp(-1.0 / correlation) } else { 0.0 };
        let mut errors = [0.0; 3];
        for n in 0..3000 {
            let stamp_s = 0.2 * f64::from(n);
            let position = Geodetic { lat_rad: 0.8, lon_rad: 0.2, height_m: 100.0 };
            let fix = GnssFix {
                t_s: stamp_s,
                position,
                velocity: FixVelocity::Full([0.0; 3]),
                position_sigma_m: None,
                velocity_sigma_m_per_s: Some([CLAIMED; 3]),
                yaw_rad: None,
            };
            let white =
                meter.judge(&fix, &crate::model::Model::default().gnss).velocity_sigma_m_per_s.unwrap()[0];
            for e in &mut errors {
                *e = keep * *e + (1.0 - keep * keep).sqrt() * sigma * random.next();
            }
            let velocity = Group {
                dof: 3,
                innovation: errors,
                normalised: errors.map(|e| e / white),
                noise: [white * white; 3],
                used: true,
                ..Group::default()
            };
            meter.learn(&FixOutcome { t_s: stamp_s, stamp_s, velocity, ..FixOutcome::default() });
        }
        meter.factor(CLAIMED) * CLAIMED
    }

    #[test]
    fn white_errors_are_found_within_a_tenth() {
        for sigma in [0.2, 0.25, 0.5] {
            let found = judged(sigma, 0.0);
            assert!((found / sigma - 1.0).abs() < 0.1, "{sigma}: {found}");
        }
    }

    /// A filter that takes the errors of neighbours for independent may not trust them more than their mean of some seconds deserves.
    #[test]
    fn errors_that_stay_for_a_second_count_for_more_than_their_scatter() {
        // White noise with the same mean over long times has (1 + keep)/(1 − keep) times the variance: ten times here.
        let found = judged(0.1, 5.0);
        assert!((0.22..0.36).contains(&found), "{found}");
    }

    #[test]
    fn a_receiver_is_never_believed_beyond_the_limits() {
        assert!((judged(1e-4, 0.0) - SMALLEST * CLAIMED).abs() < 1e-9);
        assert!((judged(50.0, 0.0) - LARGEST * CLAIMED).abs() < 1e-9);
    }
}
