//! The model: which effects are assumed to be present, with their values, and how noisy the sensors are.
//!
//! The simulation is what the model says: the simulator produces samples with it, the filter and the explanation
//! predict with it. In memory everything is SI; [`mod@file`] reads and writes `model.toml` with units in the names.

pub mod file;
mod ranges;
mod tolerances;

use crate::earth::STANDARD_GRAVITY;
use crate::effects::{self, Effect};
use crate::sample::{ImuSample, ImuStream, Quantisation, Steps};
use serde::{Deserialize, Serialize};

/// Noise and priors of the inertial unit, SI.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuModel {
    /// White noise of the gyros: N in rad/s/√Hz, so that angle variance grows as N²·t.
    pub gyro_noise: f64,
    /// White noise of the accelerometers: N in m/s²/√Hz.
    pub accel_noise: f64,
    /// Prior 1-sigma of the gyro bias, rad/s.
    pub gyro_bias_sigma: f64,
    /// Prior 1-sigma of the accelerometer bias, m/s².
    pub accel_bias_sigma: f64,
    /// Gyro bias where it is known or simulated, rad/s.
    pub gyro_bias: [f64; 3],
    /// Accelerometer bias where it is known or simulated, m/s².
    pub accel_bias: [f64; 3],
    /// What is assumed about the rounding of the source.
    pub quantisation: QuantisationBelief,
}

/// What the model says of integer samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", expecting = "enum Belief")]
pub enum QuantisationBelief {
    /// As the source message is known to be.
    #[default]
    Auto,
    /// Taken as they come.
    None,
    /// Rounded to the nearest.
    Round,
    /// Truncated toward zero.
    Truncate,
}

/// Noise of the fixes where they bring no figures of their own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "struct Gnss")]
pub struct GnssModel {
    /// 1-sigma north, east, down, m.
    pub position_sigma_m: [f64; 3],
    /// 1-sigma north, east, down, m/s.
    pub velocity_sigma_m_per_s: [f64; 3],
    /// Correlation time of position errors, s; 0 = white.
    pub position_correlation_s: f64,
    /// Stationary 1-sigma of the correlated part, m; the white part is `position_sigma_m`.
    #[serde(skip_serializing_if = "file::is_zero")]
    pub position_wander_sigma_m: [f64; 3],
    /// 1-sigma of the time stamps, s: autopilots stamp a fix when a loop finds it complete.
    pub time_sigma_s: f64,
}

impl Default for GnssModel {
    fn default() -> Self {
        Self {
            position_sigma_m: [1.5, 1.5, 2.5],
            velocity_sigma_m_per_s: [0.1, 0.1, 0.2],
            position_correlation_s: 0.0,
            position_wander_sigma_m: [0.0; 3],
            time_sigma_s: 0.0,
        }
    }
}

/// One effect with its assumed values, SI, one per parameter.
#[derive(Debug, Clone)]
pub struct EffectSetting {
    /// Which.
    pub effect: &'static dyn Effect,
    /// Known or prior values.
    pub values: Vec<f64>,
    /// Prior sigmas; a parameter with sigma 0 is known and not estimated.
    pub sigmas: Vec<f64>,
}

impl EffectSetting {
    /// An effect to be estimated from nothing: zero with the prior sigmas of its definition.
    pub fn unknown(effect: &'static dyn Effect) -> Self {
        let sigmas =
            effect.groups().iter().flat_map(|g| std::iter::repeat_n(g.prior_sigma, g.shape.len())).collect();
        Self { effect, values: vec![0.0; effect.len()], sigmas }
    }

    /// An effect of known size.
    ///
    /// # Errors
    /// When the number of values is not that of the effect's parameters.
    pub fn known(effect: &'static dyn Effect, values: &[f64]) -> Result<Self, ModelError> {
        if values.len() != effect.len() {
            return Err(ModelError::Count {
                effect: effect.name(),
                wanted: effect.len(),
                found: values.len(),
            });
        }
        Ok(Self { effect, values: values.to_vec(), sigmas: vec![0.0; values.len()] })
    }

    /// Names of the parameters with their groups' units, in order.
    pub fn parameters(&self) -> impl Iterator<Item = (&'static str, effects::Unit)> {
        self.effect.groups().iter().flat_map(|g| g.names.iter().map(|n| (*n, g.unit)))
    }

    /// The same with sigmas only where a filter can carry the parameter as a state; the others (instants, noise
    /// densities) become known values. That is what a model file can hold.
    #[must_use]
    pub fn for_filters(mut self) -> Self {
        let mut sigmas = vec![0.0; self.sigmas.len()];
        self.states().for_each(|k| sigmas[k] = self.sigmas[k]);
        self.sigmas = sigmas;
        self
    }

    /// Which of the parameters a filter can carry as states, in order.
    pub fn states(&self) -> impl Iterator<Item = usize> + use<> {
        let groups = self.effect.groups().iter();
        let carried = groups.flat_map(|g| std::iter::repeat_n(g.is_state(), g.shape.len()));
        carried.enumerate().filter(|(_, is)| *is).map(|(k, _)| k)
    }

    /// Number of parameters that are estimated.
    pub fn estimated(&self) -> usize {
        self.sigmas.iter().filter(|s| **s > 0.0).count()
    }
}

/// What is known of several constants together, where more is known than a sigma of each: a filter begins with it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointPrior {
    /// Short names of the states, for example `g11` and `bg_x`.
    pub names: Vec<String>,
    /// Their covariance, SI, row by row.
    pub covariance_si: Vec<Vec<f64>>,
    /// 1-sigma of each before anything was measured, SI: what it takes to call a state observable counts from there.
    pub unmeasured_si: Vec<f64>,
}

impl JointPrior {
    /// Whether it is a covariance of all its states.
    fn is_sound(&self) -> bool {
        let n = self.names.len();
        let rows = || self.covariance_si.iter();
        rows().len() == n
            && self.unmeasured_si.len() == n
            && self.unmeasured_si.iter().all(|s| s.is_finite())
            && rows().all(|row| row.len() == n && row.iter().all(|v| v.is_finite()))
            && (0..n).all(|i| self.covariance_si[i][i] > 0.0)
            && (0..n).all(|i| (0..n).all(|j| self.covariance_si[i][j] == self.covariance_si[j][i]))
    }
}

/// The whole model.
#[derive(Debug, Clone)]
pub struct Model {
    /// Inertial unit.
    pub imu: ImuModel,
    /// Fixes.
    pub gnss: GnssModel,
    /// Effects in the order in which their states stand in the filter.
    pub effects: Vec<EffectSetting>,
    /// Names of the effects that no user asked for: tolerances of the sensors ([`Model::with_tolerances`]).
    pub tolerances: Vec<&'static str>,
    /// What the unit's own file says of them together.
    pub joint: Option<Box<JointPrior>>,
}

impl Default for Model {
    /// Noise and priors of a consumer autopilot (FIELD_NOTES figures), and no effects.
    fn default() -> Self {
        Self {
            imu: ImuModel {
                gyro_noise: 0.01_f64.to_radians(),
                accel_noise: 0.006,
                gyro_bias_sigma: 0.5_f64.to_radians(),
                accel_bias_sigma: 0.2,
                gyro_bias: [0.0; 3],
                accel_bias: [0.0; 3],
                quantisation: QuantisationBelief::Auto,
            },
            gnss: GnssModel::default(),
            effects: Vec::new(),
            tolerances: Vec::new(),
            joint: None,
        }
    }
}

/// Number of elements of G that the filter estimates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GElements {
    /// None: the 15-state filter.
    None,
    /// The diagonal: 18 states (the paper, eq. 20).
    Diagonal,
    /// All nine: 24 states (the paper, eq. 24).
    Full,
}

impl Model {
    /// What `run`, `replay`, `plan` and `demo` assume by default: full G and the GNSS latency are estimated, in
    /// sensors with the tolerances of a consumer unit.
    pub fn standard() -> Self {
        Self::calibrated().with_tolerances()
    }

    /// The standard model for sensors without tolerances: scale factors, axes and the place of the antenna are exact.
    pub fn calibrated() -> Self {
        let mut model = Self::default().with_g(GElements::Full, None);
        // Real position errors are first-order Gauss-Markov: 1 to 2 m over tens of seconds (FIELD_NOTES). A filter that takes them for
        // white noise learns a heading and biases from them while the vehicle stands.
        model.gnss.position_correlation_s = 60.0;
        model.gnss.position_wander_sigma_m = [1.5, 1.5, 2.5];
        let mut latency = EffectSetting::unknown(&effects::GpsLatency);
        // u-blox receivers about 0.12 s, published flights 0.05 to 0.3 s (FIELD_NOTES).
        latency.values[0] = 0.12;
        latency.sigmas[0] = 0.08;
        model.set(latency);
        // On a vehicle vibration dominates, and samples are stamped when they are sent.
        model.imu.accel_noise = 0.015;
        model.imu.gyro_noise = 0.012_f64.to_radians();
        model.gnss.velocity_sigma_m_per_s = [0.08, 0.08, 0.2];
        // A fix is found complete by a loop of 20 to 50 Hz.
        model.gnss.time_sigma_s = 0.01;
        model
    }

    /// The same model with this many elements of G estimated, from zero, with a prior sigma in rad/s per m/s²
    /// (`None`: the effect's own).
    #[must_use]
    pub fn with_g(mut self, elements: GElements, prior_sigma: Option<f64>) -> Self {
        let mut setting = EffectSetting::unknown(&effects::GYRO_G_SENSITIVITY);
        for (k, sigma) in setting.sigmas.iter_mut().enumerate() {
            let estimated = match elements {
                GElements::None => false,
                GElements::Diagonal => k % 4 == 0,
                GElements::Full => true,
            };
            *sigma = if estimated { prior_sigma.unwrap_or(*sigma) } else { 0.0 };
        }
        self.remove(setting.effect.name());
        if elements != GElements::None {
            self.effects.insert(0, setting);
        }
        self
    }

    /// Puts an effect in, replacing one of the same name.
    pub fn set(&mut self, setting: EffectSetting) {
        self.tolerances.retain(|name| *name != setting.effect.name());
        match self.effects.iter_mut().find(|s| s.effect.name() == setting.effect.name()) {
            Some(old) => *old = setting,
            None => self.effects.push(setting),
        }
    }

    /// Takes an effect out.
    pub fn remove(&mut self, name: &str) {
        self.tolerances.retain(|n| *n != name);
        self.effects.retain(|s| s.effect.name() != name);
    }

    /// 1-sigma of a state before anything was measured, SI, where this model begins with `start`.
    pub fn unmeasured_sigma(&self, name: &str, start: f64) -> f64 {
        let own = self.joint.as_deref().and_then(|j| {
            let k = j.names.iter().position(|n| n == name)?;
            j.unmeasured_si.get(k).copied()
        });
        own.map_or(start, |sigma| sigma.max(start))
    }

    /// The same with nothing of what the unit's own file says but its values to begin from: every constant as uncertain as before anything
    /// was measured.
    #[must_use]
    pub fn forgetting_unit(mut self) -> Self {
        let Some(joint) = self.joint.take() else { return self };
        let unmeasured: std::collections::BTreeMap<_, _> =
            joint.names.iter().map(String::as_str).zip(joint.unmeasured_si.iter().copied()).collect();
        let of = |name: &str, sigma: f64| unmeasured.get(name).map_or(sigma, |s| s.max(sigma));
        self.imu.gyro_bias_sigma = of("bg_x", self.imu.gyro_bias_sigma);
        self.imu.accel_bias_sigma = of("ba_x", self.imu.accel_bias_sigma);
        for setting in &mut self.effects {
            let names: Vec<_> = setting.parameters().map(|(name, _)| name).collect();
            for (sigma, name) in setting.sigmas.iter_mut().zip(names).filter(|(sigma, _)| **sigma > 0.0) {
                *sigma = of(name, *sigma);
            }
        }
        self
    }

    /// The setting of this effect, if the model has it.
    pub fn get(&self, name: &str) -> Option<&EffectSetting> {
        self.effects.iter().find(|s| s.effect.name() == name)
    }

    /// The sample as it was before the faults of its source, if the model assumes any.
    pub fn undo_source(&self, sample: &ImuSample) -> ImuSample {
        let mut undone = *sample;
        for setting in self.effects.iter().rev().filter(|s| s.effect.is_source_mistake()) {
            [undone.gyro, undone.accel] = setting.effect.undo_source(&undone.gyro, &undone.accel);
        }
        undone
    }

    /// The same from a sample and those before; `None` where it adds no information. The last fault is undone first, and each
    /// sees what the one undone before it gave: as [`Effect::undo_sequence`] does with a whole
    /// flight.
    pub fn undo_source_after(&self, now: &ImuSample, before: &mut SourceHistory) -> Option<ImuSample> {
        let faults = self.effects.iter().rev().filter(|s| s.effect.is_source_mistake());
        let mut sample = *now;
        for (k, setting) in faults.enumerate() {
            if before.0.len() <= k {
                before.0.push(None);
            }
            let last = before.0[k].replace(sample);
            sample = setting.effect.undo_source_after(&sample, last.as_ref())?;
        }
        Some(sample)
    }

    /// How the samples of this stream are to be read: the belief of the model over what the source says.
    pub fn quantisation_of(&self, stream: &ImuStream) -> Quantisation {
        let steps = match stream.quantisation {
            Quantisation::None => Steps::RAW_IMU,
            Quantisation::Round(steps) | Quantisation::Truncate(steps) => steps,
        };
        if self.effects.iter().any(|s| s.effect.truncates_samples()) {
            return Quantisation::Truncate(steps);
        }
        match self.imu.quantisation {
            QuantisationBelief::Auto => stream.quantisation,
            QuantisationBelief::None => Quantisation::None,
            QuantisationBelief::Round => Quantisation::Round(steps),
            QuantisationBelief::Truncate => Quantisation::Truncate(steps),
        }
    }
}

/// The last sample before each fault of the source was undone.
#[derive(Debug, Clone, Default)]
pub struct SourceHistory(Vec<Option<ImuSample>>);

/// Why a model cannot be had.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// Not TOML, or a key that the contract does not have.
    #[error("{message}")]
    Syntax {
        /// What the parser said.
        message: String,
        /// Bytes of the source it is about.
        span: Option<std::ops::Range<usize>>,
    },
    /// Another schema.
    #[error("schema is \"{0}\", this program reads \"gaware.model/1\"")]
    Schema(String),
    /// An effect that does not exist.
    #[error("there is no effect \"{name}\"; known effects: {known}")]
    UnknownEffect {
        /// As written.
        name: String,
        /// The registry, comma separated.
        known: String,
    },
    /// A key an effect does not have.
    #[error("effect {effect} has no key \"{key}\"; it takes {wanted}")]
    UnknownKey {
        /// Effect.
        effect: &'static str,
        /// As written.
        key: String,
        /// The keys that exist.
        wanted: String,
    },
    /// A value that cannot be estimated is not given.
    #[error("effect {effect} needs {key}: it cannot be estimated in flight")]
    Missing {
        /// Effect.
        effect: &'static str,
        /// Key in the file.
        key: String,
    },
    /// Wrong number or layout of values.
    #[error("effect {effect} takes {wanted} values, {found} were given")]
    Count {
        /// Effect.
        effect: &'static str,
        /// Parameters it has.
        wanted: usize,
        /// Values given.
        found: usize,
    },
    /// A value outside what is physically possible.
    #[error("{key} = {value} is not usable: {reason}")]
    Value {
        /// Key in the file.
        key: String,
        /// As written.
        value: f64,
        /// Why.
        reason: String,
    },
}

/// 1 mg in m/s².
pub const MILLI_G: f64 = 1e-3 * STANDARD_GRAVITY;

#[cfg(test)]
mod tests {
    use crate::math::sin;

    use super::*;
    use crate::effects::ReportedSample;
    use nalgebra::Vector3;

    /// A swing as a source with these faults reports it.
    fn reported(faults: &[&str]) -> (Model, Vec<ImuSample>, Vec<ImuSample>) {
        let mut model = Model::default();
        for name in faults {
            model.set(EffectSetting::unknown(effects::find(name).unwrap()));
        }
        let mut before: Vec<Option<ReportedSample>> = vec![None; faults.len()];
        let (mut true_samples, mut samples) = (Vec::new(), Vec::new());
        for k in 0..200_u32 {
            let t_s = f64::from(k) * 0.02;
            let swing = |a: f64| Vector3::new(sin(0.9 * t_s + a), sin(0.8 * t_s), sin(0.5 * t_s - a));
            let sample =
                ImuSample { t_s, gyro: swing(0.3), accel: swing(-0.3) * 9.0, temperature_degc: None };
            let mut now = [sample.gyro, sample.accel];
            for (setting, before) in model.effects.iter().zip(&mut before) {
                let reported = setting.effect.source_after(now, before.as_ref());
                let count = before.map_or(0, |b| b.count) + 1;
                *before = Some(ReportedSample { raw: now, reported, count });
                now = reported;
            }
            true_samples.push(sample);
            samples.push(ImuSample { gyro: now[0], accel: now[1], ..sample });
        }
        (model, true_samples, samples)
    }

    #[test]
    fn two_faults_at_once_are_undone_alike_live_and_over_a_whole_flight() {
        for faults in [
            ["samples_repeated", "accel_x_reversed"],
            ["accel_x_reversed", "gyro_in_deg_per_s"],
            ["gyro_xy_swapped", "accel_in_g"],
            ["gyro_xz_swapped", "samples_repeated"],
        ] {
            let (model, true_samples, samples) = reported(&faults);
            let mut history = SourceHistory::default();
            let live: Vec<ImuSample> =
                samples.iter().filter_map(|s| model.undo_source_after(s, &mut history)).collect();
            let mut whole = samples.clone();
            for setting in model.effects.iter().rev() {
                whole = setting.effect.undo_sequence(&whole);
            }
            assert_eq!(live, whole, "{faults:?}");
            assert!(live.len() >= 99, "{faults:?}: {}", live.len());
            for s in &live[1..] {
                let truth = true_samples.iter().find(|t| t.t_s == s.t_s).unwrap();
                let off = (s.gyro - truth.gyro).amax().max((s.accel - truth.accel).amax());
                assert!(off < 1e-12, "{faults:?} at {}: {off}", s.t_s);
            }
        }
    }
}
