//! What the JSON schema of an explanation says of types whose crate knows no schemas.

use schemars::JsonSchema;

/// One figure of the noise.
#[derive(JsonSchema)]
#[allow(dead_code, reason = "describes `gaware_nav::identify::noise::NoiseEntry`")]
pub(super) struct NoiseFigure {
    /// `gyro`, `accel`, `gnss_position`, …
    name: String,
    /// Unit of the values.
    unit: String,
    /// As the model or the fixes have it.
    assumed: f64,
    /// As the flights have it.
    fitted: f64,
    /// 1-sigma of that.
    sigma: f64,
    /// Whether such a sensor can have it.
    plausible: bool,
    /// What it means where it cannot.
    finding: Option<String>,
}
