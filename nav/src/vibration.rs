//! Power of vibration on each axis: the variance of the samples above a few hertz.
//!
//! A fourth-order Butterworth high-pass (two biquads, Bristow-Johnson's "Audio EQ cookbook") leaves vibration, aliased or not,
//! and takes away maneuvers. Causal, and a function of the samples alone.

use crate::math::sin_cos;
use crate::sample::ImuSample;
use nalgebra::Vector3;

/// What is slower is motion, Hz …
const CORNER_HZ: f64 = 4.0;
/// … unless samples are slow themselves: then it is this share of their rate.
const CORNER_SHARE: f64 = 0.2;
/// Quality of the two biquads of a Butterworth low-pass or high-pass of fourth order.
const QUALITY: [f64; 2] = [0.541_196_1, 1.306_563_0];
/// The rate of the samples is measured over so many.
const SETTLED: u32 = 20;
/// The filter starts anew after so long without samples, s.
const GAP_S: f64 = 0.5;
/// Running power is a mean over about this time, s.
const MEMORY_S: f64 = 2.0;

/// One biquad on three axes: coefficients b₀, b₁, b₂, a₁, a₂ over a₀, and the last two inputs and outputs.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Biquad {
    c: [f64; 5],
    x: [Vector3<f64>; 2],
    y: [Vector3<f64>; 2],
}

impl Biquad {
    fn high_pass(share_of_rate: f64, quality: f64) -> Self {
        let (sin, cos) = sin_cos(std::f64::consts::TAU * share_of_rate);
        let alpha = sin / (2.0 * quality);
        let (b, a0) = (0.5 * (1.0 + cos), 1.0 + alpha);
        Self { c: [b, -2.0 * b, b, -2.0 * cos, 1.0 - alpha].map(|c| c / a0), ..Self::default() }
    }

    fn take(&mut self, x: Vector3<f64>) -> Vector3<f64> {
        let [b0, b1, b2, a1, a2] = self.c;
        let y = x * b0 + self.x[0] * b1 + self.x[1] * b2 - self.y[0] * a1 - self.y[1] * a2;
        (self.x, self.y) = ([x, self.x[0]], [y, self.y[0]]);
        y
    }
}

/// Specific force without what is slow.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct HighPass {
    last_s: Option<f64>,
    first: Option<Vector3<f64>>,
    counted: u32,
    interval_s: f64,
    biquads: Option<[Biquad; 2]>,
}

impl HighPass {
    /// What is fast in the next sample, m/s²; zero until the rate of the samples is known.
    pub(crate) fn take(&mut self, sample: &ImuSample) -> Vector3<f64> {
        let dt = self.last_s.replace(sample.t_s).map_or(0.0, |last| sample.t_s - last);
        if dt > GAP_S {
            self.first = None;
        } else if dt > 0.0 && self.counted < SETTLED {
            self.counted += 1;
            self.interval_s += (dt - self.interval_s) / f64::from(self.counted);
        }
        if self.counted < SETTLED {
            return Vector3::zeros();
        }
        // From rest at the first value: a constant is no step.
        if self.first.is_none() {
            let share = (CORNER_HZ * self.interval_s).min(CORNER_SHARE);
            self.biquads = Some(QUALITY.map(|q| Biquad::high_pass(share, q)));
        }
        let first = *self.first.get_or_insert(sample.accel);
        let Some(biquads) = &mut self.biquads else { return Vector3::zeros() };
        biquads.iter_mut().fold(sample.accel - first, |x, b| b.take(x))
    }
}

/// Running power.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Meter {
    high_pass: HighPass,
    last_s: Option<f64>,
    power: Vector3<f64>,
}

impl Meter {
    /// Takes the next sample.
    pub(crate) fn take(&mut self, sample: &ImuSample) {
        let dt = self.last_s.replace(sample.t_s).map_or(0.0, |last| sample.t_s - last);
        let fast = self.high_pass.take(sample);
        self.power += (fast.component_mul(&fast) - self.power) * (dt / MEMORY_S).clamp(0.0, 1.0);
    }

    /// Variance by axis, (m/s²)².
    pub(crate) fn power(&self) -> Vector3<f64> {
        self.power
    }
}

#[cfg(test)]
mod tests {
    use crate::math::sin;

    use super::*;

    fn sample(t_s: f64, accel: Vector3<f64>) -> ImuSample {
        ImuSample { t_s, gyro: Vector3::zeros(), accel, temperature_degc: None }
    }

    /// A line at 87 Hz sampled at 50 Hz and a maneuver: the power is that of the line.
    #[test]
    fn vibration_is_told_from_motion_whatever_the_rate() {
        for rate_hz in [50.0, 200.0, 400.0] {
            let mut meter = Meter::default();
            let (mut sum, mut n) = (Vector3::zeros(), 0.0);
            for k in 0..(30.0 * rate_hz) as u32 {
                let t = f64::from(k) / rate_hz;
                let line =
                    |size: f64| size * std::f64::consts::SQRT_2 * sin(std::f64::consts::TAU * 87.3 * t);
                let turn = 4.0 * sin(std::f64::consts::TAU * 0.5 * t);
                meter.take(&sample(t, Vector3::new(line(0.5), line(2.0) + turn, turn - 9.8)));
                if t > 10.0 {
                    sum += meter.power();
                    n += 1.0;
                }
            }
            let power = sum / n;
            assert!(
                (power.x / 0.25 - 1.0).abs() < 0.1 && (power.y / 4.0 - 1.0).abs() < 0.1,
                "{rate_hz}: {power}"
            );
            assert!(power.z < 0.01, "{rate_hz}: {power}");
        }
    }
}
