use super::*;
use crate::airframe::Airframe;
use gaware_nav::math::{sin, tan};

fn wing() -> Airframe {
    Airframe::example("small_fixed_wing").expect("shipped").with_side_force(0.0, 0.0)
}

fn fly_wing(command: impl Fn(f64) -> WingCommand, seconds: f64) -> Vec<Kinematics> {
    fly(&wing(), command, seconds)
}

fn fly(airframe: &Airframe, command: impl Fn(f64) -> WingCommand, seconds: f64) -> Vec<Kinematics> {
    let wind = Vector3::new(3.0, -2.0, 0.0);
    let mut state = WingState::level(Vector3::new(0.0, 0.0, -100.0), 16.0, 0.5);
    let mut samples = Vec::new();
    while state.t_s < seconds {
        samples.push(state.kinematics(airframe, &wind));
        state.step(airframe, &wind, &command(state.t_s), STEP_S);
    }
    fill_rates(&mut samples);
    samples
}

fn turn(bank_deg: f64) -> impl Fn(f64) -> WingCommand {
    move |t| WingCommand {
        airspeed_m_per_s: 16.0 + sin(t),
        bank_rad: bank_deg.to_radians(),
        climb_rad: 0.1 * sin(0.5 * t),
        sideslip_rad: 0.0,
    }
}

/// The strapdown equations (Groves 2013, chapter 5, flat Earth) bring the samples back.
fn assert_consistent(samples: &[Kinematics]) {
    for pair in samples.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let dt = b.t_s - a.t_s;
        let felt = (a.attitude * a.force + b.attitude * b.force) / 2.0 + GRAVITY;
        let moved = (b.velocity_ned_m_per_s - a.velocity_ned_m_per_s) / dt;
        assert!((felt - moved).norm() < 0.35, "{} s: {felt} {moved}", a.t_s);
        let turned = (a.attitude.inverse() * b.attitude).scaled_axis() / dt;
        // The first and last rates are one-sided.
        assert!((turned - (a.rate + b.rate) / 2.0).norm() < 0.16, "{} s", a.t_s);
    }
    let drift: Vector3<f64> = samples
        .windows(2)
        .map(|p| {
            let felt = (p[0].attitude * p[0].force + p[1].attitude * p[1].force) / 2.0 + GRAVITY;
            felt * (p[1].t_s - p[0].t_s)
        })
        .sum();
    let (first, last) = (&samples[0], &samples[samples.len() - 1]);
    let moved = last.velocity_ned_m_per_s - first.velocity_ned_m_per_s;
    assert!((drift - moved).norm() < 0.5, "{drift} {moved}");
}

/// ArduPilot's simulated plane without a coordinated rudder: 0.178 g at 45° of bank, 0.20 g at 55°, 0.122 g at 30°, and to the side
/// that goes down while it rolls (recorded, means over a flight).
#[test]
fn an_uncoordinated_turn_feels_a_side_force_to_its_outside() {
    let mut airframe = wing().with_side_force(0.178, 0.1);
    airframe.bank_max_deg = 60.0;
    for (bank, wanted) in [(45.0, -0.178), (55.0, -0.204), (30.0, -0.122), (-45.0, 0.178)] {
        let level = |t: f64| WingCommand { climb_rad: 0.0, airspeed_m_per_s: 16.0, ..turn(bank)(t) };
        let samples = fly(&airframe, level, 20.0);
        assert_consistent(&samples);
        let felt = samples[samples.len() - 1].force.y / 9.80665;
        assert!((felt - wanted).abs() < 0.015, "{bank}°: {felt} g");
        let early = &samples[8..16];
        let rolling = early.iter().map(|k| k.force.y * bank.signum()).fold(f64::MIN, f64::max) / 9.80665;
        assert!(rolling > 0.005, "{bank}°: {rolling} g while it rolls in");
        // The side force works against the turn.
        let last = &samples[samples.len() - 1];
        let turned = (last.attitude * last.rate).z.abs();
        let coordinated = 9.80665 * tan(bank.to_radians()).abs() / 16.0;
        assert!((turned / coordinated - airframe.turn_share()).abs() < 0.03, "{bank}°: {turned}");
    }
}

#[test]
fn a_coordinated_turn_feels_no_side_force() {
    let samples = fly_wing(turn(45.0), 20.0);
    assert_consistent(&samples);
    assert!(samples.iter().all(|k| k.force.y.abs() < 1e-9));
    let load = samples.iter().map(|k| -k.force.z / 9.80665).fold(0.0, f64::max);
    assert!(load > 1.35 && load < 1.8, "45° of bank feel 1.41 g, {load}");
}

#[test]
fn sideslip_excites_the_y_axis_and_keeps_the_heading() {
    let airframe = wing();
    let slip = 0.2;
    let samples = fly_wing(
        |_| WingCommand {
            airspeed_m_per_s: 16.0,
            bank_rad: WingState::bank_against_sideslip(&airframe, 16.0, slip),
            climb_rad: 0.0,
            sideslip_rad: slip,
        },
        12.0,
    );
    assert_consistent(&samples);
    let last = &samples[samples.len() - 1];
    assert!(last.force.y < -1.2, "{}", last.force);
    assert!((last.velocity_ned_m_per_s.y / last.velocity_ned_m_per_s.x).abs() < 1.0);
}

#[test]
fn a_multirotor_feels_its_drag_sideways() {
    let airframe = Airframe::example("quadrotor").expect("shipped");
    let wind = Vector3::zeros();
    let mut state = RotorState::steady(Vector3::new(0.0, 0.0, -30.0), Vector3::zeros(), 0.0);
    let mut samples = Vec::new();
    while state.t_s < 10.0 {
        samples.push(state.kinematics(&airframe, &wind));
        let v = Vector3::new(0.0, if state.t_s < 6.0 { 8.0 } else { 0.0 }, 0.0);
        state.step(&airframe, &wind, &RotorCommand { velocity_ned_m_per_s: v, yaw_rad: 0.0 }, STEP_S);
    }
    fill_rates(&mut samples);
    assert_consistent(&samples);
    let steady = &samples[(5.5 / STEP_S) as usize];
    assert!(steady.force.y < -1.5, "0.3/s at 8 m/s is 2.4 m/s², {}", steady.force);
}

#[test]
fn extent_is_counted_along_the_course() {
    let samples = fly_wing(turn(0.0), 10.0);
    let extent = Extent::of(&samples, 0.5);
    assert!(extent.ahead_m > 140.0 && extent.behind_m == 0.0 && extent.right_m < 1e-6, "{extent:?}");
}
