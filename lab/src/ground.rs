//! The ground session over many units: what six sides by hand are worth, by source of the samples and by GNSS.
//!
//! Units are drawn from the filter's own prior, hands are those of the simulated session (sides up to 12° off, hands that shake, mistakes,
//! sides 20° off, a soft table, two sides missing). Errors are those once it is armed after
//! the session, against the sigmas there.

pub mod then_flight;

use super::statistics::summary;
use gaware::parallel::{Progress, map_runs};
use gaware_nav::consistency::{error, nees};
use gaware_nav::earth::Geodetic;
use gaware_nav::estimator::Estimator;
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::filter::layout::index;
use gaware_nav::mechanization::NavState;
use gaware_nav::model::Model;
use gaware_nav::sample::{Quantisation, Sample, Steps};
use gaware_sitl::scenario::{Scenario, scenario};
use gaware_sitl::sensors::{Flight, draw_vehicle};
use gaware_sitl::trajectory::Flown;
use gaware_sitl::trajectory::hand::{Hand, Manner};
use gaware_sitl::truth::Trajectory;
use serde::Serialize;

/// Rate of the inertial samples of a link, and of a `.bin` with its default mask, Hz.
const IMU_RATE_HZ: [f64; 2] = [50.0, 25.0];
/// A side is held for so long and six seconds more, s: the session asks for 12 to 45 in two or three visits, and all of it takes six minutes.
const HOLD_S: f64 = 15.0;
/// Whether all of G is observable is asked so often, s.
const LOOK_EVERY_S: f64 = 5.0;
/// An element of G is observable below this sigma, deg/h/g: the engine's default target.
const OBSERVABLE: f64 = 30.0;
/// The antenna sees the sky within this angle of level, as the cosine.
const SKY: f64 = 0.87;

/// What the samples come from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// `RAW_IMU` of gyros so quiet that truncation bites.
    RawQuiet,
    /// `RAW_IMU`.
    Raw,
    /// `HIGHRES_IMU`.
    Highres,
    /// `IMU` of a DataFlash log.
    Bin,
}

/// What the receiver sees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sky {
    /// Fixes all the time.
    Open,
    /// Fixes only while the vehicle is level.
    Covered,
    /// None; the place is given.
    Place,
    /// None, and nobody says where it is.
    None,
}

/// What is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Units per row.
    pub runs: usize,
    /// First seed.
    pub seed: u64,
}

/// One row.
#[derive(Debug, Clone, Serialize)]
pub struct GroundRow {
    /// Source of the samples.
    pub source: Source,
    /// What the receiver sees.
    pub sky: Sky,
    /// How hands do it.
    pub manner: String,
    /// Share of the elements of G that are observable.
    pub observable: f64,
    /// Share of the units of which all nine are.
    pub all_nine: f64,
    /// Median time until they are, s; not a number where they never are.
    pub all_nine_after_s: f64,
    /// Median sigma of the elements, deg/h/g.
    pub g_sigma_deg_per_h_per_g: f64,
    /// RMS error of the elements, deg/h/g.
    pub g_rms_deg_per_h_per_g: f64,
    /// Mean normalised squared error of the sensors' constants per degree of freedom.
    pub nees_per_dof: f64,
    /// Share of the elements beyond three sigma.
    pub beyond_3_sigma: f64,
    /// RMS errors of gyro scale, ppm, gyro misalignment, mrad, and accelerometer scale, ppm.
    pub tolerances_rms: [f64; 3],
}

/// The whole study.
#[derive(Debug, Clone, Serialize)]
pub struct GroundStudy {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// Units per row.
    pub runs: usize,
    /// First seed.
    pub seed: u64,
    /// Length of a session without mistakes, s.
    pub session_s: f64,
    /// Rows.
    pub rows: Vec<GroundRow>,
}

/// What one session shows.
#[derive(Debug, Default)]
struct Run {
    /// Error and sigma of the elements of G, deg/h/g.
    g: Vec<(f64, f64)>,
    nees: f64,
    /// When all of G was observable first, s.
    all_nine_s: Option<f64>,
    /// Squared errors of the tolerances.
    tolerances: [Vec<f64>; 3],
}

const ROWS: [(Source, Sky, Manner); 17] = [
    (Source::RawQuiet, Sky::Open, Manner::Careful),
    (Source::RawQuiet, Sky::Covered, Manner::Careful),
    (Source::RawQuiet, Sky::Place, Manner::Careful),
    (Source::Raw, Sky::Open, Manner::Careful),
    (Source::Raw, Sky::Covered, Manner::Careful),
    (Source::Raw, Sky::Place, Manner::Careful),
    (Source::Highres, Sky::Open, Manner::Careful),
    (Source::Highres, Sky::Covered, Manner::Careful),
    (Source::Highres, Sky::Place, Manner::Careful),
    (Source::Highres, Sky::None, Manner::Careful),
    (Source::Bin, Sky::Open, Manner::Careful),
    (Source::Bin, Sky::Covered, Manner::Careful),
    (Source::Bin, Sky::Place, Manner::Careful),
    (Source::Highres, Sky::Place, Manner::Mistaken),
    (Source::Highres, Sky::Place, Manner::Askew),
    (Source::Highres, Sky::Place, Manner::Soft),
    (Source::Highres, Sky::Place, Manner::TwoMissing),
];

/// Number of sessions that [`run`] makes.
pub fn sessions(settings: &Settings) -> usize {
    ROWS.len() * settings.runs
}

/// Runs the study.
pub fn run(settings: &Settings, progress: &dyn Progress) -> GroundStudy {
    let base = scenario("hand");
    let path = |manner| Flown::with_step(Hand::in_manner(HOLD_S, manner), 0.02);
    let runs = settings.runs.max(1);
    let made = map_runs(ROWS.len() * runs, progress, |k| {
        let (source, sky, manner) = ROWS[k / runs];
        let seed = settings.seed.wrapping_add((k % runs) as u64);
        base.as_ref().map_or_else(Run::default, |base| one(base, &path(manner), source, sky, seed))
    });
    let rows = ROWS.iter().zip(made.chunks(runs)).map(|(row, runs)| summarise(*row, runs));
    let session_s = path(Manner::Careful).duration_s();
    GroundStudy { schema: "gaware.study/1", runs, seed: settings.seed, session_s, rows: rows.collect() }
}

fn one(base: &Scenario, path: &Flown, source: Source, sky: Sky, seed: u64) -> Run {
    let (mut estimator, unit, all_nine_s) = held(base, path, source, sky, seed);
    estimator.set_flight(false, true);
    Run { all_nine_s, ..judge(&estimator, &unit, path) }
}

/// The estimator after a session, the unit that was held, and when all of G was observable.
fn held(
    base: &Scenario,
    path: &Flown,
    source: Source,
    sky: Sky,
    seed: u64,
) -> (Estimator, Model, Option<f64>) {
    let model = Model::standard();
    let mut unit = draw_vehicle(&model, seed);
    unit.gnss = base.model.gnss.clone();
    unit.gnss.time_sigma_s = model.gnss.time_sigma_s;
    // Quiet gyros scatter by a tenth of a count, those of the standard model by 1.5 counts at 50 Hz.
    unit.imu.gyro_noise *= if source == Source::RawQuiet { 0.07 } else { 1.0 };
    let mut sensors = base.sensors.clone();
    sensors.imu_rate_hz = IMU_RATE_HZ[usize::from(source == Source::Bin)];
    sensors.attitude_rate_hz = 5.0;
    sensors.attitude_sigma_rad = [0.02, 0.02, 0.1];
    (sensors.quantisation, sensors.message) = match source {
        Source::Highres => (Quantisation::None, "HIGHRES_IMU".into()),
        Source::Bin => (Quantisation::None, "IMU".into()),
        Source::Raw | Source::RawQuiet => (Quantisation::Truncate(Steps::RAW_IMU), "RAW_IMU".into()),
    };
    let mut estimator = Estimator::new(model);
    // There is no session with an armed vehicle.
    estimator.set_flight(false, false);
    if sky == Sky::Place {
        estimator.set_place(Geodetic { height_m: 0.0, ..path.clone().truth_at(0.0).place });
    }
    let (mut next_s, mut all_nine_s) = (LOOK_EVERY_S, None);
    for (sample, truth) in Flight::new(Box::new(path.clone()), &unit, sensors, seed) {
        let seen = match sky {
            Sky::Open => true,
            Sky::Covered => truth.c_nb[(2, 2)] > SKY,
            Sky::Place | Sky::None => false,
        };
        if seen || !matches!(sample, Sample::Fix(_)) {
            let _ = estimator.feed(&sample);
        }
        if truth.t_s >= next_s && all_nine_s.is_none() {
            next_s += LOOK_EVERY_S;
            all_nine_s = shows_all_of_g(&estimator).then_some(truth.t_s);
        }
    }
    (estimator, unit, all_nine_s)
}

fn shows_all_of_g(estimator: &Estimator) -> bool {
    estimator.filter().is_some_and(|filter| {
        let names = filter.layout().names().iter().enumerate();
        let mut g = names.filter(|(_, name)| name.effect == "gyro_g_sensitivity");
        g.all(|(k, n)| filter.covariance().sigma(index::GYRO_BIAS + k) / n.unit.si < OBSERVABLE)
    })
}

fn judge(estimator: &Estimator, unit: &Model, path: &Flown) -> Run {
    let mut run = Run::default();
    let Some(filter) = estimator.filter() else { return run };
    let truth = path.clone().truth_at(filter.t_s());
    let nav = NavState::from_ned(truth.place, &truth.v_n, &truth.c_nb);
    let e = error(filter, &nav, &Calibration::new(unit));
    let names = filter.layout().names();
    let mut own = Vec::new();
    for (k, name) in names.iter().enumerate().filter(|(_, n)| !n.effect.starts_with("gps")) {
        let state = index::GYRO_BIAS + k;
        let (off, sigma) = (e[state] / name.unit.si, filter.covariance().sigma(state) / name.unit.si);
        own.push(state);
        match name.effect {
            "gyro_g_sensitivity" => run.g.push((off, sigma)),
            "gyro_scale_factor" => run.tolerances[0].push(off * off),
            "gyro_misalignment" => run.tolerances[1].push(off * off),
            "accel_scale_factor" => run.tolerances[2].push(off * off),
            _ => {}
        }
    }
    run.nees = nees(filter, &e, &own).unwrap_or(f64::INFINITY) / own.len().max(1) as f64;
    run
}

fn summarise((source, sky, manner): (Source, Sky, Manner), runs: &[Run]) -> GroundRow {
    let cells = || runs.iter().flat_map(|r| r.g.iter().copied());
    let all = (9 * runs.len()).max(1) as f64;
    let count = |of: &dyn Fn((f64, f64)) -> bool| cells().filter(|c| of(*c)).count() as f64 / all;
    let nine = |r: &&Run| r.g.len() == 9 && r.g.iter().all(|(_, sigma)| *sigma < OBSERVABLE);
    let rms = |k: usize| summary(runs.iter().flat_map(|r| r.tolerances[k].clone())).mean.sqrt();
    GroundRow {
        source,
        sky,
        manner: format!("{manner:?}"),
        observable: count(&|(_, sigma)| sigma < OBSERVABLE),
        all_nine: runs.iter().filter(nine).count() as f64 / runs.len().max(1) as f64,
        all_nine_after_s: summary(runs.iter().filter_map(|r| r.all_nine_s)).median,
        g_sigma_deg_per_h_per_g: summary(cells().map(|(_, sigma)| sigma)).median,
        g_rms_deg_per_h_per_g: summary(cells().map(|(off, _)| off * off)).mean.sqrt(),
        nees_per_dof: summary(runs.iter().map(|r| r.nees)).mean,
        beyond_3_sigma: count(&|(off, sigma)| off.abs() > 3.0 * sigma),
        tolerances_rms: [0, 1, 2].map(rms),
    }
}

impl std::fmt::Display for GroundStudy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "Ground sessions by hand of {:.0} s, {} units a row, seed {}; sigma and RMS of G in deg/h/g",
            self.session_s, self.runs, self.seed
        )?;
        writeln!(
            f,
            "{:10} {:8} {:10}{:>11}{:>9}{:>8}{:>8}{:>8}{:>10}{:>6}{:>12}{:>10}{:>12}",
            "source",
            "sky",
            "hands",
            "observable",
            "9 of 9",
            "after",
            "sigma",
            "RMS",
            "NEES/dof",
            ">3σ",
            "gyro ppm",
            "mrad",
            "accel ppm"
        )?;
        for r in &self.rows {
            writeln!(
                f,
                "{:10} {:8} {:10}{:10.1}%{:8.1}%{:7.0}s{:8.1}{:8.1}{:10.2}{:5.1}%{:12.0}{:10.2}{:12.0}",
                format!("{:?}", r.source),
                format!("{:?}", r.sky),
                r.manner,
                100.0 * r.observable,
                100.0 * r.all_nine,
                r.all_nine_after_s,
                r.g_sigma_deg_per_h_per_g,
                r.g_rms_deg_per_h_per_g,
                r.nees_per_dof,
                100.0 * r.beyond_3_sigma,
                r.tolerances_rms[0],
                r.tolerances_rms[1],
                r.tolerances_rms[2]
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_sitl::sensors::SensorConfig;

    #[test]
    fn six_sides_show_all_of_g_whatever_the_sky() {
        let base = scenario("hand").unwrap();
        let path = Flown::with_step(Hand::with_mistakes(HOLD_S), 0.02);
        for sky in [Sky::Open, Sky::Covered, Sky::Place, Sky::None] {
            let found = one(&base, &path, Source::Highres, sky, 3);
            assert_eq!(found.g.len(), 9);
            for (off, sigma) in &found.g {
                assert!(*sigma < OBSERVABLE && off.abs() < 4.0 * sigma, "{sky:?}: {off} ± {sigma}");
            }
        }
    }

    /// On foam the gyros' scale, axes and biases are off by more than their sigmas say: the file of the unit has none of them.
    #[test]
    fn the_file_of_a_unit_has_nothing_that_a_soft_support_spoils() {
        let base = scenario("hand").unwrap();
        let kept = |manner| {
            let path = Flown::with_step(Hand::in_manner(HOLD_S, manner), 0.02);
            let (estimator, ..) = held(&base, &path, Source::Highres, Sky::Place, 3);
            let unit = gaware::unit::Unit::of_filter(estimator.filter().unwrap(), Default::default());
            ["g11", "sa_x", "sg_x", "mg_xy", "bg_x"].map(|name| unit.get(name).is_some())
        };
        assert_eq!(kept(Manner::Careful), [true; 5]);
        assert_eq!(kept(Manner::Soft), [true, true, false, false, false]);
    }

    /// Also where it is armed while it stands on the foam, which the period under way has shown.
    #[test]
    fn whoever_is_armed_has_left_the_foam() {
        let base = scenario("hand").unwrap();
        let path = Flown::with_step(Hand::in_manner(HOLD_S, Manner::Soft), 0.02);
        let unit = draw_vehicle(&Model::standard(), 2);
        let sensors = SensorConfig { imu_rate_hz: 50.0, message: "HIGHRES_IMU".into(), ..base.sensors };
        let mut estimator = Estimator::new(Model::standard());
        estimator.set_flight(false, false);
        estimator.set_place(path.clone().truth_at(0.0).place);
        let turned = |e: &Estimator| e.filter().map_or(0.0, |f| f.turned_on_support());
        let mut shown = 0;
        let samples = Flight::new(Box::new(path), &unit, sensors, 2).map(|s| s.0);
        for (k, sample) in samples.filter(|s| !matches!(s, Sample::Fix(_))).enumerate() {
            let _ = estimator.feed(&sample);
            if k % 100 == 0 && turned(&estimator) > 0.0 {
                let mut armed = estimator.clone();
                armed.set_flight(false, true);
                assert_eq!(turned(&armed), 0.0, "sample {k}");
                shown += 1;
            }
        }
        assert!(shown > 20, "the foam is noticed: {shown}");
    }

    /// A flight that goes on from there begins without what foam has spoiled, and with what it has not.
    #[test]
    fn a_flight_after_a_session_on_foam_begins_with_sigmas_that_hold() {
        let base = scenario("hand").unwrap();
        let path = Flown::with_step(Hand::in_manner(HOLD_S, Manner::Soft), 0.02);
        let runs: Vec<Run> =
            (1..=4).map(|seed| one(&base, &path, Source::Highres, Sky::Place, seed)).collect();
        assert!(runs.iter().flat_map(|r| &r.g).all(|(_, sigma)| *sigma < OBSERVABLE));
        let nees = runs.iter().map(|r| r.nees).sum::<f64>() / runs.len() as f64;
        assert!(nees < 1.5, "{nees}");
    }
}
