//! The vehicle of a loop: a consumer unit with biases of its own and one error that a parameter of its autopilot corrects.

use gaware_mission::item::Autopilot as Firmware;
use gaware_nav::effects::{ACCEL_SCALE_FACTOR, Effect, GpsLatency, GpsLeverArm};
use gaware_nav::model::{EffectSetting, Model};
use gaware_sitl::noise::{Noise, Purpose};
use gaware_sitl::sensors::draw_vehicle;
use serde::Serialize;

/// Delay of a fix that the firmware assumes by default, s: the driver's of ArduPilot, `EKF2_GPS_DELAY` of PX4.
const USUAL_DELAY_S: [f64; 2] = [0.120, 0.110];
/// Delay that is injected, s: clear of the default, within the range of the parameter.
const DELAY_S: [(f64, f64); 2] = [(0.20, 0.24), (0.20, 0.28)];
/// Place of the antenna from the inertial unit: forward, right, down, m, either side.
const LEVER_M: [(f64, f64); 3] = [(0.5, 1.2), (0.3, 0.8), (0.2, 0.6)];
/// Scale factor error of an accelerometer that was never calibrated (TDK MPU-6000 data sheet, PS-MPU-6000A-00, section 6.2: ±3 %).
const SCALE: (f64, f64) = (0.02, 0.035);
/// Accelerometer bias of a unit whose offsets were calibrated, m/s².
const ACCEL_BIAS_SIGMA_M_PER_S2: f64 = 0.05;
/// Velocity noise of the receiver north, east, down, m/s (u-blox specifies 0.05 m/s for its M8 to M10).
const VELOCITY_SIGMA_M_PER_S: [f64; 3] = [0.05, 0.05, 0.07];

/// An effect that a parameter of both autopilots corrects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum Correctable {
    /// Fixes are older than the autopilot assumes.
    GpsLatency,
    /// The antenna is not where the autopilot assumes it.
    GpsLeverArm,
    /// The accelerometers were never calibrated.
    AccelScaleFactor,
}

impl Correctable {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::GpsLatency, Self::GpsLeverArm, Self::AccelScaleFactor];

    fn effect(self) -> &'static dyn Effect {
        match self {
            Self::GpsLatency => &GpsLatency,
            Self::GpsLeverArm => &GpsLeverArm,
            Self::AccelScaleFactor => &ACCEL_SCALE_FACTOR,
        }
    }

    /// Its name in models and reports.
    pub fn name(self) -> &'static str {
        self.effect().name()
    }
}

/// The vehicle of a seed.
pub fn vehicle(effect: Correctable, firmware: Firmware, seed: u64) -> Model {
    let mut base = Model::calibrated();
    base.effects.clear();
    base.imu.accel_bias_sigma = ACCEL_BIAS_SIGMA_M_PER_S2;
    base.gnss.velocity_sigma_m_per_s = VELOCITY_SIGMA_M_PER_S;
    let mut truth = draw_vehicle(&base, seed);
    let mut noise = Noise::numbered(seed, Purpose::HiddenTruth, 17);
    let mut between = |(low, high): (f64, f64)| low + (high - low) * noise.uniform();
    let px4 = usize::from(firmware == Firmware::Px4);
    let (mut delay_s, mut other) = (USUAL_DELAY_S[px4], Vec::new());
    match effect {
        Correctable::GpsLatency => delay_s = between(DELAY_S[px4]),
        Correctable::GpsLeverArm => other = LEVER_M.map(&mut between).to_vec(),
        Correctable::AccelScaleFactor => other = [SCALE; 3].map(&mut between).to_vec(),
    }
    for value in &mut other {
        // Either side.
        *value = value.copysign(between((-1.0, 1.0)));
    }
    truth.set(exactly(&GpsLatency, &[delay_s]));
    if !other.is_empty() {
        truth.set(exactly(effect.effect(), &other));
    }
    truth
}

fn exactly(effect: &'static dyn Effect, values: &[f64]) -> EffectSetting {
    let mut setting = EffectSetting::unknown(effect);
    setting.values = values.to_vec();
    setting.sigmas = vec![0.0; values.len()];
    setting
}
