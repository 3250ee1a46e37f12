//! What is known of one inertial unit (`unit.toml`, schema `gaware.unit/1`): values of its constants with their covariance, from which
//! hardware, firmware and day. A model takes them as priors, with what a turn-on does to biases and age to the rest.

mod ageing;
pub mod known;

use crate::inputs;
use crate::outputs::{OutputError, Outputs, mark};
use gaware_nav::consistency::departure;
use gaware_nav::effects::ActsOn;
use gaware_nav::filter::Filter;
use gaware_nav::filter::layout::index;
use gaware_nav::math::hypot;
use gaware_nav::model::{EffectSetting, JointPrior, Model};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const SCHEMA: &str = "gaware.unit/1";
/// What a turn-on may do to the biases, as a share of their prior sigma: as after a restart of the autopilot.
const TURN_ON: f64 = 0.1;
/// Two results of one unit that differ by more than so many of their sigmas contradict each other.
const CONTRADICTION: f64 = 4.0;
/// A correlation matrix may be this far from positive.
const ROUNDED: f64 = 1e-6;
/// A state that keeps more of its prior sigma than this has not been measured.
const MEASURED: f64 = 0.7;

/// Why a unit file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum UnitError {
    /// It cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// File.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is no unit file.
    #[error("{path} is no unit file: {reason}")]
    Syntax {
        /// File.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// It belongs to other hardware.
    #[error("{path} is of the unit {of}, and the vehicle has {has}: use the file of this unit")]
    Other {
        /// File.
        path: PathBuf,
        /// Hardware id in the file.
        of: String,
        /// That of the vehicle or log.
        has: String,
    },
    /// Recordings say something else.
    #[error(
        "the recordings disagree with {path} in {what}: measure the unit again, or check what has changed (warm-up, mounting, another sensor)"
    )]
    Contradicted {
        /// File.
        path: PathBuf,
        /// How many values.
        what: String,
    },
    /// A recording is in it.
    #[error("{log} is in {path} already, and would count twice: leave it out")]
    Again {
        /// File.
        path: PathBuf,
        /// Recording.
        log: String,
    },
    /// What a recording says is not to be believed.
    #[error("{log}: {why}; nothing was written (--force adds it all the same)")]
    Doubtful {
        /// Recording.
        log: String,
        /// Why.
        why: String,
    },
    /// Nothing was measured.
    #[error(
        "{0} shows nothing of the unit: turn it to six sides, each held still (gaware ground), or fly maneuvers"
    )]
    Nothing(String),
    /// It is not written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// One constant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitState {
    /// Short name, for example `g11`.
    pub name: String,
    /// Effect, or `gyro_bias`, `accel_bias`.
    pub effect: String,
    /// Unit of value and sigma.
    pub unit: String,
    /// Value.
    pub value: f64,
    /// 1-sigma.
    pub sigma: f64,
    /// 1-sigma before anything was measured.
    pub prior_sigma: f64,
}

/// Where the values come from.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Origin {
    /// Hardware id: `uid2` or `uid` of `AUTOPILOT_VERSION`, or the board's serial number of a log.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hardware_id: Option<String>,
    /// Firmware, as `ardupilot 4.6`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub firmware: Option<String>,
    /// Day, `2026-11-24`.
    pub date: String,
    /// Mean temperature of the unit, where its messages carry it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_degc: Option<f64>,
    /// Recordings and sessions, oldest first.
    pub from: Vec<String>,
    /// SHA-256 of the recordings.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sha256: Vec<String>,
    /// Parameters that name the sensors (`INS_GYR_ID`, `CAL_GYRO0_ID`).
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub sensor_ids: BTreeMap<String, f64>,
}

/// What is known of one unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Unit {
    schema: String,
    /// Lower triangle of the covariance of the states, row by row, in their units.
    pub covariance: Vec<Vec<f64>>,
    /// Where it comes from.
    pub origin: Origin,
    /// The constants.
    pub states: Vec<UnitState>,
}

/// The file of the unit with this hardware id in a folder of unit files: its newest, and none where the folder has none. Files that are no unit
/// files are passed over.
///
/// # Errors
/// The folder cannot be read.
pub fn find(folder: &Path, hardware_id: &str) -> Result<Option<PathBuf>, UnitError> {
    let wrong = |source| UnitError::Read { path: folder.to_owned(), source };
    let mut own: Vec<(String, PathBuf)> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(wrong)? {
        let path = entry.map_err(wrong)?.path();
        if path.extension().is_some_and(|e| e == "toml")
            && let Ok(unit) = Unit::read(&path)
            && unit.origin.hardware_id.as_deref() == Some(hardware_id)
        {
            own.push((unit.origin.date, path));
        }
    }
    Ok(own.into_iter().max().map(|(_, path)| path))
}

/// Where the file of the unit with this hardware id goes in a folder of unit files.
pub fn file_of(folder: &Path, hardware_id: &str) -> PathBuf {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    folder.join(format!("{}.toml", hardware_id.chars().map(plain).take(64).collect::<String>()))
}

impl Unit {
    /// What a filter knows of the sensors: their biases and every effect that acts on samples, without what a support that gave way has spoiled.
    pub fn of_filter(filter: &Filter, origin: Origin) -> Self {
        let model = filter.model();
        let spoilt = filter.spoilt_by_support();
        let names = filter.layout().names().iter().enumerate().map(|(k, n)| (index::GYRO_BIAS + k, n));
        let own = |effect: &str| {
            let acts = model.get(effect).is_some_and(|s| s.effect.acts_on(ActsOn::Samples));
            acts || effect.ends_with("_bias")
        };
        let kept: Vec<_> = names.filter(|(state, n)| !spoilt.contains(state) && own(n.effect)).collect();
        let states = kept.iter().map(|(state, n)| UnitState {
            name: n.name.to_owned(),
            effect: n.effect.to_owned(),
            unit: n.unit.symbol.to_owned(),
            value: filter.calibration().get(filter.layout(), *state) / n.unit.si,
            sigma: filter.covariance().sigma(*state) / n.unit.si,
            prior_sigma: filter.initial_sigmas().get(*state).copied().unwrap_or(0.0) / n.unit.si,
        });
        let row = |a: usize| {
            let (i, n) = kept[a];
            let with = kept.iter().take(a + 1);
            with.map(|(j, m)| filter.covariance().at(i, *j) / (n.unit.si * m.unit.si)).collect()
        };
        Self {
            schema: SCHEMA.to_owned(),
            covariance: (0..kept.len()).map(row).collect(),
            origin,
            states: states.collect(),
        }
    }

    /// Reads a unit file.
    ///
    /// # Errors
    /// It cannot be read, or is none.
    pub fn read(path: &Path) -> Result<Self, UnitError> {
        let text = inputs::text(path).map_err(|source| UnitError::Read { path: path.to_owned(), source })?;
        Self::parse(&text).map_err(|reason| UnitError::Syntax { path: path.to_owned(), reason })
    }

    /// Whether a text is meant as such a file: it names the schema, of whatever version.
    pub fn is_one(text: &str) -> bool {
        text.contains("gaware.unit/")
    }

    /// The content of a unit file.
    ///
    /// # Errors
    /// Why it is none.
    pub fn parse(text: &str) -> Result<Self, String> {
        let unit: Self = toml::from_str(text).map_err(|e| e.message().to_owned())?;
        if unit.schema != SCHEMA {
            return Err(format!("its schema is {:?}, not {SCHEMA:?}", unit.schema));
        }
        let sound = |s: &UnitState| s.value.is_finite() && s.sigma.is_finite() && s.sigma > 0.0;
        if let Some(wrong) = unit.states.iter().find(|s| !sound(s)) {
            return Err(format!("{} has no finite value with a positive sigma", wrong.name));
        }
        for (k, state) in unit.states.iter().enumerate() {
            if unit.states.iter().take(k).any(|s| s.name == state.name) {
                return Err(format!("{} stands in it twice", state.name));
            }
            // Values are read in the units of the catalogue: another one would be another value.
            if let Some(own) = unit_of(state).filter(|own| *own != state.unit) {
                return Err(format!("{} is given in {:?}, and must be in {own:?}", state.name, state.unit));
            }
        }
        let rows = unit.covariance.iter().enumerate().all(|(k, row)| row.len() == k + 1);
        if !rows || unit.covariance.len() != unit.states.len() {
            return Err("its covariance is not a lower triangle with a row for each state".to_owned());
        }
        let n = unit.states.len();
        let correlations = DMatrix::from_fn(n, n, |i, j| unit.correlation(i, j));
        // Entries are written with all digits; what rounding leaves of a state that is known through others is no error of the file.
        if unit.covariance.iter().enumerate().any(|(k, row)| row[k].is_nan() || row[k] <= 0.0)
            || (correlations + DMatrix::identity(n, n) * ROUNDED).cholesky().is_none()
        {
            return Err("its covariance is none: it is not positive".to_owned());
        }
        if unit.origin.date.len() > 10 || ageing::days(&unit.origin.date).is_none() {
            return Err(format!("{:?} is no date as in 2026-11-24", unit.origin.date));
        }
        Ok(unit)
    }

    /// As a file.
    pub fn to_toml(&self) -> String {
        mark::text(toml::to_string(self).unwrap_or_default(), mark::Style::Hash)
    }

    /// Writes it.
    ///
    /// # Errors
    /// It may not be written there.
    pub fn write(&self, path: &Path, outputs: &Outputs) -> Result<(), UnitError> {
        Ok(outputs.write(path, self.to_toml())?)
    }

    /// A result that began from this earlier one: what was known before anything was measured, and where all of it comes from.
    #[must_use]
    pub fn after(mut self, before: &Self) -> Self {
        for state in &mut self.states {
            state.prior_sigma = before.get(&state.name).map_or(state.prior_sigma, |s| s.prior_sigma);
        }
        let Origin { hardware_id, firmware, sensor_ids, from, sha256, .. } = &before.origin;
        let own = &mut self.origin;
        own.from = from.iter().chain(&own.from).cloned().collect();
        own.sha256 = sha256.iter().chain(&own.sha256).cloned().collect();
        own.hardware_id = own.hardware_id.take().or_else(|| hardware_id.clone());
        own.firmware = own.firmware.take().or_else(|| firmware.clone());
        if own.sensor_ids.is_empty() {
            own.sensor_ids.clone_from(sensor_ids);
        }
        self
    }

    /// The state of this name.
    pub fn get(&self, name: &str) -> Option<&UnitState> {
        self.states.iter().find(|s| s.name == name)
    }

    /// Names of the states that were measured.
    pub fn measured(&self) -> Vec<&str> {
        let measured = |s: &&UnitState| s.sigma < MEASURED * s.prior_sigma;
        self.states.iter().filter(measured).map(|s| s.name.as_str()).collect()
    }

    /// Sigma of a state after so many days and a turn-on.
    fn aged(state: &UnitState, days: f64) -> f64 {
        let more = if state.effect.ends_with("_bias") {
            TURN_ON * state.prior_sigma
        } else {
            ageing::walk(days) * state.prior_sigma
        };
        hypot(state.sigma, more).min(state.prior_sigma.max(state.sigma))
    }

    /// What age makes of the sigmas of G on this day, in words; nothing where that is less than half of them.
    fn aged_words(&self, today: &str) -> Option<String> {
        let days = ageing::between(&self.origin.date, today);
        let own = self.states.iter().filter(|s| s.effect == "gyro_g_sensitivity");
        let largest = |of: &dyn Fn(&UnitState) -> f64| own.clone().map(of).fold(0.0, f64::max);
        let (then, now) = (largest(&|s| s.sigma), largest(&|s| Self::aged(s, days)));
        (now > 1.5 * then).then(|| {
            format!("{days:.0} days later G counts as known to ± {now:.0} deg/h/g instead of ± {then:.0}")
        })
    }

    /// Makes the values priors of this model, as they are so many days later. What the model takes for known stays so.
    pub fn apply(&self, model: &mut Model, today: &str) {
        let days = ageing::between(&self.origin.date, today);
        for (effect, unit, values, sigma) in [
            ("gyro_bias", unit_si("deg/h"), &mut model.imu.gyro_bias, &mut model.imu.gyro_bias_sigma),
            ("accel_bias", unit_si("mg"), &mut model.imu.accel_bias, &mut model.imu.accel_bias_sigma),
        ] {
            let mut largest: f64 = 0.0;
            let own = self.states.iter().filter(|s| s.effect == effect);
            for (value, state) in values.iter_mut().zip(own) {
                *value = state.value * unit;
                largest = largest.max(Self::aged(state, days) * unit);
            }
            if largest > 0.0 {
                *sigma = largest.min(*sigma);
            }
        }
        let known: Vec<String> = model.effects.iter().map(|s| s.effect.name().to_owned()).collect();
        for name in known {
            let Some(setting) = model.get(&name).cloned() else { continue };
            if setting.effect.acts_on(ActsOn::Samples) {
                self.apply_effect(setting, model, days);
            }
        }
        model.joint = Some(Box::new(self.joint(model, days)));
    }

    /// What is known of all states together that a filter with this model estimates: the correlations of the file with the sigmas of so many
    /// days later, since what turn-ons and ageing add is independent.
    fn joint(&self, model: &Model, days: f64) -> JointPrior {
        let estimated = |s: &UnitState| {
            let of = |setting: &EffectSetting| {
                let mut names = setting.parameters().zip(&setting.sigmas);
                names.any(|((name, _), sigma)| name == s.name && *sigma > 0.0)
            };
            s.effect.ends_with("_bias") || model.get(&s.effect).is_some_and(of)
        };
        let own: Vec<_> = self.states.iter().enumerate().filter(|(_, s)| estimated(s)).collect();
        let si = |s: &UnitState| {
            let setting = model.get(&s.effect);
            let of = setting.and_then(|e| e.parameters().find(|(name, _)| *name == s.name));
            of.map_or_else(|| unit_si(&s.unit), |(_, unit)| unit.si)
        };
        let entry = |(i, a): &(usize, &UnitState), (j, b): &(usize, &UnitState)| {
            let kept = if i == j {
                Self::aged(a, days).powi(2)
            } else {
                self.correlation(*i, *j) * (a.sigma * b.sigma)
            };
            // Symmetric to the last digit: a recording whose model is not cannot be replayed.
            kept * (si(a) * si(b))
        };
        JointPrior {
            unmeasured_si: own.iter().map(|(_, s)| s.prior_sigma * si(s)).collect(),
            names: own.iter().map(|(_, s)| s.name.clone()).collect(),
            covariance_si: own.iter().map(|a| own.iter().map(|b| entry(a, b)).collect()).collect(),
        }
    }

    /// Of two states, by the file.
    fn correlation(&self, i: usize, j: usize) -> f64 {
        let at =
            |i: usize, j: usize| self.covariance.get(i.max(j)).and_then(|row| row.get(i.min(j))).copied();
        let of = |i: usize, j: usize| Some(at(i, j)? / (at(i, i)? * at(j, j)?).sqrt());
        of(i, j).filter(|c| c.is_finite()).unwrap_or(0.0)
    }

    fn apply_effect(&self, mut setting: EffectSetting, model: &mut Model, days: f64) {
        let mut changed = false;
        let parameters: Vec<_> = setting.parameters().collect();
        for (k, (name, unit)) in parameters.into_iter().enumerate() {
            let Some(state) = self.get(name).filter(|s| s.effect == setting.effect.name()) else { continue };
            if setting.sigmas[k] > 0.0 {
                setting.values[k] = state.value * unit.si;
                setting.sigmas[k] = Self::aged(state, days) * unit.si;
                changed = true;
            }
        }
        if !changed {
            return;
        }
        // A tolerance with a prior is a tolerance still: no flight is flown for its sake.
        let tolerances = model.tolerances.clone();
        model.set(setting);
        model.tolerances = tolerances;
    }

    /// Where another result of the same unit, measured by itself, contradicts this one, in words.
    pub fn contradictions(&self, other: &Self) -> Vec<String> {
        let days = ageing::between(&self.origin.date, &other.origin.date);
        let compare = |s: &UnitState| {
            let new = other.get(&s.name)?;
            let sigma = hypot(Self::aged(s, days), new.sigma);
            let off = (new.value - s.value) / sigma;
            (off.abs() > CONTRADICTION).then(|| {
                format!(
                    "{}: {} {}, now {}: {:.1} sigma apart",
                    s.name,
                    crate::figures::with_sigma(s.value, s.sigma),
                    s.unit,
                    crate::figures::with_sigma(new.value, new.sigma),
                    off.abs()
                )
            })
        };
        self.states.iter().filter_map(compare).collect()
    }

    /// Where what recordings show of a model that began from this file contradicts it, in words: an estimate that began from a value lies from it by
    /// the root of what its variance has lost since.
    pub fn contradicted_by(&self, before: &Model, after: &Model) -> Option<String> {
        let mut said = Vec::new();
        for old in before.effects.iter().filter(|s| s.effect.acts_on(ActsOn::Samples)) {
            let Some(new) = after.get(old.effect.name()) else { continue };
            for (k, (name, unit)) in old.parameters().enumerate() {
                let (sigma, left) = (old.sigmas[k], new.sigmas[k]);
                if self.get(name).is_none() || sigma <= 0.0 {
                    continue;
                }
                let off = departure(new.values[k] - old.values[k], sigma.powi(2), left.powi(2));
                if off > CONTRADICTION {
                    let figure =
                        |value: f64, sigma: f64| crate::figures::with_sigma(value / unit.si, sigma / unit.si);
                    said.push(format!(
                        "{name}: {} {}, now {}: {off:.1} sigma apart",
                        figure(old.values[k], sigma),
                        unit.symbol,
                        figure(new.values[k], left)
                    ));
                }
            }
        }
        (!said.is_empty()).then(|| said.join("; "))
    }

    /// Whether this file may be used for hardware with this id.
    ///
    /// # Errors
    /// Both are known and differ.
    pub fn check_hardware(&self, path: &Path, id: Option<&str>) -> Result<(), UnitError> {
        match (&self.origin.hardware_id, id) {
            (Some(of), Some(has)) if of != has => {
                Err(UnitError::Other { path: path.to_owned(), of: of.clone(), has: has.to_owned() })
            }
            _ => Ok(()),
        }
    }
}

/// The unit that a state of a bias or of an effect of the catalogue has.
fn unit_of(state: &UnitState) -> Option<&'static str> {
    use gaware_nav::effects::unit::{DEG_PER_H, MG};
    match state.effect.as_str() {
        "gyro_bias" => Some(DEG_PER_H.symbol),
        "accel_bias" => Some(MG.symbol),
        name => {
            let setting = EffectSetting::unknown(gaware_nav::effects::find(name)?);
            setting.parameters().find(|(own, _)| *own == state.name).map(|(_, unit)| unit.symbol)
        }
    }
}

/// The SI value of a unit of biases.
fn unit_si(symbol: &str) -> f64 {
    use gaware_nav::effects::unit::{DEG_PER_H, MG};
    if symbol == DEG_PER_H.symbol { DEG_PER_H.si } else { MG.si }
}

#[cfg(test)]
mod tests;
