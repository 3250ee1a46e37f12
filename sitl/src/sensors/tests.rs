use super::*;
use crate::trajectory::Flown;
use crate::trajectory::bench::Bench;
use crate::trajectory::fixed_wing::FixedWing;
use gaware_nav::effects;
use gaware_nav::model::EffectSetting;
use gaware_nav::sample::Steps;

fn silent() -> Model {
    let mut model = Model::default();
    model.imu.gyro_noise = 0.0;
    model.imu.accel_noise = 0.0;
    model.gnss.position_sigma_m = [0.0; 3];
    model.gnss.velocity_sigma_m_per_s = [0.0; 3];
    model
}

fn known(name: &str, values: &[f64]) -> EffectSetting {
    EffectSetting::known(effects::find(name).unwrap(), values).unwrap()
}

fn turn() -> Box<dyn Trajectory> {
    Box::new(Flown::new(FixedWing::steady_turn(22.0, 0.7, 4.0)))
}

fn imu(flight: Flight) -> Vec<(ImuSample, Truth)> {
    flight.filter_map(|(s, t)| if let Sample::Imu(i) = s { Some((i, t)) } else { None }).collect()
}

fn fixes(flight: Flight) -> Vec<(GnssFix, Truth)> {
    flight.filter_map(|(s, t)| if let Sample::Fix(f) = s { Some((f, t)) } else { None }).collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(s, n): (f64, f64), v| (s + v * v, n + 1.0));
    (sum / n).sqrt()
}

#[test]
fn perfect_sensors_read_the_truth_in_order_of_time() {
    let config =
        SensorConfig { attitude_rate_hz: 10.0, attitude_sigma_rad: [0.0; 3], ..SensorConfig::default() };
    let items: Vec<_> = Flight::new(turn(), &silent(), config, 1).collect();
    assert!(matches!(items[0].0, Sample::Stream(_)));
    assert_eq!(items.len(), 1 + 801 + 21 + 41);
    assert!(items.windows(2).all(|w| w[0].1.t_s <= w[1].1.t_s));
    for (sample, truth) in &items {
        match sample {
            Sample::Imu(s) => assert_eq!((s.gyro, s.accel, s.t_s), (truth.rate_ib, truth.force, truth.t_s)),
            Sample::Fix(f) => {
                assert_eq!(f.position, truth.place);
                assert_eq!(f.velocity, FixVelocity::Horizontal([truth.v_n.x, truth.v_n.y]));
            }
            Sample::Attitude(a) => {
                assert!((Vector3::from(a.roll_pitch_yaw) - euler_from_c_nb(&truth.c_nb)).norm() < 1e-12);
            }
            _ => {}
        }
    }
}

#[test]
fn effects_and_biases_of_the_model_appear_in_the_samples() {
    let mut model = silent();
    model.imu.gyro_bias = [0.01, -0.02, 0.03];
    model.set(known("gyro_g_sensitivity", &[1e-4, 0.0, 0.0, 0.0, 0.0, 2e-4, 0.0, 0.0, 0.0]));
    for (s, truth) in imu(Flight::new(turn(), &model, SensorConfig::default(), 1)) {
        let extra = Vector3::new(0.01 + 1e-4 * truth.force.x, -0.02 + 2e-4 * truth.force.z, 0.03);
        assert!((s.gyro - truth.rate_ib - extra).norm() < 1e-12);
    }
}

#[test]
fn a_late_fix_tells_of_the_past() {
    let mut model = silent();
    model.set(known("gps_latency", &[0.25]));
    let late = fixes(Flight::new(turn(), &model, SensorConfig::default(), 1));
    assert!((late[0].0.t_s - 0.4).abs() < 1e-12, "the first fix is the first that has something to tell");
    for (fix, truth) in late {
        assert!((fix.t_s - 0.25 - truth.t_s).abs() < 1e-9);
        assert_eq!(fix.position, truth.place);
    }
}

#[test]
fn noise_has_the_density_of_the_model_and_switching_one_source_leaves_the_others() {
    let mut model = silent();
    model.imu.accel_noise = 0.01;
    let mut noisy = model.clone();
    noisy.imu.gyro_noise = 1e-3;
    let bench = || Box::new(Flown::new(Bench::new(20.0))) as Box<dyn Trajectory>;
    let quiet = imu(Flight::new(bench(), &model, SensorConfig::default(), 7));
    let loud = imu(Flight::new(bench(), &noisy, SensorConfig::default(), 7));
    assert!(quiet.iter().zip(&loud).all(|(a, b)| a.0.accel == b.0.accel));
    let sigma = rms(loud.iter().map(|(s, t)| s.gyro.y - t.rate_ib.y));
    assert!((sigma / (1e-3 * 200f64.sqrt()) - 1.0).abs() < 0.05, "{sigma}");
}

#[test]
fn truncation_of_the_model_wins_over_what_the_source_claims() {
    let mut model = silent();
    model.set(known("imu_truncation", &[]));
    let config =
        SensorConfig { quantisation: Quantisation::Round(Steps::RAW_IMU), ..SensorConfig::default() };
    for (s, truth) in imu(Flight::new(turn(), &model, config, 1)) {
        let counts = truth.rate_ib / 1e-3;
        assert!((s.gyro / 1e-3 - counts.map(f64::trunc)).norm() < 1e-9);
    }
}

#[test]
fn vibration_has_its_size_and_reaches_the_gyros_through_g() {
    let mut model = silent();
    model.set(known("gyro_g_sensitivity", &[0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    let line = VibrationLine { frequency_hz: 87.3, accel_rms: [0.0, 0.0, 3.0], gyro_rms: [0.0; 3] };
    let config = SensorConfig { vibration: vec![line], ..SensorConfig::default() };
    let samples = imu(Flight::new(Box::new(Flown::new(Bench::new(20.0))), &model, config, 1));
    let accel = rms(samples.iter().map(|(s, t)| s.accel.z - t.force.z));
    let gyro = rms(samples.iter().map(|(s, t)| s.gyro.x - t.rate_ib.x - 1e-3 * t.force.z));
    assert!((accel - 3.0).abs() < 0.05, "{accel}");
    assert!((gyro - 3e-3).abs() < 1e-4, "{gyro}");
}

#[test]
fn wandering_positions_are_correlated() {
    let mut model = silent();
    model.gnss.position_correlation_s = 30.0;
    model.gnss.position_wander_sigma_m = [1.5; 3];
    let config = SensorConfig { vertical_velocity: true, ..SensorConfig::default() };
    let all = fixes(Flight::new(Box::new(Flown::new(Bench::new(120.0))), &model, config, 5));
    let down: Vec<f64> = all.iter().map(|(f, t)| t.place.height_m - f.position.height_m).collect();
    let change = rms(down.windows(2).map(|w| w[1] - w[0]));
    // √(2 Δt/τ) σ with Δt = 0.2 s.
    assert!((change / (1.5 * (2.0f64 * 0.2 / 30.0).sqrt()) - 1.0).abs() < 0.15, "{change}");
}

#[test]
fn an_outage_hides_fixes_and_changes_no_other() {
    let with = |outages| {
        let config = SensorConfig { outages, ..SensorConfig::default() };
        fixes(Flight::new(turn(), &Model::default(), config, 2))
    };
    let (all, some) = (with(vec![]), with(vec![(1.0, 2.0)]));
    assert_eq!(some.len(), all.len() - 5);
    assert_eq!(some.last(), all.last());
}

#[test]
fn late_stamps_stay_within_their_jitter() {
    let config = SensorConfig { time_jitter_s: 0.002, ..SensorConfig::default() };
    let late: Vec<f64> =
        imu(Flight::new(turn(), &silent(), config, 1)).iter().map(|(s, t)| s.t_s - t.t_s).collect();
    assert!(late.iter().all(|l| (0.0..0.002).contains(l)));
    assert!((late.iter().sum::<f64>() / late.len() as f64 - 0.001).abs() < 1e-4);
}

#[test]
fn drawn_vehicles_differ_and_known_values_stay() {
    let mut model = Model::standard();
    model.set(known("gps_lever_arm", &[0.3, 0.0, -0.1]));
    let (a, b) = (draw_vehicle(&model, 1), draw_vehicle(&model, 2));
    assert_ne!(a.imu.gyro_bias, b.imu.gyro_bias);
    assert_ne!(a.get("gyro_g_sensitivity").unwrap().values, b.get("gyro_g_sensitivity").unwrap().values);
    assert_eq!(a.get("gps_lever_arm").unwrap().values, vec![0.3, 0.0, -0.1]);
}
