//! What the samples do not show: the one rule about samples that are missing, for filter and explanation, and what happens between
//! samples that are far apart.
//!
//! Values between two samples are taken on a straight line. Where the true ones bend, an interval h integrates κ h³/12 too much (the
//! trapezoidal rule: Abramowitz & Stegun 1964, 25.4.1, with κ the second derivative). The last three samples show how strongly values
//! bend now, so the error has a variance that the filter can count: large in a maneuver that few samples show, nothing in steady
//! flight.

use crate::sample::ImuSample;
use nalgebra::Vector3;

/// A gap between samples longer than this is not integrated as if nothing had happened, s.
pub(crate) const GAP_S: f64 = 0.25;
/// What an unseen vehicle may do in a gap of which nothing else is known: rate, rad/s, and acceleration, m/s².
pub(crate) const MOTION: (f64, f64) = (0.5, 5.0);
/// Samples no further apart than this show all that a vehicle does, s: 20 Hz, twice the bandwidth of an attitude loop and more.
const DENSE_S: f64 = 0.05;
/// The error of one interval has this sigma in units of κ h³/12: neighbouring intervals bend alike, so that their errors add up
/// before they cancel.
const BEND_SIGMA: f64 = 2.0;

/// Values of a sample.
#[derive(Debug, Clone, Copy)]
struct Point {
    t_s: f64,
    rate: Vector3<f64>,
    force: Vector3<f64>,
}

impl Point {
    fn of(sample: &ImuSample) -> Self {
        Self { t_s: sample.t_s, rate: sample.gyro, force: sample.accel }
    }
}

/// The last two samples that a sensor took.
#[derive(Debug, Clone, Default)]
pub(super) struct Bend {
    before: Option<Point>,
    last: Option<Point>,
}

/// White noise that stands for what lies between two samples, per axis: (rad/s)²/Hz and (m/s²)²/Hz.
pub(super) type BetweenSamples = Option<[Vector3<f64>; 2]>;

impl Bend {
    /// Takes the next sample of the sensor.
    pub(super) fn take(&mut self, sample: &ImuSample) {
        if self.last.is_none_or(|last| sample.t_s > last.t_s) {
            self.before = self.last.replace(Point::of(sample));
        }
    }

    /// What the straight line to this sample may leave out; nothing where samples are close together.
    pub(super) fn noise_until(&self, next: &ImuSample) -> BetweenSamples {
        let (before, last, next) = (self.before?, self.last?, Point::of(next));
        let (h, h_before) = (next.t_s - last.t_s, last.t_s - before.t_s);
        if h <= DENSE_S || h_before <= 0.0 {
            return None;
        }
        let noise = |value: fn(&Point) -> Vector3<f64>| {
            let slope = (value(&next) - value(&last)) / h;
            let slope_before = (value(&last) - value(&before)) / h_before;
            let bend = (slope - slope_before) * (2.0 / (h + h_before));
            let error = bend * (BEND_SIGMA * h * h * h / 12.0);
            error.component_mul(&error) / h
        };
        Some([noise(|p| p.rate), noise(|p| p.force)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(t_s: f64, rate: f64) -> ImuSample {
        let (gyro, accel) = (Vector3::new(rate, 0.0, 0.0), Vector3::new(0.0, 0.0, -9.8));
        ImuSample { t_s, gyro, accel, temperature_degc: None }
    }

    /// A rate of ½ κ t² over 0.2 s: the line between its ends holds κ h³/12 more than the parabola.
    #[test]
    fn the_noise_covers_what_a_straight_line_adds_to_a_parabola() {
        let (h, bend) = (0.2, 6.0);
        let at = |k: f64| sample(k * h, 0.5 * bend * (k * h).powi(2));
        let mut seen = Bend::default();
        seen.take(&at(0.0));
        seen.take(&at(1.0));
        let [rate, force] = seen.noise_until(&at(2.0)).unwrap();
        let line = 0.5 * h * (at(1.0).gyro.x + at(2.0).gyro.x);
        let parabola = bend * ((2.0 * h).powi(3) - h.powi(3)) / 6.0;
        let sigma = (rate.x * h).sqrt();
        assert!((sigma - BEND_SIGMA * (line - parabola)).abs() < 1e-12, "{sigma} {}", line - parabola);
        assert_eq!((rate.y, force), (0.0, Vector3::zeros()));
    }

    #[test]
    fn steady_motion_and_samples_close_together_add_no_noise() {
        let mut seen = Bend::default();
        assert!(seen.noise_until(&sample(0.0, 0.0)).is_none(), "nothing before it");
        (0..2).for_each(|k| seen.take(&sample(f64::from(k) * 0.2, 0.3)));
        assert_eq!(seen.noise_until(&sample(0.4, 0.3)), Some([Vector3::zeros(); 2]));
        assert!(seen.noise_until(&sample(0.22, 0.9)).is_none(), "50 Hz");
    }
}
