//! The paper's flight, many times: filters of 15, 18 and 24 states against truth, predicted sigma and information bound.
//!
//! The vehicle's constants are those of the paper in every run; what is drawn is the noise and the filter's initial
//! estimate, from the filter's own prior. Samples go to the filter directly, with 3-D velocity as in the paper.

use super::statistics::Rms3;
use gaware::parallel::{Progress, map_runs};
use gaware_nav::bound::InformationBound;
use gaware_nav::consistency::{error, nees, nees_band_95};
use gaware_nav::effects::unit;
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::filter::layout::index;
use gaware_nav::filter::{Filter, Fusion, Initial};
use gaware_nav::mechanization::{Motion, NavState};
use gaware_nav::model::{GElements, Model};
use gaware_nav::rotation::{exp, wrap_pi};
use gaware_nav::sample::{FixVelocity, ImuSample, SampleKind};
use gaware_sitl::noise::{Noise, Purpose};
use gaware_sitl::scenario::{Scenario, scenario};
use gaware_sitl::sensors::Sensors;
use gaware_sitl::truth::Truth;
use nalgebra::Vector3;
use serde::Serialize;

/// Prior 1-sigma of an element of G: the size of the paper's values, deg/h/g.
const G_SIGMA_DEG_PER_H_PER_G: f64 = 10.0;
/// Prior 1-sigma of position, m, and velocity, m/s.
const START_SIGMA: (f64, f64) = (5.0, 0.5);
/// Consistency counts from here on, s.
const CONSISTENT_FROM_S: f64 = 40.0;
/// Attitude counts from here on, s (the design's contract).
const ATTITUDE_FROM_S: f64 = 60.0;
/// Samples between two epochs that are evaluated: one second.
const EPOCH_SAMPLES: usize = 200;

/// What to run.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Flights per filter.
    pub runs: usize,
    /// First seed.
    pub seed: u64,
    /// 1-sigma of each initial attitude error, deg.
    pub attitude_error_deg: f64,
}

/// One parameter over all runs, in its unit.
#[derive(Debug, Clone, Serialize)]
pub struct Parameter {
    /// Name.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Truth.
    pub truth: f64,
    /// Mean of the final estimates.
    pub mean: f64,
    /// Standard error of that mean.
    pub mean_standard_error: f64,
    /// RMS of the final errors.
    pub rms_error: f64,
    /// RMS of the filter's own final sigmas.
    pub predicted_sigma: f64,
    /// Information bound at the end.
    pub bound: f64,
}

/// One filter over all runs.
#[derive(Debug, Clone, Serialize)]
pub struct FilterResult {
    /// Number of states.
    pub states: usize,
    /// RMS of roll, pitch, yaw from 60 s on, deg.
    pub attitude_rms_deg: [f64; 3],
    /// NEES per degree of freedom, mean over runs and epochs from 40 s on.
    pub nees_per_dof: f64,
    /// 95 % band of the mean over runs at one epoch.
    pub nees_band_95: [f64; 2],
    /// Share of the epochs from 40 s on whose mean lies inside the band.
    pub nees_inside_band: f64,
    /// Mean NEES per degree of freedom at each epoch: time s, value.
    pub nees_over_time: Vec<(f64, f64)>,
    /// Every constant state.
    pub parameters: Vec<Parameter>,
}

/// The whole study.
#[derive(Debug, Clone, Serialize)]
pub struct Study {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// Flights per filter.
    pub runs: usize,
    /// First seed.
    pub seed: u64,
    /// 1-sigma of each initial attitude error, deg.
    pub attitude_error_deg: f64,
    /// 15, 18 and 24 states.
    pub filters: Vec<FilterResult>,
}

/// Why the study cannot run.
#[derive(Debug, thiserror::Error)]
pub enum PaperError {
    /// The scenario is gone.
    #[error("the scenario \"paper\" does not exist in this build")]
    NoScenario,
    /// Nothing to do.
    #[error("a study needs at least 2 runs")]
    TooFewRuns,
}

/// The flight, evaluated once at every sample.
struct Flight {
    scenario: Scenario,
    truth: Vec<Truth>,
}

/// What one run leaves behind.
struct Run {
    nees: Vec<(f64, f64)>,
    attitude: Rms3,
    /// Estimate and sigma of each constant state, SI.
    parameters: Vec<(f64, f64)>,
    dof: usize,
}

/// Runs the study.
///
/// # Errors
/// Fewer than two runs.
pub fn run(settings: &Settings, progress: &dyn Progress) -> Result<Study, PaperError> {
    if settings.runs < 2 {
        return Err(PaperError::TooFewRuns);
    }
    let scenario = scenario("paper").ok_or(PaperError::NoScenario)?;
    let mut trajectory = scenario.trajectory();
    let rate = scenario.sensors.imu_rate_hz;
    let n = (trajectory.duration_s() * rate).round() as usize;
    let truth = (0..=n).map(|i| trajectory.truth_at(i as f64 / rate)).collect();
    let flight = Flight { scenario, truth };
    let filters = [GElements::None, GElements::Diagonal, GElements::Full]
        .map(|elements| one_filter(&flight, elements, settings, progress));
    Ok(Study {
        schema: "gaware.study/1",
        runs: settings.runs,
        seed: settings.seed,
        attitude_error_deg: settings.attitude_error_deg,
        filters: filters.into(),
    })
}

fn one_filter(
    flight: &Flight,
    elements: GElements,
    settings: &Settings,
    progress: &dyn Progress,
) -> FilterResult {
    let prior = prior(&flight.scenario.model, elements);
    let bound = bound(flight, &prior, settings);
    let runs = map_runs(settings.runs, progress, |k| {
        one_run(flight, &prior, settings, settings.seed.wrapping_add(k as u64))
    });
    summarise(&runs, &bound, &flight.scenario.model, settings)
}

/// The model of the filter: true values, prior sigmas.
fn prior(truth: &Model, elements: GElements) -> Model {
    let sigma = G_SIGMA_DEG_PER_H_PER_G * unit::DEG_PER_H_PER_G.si;
    let mut model = truth.clone().with_g(elements, Some(sigma));
    if let (Some(to), Some(from)) = (model.effects.first_mut(), truth.effects.first()) {
        to.values.clone_from(&from.values);
    }
    model
}

fn start(truth: &Truth, attitude_error_deg: f64) -> Initial {
    Initial {
        t_s: truth.t_s,
        nav: NavState::from_ned(truth.place, &truth.v_n, &truth.c_nb),
        position_sigma_m: [START_SIGMA.0; 3],
        velocity_sigma_m_per_s: [START_SIGMA.1; 3],
        attitude_sigma_rad: [attitude_error_deg.to_radians(); 3],
    }
}

/// An initial estimate drawn from the prior: truth = estimate ⊞ error.
fn draw(prior: &Model, initial: &Initial, seed: u64) -> (Model, Initial) {
    let mut noise = Noise::new(seed, Purpose::HiddenTruth);
    let mut model = prior.clone();
    for axis in 0..3 {
        model.imu.gyro_bias[axis] += noise.normal() * prior.imu.gyro_bias_sigma;
        model.imu.accel_bias[axis] += noise.normal() * prior.imu.accel_bias_sigma;
    }
    for setting in &mut model.effects {
        for (value, sigma) in setting.values.iter_mut().zip(&setting.sigmas) {
            *value += noise.normal() * sigma;
        }
    }
    let mut drawn = initial.clone();
    let turn = noise.normal3().component_mul(&Vector3::from(initial.attitude_sigma_rad));
    drawn.nav.q_eb *= exp(&turn);
    drawn.nav.r_e += noise.normal3() * START_SIGMA.0;
    drawn.nav.v_e += noise.normal3() * START_SIGMA.1;
    (model, drawn)
}

fn bound(flight: &Flight, prior: &Model, settings: &Settings) -> Filter {
    let first = &flight.truth[0];
    let mut bound = InformationBound::new(prior, &start(first, settings.attitude_error_deg));
    for (i, truth) in flight.truth.iter().enumerate() {
        bound.advance(truth.t_s, &Motion { rate: truth.rate_ib, force: truth.force }, None);
        bound.set_nav(NavState::from_ned(truth.place, &truth.v_n, &truth.c_nb));
        if is_fix(flight, i) {
            bound.fix(FixVelocity::Full(truth.v_n.into()), None);
        }
    }
    bound.filter().clone()
}

/// Fixes come at the scenario's rate, the first one interval after the start.
fn is_fix(flight: &Flight, sample: usize) -> bool {
    let sensors = &flight.scenario.sensors;
    let every = (sensors.imu_rate_hz / sensors.fix_rate_hz).round().max(1.0) as usize;
    sample > 0 && sample.is_multiple_of(every)
}

fn one_run(flight: &Flight, prior: &Model, settings: &Settings, seed: u64) -> Run {
    let first = &flight.truth[0];
    let (model, initial) = draw(prior, &start(first, settings.attitude_error_deg), seed);
    let mut sensors = Sensors::new(&flight.scenario.model, flight.scenario.sensors.clone(), seed);
    let mut filter = Filter::new(&model, &initial);
    filter.set_stream(SampleKind::Point, (0.0, 0.0));
    let mut fusion = Fusion::new(filter);
    // The truth of the filter's own parameters, whatever it started from.
    let truth_values = Calibration::new(prior);
    let mut run = Run { nees: Vec::new(), attitude: Rms3::default(), parameters: Vec::new(), dof: 0 };
    for (i, truth) in flight.truth.iter().enumerate() {
        let sample: ImuSample = sensors.imu(truth);
        fusion.push_imu(sample);
        if is_fix(flight, i) {
            fusion.push_fix(sensors.fix(truth.t_s, |_| *truth).0);
        }
        while fusion.poll().is_some() {}
        if i.is_multiple_of(EPOCH_SAMPLES) && truth.t_s >= CONSISTENT_FROM_S {
            let nav = NavState::from_ned(truth.place, &truth.v_n, &truth.c_nb);
            let filter = fusion.filter();
            let states: Vec<usize> = (0..filter.layout().len()).collect();
            run.dof = states.len();
            if let Some(value) = nees(filter, &error(filter, &nav, &truth_values), &states) {
                run.nees.push((truth.t_s, value));
            }
        }
        if truth.t_s >= ATTITUDE_FROM_S && is_fix(flight, i) {
            let errors = fusion.filter().nav().euler() - gaware_nav::rotation::euler_from_c_nb(&truth.c_nb);
            run.attitude.add(errors.map(|a| wrap_pi(a).to_degrees()).into());
        }
    }
    let filter = fusion.filter();
    run.parameters = (index::GYRO_BIAS..filter.layout().len())
        .map(|s| (filter.calibration().get(filter.layout(), s), filter.covariance().sigma(s)))
        .collect();
    run
}

fn summarise(runs: &[Run], bound: &Filter, truth: &Model, settings: &Settings) -> FilterResult {
    let n = runs.len() as f64;
    let layout = bound.layout();
    let mut attitude = [0.0; 3];
    for run in runs {
        let v = run.attitude.value();
        (0..3).for_each(|k| attitude[k] += v[k] * v[k] / n);
    }
    let epochs = runs.first().map_or(0, |r| r.nees.len());
    let dof = runs.first().map_or(1, |r| r.dof);
    let band = nees_band_95(dof, settings.runs);
    let over_time: Vec<(f64, f64)> = (0..epochs)
        .filter_map(|e| {
            let mean = runs.iter().filter_map(|r| r.nees.get(e)).map(|v| v.1).sum::<f64>() / n / dof as f64;
            runs.first().and_then(|r| r.nees.get(e)).map(|v| (v.0, mean))
        })
        .collect();
    let inside = over_time.iter().filter(|v| v.1 >= band[0] && v.1 <= band[1]).count();
    let true_values = Calibration::new(truth);
    let parameters = layout
        .names()
        .iter()
        .enumerate()
        .map(|(i, name)| {
            let state = index::GYRO_BIAS + i;
            let true_value = if i < 6 {
                true_values.get(layout, state)
            } else {
                layout.slots().get(i - 6).map_or(0.0, |s| true_values.parameters()[s.effect][s.parameter])
            };
            let of =
                |f: &dyn Fn(&(f64, f64)) -> f64| runs.iter().map(|r| f(&r.parameters[i])).sum::<f64>() / n;
            let mean = of(&|p| p.0);
            let variance = of(&|p| (p.0 - mean).powi(2));
            let si = name.unit.si;
            Parameter {
                name: name.name,
                unit: name.unit.symbol,
                truth: true_value / si,
                mean: mean / si,
                mean_standard_error: (variance / (n - 1.0)).sqrt() / si,
                rms_error: of(&|p| (p.0 - true_value).powi(2)).sqrt() / si,
                predicted_sigma: of(&|p| p.1 * p.1).sqrt() / si,
                bound: bound.covariance().sigma(state) / si,
            }
        })
        .collect();
    FilterResult {
        states: layout.len(),
        attitude_rms_deg: attitude.map(f64::sqrt),
        nees_per_dof: over_time.iter().map(|v| v.1).sum::<f64>() / epochs.max(1) as f64,
        nees_band_95: band,
        nees_inside_band: inside as f64 / epochs.max(1) as f64,
        nees_over_time: over_time,
        parameters,
    }
}
