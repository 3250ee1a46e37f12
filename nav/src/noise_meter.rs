//! How noisy the samples of a running vehicle are: vibration exceeds the sensor's own noise by far.
//!
//! The second difference of white noise of variance σ² has variance 6σ², and motion that is smooth over three samples
//! drops out of it. Causal, and a function of the samples alone.

use crate::sample::ImuSample;
use nalgebra::Vector3;

/// Memory of the running mean, s.
const MEMORY_S: f64 = 5.0;
/// Noise up to so many times the model's variance is left to the model.
const TOLERATED: f64 = 2.0;

/// Running estimate of white noise per hertz.
#[derive(Debug, Clone, Default)]
pub struct NoiseMeter {
    last: [Option<ImuSample>; 2],
    seconds: f64,
    gyro: f64,
    accel: f64,
    interval_s: f64,
}

impl NoiseMeter {
    /// Takes a sample.
    pub fn push(&mut self, sample: &ImuSample) {
        if let [Some(a), Some(b)] = &self.last {
            let dt = sample.t_s - b.t_s;
            let even = (dt - (b.t_s - a.t_s)).abs() < 0.2 * dt;
            if dt > 0.0 && dt < 0.5 && even {
                let second = |x: Vector3<f64>, y: Vector3<f64>, z: Vector3<f64>| {
                    (x - y * 2.0 + z).norm_squared() / 3.0 / 6.0 * dt
                };
                let share = dt / self.seconds.clamp(dt, MEMORY_S);
                self.gyro += share * (second(a.gyro, b.gyro, sample.gyro) - self.gyro);
                self.accel += share * (second(a.accel, b.accel, sample.accel) - self.accel);
                self.interval_s += share * (dt - self.interval_s);
                self.seconds += dt;
            }
        }
        self.last = [self.last[1], Some(*sample)];
    }

    /// Mean interval between samples, s; 0 before the third sample.
    pub fn interval_s(&self) -> f64 {
        self.interval_s
    }

    /// What to add to the model's variances per hertz (both gyro and accelerometer), given these.
    pub fn excess(&self, gyro: f64, accel: f64) -> (f64, f64) {
        let over =
            |measured: f64, model: f64| if measured > TOLERATED * model { measured - model } else { 0.0 };
        if self.seconds < 0.5 { (0.0, 0.0) } else { (over(self.gyro, gyro), over(self.accel, accel)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(amplitude: f64) -> NoiseMeter {
        let mut meter = NoiseMeter::default();
        let mut x = 1u64;
        for i in 0..2000 {
            // A uniform generator is enough: variance amplitude²/3.
            let mut draw = || {
                x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                amplitude * ((x >> 11) as f64 / (1u64 << 52) as f64 - 1.0)
            };
            let t_s = f64::from(i) * 0.01;
            let slow = (t_s * 2.0).sin();
            let accel = Vector3::new(slow + draw(), draw(), draw());
            meter.push(&ImuSample { t_s, gyro: Vector3::repeat(slow), accel, temperature_degc: None });
        }
        meter
    }

    #[test]
    fn measures_white_noise_and_not_smooth_motion() {
        let (gyro, accel) = run(3.0).excess(1e-8, 1e-5);
        assert!((accel / (3.0 * 0.01) - 1.0).abs() < 0.2, "{accel}");
        assert_eq!(gyro, 0.0);
    }

    #[test]
    fn quiet_samples_are_left_to_the_model() {
        assert_eq!(run(0.001).excess(1e-8, 1e-5), (0.0, 0.0));
    }
}
