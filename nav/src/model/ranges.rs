//! Ranges of the numbers of `model.toml`: far wider than any sensor, and narrow enough that squares of them stay finite and apart from zero.

use super::ModelError;
use crate::effects::ParameterGroup;

/// Numbers between two limits, both included, and zero where it is allowed besides.
#[derive(Debug, Clone, Copy)]
pub(super) struct Range {
    from: f64,
    to: f64,
    zero: bool,
}

/// A density of noise, deg/s/√Hz or m/s²/√Hz, or the sigma of a bias, deg/s or m/s².
pub(super) const INERTIAL_SIGMA: Range = Range::between(1e-9, 1e3);
/// A bias, deg/s or m/s².
pub(super) const BIAS: Range = Range::up_to(1e3);
/// Sigma of a position, m, or velocity, m/s, of a fix.
pub(super) const FIX_SIGMA: Range = Range::between(1e-6, 1e6);
/// Sigma of an error of positions that is not there everywhere, m.
pub(super) const OPTIONAL_FIX_SIGMA: Range = Range { from: 0.0, zero: true, ..FIX_SIGMA };
/// Correlation time of positions, s; 0 for none.
pub(super) const CORRELATION_S: Range = Range { from: 0.0, to: 1e6, zero: true };
/// Jitter of stamps, s.
pub(super) const STAMP_S: Range = Range { from: 0.0, to: 10.0, zero: true };
/// Sigmas of an effect that a filter can estimate, in multiples of what is assumed where nothing is known; values up to the same.
const IN_PRIORS: (f64, f64) = (1e-9, 1e9);
/// An instant, s, or a random walk, in the units of the file.
const SET: Range = Range::up_to(1e9);

impl Range {
    const fn between(from: f64, to: f64) -> Self {
        Self { from, to, zero: false }
    }

    const fn up_to(to: f64) -> Self {
        Self { from: -to, to, zero: true }
    }

    /// Of a value of an effect, in the units of the file.
    pub(super) fn of_value(group: &ParameterGroup) -> Self {
        if !group.is_state() {
            return SET;
        }
        Self::up_to(IN_PRIORS.1 * group.prior_sigma / group.unit.si)
    }

    /// Of a sigma of an effect, in the units of the file; 0 is a known value.
    pub(super) fn of_sigma(group: &ParameterGroup) -> Self {
        let prior = if group.is_state() { group.prior_sigma / group.unit.si } else { 1.0 };
        Self { from: IN_PRIORS.0 * prior, to: IN_PRIORS.1 * prior, zero: true }
    }

    /// The number, where it is within the range.
    pub(super) fn check(self, key: &str, value: f64) -> Result<f64, ModelError> {
        let reason = if !value.is_finite() {
            "it must be a finite number".to_owned()
        } else if value < 0.0 && self.from >= 0.0 {
            if self.zero { "it must not be negative" } else { "it must be positive" }.to_owned()
        } else if value == 0.0 && !self.zero {
            "it must be positive".to_owned()
        } else if (self.from..=self.to).contains(&value) || self.zero && value == 0.0 {
            return Ok(value);
        } else {
            format!("it must lie between {} and {}", short(self.from), short(self.to))
        };
        Err(ModelError::Value { key: key.to_owned(), value, reason })
    }
}

/// Limits are round numbers in SI, not always in the units of the file.
fn short(v: f64) -> String {
    format!("{v:.3e}").parse::<f64>().unwrap_or(v).to_string()
}

#[cfg(test)]
mod tests {
    use crate::effects::REGISTRY;
    use crate::model::Model;

    #[test]
    fn numbers_that_no_sensor_has_are_refused_by_name() {
        let head = "schema = \"gaware.model/1\"\n";
        for (key, text) in [
            ("gyro_noise_deg_per_s_per_rthz", "[imu]\ngyro_noise_deg_per_s_per_rthz = 1e308"),
            ("gyro_noise_deg_per_s_per_rthz", "[imu]\ngyro_noise_deg_per_s_per_rthz = 1e-300"),
            ("accel_bias_sigma_m_per_s2", "[imu]\naccel_bias_sigma_m_per_s2 = 1e200"),
            ("accel_bias_m_per_s2", "[imu]\naccel_bias_m_per_s2 = [0.0, -1e160, 0.0]"),
            ("position_sigma_m", "[gnss]\nposition_sigma_m = [1e308, 1.0, 1.0]"),
            ("velocity_sigma_m_per_s", "[gnss]\nvelocity_sigma_m_per_s = [1.0, 1e-200, 1.0]"),
            ("position_correlation_s", "[gnss]\nposition_correlation_s = 1e300"),
            ("time_sigma_s", "[gnss]\ntime_sigma_s = 1e308"),
            ("value_s", "[effects.gps_latency]\nvalue_s = 1e308"),
            ("sigma_s", "[effects.gps_latency]\nvalue_s = 0.1\nsigma_s = 1e-200"),
            ("value_ppm", "[effects.gyro_scale_factor]\nvalue_ppm = [1e308, 0.0, 0.0]"),
            ("value_deg_per_h", "[effects.gyro_bias_step]\nvalue_s = 1.0\nvalue_deg_per_h = [1e308, 0, 0]"),
        ] {
            let error = Model::from_toml(&format!("{head}{text}\n")).expect_err(text).to_string();
            assert!(error.contains(key) && error.contains("it must"), "{text}: {error}");
        }
    }

    /// What the program itself assumes of an effect, and a thousandth of it, is within the range.
    #[test]
    fn priors_of_every_effect_are_accepted() {
        for &effect in REGISTRY {
            for factor in [1.0, 1e-3] {
                let mut setting = crate::model::EffectSetting::unknown(effect);
                setting.sigmas.iter_mut().for_each(|s| *s *= factor);
                let mut model = Model::default();
                model.set(setting);
                assert!(Model::from_toml(&model.to_toml()).is_ok(), "{}", effect.name());
            }
        }
    }
}
