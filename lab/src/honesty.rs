//! Honest sigmas: of the states that are called observable, how far the estimates are from the truth, over many drawn vehicles.

use super::observability::{ObservabilityError, PAPER_G_SIGMA, find};
use super::statistics::wilson_95;
use gaware::engine::snapshot::Status;
use gaware::engine::{Engine, EngineOptions};
use gaware::parallel::{Progress, map_runs};
use gaware_nav::effects::GpsLatency;
use gaware_nav::filter::Filter;
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::filter::layout::{Layout, index};
use gaware_nav::model::{EffectSetting, GElements, Model};
use gaware_sitl::scenario::Scenario;
use gaware_sitl::sensors::draw_vehicle;
use serde::Serialize;

/// What to fly for honest sigmas.
#[derive(Debug, Clone)]
pub struct HonestySettings {
    /// Flights per scenario.
    pub runs: usize,
    /// First seed.
    pub seed: u64,
    /// Scenarios.
    pub scenarios: Vec<String>,
    /// Estimate as if the sensors had no tolerances; they have them all the same.
    pub ignore_tolerances: bool,
}

/// One scenario over all flights.
#[derive(Debug, Clone, Serialize)]
pub struct Honesty {
    /// Scenario.
    pub scenario: String,
    /// Flights.
    pub runs: usize,
    /// States called observable at the end, over all flights.
    pub called_observable: usize,
    /// Of these within 2 sigma of truth.
    pub within_2_sigma: usize,
    /// Their share.
    pub share: f64,
    /// 95 % interval of that share, as if states were independent (Wilson 1927).
    pub interval_95: [f64; 2],
    /// Largest error over sigma of all states called observable.
    pub worst_error_over_sigma: f64,
    /// State by state, those that were called observable at least once.
    pub by_state: Vec<StateHonesty>,
}

/// One state over all flights that made it observable.
#[derive(Debug, Clone, Serialize)]
pub struct StateHonesty {
    /// Name.
    pub name: String,
    /// Flights in which it was called observable.
    pub called_observable: usize,
    /// Of these within 2 sigma of truth.
    pub within_2_sigma: usize,
    /// Their share.
    pub share: f64,
    /// 95 % interval of that share (Wilson 1927).
    pub interval_95: [f64; 2],
    /// RMS of error over sigma: 1 for an honest filter.
    pub rms_error_over_sigma: f64,
    /// Mean of error over sigma: 0 without a bias.
    pub mean_error_over_sigma: f64,
    /// Largest error over sigma.
    pub worst_error_over_sigma: f64,
    /// Median sigma, in `unit`.
    pub median_sigma: f64,
    /// Unit of screens.
    pub unit: String,
}

/// One state called observable after one flight.
#[derive(Debug, Clone)]
struct Called {
    name: &'static str,
    unit: &'static str,
    /// In the unit.
    sigma: f64,
    error_over_sigma: f64,
}

impl StateHonesty {
    fn of(found: &[&Called]) -> Self {
        let n = found.len().max(1) as f64;
        let errors: Vec<f64> = found.iter().map(|c| c.error_over_sigma).collect();
        let within = errors.iter().filter(|e| e.abs() <= 2.0).count();
        let (name, unit) = found.first().map_or(("", ""), |c| (c.name, c.unit));
        let mut sigmas: Vec<f64> = found.iter().map(|c| c.sigma).collect();
        sigmas.sort_by(f64::total_cmp);
        Self {
            name: name.to_owned(),
            called_observable: errors.len(),
            within_2_sigma: within,
            share: within as f64 / n,
            interval_95: wilson_95(within, errors.len()),
            rms_error_over_sigma: (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt(),
            mean_error_over_sigma: errors.iter().sum::<f64>() / n,
            worst_error_over_sigma: errors.iter().fold(0.0, |worst, e| e.abs().max(worst)),
            median_sigma: sigmas.get(sigmas.len() / 2).copied().unwrap_or(0.0),
            unit: unit.to_owned(),
        }
    }
}

/// Of the states called observable, how many lie within 2 sigma of truth: drawn vehicles through the engine.
///
/// # Errors
/// An unknown scenario, or fewer than two runs.
pub fn honest_sigmas(
    settings: &HonestySettings,
    progress: &dyn Progress,
) -> Result<Vec<Honesty>, ObservabilityError> {
    if settings.runs < 2 {
        return Err(ObservabilityError::TooFewRuns);
    }
    let scenarios = settings.scenarios.iter().map(|name| find(name)).collect::<Result<Vec<_>, _>>()?;
    Ok(scenarios.iter().map(|scenario| honesty(scenario, settings, progress)).collect())
}

fn honesty(scenario: &Scenario, settings: &HonestySettings, progress: &dyn Progress) -> Honesty {
    let belief = belief(scenario);
    let assumed =
        if settings.ignore_tolerances { belief.clone().without_tolerances() } else { belief.clone() };
    let runs = map_runs(settings.runs, progress, |k| {
        one_flight(scenario, &belief, &assumed, settings.seed.wrapping_add(k as u64))
    });
    let called: Vec<&Called> = runs.iter().flatten().collect();
    let mut names: Vec<&str> = Vec::new();
    for state in &called {
        if !names.contains(&state.name) {
            names.push(state.name);
        }
    }
    let by_state: Vec<StateHonesty> = names
        .into_iter()
        .map(|name| StateHonesty::of(&called.iter().copied().filter(|c| c.name == name).collect::<Vec<_>>()))
        .collect();
    let within = by_state.iter().map(|s| s.within_2_sigma).sum();
    Honesty {
        scenario: scenario.name.to_owned(),
        runs: settings.runs,
        called_observable: called.len(),
        within_2_sigma: within,
        share: within as f64 / called.len().max(1) as f64,
        interval_95: wilson_95(within, called.len()),
        worst_error_over_sigma: by_state.iter().map(|s| s.worst_error_over_sigma).fold(0.0, f64::max),
        by_state,
    }
}

/// What the engine assumes before the flight: the noise of these sensors and the tolerances of a consumer unit, nothing of their
/// constants. The paper's sensors have no tolerances.
fn belief(scenario: &Scenario) -> Model {
    let mut model = if scenario.name == "paper" { Model::calibrated() } else { Model::standard() };
    model.imu = scenario.model.imu.clone();
    (model.imu.gyro_bias, model.imu.accel_bias) = ([0.0; 3], [0.0; 3]);
    model.gnss = scenario.model.gnss.clone();
    if scenario.name == "paper" {
        model = model.with_g(GElements::Full, Some(PAPER_G_SIGMA));
    }
    if !scenario.model.effects.iter().any(|s| s.effect.delays_fixes()) {
        model.set(EffectSetting { effect: &GpsLatency, values: vec![0.0], sigmas: vec![0.0] });
    }
    model
}

/// Every state called observable after one flight of a vehicle drawn from what is assumed, estimated with what is assumed.
fn one_flight(scenario: &Scenario, belief: &Model, assumed: &Model, seed: u64) -> Vec<Called> {
    let vehicle = draw_vehicle(belief, seed);
    let flight =
        gaware_sitl::sensors::Flight::new(scenario.trajectory(), &vehicle, scenario.sensors.clone(), seed);
    let mut engine = Engine::new(assumed.clone(), EngineOptions::default());
    flight.for_each(|(sample, _)| engine.feed(&sample));
    let Some(filter) = engine.filter() else { return Vec::new() };
    let views = engine.snapshot().observability;
    let truth = (Layout::new(&vehicle), Calibration::new(&vehicle));
    let observable = views.states.iter().filter(|s| s.status == Status::Observable);
    observable.filter_map(|s| called(filter, &truth, &s.name)).collect()
}

fn called(filter: &Filter, (layout, truth): &(Layout, Calibration), name: &str) -> Option<Called> {
    let state = filter.layout().find(name)?;
    let shown = filter.layout().names().get(state.checked_sub(index::GYRO_BIAS)?)?;
    let error = filter.calibration().get(filter.layout(), state) - truth.get(layout, layout.find(name)?);
    let sigma = filter.covariance().sigma(state);
    Some(Called {
        name: shown.name,
        unit: shown.unit.symbol,
        sigma: sigma / shown.unit.si,
        error_over_sigma: error / sigma.max(f64::MIN_POSITIVE),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn honest_errors_are_told_as_such() {
        let called =
            [(1.0, 10.0), (-1.0, 40.0), (0.5, 20.0), (-2.5, 30.0)].map(|(error_over_sigma, sigma)| Called {
                name: "g11",
                unit: "deg/h/g",
                sigma,
                error_over_sigma,
            });
        let state = StateHonesty::of(&called.iter().collect::<Vec<_>>());
        assert_eq!((state.called_observable, state.within_2_sigma), (4, 3));
        assert!((state.rms_error_over_sigma - 1.458).abs() < 1e-3, "{state:?}");
        assert!((state.mean_error_over_sigma + 0.5).abs() < 1e-12);
        assert_eq!((state.worst_error_over_sigma, state.median_sigma), (2.5, 30.0));
    }
}
