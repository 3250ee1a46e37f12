//! Named scenarios: a flight with its sensors and the model that is true in it.

use crate::sensors::{Flight, SensorConfig, VibrationLine};
use crate::trajectory::bench::Bench;
use crate::trajectory::fixed_wing::FixedWing;
use crate::trajectory::hand::Hand;
use crate::trajectory::multirotor::Multirotor;
use crate::trajectory::paper::Paper;
use crate::trajectory::{Flown, Scripted};
use crate::truth::Trajectory;
use crate::vehicle::VehicleConfig;
use gaware_nav::effects::{self, unit};
use gaware_nav::model::{EffectSetting, GnssModel, ImuModel, MILLI_G, Model, ModelError};
use gaware_nav::sample::{Quantisation, Steps};

/// What flies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Airframe {
    /// An aircraft.
    FixedWing,
    /// A multirotor.
    Multirotor,
}

/// A flight with its sensors and the model that is true in it.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Name on the command line.
    pub name: &'static str,
    /// One line for people.
    pub description: &'static str,
    /// What flies.
    pub airframe: Airframe,
    /// The truth about the sensors: values are simulated, sigmas are the prior of a filter that does not know them.
    pub model: Model,
    /// Rates and habits.
    pub sensors: SensorConfig,
    /// A vehicle that waits for a mission; `trajectory` then only stands where it starts.
    pub vehicle: Option<VehicleConfig>,
    /// Whether people turn it by hand on the ground: it is not armed.
    pub by_hand: bool,
    trajectory: Flown,
}

impl Scenario {
    /// The trajectory; copies share the integrated path.
    pub fn trajectory(&self) -> Box<dyn Trajectory> {
        Box::new(self.trajectory.clone())
    }

    /// The same flight so many times in a row, each with take-off and landing; `None` where it does not end at rest.
    #[must_use]
    pub fn repeated(self, times: u32) -> Option<Self> {
        let wing = |profile: FixedWing| Flown::new(profile.landed().repeated(times));
        let trajectory = match self.name {
            "fixed_wing" => wing(FixedWing::new(true)),
            "fixed_wing_coordinated" => wing(FixedWing::new(false)),
            "fixed_wing_gusts" => wing(gusty()),
            "multirotor" => Flown::new(Multirotor::new().repeated(times)),
            _ => return None,
        };
        Some(Self { trajectory, ..self })
    }

    /// The flight as its sensors report it.
    pub fn flight(&self, seed: u64) -> Flight {
        Flight::new(self.trajectory(), &self.model, self.sensors.clone(), seed)
    }
}

/// An injected effect that cannot be had.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InjectError {
    /// The model refuses it.
    #[error("cannot inject {text}: {source}")]
    Model {
        /// As written.
        text: String,
        /// Why.
        source: ModelError,
    },
    /// A value per group of parameters is needed.
    #[error("cannot inject {text}: {effect} takes {wanted}")]
    Groups {
        /// As written.
        text: String,
        /// Which effect.
        effect: &'static str,
        /// What it takes.
        wanted: String,
    },
}

/// Puts an effect into the truth: `EFFECT=VALUE` with the value as in a model file (`gps_latency=0.3`,
/// `gps_lever_arm=[0.3,0,-0.1]`), several kinds of values apart by `;` (`gps_bias_step=40;5`), and the name alone for an
/// effect without parameters.
///
/// # Errors
/// When there is no such effect or the values do not fit it.
pub fn inject(model: &mut Model, text: &str) -> Result<(), InjectError> {
    let wrong = |source| InjectError::Model { text: text.into(), source };
    let (name, value) = text.split_once('=').unwrap_or((text, ""));
    let name = name.trim();
    // The model file knows names, layouts, units and limits; the argument becomes one.
    let mut file = format!("schema = \"gaware.model/1\"\n[effects.{name:?}]\n");
    if let Some(effect) = effects::find(name) {
        let values: Vec<&str> = value.split(';').filter(|v| !v.trim().is_empty()).collect();
        let groups = effect.groups();
        if values.len() != groups.len() {
            let units: Vec<&str> = groups.iter().map(|g| g.unit.symbol).collect();
            let wanted =
                if units.is_empty() { "no value".into() } else { format!("values in {}", units.join("; ")) };
            return Err(InjectError::Groups { text: text.into(), effect: effect.name(), wanted });
        }
        for (group, value) in groups.iter().zip(values) {
            file.push_str(&format!("value_{} = {value}\n", group.unit.suffix));
        }
    }
    for setting in Model::from_toml(&file).map_err(wrong)?.effects {
        model.set(setting);
    }
    Ok(())
}

type Builder = fn() -> Scenario;

/// Every scenario, by name.
const REGISTRY: &[(&str, Builder)] = &[
    ("paper", paper),
    ("fixed_wing", fixed_wing),
    ("fixed_wing_coordinated", fixed_wing_coordinated),
    ("fixed_wing_gusts", fixed_wing_gusts),
    ("multirotor", multirotor),
    ("bench", bench),
    ("bench_vibration", bench_vibration),
    ("hand", hand),
    ("hand_mistakes", hand_mistakes),
    ("mission_fixed_wing", mission_fixed_wing),
    ("mission_multirotor", mission_multirotor),
];

/// Names of all scenarios.
pub fn names() -> impl Iterator<Item = &'static str> {
    REGISTRY.iter().map(|(name, _)| *name)
}

/// The scenario of this name.
pub fn scenario(name: &str) -> Option<Scenario> {
    REGISTRY.iter().find(|(n, _)| *n == name).map(|(_, build)| build())
}

/// The paper's flight, section 4, with the figures of its sensors.
fn paper() -> Scenario {
    const IMU_RATE_HZ: f64 = 200.0;
    let g = 10.0 * unit::DEG_PER_H_PER_G.si;
    let mut model = Model {
        imu: ImuModel {
            // The paper gives noise per sample.
            gyro_noise: 0.0028f64.to_radians() / IMU_RATE_HZ.sqrt(),
            accel_noise: 0.001 / IMU_RATE_HZ.sqrt(),
            gyro_bias_sigma: 100.0 * unit::DEG_PER_H.si,
            accel_bias_sigma: 2.0 * MILLI_G,
            gyro_bias: [50.0 * unit::DEG_PER_H.si; 3],
            accel_bias: [MILLI_G; 3],
            ..Model::default().imu
        },
        gnss: GnssModel {
            position_sigma_m: [5.0; 3],
            velocity_sigma_m_per_s: [0.5; 3],
            position_correlation_s: 0.0,
            position_wander_sigma_m: [0.0; 3],
            time_sigma_s: 0.0,
        },
        ..Model::default()
    };
    model.effects.push(EffectSetting {
        effect: &effects::GYRO_G_SENSITIVITY,
        values: vec![g, 0.0, 0.0, 0.0, g, 0.0, 0.0, 0.0, g],
        sigmas: vec![0.0; 9],
    });
    Scenario {
        name: "paper",
        description: "the paper's flight: 70 s, up to 80 g to the right (Fan et al. 2014, section 4)",
        airframe: Airframe::FixedWing,
        model,
        sensors: SensorConfig {
            imu_rate_hz: IMU_RATE_HZ,
            fix_rate_hz: 100.0,
            vertical_velocity: true,
            report_sigmas: true,
            message: "HIGHRES_IMU".into(),
            ..SensorConfig::default()
        },
        vehicle: None,
        by_hand: false,
        trajectory: Flown::new(Paper::new()),
    }
}

/// A consumer autopilot: MPU-6000 class gyros with a visible g-sensitivity, wandering GNSS.
fn consumer_model() -> Model {
    let mut model = Model::default();
    model.imu.gyro_bias = [0.12f64, -0.2, 0.08].map(f64::to_radians);
    model.imu.accel_bias = [0.06, -0.05, 0.09];
    model.gnss.position_sigma_m = [0.5, 0.5, 0.8];
    model.gnss.position_correlation_s = 60.0;
    model.gnss.position_wander_sigma_m = [1.2, 1.2, 2.0];
    let g = [150.0, 30.0, -60.0, -45.0, 130.0, 50.0, 25.0, -35.0, -170.0];
    model.effects.push(EffectSetting {
        effect: &effects::GYRO_G_SENSITIVITY,
        values: g.map(|v| v * unit::DEG_PER_H_PER_G.si).to_vec(),
        sigmas: vec![0.0; 9],
    });
    model.effects.push(EffectSetting { effect: &effects::GpsLatency, values: vec![0.12], sigmas: vec![0.0] });
    model
}

/// What such an autopilot sends: truncated integers at 200 Hz, fixes at 5 Hz without vertical velocity.
fn consumer_sensors() -> SensorConfig {
    SensorConfig {
        imu_rate_hz: 200.0,
        fix_rate_hz: 5.0,
        report_sigmas: true,
        message: "RAW_IMU".into(),
        quantisation: Quantisation::Truncate(Steps::RAW_IMU),
        attitude_rate_hz: 10.0,
        ..SensorConfig::default()
    }
}

fn small_aircraft(name: &'static str, description: &'static str, profile: FixedWing) -> Scenario {
    Scenario {
        name,
        description,
        airframe: Airframe::FixedWing,
        model: consumer_model(),
        sensors: consumer_sensors(),
        vehicle: None,
        by_hand: false,
        trajectory: Flown::new(profile),
    }
}

fn fixed_wing() -> Scenario {
    small_aircraft(
        "fixed_wing",
        "small aircraft, 300 s: coordinated turns, speed changes, pull-ups and sideslips",
        FixedWing::new(true),
    )
}

fn fixed_wing_coordinated() -> Scenario {
    small_aircraft(
        "fixed_wing_coordinated",
        "the same flight without sideslip: nothing excites the right axis",
        FixedWing::new(false),
    )
}

fn fixed_wing_gusts() -> Scenario {
    small_aircraft(
        "fixed_wing_gusts",
        "the same flight without deliberate sideslip, in turbulent air",
        gusty(),
    )
}

fn gusty() -> FixedWing {
    FixedWing::new(false).with_gusts(30.0, 0.7, 0.3)
}

fn multirotor() -> Scenario {
    Scenario {
        name: "multirotor",
        description: "quadrotor, 240 s: hover, dashes and crab legs in all directions, yaw, climbs",
        airframe: Airframe::Multirotor,
        model: consumer_model(),
        sensors: consumer_sensors(),
        vehicle: None,
        by_hand: false,
        trajectory: Flown::new(Multirotor::new()),
    }
}

fn bench() -> Scenario {
    Scenario {
        name: "bench",
        description: "stationary for 600 s",
        airframe: Airframe::FixedWing,
        model: consumer_model(),
        sensors: consumer_sensors(),
        vehicle: None,
        by_hand: false,
        trajectory: Flown::new(Bench::new(600.0)),
    }
}

/// A unit that people turn by hand, as it comes from the shop: the tolerances of a consumer unit.
fn by_hand(name: &'static str, description: &'static str, profile: Hand) -> Scenario {
    let mut scenario =
        Scenario { name, description, by_hand: true, trajectory: Flown::new(profile), ..bench() };
    let ppm = 1e-6;
    for (effect, values) in [
        (effects::find("gyro_scale_factor"), &[2400.0 * ppm, -1800.0 * ppm, 3100.0 * ppm][..]),
        (effects::find("accel_scale_factor"), &[-2100.0 * ppm, 1500.0 * ppm, 2700.0 * ppm][..]),
    ] {
        let setting = effect.and_then(|e| EffectSetting::known(e, values).ok());
        scenario.model.effects.extend(setting);
    }
    scenario
}

fn hand() -> Scenario {
    by_hand("hand", "turned by hand on the ground: six sides, once around each axis", Hand::six_sides(26.0))
}

fn hand_mistakes() -> Scenario {
    by_hand(
        "hand_mistakes",
        "the same with hands that shake, a side twice and one that is left too early",
        Hand::with_mistakes(26.0),
    )
}

/// A vehicle that stands until a mission is uploaded and started.
fn mission_vehicle(name: &'static str, description: &'static str, config: VehicleConfig) -> Scenario {
    Scenario { name, description, airframe: config.airframe, vehicle: Some(config), ..bench() }
}

fn mission_fixed_wing() -> Scenario {
    mission_vehicle(
        "mission_fixed_wing",
        "small aircraft that flies what is uploaded",
        VehicleConfig { gust_m_per_s: 0.3, ..VehicleConfig::fixed_wing() },
    )
}

fn mission_multirotor() -> Scenario {
    mission_vehicle(
        "mission_multirotor",
        "quadrotor that flies what is uploaded",
        VehicleConfig { gust_m_per_s: 0.3, ..VehicleConfig::multirotor() },
    )
}

/// 3 m/s² RMS in three lines that sampling folds to low and high frequencies.
fn bench_vibration() -> Scenario {
    let line = |frequency_hz: f64, rms: f64| VibrationLine {
        frequency_hz,
        accel_rms: [0.55 * rms, 0.45 * rms, 0.7 * rms],
        gyro_rms: [0.01 * rms, 0.012 * rms, 0.006 * rms],
    };
    let mut scenario = bench();
    scenario.name = "bench_vibration";
    scenario.description = "stationary for 600 s with a running engine: vibration of 3 m/s² RMS";
    scenario.sensors.vibration = vec![line(93.7, 2.4), line(187.4, 1.6), line(41.3, 0.9)];
    scenario
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_nav::sample::Sample;
    use nalgebra::Vector3;

    #[test]
    fn every_scenario_can_be_had_by_its_name() {
        for name in names() {
            assert_eq!(scenario(name).map(|s| s.name), Some(name));
        }
        assert!(scenario("no such thing").is_none());
    }

    #[test]
    fn a_repeated_flight_takes_off_maneuvers_and_lands_each_time() {
        for (name, once_s) in [
            ("fixed_wing", 340.0),
            ("fixed_wing_coordinated", 340.0),
            ("fixed_wing_gusts", 340.0),
            ("multirotor", 240.0),
        ] {
            let mut flown = scenario(name).and_then(|s| s.repeated(3)).unwrap().trajectory();
            assert_eq!(flown.duration_s(), 3.0 * once_s, "{name}");
            for k in 0..3 {
                let from_s = f64::from(k) * once_s;
                for at_s in [0.0, 5.0, once_s - 1e-3] {
                    let speed = flown.truth_at(from_s + at_s).v_n.norm();
                    assert!(speed < 1e-6, "{name}: {speed} m/s at {at_s} s of flight {k}");
                }
                // A multirotor lands with another heading than it took off with, so that the axes differ.
                for at_s in [66.0, 160.0, 212.0] {
                    let [first, again] = [at_s, from_s + at_s].map(|t_s| flown.truth_at(t_s));
                    let [force, speed] =
                        [again.force.norm() - first.force.norm(), again.v_n.norm() - first.v_n.norm()];
                    assert!(force.abs() < 0.02, "{name} at {at_s} s of flight {k}: {force} m/s²");
                    assert!(speed.abs() < 1e-6, "{name} at {at_s} s of flight {k}: {speed} m/s");
                }
            }
        }
        for name in ["paper", "bench", "mission_multirotor"] {
            assert!(scenario(name).and_then(|s| s.repeated(2)).is_none(), "{name}");
        }
    }

    #[test]
    fn effects_are_hidden_as_written_or_refused_in_words() {
        let mut model = Model::default();
        inject(&mut model, "gps_latency=0.3").unwrap();
        inject(&mut model, "gps_lever_arm=[0.3, 0, -0.1]").unwrap();
        inject(&mut model, "imu_truncation").unwrap();
        assert_eq!(model.get("gps_latency").unwrap().values, vec![0.3]);
        assert_eq!(model.get("gps_lever_arm").unwrap().values, vec![0.3, 0.0, -0.1]);
        assert_eq!(model.effects.len(), 3);
        for (wrong, said) in [
            ("gremlins=3", "there is no effect"),
            ("gps_latency", "values in s"),
            ("gps_lever_arm=0.3", "3 values"),
            ("gps_latency=soon", "cannot inject"),
            ("imu_truncation=1", "no value"),
        ] {
            let error = inject(&mut model, wrong).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn the_papers_sensors_have_the_papers_figures() {
        let paper = scenario("paper").unwrap();
        let items: Vec<_> = paper.flight(1).take_while(|(_, t)| t.t_s < 10.0).collect();
        let gyro: Vec<Vector3<f64>> = items
            .iter()
            .filter_map(|(s, t)| if let Sample::Imu(i) = s { Some(i.gyro - t.rate_ib) } else { None })
            .collect();
        assert_eq!(gyro.len(), 2000);
        let mean = gyro.iter().sum::<Vector3<f64>>() / 2000.0;
        let sigma = (gyro.iter().map(|g| (g - mean).norm_squared()).sum::<f64>() / 6000.0).sqrt();
        assert!((sigma.to_degrees() / 0.0028 - 1.0).abs() < 0.03, "{sigma}");
        // 50 deg/h of bias, and −10 deg/h on the down axis from the time on the ground.
        let expected = Vector3::new(50.0, 50.0, 40.0) * unit::DEG_PER_H.si;
        assert!((mean - expected).norm() < 1.0 * unit::DEG_PER_H.si, "{mean}");
        // Fixes fall on sample times.
        assert!(items.iter().filter(|(s, _)| matches!(s, Sample::Fix(_))).count() == 1000);
    }

    #[test]
    fn the_vibrating_bench_vibrates_as_said() {
        let bench = scenario("bench_vibration").unwrap();
        let samples: Vec<f64> = bench
            .flight(3)
            .take_while(|(_, t)| t.t_s < 30.0)
            .filter_map(|(s, t)| if let Sample::Imu(i) = s { Some((i.accel - t.force).norm()) } else { None })
            .collect();
        let rms = (samples.iter().map(|v| v * v).sum::<f64>() / samples.len() as f64).sqrt();
        assert!((rms - 3.0).abs() < 0.1, "{rms}");
    }
}
