//! Biases that drift as those of a board that warms up, live: errors against sigmas, minute by minute.
//!
//! Sensors are drawn from the filter's own prior, and a drift that the model does not name is added to the gyros or the accelerometers. The truth of the
//! bias is the drawn one with the drift of that instant.

use super::endurance::assumed;
use super::statistics::summary;
use gaware::parallel::{Progress, map_runs};
use gaware_nav::consistency::{error, nees};
use gaware_nav::effects::unit;
use gaware_nav::estimator::{Estimator, Stage};
use gaware_nav::filter::Filter;
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::filter::layout::index;
use gaware_nav::math::{atan2, cos, exp_m1, sin};
use gaware_nav::mechanization::NavState;
use gaware_nav::model::Model;
use gaware_nav::sample::{Quantisation, Sample};
use gaware_sitl::noise::{Noise, Purpose};
use gaware_sitl::scenario::{Scenario, scenario};
use gaware_sitl::sensors::{Flight, draw_vehicle};
use gaware_sitl::trajectory::fixed_wing::FixedWing;
use gaware_sitl::trajectory::multirotor::Multirotor;
use gaware_sitl::trajectory::{Flown, Scripted};
use gaware_sitl::truth::{Trajectory, Truth};
use serde::Serialize;

/// Rate of the inertial samples, Hz.
const IMU_RATE_HZ: f64 = 50.0;
/// On the ground before the flight, s.
const GROUND_S: f64 = 60.0;
/// Errors are looked at so often, s.
const LOOK_EVERY_S: f64 = 20.0;
/// … and from here on, s: in flight, the heading found.
const LOOK_FROM_S: f64 = 150.0;
/// Share of a drift that each axis has.
const AXES: [f64; 3] = [1.0, -0.8, 0.6];

/// How the biases change: those of the gyros, where nothing else is said.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Drift {
    /// Not at all.
    None,
    /// As fast as this from the start on, deg/h per minute: ArduPilot's simulator has 180 on one axis.
    Ramp(f64),
    /// By this at 200 s, deg/h.
    Step(f64),
    /// By this with a time constant of three minutes, deg/h.
    WarmUp(f64),
    /// A random walk, deg/h/√h.
    Walk(f64),
    /// Those of the accelerometers by this, mg, with the same time constant.
    Accel(f64),
}

/// Every drift that is flown.
pub const DRIFTS: [Drift; 15] = [
    Drift::None,
    Drift::Ramp(10.0),
    Drift::Ramp(30.0),
    Drift::Ramp(100.0),
    Drift::Ramp(180.0),
    Drift::Ramp(300.0),
    Drift::Step(100.0),
    Drift::Step(1000.0),
    Drift::WarmUp(300.0),
    Drift::WarmUp(2000.0),
    Drift::Walk(60.0),
    Drift::Walk(250.0),
    Drift::Walk(1000.0),
    Drift::Accel(10.0),
    Drift::Accel(30.0),
];

impl std::fmt::Display for Drift {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::None => write!(f, "none"),
            Self::Ramp(x) => write!(f, "{x} deg/h per minute"),
            Self::Step(x) => write!(f, "step of {x} deg/h"),
            Self::WarmUp(x) => write!(f, "warm-up by {x} deg/h"),
            Self::Walk(x) => write!(f, "walk {x} deg/h/√h"),
            Self::Accel(x) => write!(f, "accel. warm-up by {x} mg"),
        }
    }
}

/// A drift as it happens in one flight.
struct Drifting {
    drift: Drift,
    noise: Noise,
    t_s: f64,
    /// Of gyros, rad/s, and accelerometers, m/s².
    bias: [[f64; 3]; 2],
}

impl Drifting {
    fn new(drift: Drift, seed: u64) -> Self {
        Self { drift, noise: Noise::numbered(seed, Purpose::BiasWalk, 1), t_s: 0.0, bias: [[0.0; 3]; 2] }
    }

    /// What it has added to the biases at this time; times do not decrease.
    fn at(&mut self, t_s: f64) -> [[f64; 3]; 2] {
        let dt = (t_s - self.t_s).max(0.0);
        self.t_s = t_s;
        let shared = |deg_per_h: f64| AXES.map(|share| share * deg_per_h * unit::DEG_PER_H.si);
        let warmed = -exp_m1(-t_s / 180.0);
        self.bias[0] = match self.drift {
            Drift::None => [0.0; 3],
            Drift::Accel(x) => {
                self.bias[1] = AXES.map(|share| share * x * unit::MG.si * warmed);
                [0.0; 3]
            }
            Drift::Ramp(x) => shared(x * t_s / 60.0),
            Drift::Step(x) => shared(if t_s < 200.0 { 0.0 } else { x }),
            Drift::WarmUp(x) => shared(x * warmed),
            Drift::Walk(x) => {
                let sigma = x * unit::DEG_PER_H_PER_RTH.si * dt.sqrt();
                self.bias[0].map(|b| b + sigma * self.noise.normal())
            }
        };
        self.bias
    }
}

/// What is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Vehicles per drift and kind of vehicle.
    pub seeds: usize,
    /// First seed.
    pub seed: u64,
}

/// One drift over all vehicles of one kind.
#[derive(Debug, Clone, Serialize)]
pub struct DriftResult {
    /// `wing` or `rotor`.
    pub vehicle: &'static str,
    /// The drift in words.
    pub drift: String,
    /// Looks at a running filter.
    pub looks: usize,
    /// Mean normalised squared error per degree of freedom over all looks.
    pub nees_mean_per_dof: f64,
    /// The worst flight's mean.
    pub nees_worst_flight: f64,
    /// RMS of roll and pitch errors, deg.
    pub tilt_rms_deg: f64,
    /// RMS of the heading error, deg.
    pub yaw_rms_deg: f64,
    /// Largest error of an element of G in its own sigmas.
    pub g_worst_sigmas: f64,
    /// Median sigma of the elements of G at the end, deg/h/g.
    pub g_sigma_deg_per_h_per_g: f64,
    /// Random walk of the gyro biases that the filter assumed at the end beyond its model, deg/h/√h, median.
    pub walk_deg_per_h_per_rth: f64,
    /// The same of the accelerometers, mg/√h.
    pub walk_mg_per_rth: f64,
}

/// The whole study.
#[derive(Debug, Clone, Serialize)]
pub struct DriftStudy {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// Vehicles per row.
    pub seeds: usize,
    /// First seed.
    pub seed: u64,
    /// Rows.
    pub drifts: Vec<DriftResult>,
}

/// What one flight shows.
#[derive(Default)]
struct Run {
    nees: Vec<f64>,
    tilt_square: Vec<f64>,
    yaw_square: Vec<f64>,
    g_worst: f64,
    g_sigmas: Vec<f64>,
    /// Of gyros and accelerometers.
    walk: [f64; 2],
}

/// Number of flights that [`run`] makes.
pub fn flights(settings: &Settings) -> usize {
    2 * DRIFTS.len() * settings.seeds
}

/// Runs the study; nothing where the build has no such scenario.
pub fn run(settings: &Settings, progress: &dyn Progress) -> DriftStudy {
    let base = scenario("fixed_wing");
    let jobs: Vec<(bool, Drift)> =
        [false, true].into_iter().flat_map(|rotor| DRIFTS.map(|d| (rotor, d))).collect();
    let seeds = settings.seeds.max(1);
    let runs = map_runs(jobs.len() * seeds, progress, |k| {
        let (rotor, drift) = jobs[k / seeds];
        let seed = settings.seed.wrapping_add((k % seeds) as u64);
        base.as_ref().map_or_else(Run::default, |base| one_flight(base, rotor, drift, seed))
    });
    let drifts =
        jobs.iter().zip(runs.chunks(seeds)).map(|((rotor, drift), runs)| summarise(*rotor, *drift, runs));
    DriftStudy { schema: "gaware.study/1", seeds, seed: settings.seed, drifts: drifts.collect() }
}

/// Ten minutes of flight after a minute on the ground.
fn trajectory(rotor: bool) -> Flown {
    const STEP_S: f64 = 1.0 / IMU_RATE_HZ;
    const AT_REST_S: f64 = 5.0;
    if rotor {
        Flown::with_step(Multirotor::new().repeated(2).paused(AT_REST_S, GROUND_S), STEP_S)
    } else {
        Flown::with_step(FixedWing::new(true).landed().repeated(2).paused(AT_REST_S, GROUND_S), STEP_S)
    }
}

fn one_flight(base: &Scenario, rotor: bool, drift: Drift, seed: u64) -> Run {
    let model = assumed(base);
    let vehicle = draw_vehicle(&model, seed);
    let mut sensors = base.sensors.clone();
    sensors.imu_rate_hz = IMU_RATE_HZ;
    sensors.attitude_rate_hz = 2.0;
    sensors.attitude_sigma_rad = [0.05, 0.05, 0.14];
    sensors.quantisation = Quantisation::None;
    sensors.message = "HIGHRES_IMU".into();
    let path = trajectory(rotor);
    let mut watch =
        Watcher { vehicle: &vehicle, path: path.clone(), next_s: LOOK_FROM_S, run: Run::default() };
    let mut estimator = Estimator::new(model);
    let mut drifting = Drifting::new(drift, seed);
    Flight::new(Box::new(path), &vehicle, sensors, seed).for_each(|(mut sample, truth)| {
        if let Sample::Imu(s) = &mut sample {
            let [gyro, accel] = drifting.at(truth.t_s);
            (0..3).for_each(|k| (s.gyro[k], s.accel[k]) = (s.gyro[k] + gyro[k], s.accel[k] + accel[k]));
        }
        let _ = estimator.feed(&sample);
        watch.look(&estimator, &truth, &drifting.bias);
    });
    let mut run = watch.run;
    let walk = estimator.walk();
    run.walk = [walk.gyro / unit::DEG_PER_H_PER_RTH.si, walk.accel / unit::MG_PER_RTH.si];
    run
}

/// Looks at the estimate now and then.
struct Watcher<'a> {
    vehicle: &'a Model,
    path: Flown,
    next_s: f64,
    run: Run,
}

impl Watcher<'_> {
    fn look(&mut self, estimator: &Estimator, truth: &Truth, drifted: &[[f64; 3]; 2]) {
        if truth.t_s < self.next_s || truth.t_s > self.path.duration_s() - 1.0 {
            return;
        }
        self.next_s += LOOK_EVERY_S;
        if let Some(filter) = estimator.filter().filter(|_| estimator.stage() == Stage::Running) {
            self.judge(filter, drifted);
        }
    }

    fn judge(&mut self, filter: &Filter, [gyro, accel]: &[[f64; 3]; 2]) {
        let truth = self.path.truth_at(filter.t_s());
        let nav = NavState::from_ned(truth.place, &truth.v_n, &truth.c_nb);
        let mut vehicle = self.vehicle.clone();
        for k in 0..3 {
            vehicle.imu.gyro_bias[k] += gyro[k];
            vehicle.imu.accel_bias[k] += accel[k];
        }
        let e = error(filter, &nav, &Calibration::new(&vehicle));
        let (layout, p) = (filter.layout(), filter.covariance());
        let states: Vec<usize> = (0..index::GYRO_BIAS + layout.names().len()).collect();
        let run = &mut self.run;
        run.nees.push(nees(filter, &e, &states).unwrap_or(f64::INFINITY) / states.len() as f64);
        let (own, true_) = (filter.nav().euler(), nav.euler());
        run.tilt_square.extend([0, 1].map(|k| (own[k] - true_[k]).to_degrees().powi(2)));
        let yaw = own[2] - true_[2];
        run.yaw_square.push(atan2(sin(yaw), cos(yaw)).to_degrees().powi(2));
        run.g_sigmas.clear();
        for (i, name) in layout.names().iter().enumerate().filter(|(_, n)| n.effect == "gyro_g_sensitivity") {
            let state = i + index::GYRO_BIAS;
            run.g_worst = run.g_worst.max((e[state] / p.sigma(state)).abs());
            run.g_sigmas.push(p.sigma(state) / name.unit.si);
        }
    }
}

fn summarise(rotor: bool, drift: Drift, runs: &[Run]) -> DriftResult {
    let over = |f: &dyn Fn(&Run) -> Vec<f64>| summary(runs.iter().flat_map(f));
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
    DriftResult {
        vehicle: if rotor { "rotor" } else { "wing" },
        drift: drift.to_string(),
        looks: runs.iter().map(|r| r.nees.len()).sum(),
        nees_mean_per_dof: over(&|r| r.nees.clone()).mean,
        nees_worst_flight: over(&|r| vec![mean(&r.nees)]).max,
        tilt_rms_deg: over(&|r| r.tilt_square.clone()).mean.sqrt(),
        yaw_rms_deg: over(&|r| r.yaw_square.clone()).mean.sqrt(),
        g_worst_sigmas: over(&|r| vec![r.g_worst]).max,
        g_sigma_deg_per_h_per_g: over(&|r| r.g_sigmas.clone()).median,
        walk_deg_per_h_per_rth: over(&|r| vec![r.walk[0]]).median,
        walk_mg_per_rth: over(&|r| vec![r.walk[1]]).median,
    }
}

impl std::fmt::Display for DriftStudy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "Biases that drift, {} vehicles each, seed {}: errors from {LOOK_FROM_S} s on, every {LOOK_EVERY_S} s",
            self.seeds, self.seed
        )?;
        writeln!(
            f,
            "{:6} {:24}{:>6}{:>10}{:>8}{:>9}{:>9}{:>10}{:>12}{:>8}{:>8}",
            "",
            "drift",
            "looks",
            "NEES/dof",
            "worst",
            "tilt °",
            "yaw °",
            "G worst σ",
            "G σ deg/h/g",
            "walk",
            "mg/√h"
        )?;
        for d in &self.drifts {
            writeln!(
                f,
                "{:6} {:24}{:6}{:10.2}{:8.2}{:9.3}{:9.2}{:10.1}{:12.0}{:8.0}{:8.0}",
                d.vehicle,
                d.drift,
                d.looks,
                d.nees_mean_per_dof,
                d.nees_worst_flight,
                d.tilt_rms_deg,
                d.yaw_rms_deg,
                d.g_worst_sigmas,
                d.g_sigma_deg_per_h_per_g,
                d.walk_deg_per_h_per_rth,
                d.walk_mg_per_rth
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ArduPilot's simulator drifts like this by default: the tilt was off by 1.5° at a claimed .1°, an element of G by 20 sigma.
    #[test]
    fn a_drift_is_found_and_none_is_not() {
        let base = scenario("fixed_wing").unwrap();
        for (drift, walks) in
            [(Drift::None, [false; 2]), (Drift::Ramp(180.0), [true, false]), (Drift::Accel(30.0), [true; 2])]
        {
            let flown = one_flight(&base, false, drift, 1);
            assert_eq!(flown.walk.map(|w| w > 0.0), walks, "{drift}: {:?}", flown.walk);
            let found = summarise(false, drift, &[flown]);
            assert!(found.looks > 20, "{found:?}");
            assert!(
                found.nees_mean_per_dof < 1.3 && found.tilt_rms_deg < 0.3 && found.g_worst_sigmas < 4.0,
                "{found:?}"
            );
        }
    }
}
