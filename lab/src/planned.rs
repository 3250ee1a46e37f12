//! Plans for sensors beside the inertial unit, against flights: each effect alone is injected into a vehicle that flies the plan, and the 1-sigma of the report is
//! compared with what the plan promised.

use gaware::advice::on_board::OnBoard;
use gaware::aids::{self, Aids};
use gaware::commands::plan::{PlanCommandError, PlannedSensor, sensor_predictor};
use gaware::compass::SensorEffect;
use gaware::demo::flight::Flight;
use gaware::demo::{self, Prediction, Prepared};
use gaware::engine::{Engine, EngineOptions};
use gaware::parallel::{Progress, map_runs};
use gaware::pipeline::samples_of;
use gaware::sensors::ConverterOptions;
use gaware_mission::airframe::Airframe;
use gaware_mission::planner::{Reach, plan};
use gaware_nav::effects::{AIRSPEED, BAROMETER, COMPASS, Effect};
use gaware_nav::model::{EffectSetting, Model};
use gaware_sitl::air::AirSensors;
use gaware_sitl::noise::{Noise, Purpose};
use gaware_sitl::sensors::draw_vehicle;
use serde::Serialize;

/// 2026-07-01: the simulation's magnetic field is that of 2026.
const DATE_UNIX_S: f64 = 1_782_864_000.0;
/// An injected error is between these multiples of the sigma of its definition.
const SIZES: (f64, f64) = (0.7, 1.7);

/// What to fly.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What flies.
    pub airframe: Airframe,
    /// What is planned for.
    pub sensors: Vec<PlannedSensor>,
    /// Flights per effect.
    pub flights: usize,
    /// First seed.
    pub seed: u64,
}

/// A parameter of an effect over the flights that had it.
#[derive(Debug, Clone, Serialize)]
pub struct PlannedParameter {
    /// Its name.
    pub name: String,
    /// Unit of all sigmas.
    pub unit: String,
    /// 1-sigma before the flight.
    pub before: f64,
    /// 1-sigma that the plan promises.
    pub promised: f64,
    /// Median of what the reports say, where any names the effect.
    pub achieved: Option<f64>,
    /// Flights in which its effect was injected.
    pub flights: usize,
    /// Of these with its effect named.
    pub named: usize,
    /// Of these with a value within 2 sigma of the truth.
    pub within_2_sigma: usize,
}

/// All of them.
#[derive(Debug, Clone, Serialize)]
pub struct PlannedStudy {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// Airframe.
    pub airframe: String,
    /// The maneuvers of the plan, in a pilot's words.
    pub maneuvers: Vec<String>,
    /// Parameters that the plan can do something for.
    pub parameters: Vec<PlannedParameter>,
    /// What reports named that was not injected.
    pub false_names: Vec<String>,
}

fn effects(sensors: &[PlannedSensor]) -> Vec<&'static dyn Effect> {
    let of = |s: &PlannedSensor| match s {
        PlannedSensor::Compass => COMPASS,
        PlannedSensor::Airspeed => AIRSPEED,
        PlannedSensor::Barometer => BAROMETER,
    };
    // No plan warms a sensor.
    sensors.iter().flat_map(|s| of(s).iter().copied()).filter(|e| e.name() != "baro_temperature").collect()
}

/// How many flights there are.
pub fn flights(settings: &Settings) -> usize {
    settings.flights * effects(&settings.sensors).len()
}

fn planned(settings: &Settings) -> Result<Prepared, PlanCommandError> {
    let own = demo::Settings::new(settings.airframe.clone(), None);
    let request = own.request();
    let plan = plan(&request, sensor_predictor(&own.belief, &request, &settings.sensors)?)?;
    let prediction = Prediction { sigmas: Vec::new(), attitude_sigma_deg: [0.0; 3] };
    Ok(Prepared { settings: own, plan, prediction })
}

/// A size of an effect, with a sign of each parameter; nothing measures before it happens.
fn draw(effect: &'static dyn Effect, seed: u64) -> EffectSetting {
    let mut noise = Noise::numbered(seed, Purpose::HiddenTruth, 23);
    let mut setting = EffectSetting::unknown(effect);
    let is_delay = effect.name().ends_with("_delay");
    for (value, sigma) in setting.values.iter_mut().zip(&setting.sigmas) {
        let sign = if is_delay || noise.uniform() < 0.5 { 1.0 } else { -1.0 };
        *value = sign * sigma * (SIZES.0 + (SIZES.1 - SIZES.0) * noise.uniform());
    }
    setting.sigmas.fill(0.0);
    setting
}

/// One flight: what was injected, and what a report says.
fn fly(prepared: &Prepared, effect: &'static dyn Effect, seed: u64) -> (EffectSetting, Aids) {
    let mut injected = draw(effect, seed);
    let mut truth = draw_vehicle(&prepared.settings.drawn, seed);
    truth.set(injected.clone());
    let engine = Engine::new(Model::standard(), EngineOptions::default());
    let autopilot = prepared.autopilot(&truth, seed);
    let mut flight = Flight::with(prepared.clone(), truth, autopilot, engine).recorded();
    flight.run();
    // The air of the day is a part of what a height's scale is.
    if effect.name() == "baro_scale" {
        injected.values[0] += AirSensors::new(seed).height_scale();
    }
    let samples = samples_of(&flight.into_parts().0, ConverterOptions::default());
    let board =
        OnBoard { fixed_wing: Some(prepared.settings.airframe.is_fixed_wing()), ..OnBoard::default() };
    (injected, aids::of_samples(&samples, Some(DATE_UNIX_S), &board))
}

/// What a report names, by sensor: the errors are those of the first of each kind.
fn named(aids: &Aids) -> Vec<(bool, &SensorEffect)> {
    let compasses = aids.compasses.iter().flat_map(|c| &c.compasses).map(|c| (c.compass == 1, &c.effects));
    // The simulated rotors have drag, which is no error.
    let air = aids.air.iter().flat_map(|a| &a.sensors).filter(|s| s.sensor != "Drag");
    let air = air.map(|s| (s.sensor.ends_with('1'), &s.effects));
    compasses.chain(air).flat_map(|(first, effects)| effects.iter().map(move |e| (first, e))).collect()
}

/// Plans, flies every effect, and counts.
///
/// # Errors
/// No plan for this airframe.
pub fn run(settings: &Settings, progress: &dyn Progress) -> Result<PlannedStudy, PlanCommandError> {
    let prepared = planned(settings)?;
    let made = &prepared.plan;
    let all = effects(&settings.sensors);
    let flown = map_runs(flights(settings), progress, |k| {
        fly(&prepared, all[k / settings.flights], settings.seed + k as u64)
    });
    let mut false_names = Vec::new();
    for (injected, aids) in &flown {
        let others =
            named(aids).into_iter().filter(|(first, e)| !first || e.names[0] != injected.effect.name());
        false_names.extend(others.map(|(_, e)| format!("{} beside {}", e.names[0], injected.effect.name())));
    }
    let start = made.sigmas.first().map(|s| s.sigmas.clone()).unwrap_or_default();
    let parameter = |state: &gaware_mission::planner::PlannedState| {
        let before = start.iter().find(|s| s.name == state.name.as_str()).map_or(f64::NAN, |s| s.sigma);
        let mut out = PlannedParameter {
            name: state.name.clone(),
            unit: state.unit.clone(),
            before,
            promised: state.sigma,
            achieved: None,
            flights: 0,
            named: 0,
            within_2_sigma: 0,
        };
        let mut sigmas = Vec::new();
        for (injected, aids) in &flown {
            let own = injected.parameters().zip(&injected.values).find(|((name, _), _)| *name == state.name);
            let Some(((_, unit), truth)) = own else { continue };
            out.flights += 1;
            let found = named(aids).into_iter().filter(|(first, _)| *first);
            let found = found.flat_map(|(_, e)| &e.parameters).find(|p| p.name == state.name);
            if let Some(p) = found {
                out.named += 1;
                out.within_2_sigma += usize::from((p.value - truth / unit.si).abs() < 2.0 * p.sigma);
                sigmas.push(p.sigma);
            }
        }
        sigmas.sort_by(f64::total_cmp);
        out.achieved = sigmas.get(sigmas.len() / 2).copied();
        out
    };
    Ok(PlannedStudy {
        schema: "gaware.study/1",
        airframe: settings.airframe.name.clone(),
        maneuvers: made.maneuvers.iter().map(|m| m.maneuver.words(&settings.airframe).short).collect(),
        parameters: made.states.iter().filter(|s| s.reach != Reach::Unobservable).map(parameter).collect(),
        false_names,
    })
}
