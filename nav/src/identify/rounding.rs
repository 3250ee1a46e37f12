//! What the rounding of samples leaves unknown along a flight, second by second.
//!
//! Rounding errors of a count that nothing dithers stay the same as long as the count does: a stationary vehicle whose rates lie
//! below one count says nothing of where in the bin they are, however many samples it sends. An error that lasts T has the
//! effect of white noise of T times its variance on whatever is integrated over T.

use crate::quantisation::Dequantiser;
use crate::sample::{ImuSample, Quantisation};
use nalgebra::Vector3;

/// Variance per hertz that rounding adds to gyro, (rad/s)²/Hz, and accelerometer samples, (m/s²)²/Hz.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Rounding {
    start_s: f64,
    seconds: Vec<(f64, f64)>,
}

impl Rounding {
    /// Samples `interval_s` apart with their rounding undone, and what that leaves unknown.
    pub(super) fn undo(raw: &[ImuSample], q: Quantisation, interval_s: f64) -> (Vec<ImuSample>, Self) {
        let mut dequantiser = Dequantiser::new(q);
        let start_s = raw.first().map_or(0.0, |s| s.t_s);
        let length = raw.last().map_or(0.0, |s| s.t_s - start_s).max(0.0) as usize + 1;
        let mut sums = vec![(0.0, 0.0, 0.0); length];
        let lasts = [lasting(raw, |s| &s.gyro), lasting(raw, |s| &s.accel)];
        let mut samples = Vec::with_capacity(raw.len());
        for (k, sample) in raw.iter().enumerate() {
            samples.push(dequantiser.undo(sample));
            let (gyro, accel) = dequantiser.noise_density_lasting(interval_s, &[lasts[0][k], lasts[1][k]]);
            if let Some(sum) = sums.get_mut((sample.t_s - start_s) as usize) {
                *sum = (sum.0 + gyro, sum.1 + accel, sum.2 + 1.0);
            }
        }
        let mut last = (0.0, 0.0);
        let seconds = sums.into_iter().map(|(gyro, accel, n)| {
            if n > 0.0 {
                last = (gyro / n, accel / n);
            }
            last
        });
        (samples, Self { start_s, seconds: seconds.collect() })
    }

    /// At an instant of the flight.
    pub(crate) fn at(&self, t_s: f64) -> (f64, f64) {
        let second = (t_s - self.start_s).max(0.0) as usize;
        self.seconds.get(second).or(self.seconds.last()).copied().unwrap_or_default()
    }

    /// The same at another time.
    pub(super) fn move_by(&mut self, by_s: f64) {
        self.start_s += by_s;
    }
}

/// How long each axis keeps the value that it has at each sample, s.
fn lasting(raw: &[ImuSample], of: impl Fn(&ImuSample) -> &Vector3<f64>) -> Vec<Vector3<f64>> {
    let mut out = vec![Vector3::zeros(); raw.len()];
    for axis in 0..3 {
        let mut from = 0;
        for k in 1..=raw.len() {
            if k == raw.len() || of(&raw[k])[axis] != of(&raw[from])[axis] {
                let lasts_s = raw[k - 1].t_s - raw[from].t_s;
                out[from..k].iter_mut().for_each(|v| v[axis] = lasts_s);
                from = k;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use crate::math::sin;

    use super::*;
    use crate::sample::Steps;

    /// A quiet vehicle that stands for a minute and then turns: stationary it says no more of a rate than a single count does.
    #[test]
    fn a_count_that_stands_still_says_no_more_in_a_minute_than_in_a_second() {
        let steps = Steps::RAW_IMU;
        let raw: Vec<ImuSample> = (0..6000)
            .map(|k| {
                let t_s = f64::from(k) * 0.02;
                let rate = if t_s < 60.0 { 0.4 } else { 40.0 + 30.0 * sin(t_s * 0.9) } * steps.gyro;
                let real = Vector3::repeat(rate);
                let (gyro, accel) =
                    Quantisation::Truncate(steps).apply(&real, &Vector3::new(0.0, 0.0, -9.81));
                ImuSample { t_s, gyro, accel, temperature_degc: None }
            })
            .collect();
        let (samples, rounding) = Rounding::undo(&raw, Quantisation::Truncate(steps), 0.02);
        assert_eq!(samples.len(), raw.len());
        // Mean rate over the minute: the density over its length.
        let sigma = (rounding.at(30.0).0 / 60.0).sqrt();
        let bin = 2.0 * steps.gyro / 12f64.sqrt();
        assert!((sigma / bin - 1.0).abs() < 0.1, "{sigma} of a bin with {bin}");
        // Where the counts change, a second of samples shows far more.
        assert!((rounding.at(100.0).0).sqrt() < 0.3 * bin, "{:?}", rounding.at(100.0));
        assert_eq!(Rounding::undo(&raw, Quantisation::None, 0.02).1.at(30.0), (0.0, 0.0));
    }
}
