//! Where the estimates start: what the autopilot's parameters say of its receiver and its inertial unit.
//!
//! An autopilot's own log (`.bin`, `.ulg`) holds all parameters. Delay and antenna place that someone has set there are better first
//! values than those of any vehicle; their sigmas stay as they are, since it is not known how well they were measured.
//!
//! The latency of this program is relative to the inertial samples. ArduPilot's `IMU` samples went through a second-order Butterworth
//! low-pass (`INS_GYRO_FILTER`, `AP_InertialSensor/AP_InertialSensor_Backend.cpp:251`, `Filter/LowPassFilter2p.cpp`), whose delay at low
//! frequency is √2/(2π f); they are late themselves, so that the fixes seem less old. PX4's `sensor_combined` is not filtered
//! (`sensors/vehicle_imu/VehicleIMU.cpp`).

use super::on_board::OnBoard;
use super::rule::low_pass_delay_s;
use gaware_mission::item::Autopilot;
use gaware_nav::model::Model;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value};

/// Delays of a receiver that can be, s; ArduPilot takes 250 ms at most, PX4 300.
const DELAY_S: std::ops::RangeInclusive<f64> = 0.001..=0.5;
/// Distances on a vehicle that can be, m.
const DISTANCE_M: f64 = 20.0;
/// Cut-off frequencies that can be, Hz.
const CUT_OFF_HZ: std::ops::RangeInclusive<f64> = 1.0..=500.0;

/// A first value that comes from the autopilot's parameters.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Started {
    /// The effect.
    pub effect: &'static str,
    /// Its first values, in `unit`.
    pub values: Vec<f64>,
    /// Unit.
    pub unit: &'static str,
    /// The parameters that it comes from, with their values.
    pub parameters: Vec<String>,
    /// In words.
    pub text: String,
}

/// Sets the first values of a model, as far as the parameters give them; what was set, and what they leave open.
pub fn start(model: &mut Model, board: &OnBoard) -> Vec<Started> {
    let Some(autopilot) = board.autopilot else { return Vec::new() };
    let found = Found { board, used: Vec::new() };
    [latency(autopilot, found.clone()), lever_arm(autopilot, found)]
        .into_iter()
        .flatten()
        .filter(|started| set(model, started))
        .collect()
}

/// What a result says of its first values, in words.
pub fn texts(document: &Map<String, Value>) -> impl Iterator<Item = &str> {
    let started = document.get("started").and_then(Value::as_array);
    started.into_iter().flatten().filter_map(|s| s.get("text")?.as_str())
}

/// Sets the values; false where the model does not estimate the effect.
fn set(model: &mut Model, started: &Started) -> bool {
    let setting = model.effects.iter_mut().find(|s| s.effect.name() == started.effect);
    let Some(setting) = setting.filter(|s| s.estimated() > 0 && s.values.len() == started.values.len())
    else {
        return false;
    };
    setting.values.clone_from(&started.values);
    true
}

/// Parameters by name, with a list of those that were found.
#[derive(Clone)]
struct Found<'a> {
    board: &'a OnBoard,
    used: Vec<String>,
}

impl Found<'_> {
    /// The first of several names that is on board.
    fn one(&mut self, names: &[&str]) -> Option<f64> {
        let (name, value) = names.iter().find_map(|n| Some((n, *self.board.parameters.get(*n)?)))?;
        self.uses(name, value);
        Some(value)
    }

    /// Autopilots hold parameters as 32-bit numbers: more digits than those say nothing.
    fn uses(&mut self, name: &str, value: f64) {
        self.used.push(format!("{name} {}", value as f32));
    }

    /// A place on the vehicle, m; zero where none was set.
    fn place(&mut self, names: &[[&str; 3]]) -> [f64; 3] {
        let has = |triple: &&[&str; 3]| triple.iter().any(|n| self.board.parameters.contains_key(*n));
        let Some(triple) = names.iter().find(has) else { return [0.0; 3] };
        triple.map(|name| {
            let value = self.board.parameters.get(name).copied().filter(|v| v.abs() <= DISTANCE_M);
            let value = value.unwrap_or(0.0);
            if value != 0.0 {
                self.uses(name, value);
            }
            value
        })
    }
}

/// The delay of the fixes less that of the samples.
fn latency(autopilot: Autopilot, mut found: Found) -> Option<Started> {
    let delay_names: &[&str] = match autopilot {
        Autopilot::ArduPilot => &["GPS1_DELAY_MS", "GPS_DELAY_MS"],
        Autopilot::Px4 => &["SENS_GPS0_DELAY", "EKF2_GPS_DELAY"],
    };
    // 0 is "the driver's own" for ArduPilot, which no log holds.
    let delay_s = found.one(delay_names).map(|ms| ms * 1e-3).filter(|s| DELAY_S.contains(s))?;
    let filter_hz = match autopilot {
        Autopilot::ArduPilot => found.one(&["INS_GYRO_FILTER"]).filter(|hz| CUT_OFF_HZ.contains(hz)),
        Autopilot::Px4 => None,
    };
    let filter_s = filter_hz.map_or(0.0, low_pass_delay_s);
    let value = delay_s - filter_s;
    let less = filter_hz.map_or_else(String::new, |hz| {
        format!(" less the {:.0} ms that a low-pass at {hz} Hz delays the samples", filter_s * 1e3)
    });
    Some(Started {
        effect: "gps_latency",
        values: vec![value],
        unit: "s",
        text: format!("GNSS latency starts at {:.0} ms: {}{less}", value * 1e3, found.used.first()?),
        parameters: found.used,
    })
}

/// The antenna from the inertial unit.
fn lever_arm(autopilot: Autopilot, mut found: Found) -> Option<Started> {
    let (antenna, unit): (&[[&str; 3]], &[[&str; 3]]) = match autopilot {
        Autopilot::ArduPilot => (
            &[["GPS1_POS_X", "GPS1_POS_Y", "GPS1_POS_Z"], ["GPS_POS1_X", "GPS_POS1_Y", "GPS_POS1_Z"]],
            &[["INS_POS1_X", "INS_POS1_Y", "INS_POS1_Z"]],
        ),
        Autopilot::Px4 => (
            &[
                ["SENS_GPS0_OFFX", "SENS_GPS0_OFFY", "SENS_GPS0_OFFZ"],
                ["EKF2_GPS_POS_X", "EKF2_GPS_POS_Y", "EKF2_GPS_POS_Z"],
            ],
            &[["EKF2_IMU_POS_X", "EKF2_IMU_POS_Y", "EKF2_IMU_POS_Z"]],
        ),
    };
    let (antenna, unit) = (found.place(antenna), found.place(unit));
    if found.used.is_empty() {
        return None;
    }
    let values: Vec<f64> = antenna.iter().zip(unit).map(|(a, u)| a - u).collect();
    let words: Vec<String> = values.iter().map(|v| format!("{v:.2}")).collect();
    Some(Started {
        effect: "gps_lever_arm",
        unit: "m",
        text: format!(
            "antenna starts at {} m forward, right, down of the inertial unit: {}",
            words.join("/"),
            found.used.join(", ")
        ),
        values,
        parameters: found.used,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(autopilot: Autopilot, parameters: &[(&str, f64)]) -> OnBoard {
        let mut board = OnBoard { autopilot: Some(autopilot), ..OnBoard::default() };
        parameters.iter().for_each(|(name, value)| board.learn(name, *value));
        board
    }

    fn started(autopilot: Autopilot, parameters: &[(&str, f64)]) -> (Model, Vec<Started>) {
        let mut model = Model::standard();
        let started = start(&mut model, &board(autopilot, parameters));
        (model, started)
    }

    fn values(model: &Model, effect: &str) -> Vec<f64> {
        model.get(effect).map(|s| s.values.clone()).unwrap_or_default()
    }

    #[test]
    fn a_delay_that_was_set_is_the_first_latency_less_that_of_the_samples() {
        let (model, told) =
            started(Autopilot::ArduPilot, &[("GPS_DELAY_MS", 220.0), ("INS_GYRO_FILTER", 20.0)]);
        // 20 Hz: √2/(2π·20) = 11.25 ms.
        assert!((values(&model, "gps_latency")[0] - 0.208_75).abs() < 1e-5, "{told:?}");
        assert!(told[0].text.contains("209 ms") && told[0].text.contains("low-pass at 20 Hz"), "{told:?}");
        let (model, told) = started(Autopilot::Px4, &[("EKF2_GPS_DELAY", 150.0), ("IMU_GYRO_CUTOFF", 40.0)]);
        assert!((values(&model, "gps_latency")[0] - 0.15).abs() < 1e-9, "{told:?}");
        assert_eq!(told[0].parameters, ["EKF2_GPS_DELAY 150"]);
    }

    #[test]
    fn the_first_lever_arm_is_from_the_unit_to_the_antenna() {
        let parameters = [
            ("GPS1_POS_X", 1.2),
            ("GPS1_POS_Y", 0.0),
            ("GPS1_POS_Z", -0.3),
            ("INS_POS1_X", 0.2),
            ("INS_POS1_Y", -0.1),
        ];
        let (model, told) = started(Autopilot::ArduPilot, &parameters);
        let arm = values(&model, "gps_lever_arm");
        assert!(arm.iter().zip([1.0, 0.1, -0.3]).all(|(a, b)| (a - b).abs() < 1e-9), "{arm:?}");
        assert!(model.is_tolerance("gps_lever_arm"), "still no state that a flight is flown for");
        assert_eq!(told[0].parameters.len(), 4);
        // As an autopilot's 32 bits hold it.
        let (_, told) = started(Autopilot::ArduPilot, &[("INS_POS1_Z", f64::from(-0.12_f32))]);
        assert_eq!(told[0].parameters, ["INS_POS1_Z -0.12"]);
        // The sigmas are those of the standard model, and a model file keeps the values.
        let (read, standard) = (Model::from_toml(&model.to_toml()).unwrap(), Model::standard());
        assert_eq!(values(&read, "gps_lever_arm"), arm);
        let sigmas = |m: &Model| m.get("gps_lever_arm").map(|s| s.sigmas.clone());
        assert_eq!(sigmas(&model), sigmas(&standard));
    }

    #[test]
    fn what_nobody_has_set_or_nobody_can_mean_changes_nothing() {
        for parameters in [
            &[][..],
            &[("GPS_DELAY_MS", 0.0), ("INS_GYRO_FILTER", 20.0), ("GPS_POS1_X", 0.0)],
            &[("GPS_DELAY_MS", 4000.0), ("GPS_POS1_X", 400.0)],
            &[("GPS_DELAY_MS", -50.0)],
        ] {
            let (model, told) = started(Autopilot::ArduPilot, parameters);
            assert!(told.is_empty(), "{parameters:?}: {told:?}");
            assert_eq!(model.to_toml(), Model::standard().to_toml());
        }
    }

    #[test]
    fn a_model_that_knows_the_effect_keeps_its_value() {
        let mut model = Model::calibrated();
        let told = start(&mut model, &board(Autopilot::Px4, &[("EKF2_GPS_POS_X", 1.0)]));
        assert!(told.is_empty() && model.get("gps_lever_arm").is_none(), "{told:?}");
    }

    #[test]
    #[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
    fn recorded_logs_give_what_was_set_in_them() {
        let of = |name: &str| {
            let board = OnBoard::read(crate::testing::flights().join(name), None).unwrap();
            start(&mut Model::standard(), &board)
        };
        let px4 = of("real_px4_ekf_failure.ulg");
        assert_eq!(px4.len(), 1, "{px4:?}");
        assert_eq!((px4[0].effect, &px4[0].values[..]), ("gps_latency", &[0.11][..]));
        // 0 is the driver's own delay, and the place of the antenna was not measured.
        assert!(
            of("real_copter_sample.BIN").is_empty() && of("sitl_gsens_typical_dither_cut.BIN").is_empty()
        );
    }
}
