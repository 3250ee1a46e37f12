//! A companion that is never switched off: flight after flight, hour after hour, with faults in each, recorded within a limit.
//!
//! Each hour the vehicle gets another battery: its clock starts anew and it stands where it stood. In each hour there are a fault of
//! the link, one of the autopilot and one in its messages. Memory, recordings and the errors against their sigmas are looked at.

use super::flight::{self, Judged, Kind, assumed, judged};
use super::registry::{Case, Cause};
use super::spoiler::{Spoil, Spoiler};
use super::station::{Station, TURN_S};
use super::{FaultsError, MEAN_LIMIT, WORST_LIMIT};
use gaware::engine::snapshot::Phase;
use gaware::engine::{Engine, EngineOptions};
use gaware::parallel::Progress;
use gaware::pipeline::Recorded;
use gaware::sensors::ConverterOptions;
use gaware::sinks::recorder::{RecordLimit, Recorder, RecorderStats, Setup};
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::model::Model;
use gaware_sitl::faults::{Fault, LinkFaults};
use gaware_sitl::noise::{Noise, Purpose};
use gaware_sitl::scenario::{Scenario, scenario};
use gaware_sitl::sensors::draw_vehicle;
use gaware_sitl::trajectory::{Flown, Scripted, fixed_wing::FixedWing};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// An hour, s.
const HOUR_S: f64 = 3600.0;
/// A flight of 340 s after so long on the ground, s …
const GROUND_S: f64 = 380.0;
/// … so often in an hour.
const FLIGHTS: u32 = 5;
/// Snapshots are shown and recorded once in so many turns, …
const SHOW_TURNS: u64 = 50;
/// … and errors are looked at once in so many of those.
const LOOK_SHOWS: u64 = 10;
/// More items than this never wait for the recorder.
const AHEAD: usize = 4096;
/// Growth of the memory after the first hour that still counts as flat.
const GROWTH_LIMIT: f64 = 0.05;
/// Degrees of freedom of the standard model, roughly.
const DOF: f64 = 46.0;

/// What is asked for.
pub struct LongSettings<'a> {
    /// Hours.
    pub hours: u32,
    /// Seed of vehicle, noise and faults.
    pub seed: u64,
    /// Folder of the recordings.
    pub folder: &'a Path,
    /// Space for them.
    pub limit: RecordLimit,
    /// Resident memory of this process now, bytes, where the system says so.
    pub resident_bytes: &'a dyn Fn() -> Option<u64>,
}

/// One hour.
#[derive(Debug, Clone, Serialize)]
pub struct Hour {
    /// From 1.
    pub hour: u32,
    /// Its faults, in words.
    pub faults: Vec<String>,
    /// Share of the looks at which the estimate ran.
    pub running: f64,
    /// Mean normalised squared error per degree of freedom, …
    pub nees_mean_per_dof: f64,
    /// … the worst, …
    pub nees_worst_per_dof: f64,
    /// … when it was, s since the begin of the hour, and the largest errors then.
    pub worst_at_s: f64,
    /// See above.
    pub worst_states: Vec<(&'static str, f64)>,
    /// Constants with the largest errors at its end: name, and error over sigma.
    pub largest: Vec<(&'static str, f64)>,
    /// Resident memory at its end, bytes.
    pub resident_bytes: Option<u64>,
    /// The recording at its end.
    pub recorder: RecorderStats,
}

/// What became of the recordings.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Recordings {
    /// Files in the folder.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Of them, those that the reader of the `mcap` crate reads to the end, …
    pub opened: usize,
    /// … and those whose replay gives an estimate from undamaged data.
    pub replayed: usize,
}

/// The whole run.
#[derive(Debug, Clone, Serialize)]
pub struct Long {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// Seed.
    pub seed: u64,
    /// Every hour.
    pub hours: Vec<Hour>,
    /// Growth of the resident memory from the end of the first hour to the largest since.
    pub memory_growth: Option<f64>,
    /// At the end.
    pub recorder: RecorderStats,
    /// What is in the folder.
    pub recordings: Recordings,
    /// Space that was allowed, bytes.
    pub limit_bytes: u64,
    /// What must not be, in words.
    pub failures: Vec<String>,
}

/// Runs it.
///
/// # Errors
/// When the recording cannot be started, or a recording cannot be read back.
pub fn run(settings: &LongSettings<'_>, progress: &dyn Progress) -> Result<Long, FaultsError> {
    let base = scenario("fixed_wing").ok_or(FaultsError::NoScenario("fixed_wing"))?;
    let model = assumed(&base);
    let setup = Setup {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        links: vec!["udpin:0.0.0.0:14550".to_owned()],
        model_toml: model.to_toml(),
        ..Setup::default()
    };
    let recorder =
        Recorder::start_in(settings.folder, super::station::EPOCH_US, &setup, Some(settings.limit))?;
    let mut run = Run::new(&model, settings.seed, recorder);
    let mut hours = Vec::new();
    for hour in 1..=settings.hours {
        let mut done = run.hour(hour, &base, settings.seed);
        done.resident_bytes = (settings.resident_bytes)();
        hours.push(done);
        progress.tick();
    }
    let recorder = run.station.into_recorder().map(Recorder::finish).unwrap_or_default();
    let recordings = read_back(settings.folder, progress)?;
    let mut long = Long {
        schema: "gaware.study/1",
        seed: settings.seed,
        memory_growth: growth(&hours),
        hours,
        recorder,
        recordings,
        limit_bytes: settings.limit.bytes(),
        failures: Vec::new(),
    };
    long.failures = failures(&long);
    Ok(long)
}

/// The companion and what is true of its vehicle.
struct Run {
    station: Station,
    kind: Kind,
    vehicle: Model,
    sensors: Calibration,
    noise: Noise,
}

impl Run {
    fn new(model: &Model, seed: u64, recorder: Recorder) -> Self {
        let vehicle = draw_vehicle(model, seed);
        let path = FixedWing::new(true).landed().paused(5.0, GROUND_S).repeated(FLIGHTS);
        let [wing, _] = flight::kinds();
        Self {
            station: Station::new(model.clone(), seed, Some(recorder)),
            kind: Kind { path: Flown::with_step(path, TURN_S), ..wing },
            sensors: Calibration::new(&vehicle),
            vehicle,
            noise: Noise::new(seed, Purpose::Choice),
        }
    }

    /// One of these.
    fn one_of<T: Clone>(&mut self, choices: &[T]) -> Option<T> {
        let k = (self.noise.uniform() * choices.len() as f64) as usize;
        choices.get(k.min(choices.len().saturating_sub(1))).cloned()
    }

    fn hour(&mut self, hour: u32, base: &Scenario, seed: u64) -> Hour {
        let at = |share: f64, from: f64| from + 300.0 * share;
        let (link_s, vehicle_s, messages_s) = (
            at(self.noise.uniform(), 600.0),
            at(self.noise.uniform(), 1500.0),
            at(self.noise.uniform(), 2500.0),
        );
        let (link, link_words) = self.one_of(&links()).unwrap_or_default();
        let (fault, fault_words) = self.one_of(&faults(vehicle_s)).unwrap_or((Fault::Gimbal, "a gimbal"));
        let (spoil, spoil_words) = self.one_of(&spoils()).unwrap_or((Spoil::None, "nothing"));
        let case = Case {
            name: "long",
            happens: "",
            cause: Cause::Vehicle(fault),
            span_s: (messages_s, messages_s + 120.0),
            reported: &[],
            highres: false,
        };
        let seed = seed.wrapping_add(u64::from(hour) << 20);
        let path = self.kind.path.clone();
        let autopilot = flight::autopilot(&self.kind, path, &case, &base.sensors, &self.vehicle, seed);
        self.station.connect(autopilot, Spoiler::new(spoil, case.span_s.0..case.span_s.1));
        let (looks, judged) = self.fly(&link, link_s);
        let n = judged.len().max(1) as f64;
        let worst = judged.iter().max_by(|a, b| a.1.nees[0].total_cmp(&b.1.nees[0]));
        Hour {
            hour,
            faults: [link_words, fault_words, spoil_words].map(str::to_owned).to_vec(),
            running: judged.len() as f64 / f64::from(looks.max(1)),
            nees_mean_per_dof: judged.iter().map(|(_, j)| j.nees[0]).sum::<f64>() / n,
            nees_worst_per_dof: worst.map_or(0.0, |(_, j)| j.nees[0]),
            worst_at_s: worst.map_or(0.0, |(t_s, _)| *t_s),
            worst_states: worst.map(|(_, j)| j.largest.clone()).unwrap_or_default(),
            largest: judged.last().map(|(_, j)| j.largest.clone()).unwrap_or_default(),
            resident_bytes: None,
            recorder: self.station.recorder().map(Recorder::stats).unwrap_or_default(),
        }
    }

    /// Through the hour; gives the number of looks, and when the estimate ran its errors at them.
    fn fly(&mut self, link: &LinkFaults, link_s: f64) -> (u32, Vec<(f64, Judged)>) {
        let mut path = self.kind.path.clone();
        let (mut looks, mut found) = (0_u32, Vec::new());
        let turns = (HOUR_S / TURN_S) as u64;
        for turn in 0..turns {
            let t_s = turn as f64 * TURN_S;
            if (t_s - link_s).abs() < 0.5 * TURN_S {
                self.station.set_link_faults(link);
            }
            if (t_s - link_s - 120.0).abs() < 0.5 * TURN_S {
                self.station.set_link_faults(&LinkFaults::default());
            }
            self.station.turn();
            if !turn.is_multiple_of(SHOW_TURNS) {
                continue;
            }
            let (_, shown) = self.station.show();
            while self.station.recorder().is_some_and(|r| r.waiting() > AHEAD) {
                std::thread::yield_now();
            }
            if turn.is_multiple_of(SHOW_TURNS * LOOK_SHOWS) {
                looks += 1;
                let judged = judged(&self.station, &mut path, &self.sensors);
                found.extend(judged.filter(|_| shown.phase == Phase::Running).map(|j| (t_s, j)));
            }
        }
        (looks, found)
    }
}

fn links() -> Vec<(LinkFaults, &'static str)> {
    let none = LinkFaults::default;
    vec![
        (LinkFaults { loss: 0.2, ..none() }, "20 % of the frames lost"),
        (LinkFaults { loss: 1.0, ..none() }, "120 s of silence"),
        (LinkFaults { jitter_s: 2.0, ..none() }, "frames late by up to 2 s"),
        (LinkFaults { corrupt: 0.2, ..none() }, "a bit flipped in 20 % of the frames"),
        (LinkFaults { duplicate: 0.5, reorder: 0.2, ..none() }, "frames twice and overtaken"),
    ]
}

fn faults(at_s: f64) -> Vec<(Fault, &'static str)> {
    vec![
        (Fault::Reboot { at_s }, "a reboot"),
        (Fault::GnssLoss { from_s: at_s, to_s: at_s + 300.0 }, "no fix for 300 s"),
        (Fault::ClockJump { at_s, by_s: 60.0 }, "the clock 60 s ahead"),
        (Fault::RateTheft { at_s }, "another station lowers the rates"),
    ]
}

fn spoils() -> Vec<(Spoil, &'static str)> {
    vec![
        (Spoil::Clock(20.0), "the clock 20 s ahead for 120 s"),
        (Spoil::FixStamps(8.0), "every fifth fix stamped 8 s ahead"),
        (Spoil::InertialStamps(-8.0), "every fifth sample stamped 8 s behind"),
        (Spoil::Decimated(2), "half of the samples"),
        (Spoil::Flood(20), "a flood of frames of other components"),
        (Spoil::Wrap { of_us: true, at_s: 2600.0 }, "a 32-bit counter of microseconds wraps"),
    ]
}

fn growth(hours: &[Hour]) -> Option<f64> {
    let (first, later) = hours.split_first()?;
    let first = first.resident_bytes.filter(|b| *b > 0)? as f64;
    let largest = later.iter().filter_map(|h| h.resident_bytes).max()? as f64;
    Some(largest / first - 1.0)
}

/// Reads every recording, by the reader of the `mcap` crate and as `gaware replay` does.
fn read_back(folder: &Path, progress: &dyn Progress) -> Result<Recordings, FaultsError> {
    let unreadable = |source| FaultsError::Read { path: folder.to_owned(), source };
    let mut found = Recordings::default();
    let entries = std::fs::read_dir(folder).map_err(unreadable)?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "mcap"));
    paths.sort();
    for path in paths {
        let bytes = std::fs::read(&path).map_err(unreadable)?;
        found.files += 1;
        found.bytes += bytes.len() as u64;
        let summary = mcap::Summary::read(&bytes).ok().flatten();
        let whole = mcap::MessageStream::new(&bytes).is_ok_and(|mut all| all.all(|m| m.is_ok()));
        found.opened += usize::from(summary.is_some() && whole);
        drop(bytes);
        found.replayed += usize::from(replays(&path));
    }
    progress.tick();
    Ok(found)
}

fn replays(path: &Path) -> bool {
    let Ok(recorded) = Recorded::open(path, ConverterOptions::default()) else { return false };
    let model = recorded.setup().and_then(|s| Model::from_toml(&s.model_toml).ok());
    let Some(model) = model else { return false };
    let engine = Engine::new(model, EngineOptions::default());
    let Ok((pipeline, damage)) = recorded.run(engine, f64::INFINITY, &|_| {}) else { return false };
    !damage.any() && pipeline.summary().imu.samples > 0
}

fn failures(long: &Long) -> Vec<String> {
    let mut wrong = Vec::new();
    match long.memory_growth {
        Some(growth) if growth > GROWTH_LIMIT => {
            wrong.push(format!("memory grew by {:.1} % after the first hour", 100.0 * growth));
        }
        _ => {}
    }
    let stats = long.recorder;
    if stats.dropped + stats.failed > 0 {
        wrong.push(format!("{} items were not recorded", stats.dropped + stats.failed));
    }
    let found = &long.recordings;
    if found.opened < found.files || found.replayed < found.files || found.files == 0 {
        wrong.push(format!(
            "of {} recordings {} open and {} replay",
            found.files, found.opened, found.replayed
        ));
    }
    if found.bytes > long.limit_bytes {
        wrong.push(format!("the recordings take {} of {} bytes", found.bytes, long.limit_bytes));
    }
    // The mean over an hour is hardly better than one draw: the constants are the same all the time.
    let mean_limit = MEAN_LIMIT.max(1.0 + 3.3 * (2.0 / DOF).sqrt());
    for hour in &long.hours {
        let (mean, worst) = (hour.nees_mean_per_dof, hour.nees_worst_per_dof);
        if !(mean <= mean_limit && worst <= WORST_LIMIT) || hour.running < 0.5 {
            let share = 100.0 * hour.running;
            wrong.push(format!(
                "hour {}: NEES/dof {mean:.2}, worst {worst:.2}, running {share:.0} % of the time",
                hour.hour
            ));
        }
    }
    wrong
}
