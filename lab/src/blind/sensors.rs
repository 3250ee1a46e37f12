//! Blind flights for what measures air: an effect of a barometer or an airspeed sensor, or a drag, is injected, the vehicle flies in a wind, the sensors are judged, and only
//! then the truth is looked at. Effects that are not injected are as large as an ordinary calibration leaves them, of the first sensor of each kind; the
//! second barometer has none.

use super::{Family, Share};
use gaware::advice::on_board::OnBoard;
use gaware::aids;
use gaware::air::AirEntry;
use gaware::compass::Status;
use gaware::parallel::{Progress, map_runs_on};
use gaware_nav::effects::{AIRSPEED, BAROMETER, DRAG_QUADRATIC, DRAG_ROTOR, Effect, find};
use gaware_nav::model::EffectSetting;
use gaware_sitl::blind::{DURATION_S, fly_in_wind};
use gaware_sitl::noise::{Noise, Purpose};
use gaware_sitl::powertrain::Carrier;
use serde::Serialize;
use std::collections::BTreeMap;

/// What an ordinary calibration leaves of each effect, 1-sigma, SI: 1.5 % of the dynamic pressure, 2.5 Pa, .05 s, .025 m/°C, 1.5 %; 1.5 %, 1.5 Pa, .1 s.
const ORDINARY: [(&str, f64); 8] = [
    ("baro_dynamic_pressure", 0.015),
    ("baro_thrust", 2.5),
    ("baro_delay", 0.05),
    ("baro_temperature", 0.025),
    ("baro_scale", 0.015),
    ("airspeed_scale", 0.015),
    ("airspeed_offset", 1.5),
    ("airspeed_delay", 0.1),
];
/// An injected effect is between these multiples of the sigma of its definition.
const SIZES: (f64, f64) = (0.7, 1.7);
/// A parameter is informed where its sigma is below this share of the definition's.
const INFORMED: f64 = 0.7;

/// What is flown of one kind of vehicle.
pub type Tested = (Carrier, &'static [&'static dyn Effect]);
/// The effects of barometers and airspeed sensors.
pub const SENSORS: &[Tested] =
    &[(Carrier::Wings, BAROMETER), (Carrier::Wings, AIRSPEED), (Carrier::Rotors, BAROMETER)];
/// Those of drag; a clean flight has none.
pub const OF_DRAG: &[Tested] = &[(Carrier::Rotors, &[&DRAG_ROTOR, &DRAG_QUADRATIC])];

/// One injected effect and what became of it.
#[derive(Debug, Clone, Serialize)]
pub struct Injected {
    /// Its name.
    pub effect: &'static str,
    /// Its parameters, SI.
    pub values: Vec<f64>,
    /// Named alone.
    pub alone: bool,
    /// Named together with others that would do as well.
    pub in_group: bool,
    /// Errors of its informed parameters in the sigmas that were reported.
    pub errors_in_sigmas: Vec<f64>,
    /// What was said of the sensor.
    pub status: Status,
}

/// One flight.
#[derive(Debug, Clone, Serialize)]
pub struct SensorFlight {
    /// Whether wings carry the vehicle.
    pub wings: bool,
    /// Seed.
    pub seed: u64,
    /// What was injected; nothing in a clean flight.
    pub injected: Vec<Injected>,
    /// Sensors that were judged.
    pub sensors: usize,
    /// Names that stood alone and were not injected, with the sensor.
    pub wrong: Vec<String>,
    /// Of sensors with nothing injected: how many, and how many had something named.
    pub clean: [usize; 2],
    /// Error of the mean wind in its sigmas, north and east.
    pub wind_in_sigmas: Vec<f64>,
}

/// Draws a size: between multiples of the definition's sigma, each parameter with a sign of its own; a port is pressed on all sides alike, a third more or less.
fn draw(effect: &'static dyn Effect, noise: &mut Noise) -> EffectSetting {
    let mut setting = EffectSetting::unknown(effect);
    let size = SIZES.0 + (SIZES.1 - SIZES.0) * noise.uniform();
    // Nothing measures before it happens, and drag is against the motion.
    let is_delay = effect.on_air().is_some_and(|a| a.drivers.iter().any(|d| d.is_delay()));
    let sign = if is_delay || is_drag(effect) || noise.uniform() < 0.5 { 1.0 } else { -1.0 };
    for (value, sigma) in setting.values.iter_mut().zip(&setting.sigmas) {
        *value = sign * size * sigma * (0.67 + 0.66 * noise.uniform());
    }
    setting.sigmas.fill(0.0);
    setting
}

fn is_drag(effect: &dyn Effect) -> bool {
    [DRAG_ROTOR.name, DRAG_QUADRATIC.name].contains(&effect.name())
}

/// What is flown: carrier and effects.
type Job = (Carrier, Vec<&'static dyn Effect>, u64);

/// Each effect alone, each pair of one sensor in turn, and clean flights; `rounds` of all of them.
fn jobs(flown: &[Tested], rounds: usize, first_seed: u64) -> Vec<Job> {
    let mut out: Vec<Job> = Vec::new();
    for round in 0..rounds {
        for (carrier, catalogue) in flown.iter().copied() {
            let seed = |out: &Vec<Job>| first_seed + out.len() as u64;
            for (k, effect) in catalogue.iter().enumerate() {
                out.push((carrier, vec![*effect], seed(&out)));
                let other = catalogue[(k + 1 + round % (catalogue.len() - 1)) % catalogue.len()];
                out.push((carrier, vec![*effect, other], seed(&out)));
            }
            out.push((carrier, vec![], seed(&out)));
            out.push((carrier, vec![], seed(&out)));
        }
    }
    out
}

fn one((carrier, effects, seed): &Job, of_drag: bool, family: Family) -> SensorFlight {
    let mut noise = Noise::numbered(*seed, Purpose::HiddenTruth, 11);
    let mut injected: Vec<EffectSetting> = effects.iter().map(|e| draw(*e, &mut noise)).collect();
    let mut all = injected.clone();
    for (name, sigma) in ORDINARY {
        let Some(effect) = find(name).filter(|e| effects.iter().all(|i| i.name() != e.name())) else {
            continue;
        };
        let values: Vec<f64> = (0..effect.len()).map(|_| sigma * noise.normal()).collect();
        all.extend(EffectSetting::known(effect, &values).ok());
    }
    if of_drag && effects.is_empty() {
        all.extend(EffectSetting::known(&DRAG_ROTOR, &[0.0]).ok());
    }
    let (blind, wind, day) = fly_in_wind(&all, *carrier, family, *seed);
    // The air of the day is a part of what a height's scale is.
    injected.iter_mut().filter(|i| i.effect.name() == "baro_scale").for_each(|i| i.values[0] += day);
    let wings = *carrier == Carrier::Wings;
    let board = OnBoard { fixed_wing: Some(wings), ..OnBoard::default() };
    let mut report = aids::of_samples(&blind.samples, None, &board).air.unwrap_or_default();
    report.sensors.retain(|s| (s.sensor == "Drag") == of_drag);
    let of_sensor = |s: &AirEntry, effect: &str| {
        let family = effect.split('_').next();
        s.sensor
            == match family {
                Some("baro") => "Barometer 1",
                Some("drag") => "Drag",
                _ => "Airspeed sensor 1",
            }
    };
    let has_any = |s: &AirEntry| injected.iter().any(|i| of_sensor(s, i.effect.name()));
    let is_injected =
        |s: &AirEntry, name: &str| injected.iter().any(|i| i.effect.name() == name && of_sensor(s, name));
    let named = report.sensors.iter().flat_map(|s| s.effects.iter().map(move |e| (s, e)));
    let wrong = named.filter(|(s, e)| e.names.len() == 1 && !is_injected(s, e.names[0]));
    let wrong = wrong.map(|(s, e)| format!("{}: {}", s.sensor, e.names[0])).collect();
    let clean: Vec<&AirEntry> = report.sensors.iter().filter(|s| !has_any(s)).collect();
    SensorFlight {
        wings,
        seed: *seed,
        wrong,
        sensors: report.sensors.len(),
        clean: [clean.len(), clean.iter().filter(|s| !s.effects.is_empty()).count()],
        injected: injected
            .iter()
            .filter_map(|i| Some(outcome(i, report.sensors.iter().find(|s| of_sensor(s, i.effect.name()))?)))
            .collect(),
        wind_in_sigmas: report
            .sensors
            .iter()
            .filter_map(|s| s.wind.as_ref())
            .flat_map(|w| {
                let steps = DURATION_S as u32;
                let mean = (0..steps).map(|k| wind.velocity(f64::from(k))).sum::<nalgebra::Vector3<f64>>()
                    / f64::from(steps);
                [0, 1].map(|k| (w.north_east_m_per_s[k] - mean[k]) / w.sigma_m_per_s[k])
            })
            .collect(),
    }
}

fn outcome(injected: &EffectSetting, s: &AirEntry) -> Injected {
    let name = injected.effect.name();
    let own = s.effects.iter().find(|e| e.names[0] == name);
    let groups = injected.effect.groups();
    let errors = own.into_iter().flat_map(|e| e.parameters.iter().zip(groups).zip(&injected.values));
    let errors = errors
        .filter(|((p, group), _)| p.sigma * group.unit.si < INFORMED * group.prior_sigma)
        .map(|((p, group), truth)| (p.value - truth / group.unit.si) / p.sigma);
    Injected {
        effect: name,
        values: injected.values.clone(),
        alone: own.is_some_and(|e| e.names.len() == 1),
        in_group: s.effects.iter().any(|e| e.names.len() > 1 && e.names.contains(&name)),
        errors_in_sigmas: errors.collect(),
        status: s.status,
    }
}

/// Flies `rounds` of every effect alone and in a pair: 32 flights each of sensors, 6 of drag.
pub fn run(
    flown: &[Tested],
    rounds: usize,
    first_seed: u64,
    family: Family,
    threads: usize,
    progress: &dyn Progress,
) -> Vec<SensorFlight> {
    let jobs = jobs(flown, rounds, first_seed);
    let of_drag = flown.iter().all(|(_, catalogue)| catalogue.iter().all(|e| is_drag(*e)));
    map_runs_on(threads, jobs.len(), progress, |k| one(&jobs[k], of_drag, family))
}

/// How many flights a round has.
pub fn flights(flown: &[Tested], rounds: usize) -> usize {
    jobs(flown, rounds, 0).len()
}

/// One row of the table: an effect on wings or rotors.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Times that it was injected.
    pub injected: usize,
    /// Named alone.
    pub alone: Share,
    /// Named in a group.
    pub in_group: usize,
    /// Not named.
    pub missed: usize,
    /// Called ok where it was not named.
    pub missed_and_ok: usize,
    /// Informed parameters within 2 sigma.
    pub within_2_sigma: Share,
}

/// Over all flights.
#[derive(Debug, Clone, Serialize)]
pub struct Table {
    /// By carrier, effects alone or in a pair, and effect.
    pub rows: BTreeMap<String, Row>,
    /// Sensors with a name alone that was not injected.
    pub wrong_alone: Share,
    /// Sensors with nothing injected that had something named.
    pub clean_named: Share,
    /// Informed parameters of named effects within 2 sigma of the truth …
    pub within_2_sigma: Share,
    /// … and within 3.
    pub within_3_sigma: Share,
    /// Components of the mean wind within 2 sigma.
    pub wind_within_2_sigma: Share,
}

fn within(errors: &[f64], sigmas: f64) -> Share {
    Share::new(errors.iter().filter(|e| e.abs() < sigmas).count(), errors.len())
}

/// Counts.
pub fn table(flights: &[SensorFlight]) -> Table {
    let mut by: BTreeMap<String, Vec<&Injected>> = BTreeMap::new();
    for flight in flights {
        for i in &flight.injected {
            let carrier = if flight.wings { "wings" } else { "rotors" };
            let how = if flight.injected.len() > 1 { "pair" } else { "alone" };
            by.entry(format!("{carrier} {how} {}", i.effect)).or_default().push(i);
        }
    }
    let row = |all: &Vec<&Injected>| {
        let count = |what: &dyn Fn(&Injected) -> bool| all.iter().filter(|i| what(i)).count();
        let errors: Vec<f64> = all.iter().flat_map(|i| &i.errors_in_sigmas).copied().collect();
        let missed = |i: &Injected| !i.alone && !i.in_group;
        Row {
            injected: all.len(),
            alone: Share::new(count(&|i| i.alone), all.len()),
            in_group: count(&|i| i.in_group && !i.alone),
            missed: count(&missed),
            missed_and_ok: count(&|i| missed(i) && i.status == Status::Ok),
            within_2_sigma: within(&errors, 2.0),
        }
    };
    let errors: Vec<f64> =
        flights.iter().flat_map(|f| &f.injected).flat_map(|i| &i.errors_in_sigmas).copied().collect();
    let sum = |of: &dyn Fn(&SensorFlight) -> usize| flights.iter().map(of).sum::<usize>();
    let wind: Vec<f64> = flights.iter().flat_map(|f| &f.wind_in_sigmas).copied().collect();
    Table {
        rows: by.iter().map(|(name, all)| (name.clone(), row(all))).collect(),
        wrong_alone: Share::new(sum(&|f| f.wrong.len()), sum(&|f| f.sensors)),
        clean_named: Share::new(sum(&|f| f.clean[1]), sum(&|f| f.clean[0])),
        within_2_sigma: within(&errors, 2.0),
        within_3_sigma: within(&errors, 3.0),
        wind_within_2_sigma: within(&wind, 2.0),
    }
}
