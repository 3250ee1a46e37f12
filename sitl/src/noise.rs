//! Random numbers by seed and purpose: switching one source of noise on or off leaves the draws of all others as
//! they were.

use gaware_nav::math::exp;
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// What random numbers are for; each purpose has its own stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// White noise of the gyros.
    Gyro = 1,
    /// White noise of the accelerometers.
    Accel,
    /// Random walk of the biases.
    BiasWalk,
    /// Vibration phases.
    Vibration,
    /// White noise of positions.
    Position,
    /// Correlated noise of positions.
    PositionWander,
    /// White noise of velocities.
    Velocity,
    /// Jitter of time stamps.
    Jitter,
    /// Errors of the autopilot's own attitude.
    Attitude,
    /// The ground truth of a vehicle: biases and effects.
    HiddenTruth,
    /// Faults of a link.
    Link,
    /// Gusts.
    Wind,
    /// What someone does at random.
    Choice,
    /// How an aircraft slips.
    Slip,
    /// An auto-throttle that hunts.
    Throttle,
    /// Errors of what is reported of the battery.
    Reports,
    /// White noise of compasses.
    Field,
    /// Noise of barometers and airspeed, weather and gusts.
    Air,
}

/// Random numbers for one purpose.
#[derive(Debug, Clone)]
pub struct Noise(ChaCha8Rng);

impl Noise {
    /// The stream of this seed for this purpose.
    pub fn new(seed: u64, purpose: Purpose) -> Self {
        Self::numbered(seed, purpose, 0)
    }

    /// The `index`-th independent stream of this seed for this purpose.
    pub fn numbered(seed: u64, purpose: Purpose, index: u32) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(purpose as u64 + (u64::from(index) << 8));
        Self(rng)
    }

    /// A draw of mean 0 and sigma 1.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Three of them.
    pub fn normal3(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// A draw from [0, 1).
    pub fn uniform(&mut self) -> f64 {
        // 53 bits: every value of the grid 2⁻⁵³.
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// First-order Gauss-Markov noise on three axes (Brown & Hwang 2012, section 4.6).
#[derive(Debug, Clone)]
pub struct GaussMarkov {
    noise: Noise,
    state: Vector3<f64>,
    at_s: Option<f64>,
}

impl GaussMarkov {
    /// Starts in its stationary distribution.
    pub fn new(noise: Noise) -> Self {
        Self { noise, state: Vector3::zeros(), at_s: None }
    }

    /// The value at a later time, per unit of stationary sigma; white when the correlation time is zero.
    pub fn at(&mut self, t_s: f64, correlation_s: f64) -> Vector3<f64> {
        let kept = match self.at_s {
            Some(last) if correlation_s > 0.0 => exp(-(t_s - last).max(0.0) / correlation_s),
            _ => 0.0,
        };
        self.at_s = Some(t_s);
        self.state = self.state * kept + self.noise.normal3() * (1.0 - kept * kept).sqrt();
        self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn purposes_and_seeds_give_different_numbers_and_the_same_again() {
        let draw = |seed, purpose| Noise::new(seed, purpose).normal3();
        assert_eq!(draw(1, Purpose::Gyro), draw(1, Purpose::Gyro));
        assert_ne!(draw(1, Purpose::Gyro), draw(1, Purpose::Accel));
        assert_ne!(draw(1, Purpose::Gyro), draw(2, Purpose::Gyro));
    }

    #[test]
    fn gauss_markov_has_its_sigma_and_correlation() {
        const TAU_S: f64 = 5.0;
        let mut process = GaussMarkov::new(Noise::new(3, Purpose::PositionWander));
        let x: Vec<f64> = (0..100_000).map(|k| process.at(f64::from(k), TAU_S).x).collect();
        let n = x.len() as f64;
        let variance = x.iter().map(|v| v * v).sum::<f64>() / n;
        let lagged = x.windows(6).map(|w| w[0] * w[5]).sum::<f64>() / n;
        assert!((variance - 1.0).abs() < 0.05, "{variance}");
        assert!((lagged - exp(-1.0f64)).abs() < 0.05, "{lagged}");
    }
}
