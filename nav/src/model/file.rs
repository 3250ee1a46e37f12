//! `model.toml`: reading and writing, with units in the names of the keys (design, section 3).

use super::ranges::{self, Range};
use super::{EffectSetting, GnssModel, Model, ModelError, QuantisationBelief};
use crate::effects::{self, Effect, ParameterGroup, Shape};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

const SCHEMA: &str = "gaware.model/1";

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    schema: String,
    #[serde(default, skip_serializing_if = "Tolerances::is_none")]
    tolerances: Tolerances,
    #[serde(default)]
    imu: Imu,
    #[serde(default)]
    gnss: GnssModel,
    #[serde(default, skip_serializing_if = "Table::is_empty")]
    effects: Table,
    /// What a unit's file says of several constants together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    joint: Option<Box<super::JointPrior>>,
}

/// Value for the effects with a tolerance that the file does not name.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Tolerances {
    /// Nothing: the file is the whole model.
    #[default]
    None,
    /// Those of a consumer unit, as in the standard model.
    Consumer,
}

impl Tolerances {
    fn is_none(&self) -> bool {
        *self == Self::None
    }
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Imu {
    gyro_noise_deg_per_s_per_rthz: f64,
    accel_noise_m_per_s2_per_rthz: f64,
    gyro_bias_sigma_deg_per_s: f64,
    accel_bias_sigma_m_per_s2: f64,
    #[serde(skip_serializing_if = "is_zero")]
    gyro_bias_deg_per_s: [f64; 3],
    #[serde(skip_serializing_if = "is_zero")]
    accel_bias_m_per_s2: [f64; 3],
    quantisation: QuantisationBelief,
}

/// Twelve significant digits: more than any sensor has, fewer than the noise of unit conversion.
fn tidy(v: f64) -> f64 {
    format!("{v:.11e}").parse().unwrap_or(v)
}

pub(super) fn is_zero(v: &[f64; 3]) -> bool {
    v.iter().all(|x| *x == 0.0)
}

impl Default for Imu {
    fn default() -> Self {
        Self::from(&Model::default().imu)
    }
}

impl From<&super::ImuModel> for Imu {
    fn from(m: &super::ImuModel) -> Self {
        Self {
            gyro_noise_deg_per_s_per_rthz: tidy(m.gyro_noise.to_degrees()),
            accel_noise_m_per_s2_per_rthz: tidy(m.accel_noise),
            gyro_bias_sigma_deg_per_s: tidy(m.gyro_bias_sigma.to_degrees()),
            accel_bias_sigma_m_per_s2: tidy(m.accel_bias_sigma),
            gyro_bias_deg_per_s: m.gyro_bias.map(|v| tidy(v.to_degrees())),
            accel_bias_m_per_s2: m.accel_bias.map(tidy),
            quantisation: m.quantisation,
        }
    }
}

impl GnssModel {
    fn tidy(&self) -> Self {
        Self {
            position_sigma_m: self.position_sigma_m.map(tidy),
            velocity_sigma_m_per_s: self.velocity_sigma_m_per_s.map(tidy),
            position_correlation_s: tidy(self.position_correlation_s),
            position_wander_sigma_m: self.position_wander_sigma_m.map(tidy),
            time_sigma_s: tidy(self.time_sigma_s),
        }
    }
}

impl Model {
    /// Reads `model.toml`. The file is the whole model: an effect that it does not name is not there. Only with
    /// `tolerances = "consumer"` those of a consumer unit are added, for each effect with a tolerance that the file does not
    /// name; one that it names is as the file says, tighter (`sigma_ppm = 300`), known (`value_m` alone) or off (`value_ppm = [0, 0, 0]`).
    ///
    /// # Errors
    /// Not TOML, unknown keys or effects, wrong counts, values that no sensor can have.
    ///
    /// # Examples
    /// ```
    /// let model = gaware_nav::model::Model::from_toml(
    ///     "schema = \"gaware.model/1\"\n[effects.gps_latency]\nvalue_s = 0.12\n",
    /// )?;
    /// assert_eq!(model.get("gps_latency").map(|s| s.values[0]), Some(0.12));
    /// # Ok::<(), gaware_nav::model::ModelError>(())
    /// ```
    pub fn from_toml(text: &str) -> Result<Self, ModelError> {
        let file: File = toml::from_str(text)
            .map_err(|e| ModelError::Syntax { message: e.message().to_owned(), span: e.span() })?;
        if file.schema != SCHEMA {
            return Err(ModelError::Schema(file.schema));
        }
        let mut model =
            Model { imu: imu_from_file(&file.imu)?, gnss: checked(file.gnss)?, ..Model::default() };
        for (name, value) in &file.effects {
            let effect = effects::find(name).ok_or_else(|| ModelError::UnknownEffect {
                name: name.clone(),
                known: effects::REGISTRY.iter().map(|e| e.name()).collect::<Vec<_>>().join(", "),
            })?;
            model.set(setting_from_toml(effect, value)?);
        }
        let mut model = match file.tolerances {
            Tolerances::None => model,
            Tolerances::Consumer => model.with_tolerances(),
        };
        if file.joint.as_ref().is_some_and(|joint| !joint.is_sound()) {
            let message =
                "[joint] holds no covariance of its states: a symmetric square of finite numbers".to_owned();
            return Err(ModelError::Syntax { message, span: None });
        }
        model.joint = file.joint;
        Ok(model)
    }

    /// Writes `model.toml`; reading it back gives the same model to the last digit printed.
    pub fn to_toml(&self) -> String {
        let tolerances = if self.tolerances.is_empty() { Tolerances::None } else { Tolerances::Consumer };
        let named = self.effects.iter().filter(|s| !self.is_unchanged_tolerance(s)).cloned();
        let off = (tolerances == Tolerances::Consumer).then(|| self.tolerances_left_out());
        let effects = named
            .chain(off.into_iter().flatten())
            .map(|s| (s.effect.name().to_owned(), setting_to_toml(&s)))
            .collect();
        let file = File {
            schema: SCHEMA.to_owned(),
            tolerances,
            imu: Imu::from(&self.imu),
            gnss: self.gnss.tidy(),
            effects,
            joint: self.joint.clone(),
        };
        toml::to_string(&file).unwrap_or_default()
    }
}

fn imu_from_file(f: &Imu) -> Result<super::ImuModel, ModelError> {
    for v in f.gyro_bias_deg_per_s {
        ranges::BIAS.check("gyro_bias_deg_per_s", v)?;
    }
    for v in f.accel_bias_m_per_s2 {
        ranges::BIAS.check("accel_bias_m_per_s2", v)?;
    }
    let sigma = |key, value| ranges::INERTIAL_SIGMA.check(key, value);
    Ok(super::ImuModel {
        gyro_noise: sigma("gyro_noise_deg_per_s_per_rthz", f.gyro_noise_deg_per_s_per_rthz)?.to_radians(),
        accel_noise: sigma("accel_noise_m_per_s2_per_rthz", f.accel_noise_m_per_s2_per_rthz)?,
        gyro_bias_sigma: sigma("gyro_bias_sigma_deg_per_s", f.gyro_bias_sigma_deg_per_s)?.to_radians(),
        accel_bias_sigma: sigma("accel_bias_sigma_m_per_s2", f.accel_bias_sigma_m_per_s2)?,
        gyro_bias: f.gyro_bias_deg_per_s.map(f64::to_radians),
        accel_bias: f.accel_bias_m_per_s2,
        quantisation: f.quantisation,
    })
}

/// Noise that fixes can have.
fn checked(f: GnssModel) -> Result<GnssModel, ModelError> {
    for v in f.position_sigma_m {
        ranges::FIX_SIGMA.check("position_sigma_m", v)?;
    }
    for v in f.velocity_sigma_m_per_s {
        ranges::FIX_SIGMA.check("velocity_sigma_m_per_s", v)?;
    }
    for v in f.position_wander_sigma_m {
        ranges::OPTIONAL_FIX_SIGMA.check("position_wander_sigma_m", v)?;
    }
    ranges::CORRELATION_S.check("position_correlation_s", f.position_correlation_s)?;
    ranges::STAMP_S.check("time_sigma_s", f.time_sigma_s)?;
    Ok(f)
}

fn setting_from_toml(effect: &'static dyn Effect, value: &Value) -> Result<EffectSetting, ModelError> {
    let empty = Table::new();
    let table = value.as_table().unwrap_or(&empty);
    let mut keys = Vec::new();
    let (mut values, mut sigmas) = (Vec::new(), Vec::new());
    let mut given = false;
    for group in effect.groups() {
        let (value_key, sigma_key) =
            (format!("value_{}", group.unit.suffix), format!("sigma_{}", group.unit.suffix));
        let read =
            |key: &str, range| table.get(key).map(|v| numbers(effect, group, v, key, range)).transpose();
        let v = read(&value_key, Range::of_value(group))?;
        let s = read(&sigma_key, Range::of_sigma(group))?;
        given |= v.is_some() || s.is_some();
        for sigma in s.iter().flatten() {
            if *sigma > 0.0 && !group.is_state() {
                return Err(ModelError::Value {
                    key: sigma_key,
                    value: *sigma / group.unit.si,
                    reason: "no filter can estimate this parameter; give its value alone".to_owned(),
                });
            }
        }
        values.extend(v.unwrap_or_else(|| vec![0.0; group.shape.len()]));
        sigmas.extend(s.unwrap_or_else(|| vec![0.0; group.shape.len()]));
        keys.extend([value_key, sigma_key]);
    }
    if let Some(key) = table.keys().find(|k| !keys.contains(k)) {
        let wanted = if keys.is_empty() { "no keys".to_owned() } else { keys.join(", ") };
        return Err(ModelError::UnknownKey { effect: effect.name(), key: key.clone(), wanted });
    }
    // An effect that is named without a value is to be estimated from nothing, where a filter can do that.
    if !given {
        return match effect.groups().iter().find(|g| !g.is_state()) {
            Some(group) => Err(ModelError::Missing {
                effect: effect.name(),
                key: format!("value_{}", group.unit.suffix),
            }),
            None => Ok(EffectSetting::unknown(effect)),
        };
    }
    Ok(EffectSetting { effect, values, sigmas })
}

/// The numbers of one group in SI, in the order of its parameters.
fn numbers(
    effect: &'static dyn Effect,
    group: &ParameterGroup,
    value: &Value,
    key: &str,
    range: Range,
) -> Result<Vec<f64>, ModelError> {
    let mut flat = Vec::new();
    flatten(value, &mut flat);
    let wanted = match group.shape {
        Shape::MatrixWithoutDiagonal => 9,
        shape => shape.len(),
    };
    if flat.len() != wanted {
        return Err(ModelError::Count { effect: effect.name(), wanted, found: flat.len() });
    }
    if group.shape == Shape::MatrixWithoutDiagonal {
        if let Some(v) = [0, 4, 8].iter().map(|i| flat[*i]).find(|v| *v != 0.0) {
            return Err(ModelError::Value {
                key: key.to_owned(),
                value: v,
                reason: "the diagonal must be zero".to_owned(),
            });
        }
        flat = (0..9).filter(|i| i % 4 != 0).map(|i| flat[i]).collect();
    }
    for v in &flat {
        range.check(key, *v)?;
    }
    Ok(flat.into_iter().map(|v| v * group.unit.si).collect())
}

fn flatten(value: &Value, out: &mut Vec<f64>) {
    match value {
        Value::Float(f) => out.push(*f),
        Value::Integer(i) => out.push(*i as f64),
        Value::Array(a) => a.iter().for_each(|v| flatten(v, out)),
        _ => out.push(f64::NAN),
    }
}

fn setting_to_toml(setting: &EffectSetting) -> Value {
    let mut table = Table::new();
    let mut at = 0;
    for group in setting.effect.groups() {
        let range = at..at + group.shape.len();
        at = range.end;
        let (values, sigmas) = (&setting.values[range.clone()], &setting.sigmas[range]);
        table.insert(format!("value_{}", group.unit.suffix), shaped(group, values));
        if sigmas.iter().any(|s| *s > 0.0) {
            table.insert(format!("sigma_{}", group.unit.suffix), shaped(group, sigmas));
        }
    }
    Value::Table(table)
}

fn shaped(group: &ParameterGroup, si: &[f64]) -> Value {
    let number = |v: f64| Value::Float(tidy(v / group.unit.si));
    let row = |r: &[f64]| Value::Array(r.iter().map(|v| number(*v)).collect());
    match group.shape {
        Shape::Scalar => number(si[0]),
        Shape::Vector | Shape::UpperTriangle | Shape::Symmetric => row(si),
        Shape::Matrix => Value::Array(si.chunks(3).map(row).collect()),
        Shape::MatrixWithoutDiagonal => Value::Array(vec![
            row(&[0.0, si[0], si[1]]),
            row(&[si[2], 0.0, si[3]]),
            row(&[si[4], si[5], 0.0]),
        ]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_survives_a_round_trip() {
        let mut model = Model::default();
        for effect in effects::REGISTRY.iter().chain([&effects::RECEIVER]) {
            let mut s = EffectSetting::unknown(*effect);
            for (k, v) in s.values.iter_mut().enumerate() {
                *v = s.sigmas[k] * (0.1 + k as f64);
            }
            model.set(s);
        }
        let text = model.to_toml();
        let back = Model::from_toml(&text).expect("own output");
        assert_eq!(back.to_toml(), text);
        assert_eq!(back.effects.len(), model.effects.len());
        for (a, b) in back.effects.iter().map(|a| (a, model.get(a.effect.name()).expect("same"))) {
            for (x, y) in a.values.iter().zip(&b.values) {
                assert!((x - y).abs() <= 1e-10 * y.abs(), "{}", a.effect.name());
            }
        }
    }

    #[test]
    fn what_an_explanation_estimates_is_written_so_that_it_can_be_read() {
        for effect in effects::REGISTRY.iter().chain([&effects::RECEIVER]) {
            let mut setting = EffectSetting::unknown(*effect);
            setting.values.iter_mut().zip(1..).for_each(|(v, k)| *v = f64::from(k));
            setting.sigmas.fill(0.1);
            let mut model = Model::default();
            model.set(setting.clone().for_filters());
            let back = Model::from_toml(&model.to_toml()).expect("own output");
            let read = back.get(effect.name()).expect("same");
            assert_eq!(read.values.len(), setting.values.len());
            assert_eq!(read.estimated(), EffectSetting::unknown(*effect).estimated(), "{}", effect.name());
        }
    }

    #[test]
    fn a_file_is_the_whole_model_unless_it_asks_for_tolerances() {
        let head = "schema = \"gaware.model/1\"\n";
        let effects = "[effects.gyro_g_sensitivity]\n[effects.gyro_scale_factor]\nsigma_ppm = [300, 300, 300]\n\
                       [effects.gps_lever_arm]\nvalue_m = [0, 0, 0]\n";
        let read = |text: &str| Model::from_toml(text).expect("a good file");
        assert_eq!(read(&format!("{head}{effects}")).effects.len(), 3);
        assert_eq!(read(&format!("{head}tolerances = \"none\"\n{effects}")).effects.len(), 3);
        let model = read(&format!("{head}tolerances = \"consumer\"\n{effects}"));
        let sigmas = |name: &str| model.get(name).map(|s| s.sigmas.clone());
        assert_eq!(sigmas("accel_scale_factor"), Some(vec![0.003; 3]));
        assert_eq!(sigmas("gps_lever_arm"), Some(vec![0.0; 3]));
        assert!(sigmas("gyro_scale_factor").is_some_and(|s| s.iter().all(|s| (s - 3e-4).abs() < 1e-12)));
        assert_eq!(model.effects.len(), 7);
        assert!(!model.is_tolerance("gyro_scale_factor") && model.is_tolerance("accel_scale_factor"));
        assert!(Model::from_toml(&format!("{head}tolerances = \"tactical\"")).is_err());
    }

    #[test]
    fn tolerances_survive_a_round_trip_and_drawn_or_removed_ones_are_named() {
        let back = |model: &Model| Model::from_toml(&model.to_toml()).expect("own output");
        let sigmas = |model: &Model, name: &str| model.get(name).map(|s| s.sigmas.clone());
        let standard = Model::standard();
        assert!(!standard.to_toml().contains("scale_factor"), "{}", standard.to_toml());
        let read = back(&standard);
        assert_eq!(read.tolerances, standard.tolerances);
        assert_eq!(sigmas(&read, "gyro_misalignment"), sigmas(&standard, "gyro_misalignment"));
        let mut drawn = Model::standard();
        drawn.effects.iter_mut().for_each(|s| s.values.fill(1e-3));
        drawn.remove("gps_lever_arm");
        let read = back(&drawn);
        for setting in &drawn.effects {
            let values = &read.get(setting.effect.name()).expect("same").values;
            assert!(values.iter().all(|v| (v - 1e-3).abs() < 1e-12), "{}", setting.effect.name());
        }
        assert_eq!(sigmas(&read, "gps_lever_arm").map(|s| s.iter().sum()), Some(0.0));
    }

    #[test]
    fn errors_of_a_file_are_named() {
        let error = |t: &str| Model::from_toml(t).expect_err("must be rejected").to_string();
        assert!(error("schema = \"gaware.model/2\"").contains("gaware.model/1"));
        let head = "schema = \"gaware.model/1\"\n";
        assert!(error(&format!("{head}[effects.gps_latincy]\nvalue_s = 1")).contains("gps_latency"));
        assert!(error(&format!("{head}[effects.gps_latency]\nvalue_ms = 1")).contains("value_s"));
        assert!(
            error(&format!("{head}[effects.gyro_scale_factor]\nvalue_ppm = [1, 2]")).contains("3 values")
        );
        assert!(error(&format!("{head}[imu]\ngyro_noise_deg_per_s_per_rthz = -1.0")).contains("positive"));
        let drift = error(&format!("{head}[effects.gyro_bias_drift]\n"));
        assert!(drift.contains("value_deg_per_h_per_rth"), "{drift}");
        assert!(error(&format!("{head}[effects.gps_bias_step]\n")).contains("value_s"));
        assert!(error(&format!("{head}[imu]\ngyro_nois = 1.0")).contains("gyro_nois"));
        let step = error(&format!("{head}[effects.gyro_bias_step]\nvalue_s = 40.0\nsigma_s = 1.0"));
        assert!(step.contains("sigma_s") && step.contains("value alone"), "{step}");
    }
}
