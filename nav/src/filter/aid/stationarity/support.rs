//! Whether what a unit rests on gives way: foam, a soft bag, a hand.
//!
//! Gravity turns with it in the axes of the unit: block means of the specific force are a random walk with white noise on top. Which walk is decided by
//! the likelihood of its innovations (Bar-Shalom, Li & Kirubarajan 2001, section 11.6, as for the biases in [`drift`](crate::drift)), out of
//! a few and none; the stationary periods before count as one more, so that a table says something of the next side, and a side on a
//! cushion is judged by itself.

use crate::math::ln;
use nalgebra::Vector3;

/// Random walks of the attitude that are tried, rad/√s: 0.1 to 10 mrad in half a minute.
const DENSITIES: [f64; 7] = [3e-5, 6e-5, 1.2e-4, 2.5e-4, 5e-4, 1e-3, 2e-3];
/// None, and these.
const WALKS: usize = 1 + DENSITIES.len();
/// That a support gives way is said once its walk is ahead of none by so many nats, as of the walks of the biases.
const AHEAD: f64 = 7.0;

/// How a support gives way: the density of the walk of the attitude, rad/√s.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct GivesWay {
    density: f64,
}

impl GivesWay {
    fn number(k: usize) -> Self {
        Self { density: k.checked_sub(1).and_then(|k| DENSITIES.get(k).copied()).unwrap_or(0.0) }
    }

    pub(super) fn is_firm(self) -> bool {
        self.density <= 0.0
    }

    /// Variance of each axis of the turn in so long, rad².
    pub(super) fn variance(self, for_s: f64) -> f64 {
        self.density * self.density * for_s
    }
}

/// One walk: what the specific force is after the last block, m/s², and its variance.
#[derive(Debug, Clone, Copy, Default)]
struct Walk {
    force: Vector3<f64>,
    variance: f64,
    log_likelihood: f64,
}

/// The specific force of one stationary period, block by block.
#[derive(Debug, Clone, Default)]
pub(super) struct Support {
    first: Vector3<f64>,
    walks: Option<[Walk; WALKS]>,
}

impl Support {
    /// Takes the mean of a block of so long, s, with noise of this variance; what walks beside the attitude adds this variance, both (m/s²)².
    pub(super) fn take(&mut self, mean: &Vector3<f64>, duration_s: f64, noise: f64, walked: f64) {
        let Some(walks) = &mut self.walks else {
            self.first = *mean;
            self.walks = Some([Walk { force: *mean, variance: noise, log_likelihood: 0.0 }; WALKS]);
            return;
        };
        let down = mean.normalize();
        for (k, walk) in walks.iter_mut().enumerate() {
            // From the middle of one block to that of the next.
            let turned = GivesWay::number(k).variance(duration_s);
            walk.variance += turned * mean.norm_squared() + walked;
            let off = mean - walk.force;
            let across = off - down * down.dot(&off);
            let s = walk.variance + noise;
            walk.log_likelihood -= 0.5 * across.norm_squared() / s + ln(s);
            walk.force += off * (walk.variance / s);
            walk.variance *= noise / s;
        }
    }
}

impl Support {
    /// How far it has turned, rad; zero where it stands firm.
    pub(super) fn turned(&self) -> f64 {
        let likelier = |a: &&Walk, b: &&Walk| a.log_likelihood.total_cmp(&b.log_likelihood);
        let walks = self.walks.iter().flatten();
        let best = walks
            .max_by(likelier)
            .zip(self.walks.as_ref())
            .filter(|(best, walks)| best.log_likelihood - walks[0].log_likelihood > AHEAD);
        best.map_or(0.0, |(best, _)| best.force.angle(&self.first))
    }
}

/// What the stationary periods so far have shown.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::filter) struct Supports {
    log_likelihood: [f64; WALKS],
    periods: f64,
    turned: f64,
}

impl Supports {
    /// A period is over.
    pub(super) fn add(&mut self, period: &Support) {
        if let Some(walks) = &period.walks {
            self.periods += 1.0;
            self.log_likelihood.iter_mut().zip(walks).for_each(|(sum, walk)| *sum += walk.log_likelihood);
            // What one period does not show beyond chance, all of them together may.
            let most = |best: usize, k: usize| {
                if self.log_likelihood[k] > self.log_likelihood[best] { k } else { best }
            };
            let best = (1..WALKS).fold(0, most);
            let together = if self.log_likelihood[best] - self.log_likelihood[0] > AHEAD {
                walks[best].force.angle(&period.first)
            } else {
                0.0
            };
            self.turned = self.turned.max(period.turned()).max(together);
        }
    }

    /// How far it turned in the period in which it did most, rad.
    pub(super) fn turned(&self) -> f64 {
        self.turned
    }

    /// How the support gives way in this period.
    pub(super) fn judge(&self, period: &Support) -> GivesWay {
        let likelihood = |k: usize| {
            let own = period.walks.as_ref().map_or(0.0, |walks| walks[k].log_likelihood);
            // A firm support is as likely before as all the walks together.
            let prior = if k == 0 { 0.0 } else { ln(DENSITIES.len() as f64) };
            own + self.log_likelihood[k] / self.periods.max(1.0) - prior
        };
        // Of equals the first, which gives way less.
        let most = |best: usize, k: usize| if likelihood(k) > likelihood(best) { k } else { best };
        GivesWay::number((1..WALKS).fold(0, most))
    }
}

#[cfg(test)]
mod tests {
    use crate::math::exp;

    use super::*;
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand_distr::{Distribution, StandardNormal};

    /// A period of blocks of 5 s whose attitude is this at its blocks, rad, with noise of `HIGHRES_IMU`.
    fn period(seed: u64, blocks: u32, angle: impl Fn(f64) -> f64) -> Support {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut support = Support::default();
        let noise = 2e-3;
        for k in 0..blocks {
            let noise3 = Vector3::from_fn(|_, _| {
                noise * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng)
            });
            let mean = Vector3::new(0.0, -9.8 * angle(f64::from(k) * 5.0), -9.8) + noise3;
            support.take(&mean, 5.0, noise * noise, 0.0);
        }
        support
    }

    #[test]
    fn foam_is_found_in_its_first_period_and_a_firm_table_stays_one() {
        // Sigma of the turn in 25 s, rad.
        let turn = |supports: &Supports, period: &Support| supports.judge(period).variance(25.0).sqrt();
        let foam = |t: f64| 3e-3 * (1.0 - exp(-t / 4.0));
        let mut firm = 0;
        for seed in 0..40 {
            let found = turn(&Supports::default(), &period(seed, 5, foam));
            assert!((6e-4..=6e-3).contains(&found), "{found}");
            let mut supports = Supports::default();
            (0..6).for_each(|k| supports.add(&period(100 * seed + k, 5, |_| 0.0)));
            assert_eq!(supports.turned(), 0.0);
            firm += u32::from(turn(&supports, &period(7 + seed, 5, |_| 0.0)) <= 2e-4);
            // One side on a cushion.
            let cushion = period(seed, 5, foam);
            assert!(turn(&supports, &cushion) >= 6e-4);
            assert!((2e-3..4e-3).contains(&cushion.turned()), "{}", cushion.turned());
        }
        // Noise passes for a turn of more than 0.2 mrad in a quarter of the periods: `study ground` shows what that costs on a firm table.
        assert!(firm >= 30, "{firm}");
    }
}
