//! How large an effect is on these flights, and whether it is worth a name.
//!
//! Fixes that agree with the model far better than any receiver's noise come from a simulation, and then the small print of two
//! simulations is compared: samples that are filtered and delayed, velocities rounded to centimetres per second, fixes interpolated between epochs.
//! Each is small, and each can be imitated by an effect of the catalogue with overwhelming evidence. So where fixes are too good to be true, an effect must also do more than that.

use super::flight::Flight;
use super::residual::Motion;
use crate::effects::{ActsOn, Conditions, Instant, data};
use crate::model::{EffectSetting, Model};
use nalgebra::Vector3;

/// NIS below this, with the noise at the lowest that is credible, are too good to be true.
const TOO_GOOD: f64 = 0.5;
/// A gyro error below this, RMS about its mean, is no effect then, rad/s: a third of a count of `RAW_IMU`, 72 deg/h. On four of fourteen flights of ArduPilot's
/// simulator what is not there came to 1.5e-4 to 3.2e-4 (scale factors of 900 ppm, a misalignment of 1 mrad, a formula; 2026-11-26), injected G to 5.8e-4 and
/// more.
const GYRO: f64 = 3.5e-4;
/// The same of accelerometers, m/s²: two counts of `RAW_IMU`.
const ACCEL: f64 = 0.02;
/// The same of the position of fixes, m: an antenna's phase centre, a turn cut short.
const POSITION: f64 = 0.15;
/// A jump of the position below this is no event, m: receivers wander by as much all the time (0.7 m in the model), and a simulator's creeps after the
/// landing while its velocity is rounded to zero (0.55 m, `sitl_gyro_drift.tlog`).
const JUMP: f64 = 1.0;
/// The same of the velocity of fixes, m/s.
const VELOCITY: f64 = 0.05;

/// The delay of a fix that the user knows is one from the true motion. Inertial samples are late themselves, by the autopilot's
/// low-pass (two poles at 20 Hz: 11 to 14 ms) and up to a loop until they are sent: a change of a known delay below this is
/// no effect, s.
const KNOWN_DELAY_S: f64 = 0.015;

/// What an effect does on these flights.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Size {
    /// RMS of what it adds to the gyros about the mean, rad/s.
    pub gyro: f64,
    /// RMS of what it adds to the accelerometers about the mean, m/s².
    pub accel: f64,
    /// RMS of what it adds to the position of fixes, m.
    pub position: f64,
    /// RMS of what it adds to the velocity of fixes about the mean, m/s.
    pub velocity: f64,
    /// Whether it is too small to be separated from what the model leaves out.
    pub negligible: bool,
}

/// Spread of vectors about their mean, RMS.
#[derive(Default)]
struct Spread {
    n: f64,
    sum: Vector3<f64>,
    square: f64,
}

impl Spread {
    fn take(&mut self, v: &Vector3<f64>) {
        self.n += 1.0;
        self.sum += v;
        self.square += v.norm_squared();
    }

    fn rms(&self) -> f64 {
        let n = self.n.max(1.0);
        (self.square / n - (self.sum / n).norm_squared()).max(0.0).sqrt()
    }
}

/// What drives effects at a fix.
pub fn instant(motion: &Motion, flight: &Flight) -> Instant {
    let t_s = flight.initial().t_s + motion.elapsed_s;
    Instant {
        t_s,
        rate: motion.rate,
        force: motion.force,
        temperature_above_25_degc: motion.temperature_degc.map_or(0.0, |t| t - 25.0),
        around: flight.around(t_s),
        conditions: Conditions {
            speed: motion.speed,
            heading_rad: motion.heading_rad,
            height_m: motion.height_m,
            ..flight.conditions(t_s)
        },
    }
}

/// Flights as what effects do on them is measured.
#[derive(Debug, Clone)]
pub struct Flown {
    /// At each fix of each flight.
    fixes: Vec<(Instant, Motion)>,
    longest_s: f64,
    /// RMS of what the biases of gyros, rad/s, and accelerometers, m/s², have walked, about the mean: on the flight where it is most.
    walked: [f64; 2],
    /// Whether the fixes are too good to be those of a receiver.
    too_good: bool,
}

impl Flown {
    /// Flights with what each vehicle did at its fixes, and how well these agree with the model that is known best (NIS per degree of freedom).
    pub fn new<'a, M: Iterator<Item = &'a Motion>>(
        flights: &[&Flight],
        motions: impl Iterator<Item = M>,
        nis_per_dof: f64,
    ) -> Self {
        let mut walked = [0.0f64; 2];
        let of = |(flight, motions): (&&Flight, M)| {
            let motions: Vec<Motion> = motions.copied().collect();
            for (sensor, most) in walked.iter_mut().enumerate() {
                let mut spread = Spread::default();
                motions.iter().for_each(|m| spread.take(&m.walked[sensor]));
                *most = most.max(spread.rms());
            }
            motions.into_iter().map(|m| (instant(&m, flight), m)).collect::<Vec<_>>()
        };
        let fixes = flights.iter().zip(motions).flat_map(of).collect();
        Self {
            fixes,
            walked,
            longest_s: flights.iter().map(|f| f.duration_s()).fold(0.0, f64::max),
            too_good: nis_per_dof < TOO_GOOD,
        }
    }

    /// What an effect adds to what a model has of it already.
    pub fn size(&self, setting: &EffectSetting, base: &Model) -> Size {
        let known = base.get(setting.effect.name()).map(|s| s.values.as_slice());
        let mut size = self.added(setting, known);
        // Truncation is there or not.
        let sized = !setting.effect.is_empty();
        let jumps = setting.effect.event().is_some() && setting.effect.acts_on(ActsOn::Fixes);
        let position = if jumps { JUMP } else { POSITION };
        let small =
            size.gyro < GYRO && size.accel < ACCEL && size.position < position && size.velocity < VELOCITY;
        let delay = |p: &[f64]| setting.effect.fix_delay_s(p, 0.0);
        let of_clock = setting.effect.delays_fixes()
            && known.is_some_and(|k| (delay(&setting.values) - delay(k)).abs() < KNOWN_DELAY_S);
        size.negligible = sized && (self.too_good && small || of_clock);
        size
    }

    /// What a walk of the biases of so much per root second has done, or would do where the flights do not say. White noise of the samples in turbulence is
    /// taken for a fast walk where fixes are too good to be true, but such a walk gets nowhere: ones of 12 to 34 mg/√h, which would have led
    /// 5 to 15 mg away in 12 minutes, on flights of ArduPilot's simulator whose biases stayed within 0.5 mg (2026-11-27).
    fn walked(&self, walk: f64, sensor: usize) -> f64 {
        let expected = walk * self.longest_s.sqrt();
        if self.walked[sensor] > 0.0 { self.walked[sensor].min(expected) } else { expected }
    }

    /// What an effect adds.
    fn added(&self, setting: &EffectSetting, known: Option<&[f64]>) -> Size {
        let (effect, p) = (setting.effect, &setting.values);
        let [mut gyro, mut accel, mut speed, mut force] = std::array::from_fn(|_| Spread::default());
        let mut on_fix = [Spread::default(), Spread::default()];
        for (x, motion) in &self.fixes {
            let old = |f: &dyn Fn(&[f64]) -> Vector3<f64>| known.map_or(Vector3::zeros(), f);
            gyro.take(&(effect.gyro(p, x) - old(&|k| effect.gyro(k, x))));
            accel.take(&(effect.accel(p, x) - old(&|k| effect.accel(k, x))));
            match data::added(effect.name(), p, x) {
                Some((data::Target::Position, added)) => on_fix[0].take(&added),
                Some((data::Target::Velocity, added)) => on_fix[1].take(&added),
                _ => {}
            }
            force.take(&motion.force);
            speed.take(&Vector3::new(motion.speed, 0.0, 0.0));
        }
        // About zero, not about the mean.
        let size_of = |s: &Spread| (s.square / s.n.max(1.0)).sqrt();
        let walk = effect.bias_walk(p);
        let aged_s = |p: &[f64]| effect.fix_delay_s(p, self.longest_s);
        let late_s = aged_s(p) - known.map_or(0.0, aged_s);
        let older_s = effect.velocity_delay_s(p) - known.map_or(0.0, |k| effect.velocity_delay_s(k));
        let moved =
            if effect.acts_on(ActsOn::Fixes) && late_s == 0.0 && data::definition(effect.name()).is_none() {
                let offsets = setting.parameters().zip(p).filter(|((_, unit), _)| unit.symbol == "m");
                offsets.map(|(_, v)| v * v).sum::<f64>().sqrt()
            } else {
                late_s.abs() * size_of(&speed)
            };
        Size {
            gyro: gyro.rms().max(self.walked(walk.gyro, 0)),
            accel: accel.rms().max(self.walked(walk.accel, 1)),
            position: moved.max(on_fix[0].rms()),
            // The force changes by about what the vehicle accelerates by.
            velocity: (older_s.abs() * force.rms()).max(on_fix[1].rms()),
            negligible: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects;

    /// Twelve minutes whose accelerometer biases have walked so far, m/s².
    fn flown(walked: f64, too_good: bool) -> Flown {
        Flown { fixes: Vec::new(), longest_s: 720.0, walked: [0.0, walked], too_good }
    }

    /// 27 mg/√h would lead 0.12 m/s² away in twelve minutes.
    #[test]
    fn a_walk_that_led_nowhere_is_negligible_where_fixes_are_too_good_to_be_true() {
        let drift = effects::find("accel_bias_drift").unwrap();
        let walk = EffectSetting::known(drift, &[27e-3 * 9.80665 / 60.0]).unwrap();
        let size = |walked: f64, too_good: bool| flown(walked, too_good).size(&walk, &Model::default());
        assert!(size(0.004, true).negligible);
        assert!(!size(0.1, true).negligible && !size(0.004, false).negligible);
        // Where nothing says how far it led, and where it led further, it is what a walk of that size can do.
        for walked in [0.0, 5.0] {
            assert!((size(walked, true).accel - 0.118).abs() < 1e-3, "{:?}", size(walked, true));
        }
    }
}
