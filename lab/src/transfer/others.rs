//! Who else is there: a second vehicle of the same id, a vehicle that is exchanged between kill and restoration, a second station.

use super::air::{Air, Aircraft};
use super::station::Station;
use super::{DELAY_S, MOST_ITEMS, PATIENCE_S, mission, name};
use gaware::link::endpoint::Origin;
use gaware::mission_link::journal::{Content, Journal};
use gaware::mission_link::pinned::Pinned;
use gaware::mission_link::restore::{self, Restoration, RestoreError};
use gaware::mission_link::wire::{self, News, Wire, at_once};
use gaware::parallel::{Progress, map_runs};
use gaware_mission::change::Phase;
use gaware_mission::compare::differences;
use gaware_mission::item::{Autopilot as Firmware, Mission};
use gaware_mission::transfer::verified::{Goal, Options, Outcome};
use gaware_sitl::autopilot::{AutopilotConfig, Flavour};
use gaware_sitl::faults::LinkFaults;
use gaware_sitl::noise::{Noise, Purpose};
use serde::Serialize;
use std::future::Future;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, Waker};

/// The second vehicle, or station, comes within this time from the start of the upload, s.
const COMES_WITHIN_S: f64 = 40.0;
/// The program is killed within this time, s.
const KILLED_WITHIN_S: f64 = 15.0;
/// A station that began so shortly before the end is no contradiction to what was read just then, s.
const JUST_BEGUN_S: f64 = 1.0;
/// The vehicle that is meant, the other one, and where they are.
const A: u64 = 0xA1;
const B: u64 = 0xB2;
const HERE: Origin = Origin { link: 0, peer: None };
const THERE: Origin = Origin { link: 1, peer: None };

/// Who else is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Other {
    /// A second vehicle with the same system id, from the start or on the way.
    SameId,
    /// Another vehicle with the same system id in place of the first one, when an interrupted upload is taken up.
    Exchanged,
    /// A second station that uploads.
    Station,
}

/// All transfers of one autopilot beside one of them.
#[derive(Debug, Clone, Serialize)]
pub struct OthersTally {
    /// Whose habits the vehicles have: `ardupilot` or `px4`.
    pub autopilot: &'static str,
    /// Who else is there.
    pub other: Other,
    /// Transfers.
    pub runs: usize,
    /// Ended with what was asked for on the vehicle.
    pub done: usize,
    /// Refused or stopped, with what was there before on the vehicle.
    pub stopped: usize,
    /// Ended with the statement that it is not known what is on the vehicle, or that it is another station's.
    pub unknown_and_said: usize,
    /// A vehicle that was not meant was changed, or another station's mission replaced: must be none.
    pub not_meant: usize,
    /// Ended with a statement that is wrong: must be none.
    pub wrong_statement: usize,
}

/// What a transfer came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Done,
    Stopped,
    Said,
    NotMeant,
    Wrong,
}

/// Counts what this many transfers come to.
pub(super) fn tally(
    (flavour, other): (Flavour, Other),
    runs: usize,
    seed: u64,
    progress: &dyn Progress,
) -> OthersTally {
    let transfer = match other {
        Other::SameId => same_id,
        Other::Exchanged => exchanged,
        Other::Station => second_station,
    };
    let ends = map_runs(runs, progress, |k| transfer(flavour, seed + k as u64));
    let count = |end: End| ends.iter().filter(|e| **e == end).count();
    OthersTally {
        autopilot: name(flavour),
        other,
        runs,
        done: count(End::Done),
        stopped: count(End::Stopped),
        unknown_and_said: count(End::Said),
        not_meant: count(End::NotMeant),
        wrong_statement: count(End::Wrong),
    }
}

fn firmware(flavour: Flavour) -> Firmware {
    match flavour {
        Flavour::ArduPilot => Firmware::ArduPilot,
        Flavour::Px4 => Firmware::Px4,
    }
}

/// A vehicle with this mission on board.
fn aircraft(flavour: Flavour, (uid, origin): (u64, Origin), seed: u64, mission: &Mission) -> Aircraft {
    let config = AutopilotConfig { flavour, uid, seed, ..AutopilotConfig::default() };
    let mut wire = Air::of(vec![Aircraft::new(config, HERE)]).connect();
    let put = wire::upload(&mut wire, mission.clone(), Options::default(), PATIENCE_S, |_| Ok(()), |_| ());
    at_once(put);
    let mut aircraft = wire.raw.aircraft.remove(0);
    aircraft.origin = origin;
    // As slow as a telemetry radio, so that there is time for something to come between.
    aircraft.spoil(LinkFaults { delay_s: DELAY_S, ..LinkFaults::default() }, seed);
    aircraft
}

fn holds(flavour: Flavour, aircraft: &Aircraft, mission: &Mission) -> bool {
    let firmware = firmware(flavour);
    differences(firmware, mission, &aircraft.on_board(firmware)).is_empty()
}

/// Three missions that have no place in common, and dice for the rest.
fn drawn(seed: u64) -> ([Mission; 3], Noise) {
    let mut dice = Noise::new(seed, Purpose::Link);
    let lengths = [0.01, 0.02, 0.03].map(|away| (1.0 + (MOST_ITEMS - 1.0) * dice.uniform(), away));
    (lengths.map(|(items, away)| mission(items as usize, away)), dice)
}

/// Whether the statement is true of the vehicle that was meant.
fn judged(outcome: &Outcome, has: impl Fn(&Mission) -> bool, new: &Mission, previous: &Mission) -> End {
    match outcome {
        Outcome::Verified { .. } if has(new) => End::Done,
        Outcome::RestoredPrevious { .. } if has(previous) => End::Stopped,
        Outcome::Unknown { .. } => End::Said,
        _ => End::Wrong,
    }
}

fn same_id(flavour: Flavour, seed: u64) -> End {
    let ([previous, new, theirs], mut dice) = drawn(seed);
    let (kind, comes) = (4.0 * dice.uniform(), COMES_WITHIN_S * dice.uniform());
    // From the start: behind the same router, or elsewhere; on the way, of the same hardware id (as PX4's simulations have) or not.
    let (from_start, other) = match kind as u32 {
        0 => (true, (B, HERE)),
        1 => (true, (B, THERE)),
        2 => (false, (A, THERE)),
        _ => (false, (B, THERE)),
    };
    let meant = aircraft(flavour, (A, HERE), seed, &previous);
    let mut second = aircraft(flavour, other, seed + 1, &theirs);
    second.on = from_start;
    let mut wire = Air::of(vec![meant, second]).connect();
    let meant = usize::from(wire.origin() != HERE);
    let own = [&previous, &theirs];
    wire.raw.comes = (!from_start).then_some((wire.now_s() + comes, 1));
    let refused = at_once(wire.identify()).is_err();
    let outcome = (!refused).then(|| {
        let put = wire::upload(&mut wire, new.clone(), Options::default(), PATIENCE_S, |_| Ok(()), |_| ());
        at_once(put)
    });
    let has =
        |k: usize, mission: &Mission| wire.raw.aircraft.get(k).is_some_and(|a| holds(flavour, a, mission));
    let untouched = |k: usize| own.get(k).is_some_and(|mission| has(k, mission));
    match outcome {
        _ if !untouched(1 - meant) => End::NotMeant,
        None if untouched(meant) => End::Stopped,
        None => End::Wrong,
        Some(outcome) => judged(&outcome, |m| has(meant, m), &new, own[meant]),
    }
}

/// Drives a transfer until it ends or the program is killed.
fn until_killed<T>(future: impl Future<Output = T>) -> Option<T> {
    match pin!(future).as_mut().poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

/// A folder for one journal, which goes with it.
struct Folder(PathBuf);

impl Folder {
    /// No other study of this process has the same, however many run at once.
    fn new() -> Option<Self> {
        static MADE: AtomicUsize = AtomicUsize::new(0);
        let name = format!("gaware-study-{}-{}", std::process::id(), MADE.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&path).ok()?;
        Some(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Uploads until the program is killed; the journal that is left.
fn killed(wire: &mut Pinned<Air>, new: &Mission, folder: &Path) -> Option<Journal> {
    let who = wire.identity();
    let mut journal = None;
    let keep = |previous: &Mission| {
        let content = Content::Mission { previous: previous.clone(), new: new.clone(), fences: None };
        let begun = Journal::begin(folder, who, content).map_err(|e| e.to_string())?;
        journal = Some(begun);
        Ok(())
    };
    let put = wire::upload(wire, new.clone(), Options::default(), PATIENCE_S, keep, |_| ());
    match until_killed(put) {
        Some(_) => None,
        None => journal,
    }
}

fn exchanged(flavour: Flavour, seed: u64) -> End {
    let ([previous, new, theirs], mut dice) = drawn(seed);
    let (kind, killed_s) = (3.0 * dice.uniform(), KILLED_WITHIN_S * dice.uniform());
    let Some(folder) = Folder::new() else { return End::Wrong };
    let mut wire = Air::of(vec![aircraft(flavour, (A, HERE), seed, &previous)]).connect();
    if at_once(wire.identify()).is_err() {
        return End::Wrong;
    }
    wire.raw.killed_s = wire.now_s() + killed_s;
    let Some(journal) = killed(&mut wire, &new, &folder.0) else { return End::Stopped };
    let Content::Mission { previous: kept, new: wanted, .. } = &journal.content else { return End::Wrong };
    // Another one, another one that gives no hardware id, or itself.
    let (uid, own) = match kind as u32 {
        0 => (B, true),
        1 => (0, true),
        _ => (A, false),
    };
    let connected =
        if own { aircraft(flavour, (uid, HERE), seed + 1, &theirs) } else { wire.raw.aircraft.remove(0) };
    let mut wire = Air::of(vec![connected]).connect();
    if at_once(wire.identify()).is_err() {
        return End::Wrong;
    }
    let request = Restoration {
        journal: &journal,
        previous: kept,
        new: wanted,
        fences: None,
        goal: Goal::Previous,
        force: false,
        even_while_flying: false,
        patience_s: PATIENCE_S,
        backup: folder.0.join("backup.plan"),
    };
    let settled = at_once(restore::settle(&mut wire, &request, |_| ()));
    let has = |mission: &Mission| wire.raw.aircraft.first().is_some_and(|a| holds(flavour, a, mission));
    match settled {
        _ if own && !has(&theirs) => End::NotMeant,
        Err(RestoreError::OtherVehicle(_) | RestoreError::Neither { .. }) if own => End::Stopped,
        Ok(settled) if !own => match judged(&settled.outcome, has, &new, &previous) {
            End::Stopped if request.backup.exists() => End::Done,
            _ => End::Wrong,
        },
        _ => End::Wrong,
    }
}

fn second_station(flavour: Flavour, seed: u64) -> End {
    let ([previous, new, theirs], mut dice) = drawn(seed);
    let begins = COMES_WITHIN_S * dice.uniform();
    let mut wire = Air::of(vec![aircraft(flavour, (A, HERE), seed, &previous)]).connect();
    if at_once(wire.identify()).is_err() {
        return End::Wrong;
    }
    let vehicle = wire.vehicle();
    let items = theirs.wire_items(vehicle.autopilot);
    wire.raw.station = Some(Station::new(vehicle.address, items, wire.now_s() + begins));
    let mut begun = false;
    let tell = |news: News| begun |= news == News::Phase(Phase::Sending);
    let put = wire::upload(&mut wire, new.clone(), Options::default(), PATIENCE_S, |_| Ok(()), tell);
    let outcome = at_once(put);
    let end_s = wire.now_s();
    let (first_s, done_s) = wire.raw.station.as_ref().map_or((None, None), |s| (s.first_s, s.done_s));
    let has = |mission: &Mission| wire.raw.aircraft.first().is_some_and(|a| holds(flavour, a, mission));
    let came = first_s.is_some_and(|t| t < end_s - JUST_BEGUN_S);
    match outcome {
        Outcome::Foreign { .. } if came && !has(&new) && !has(&previous) => End::Said,
        // What it finished stays, unless it was there before this upload began.
        Outcome::Verified { .. } if came && done_s.is_some() && has(&new) => End::Done,
        Outcome::RestoredPrevious { .. } if done_s.is_some() && !begun => End::Stopped,
        Outcome::Verified { .. } if !came => End::Done,
        outcome => match judged(&outcome, has, &new, &previous) {
            End::Stopped if came && done_s.is_some() => End::NotMeant,
            end => end,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn studies_at_the_same_time_keep_their_journals_apart() {
        let folders = [Folder::new(), Folder::new()].map(Option::unwrap);
        assert_ne!(folders[0].0, folders[1].0);
    }
}
