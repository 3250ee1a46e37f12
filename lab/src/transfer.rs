//! Mission uploads over bad links, many times: does every one end verified, or with the previous mission back, or with words
//! that say that no one knows? The session of `gaware mission upload` runs against the simulated autopilot in virtual
//! time, and what it says at the end is compared with what really is on the vehicle.

mod air;
mod others;
mod station;

use air::{Air, Aircraft};
use gaware::link::endpoint::Origin;
use gaware::mission_link::pinned::Pinned;
use gaware::mission_link::wire::{self, Wire, at_once};
use gaware::parallel::{Progress, map_runs};
use gaware_mission::compare::differences;
use gaware_mission::item::{Home, LatLon, Mission, MissionItem, command};
use gaware_mission::transfer::verified::{Options, Outcome};
use gaware_sitl::autopilot::{AutopilotConfig, Flavour};
use gaware_sitl::faults::LinkFaults;
use gaware_sitl::noise::{Noise, Purpose};
pub use others::{Other, OthersTally};
use serde::Serialize;

/// What the faulty link does to every frame, each way.
const LOSS: f64 = 0.2;
const DUPLICATE: f64 = 0.05;
const REORDER: f64 = 0.1;
const DELAY_S: f64 = 0.2;
/// A cut begins within this time from the start of the upload, s: longer than most transfers take.
const CUT_WITHIN_S: f64 = 60.0;
/// A link that comes back does so within this time, s.
const CUT_FOR_S: (f64, f64) = (2.0, 240.0);
/// The session waits so long for a link that is gone, s.
const PATIENCE_S: f64 = 600.0;
/// Most items of the two missions.
const MOST_ITEMS: f64 = 25.0;

/// What happens to the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Link {
    /// Loss, duplicates, reordering and delay.
    Bad,
    /// The same, and cut at a random moment for a random time.
    Cut,
    /// The same, and cut at a random moment for good.
    CutForGood,
}

/// All uploads of one autopilot over one kind of link.
#[derive(Debug, Clone, Serialize)]
pub struct Tally {
    /// Whose habits the vehicle has: `ardupilot` or `px4`.
    pub autopilot: &'static str,
    /// What happens to the link.
    pub link: Link,
    /// Uploads.
    pub runs: usize,
    /// Ended verified, and the new mission is on the vehicle.
    pub verified: usize,
    /// Failed, and the previous mission is on the vehicle as is said.
    pub previous_back: usize,
    /// Ended with the statement that no one knows what is on the vehicle.
    pub unknown_and_said: usize,
    /// Of these the vehicle really holds neither mission.
    pub mixed_and_said: usize,
    /// Ended with a statement that is wrong: must be none.
    pub wrong_statement: usize,
    /// Longest virtual time, s.
    pub longest_s: f64,
}

/// All of them.
#[derive(Debug, Clone, Serialize)]
pub struct TransferStudy {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// By autopilot and link.
    pub transfers: Vec<Tally>,
    /// By autopilot and who else is there.
    pub others: Vec<OthersTally>,
}

impl TransferStudy {
    /// Transfers that ended with a wrong statement, or changed what was not meant.
    pub fn wrong(&self) -> usize {
        let others = self.others.iter().map(|t| t.wrong_statement + t.not_meant);
        self.transfers.iter().map(|t| t.wrong_statement).sum::<usize>() + others.sum::<usize>()
    }
}

/// One table row per tally.
impl std::fmt::Display for TransferStudy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{:<10}{:<14}{:>6}{:>10}{:>15}{:>14}{:>7}{:>11}",
            "", "link", "runs", "verified", "previous back", "unknown, said", "wrong", "longest s"
        )?;
        for t in &self.transfers {
            let link = match t.link {
                Link::Bad => "bad",
                Link::Cut => "cut",
                Link::CutForGood => "cut for good",
            };
            writeln!(
                f,
                "{:<10}{link:<14}{:>6}{:>10}{:>15}{:>14}{:>7}{:>11.0}",
                t.autopilot,
                t.runs,
                t.verified,
                t.previous_back,
                t.unknown_and_said,
                t.wrong_statement,
                t.longest_s
            )?;
        }
        writeln!(
            f,
            "\n{:<10}{:<26}{:>6}{:>7}{:>9}{:>15}{:>11}{:>7}",
            "", "beside it", "runs", "done", "stopped", "unknown, said", "not meant", "wrong"
        )?;
        for t in &self.others {
            let other = match t.other {
                Other::SameId => "second vehicle, same id",
                Other::Exchanged => "exchanged before restore",
                Other::Station => "second station",
            };
            writeln!(
                f,
                "{:<10}{other:<26}{:>6}{:>7}{:>9}{:>15}{:>11}{:>7}",
                t.autopilot, t.runs, t.done, t.stopped, t.unknown_and_said, t.not_meant, t.wrong_statement
            )?;
        }
        Ok(())
    }
}

/// Uploads with the seeds `seed … seed + runs − 1`, for both autopilots and each kind of link.
pub fn run(runs: usize, seed: u64, progress: &dyn Progress) -> TransferStudy {
    let kinds = [Flavour::ArduPilot, Flavour::Px4]
        .into_iter()
        .flat_map(|f| [Link::Bad, Link::Cut, Link::CutForGood].map(|l| (f, l)));
    let transfers = kinds.map(|(flavour, link)| {
        let ends = map_runs(runs, progress, |k| upload(flavour, link, seed + k as u64));
        let count = |end| ends.iter().filter(|(e, _)| *e == end).count();
        Tally {
            autopilot: name(flavour),
            link,
            runs,
            verified: count(End::Verified),
            previous_back: count(End::PreviousBack),
            unknown_and_said: count(End::UnknownSaid) + count(End::MixedSaid),
            mixed_and_said: count(End::MixedSaid),
            wrong_statement: count(End::Wrong),
            longest_s: ends.iter().map(|(_, t)| *t).fold(0.0, f64::max),
        }
    });
    let transfers = transfers.collect();
    let all = [Other::SameId, Other::Exchanged, Other::Station];
    let kinds = [Flavour::ArduPilot, Flavour::Px4].into_iter().flat_map(|f| all.map(|other| (f, other)));
    let others = kinds.map(|kind| others::tally(kind, runs, seed, progress));
    TransferStudy { schema: "gaware.study/1", transfers, others: others.collect() }
}

fn name(flavour: Flavour) -> &'static str {
    match flavour {
        Flavour::ArduPilot => "ardupilot",
        Flavour::Px4 => "px4",
    }
}

/// What an upload came to, checked against the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Verified,
    PreviousBack,
    UnknownSaid,
    MixedSaid,
    Wrong,
}

fn upload(flavour: Flavour, link: Link, seed: u64) -> (End, f64) {
    let mut dice = Noise::new(seed, Purpose::Link);
    let mut draw = |low: f64, high: f64| low + (high - low) * dice.uniform();
    let [previous, new] = [0.01, 0.02].map(|away| mission(draw(1.0, MOST_ITEMS) as usize, away));
    let (cut_at, cut_for) = (draw(0.0, CUT_WITHIN_S), draw(CUT_FOR_S.0, CUT_FOR_S.1));
    let config = AutopilotConfig { flavour, seed, ..AutopilotConfig::default() };
    let mut wire = Air::of(vec![Aircraft::new(config, Origin::default())]).connect();
    at_once(wire.identify()).map_or_else(|e| tracing::error!("{e}"), |()| ());
    let put = |wire: &mut Pinned<Air>, mission: &Mission| {
        let options = Options::default();
        at_once(wire::upload(wire, mission.clone(), options, PATIENCE_S, |_| Ok(()), |_| ()))
    };
    // Over a perfect link.
    put(&mut wire, &previous);
    let start_s = wire.now_s();
    let dropouts = match link {
        Link::Bad => Vec::new(),
        Link::Cut => vec![(start_s + cut_at, start_s + cut_at + cut_for)],
        Link::CutForGood => vec![(start_s + cut_at, f64::INFINITY)],
    };
    let faults = LinkFaults {
        loss: LOSS,
        duplicate: DUPLICATE,
        reorder: REORDER,
        delay_s: DELAY_S,
        dropouts,
        ..LinkFaults::default()
    };
    wire.raw.aircraft.iter_mut().for_each(|a| a.spoil(faults.clone(), seed));
    let outcome = put(&mut wire, &new);
    let took_s = wire.now_s() - start_s;
    let firmware = wire.vehicle().autopilot;
    let on_board = wire.raw.aircraft.iter().map(|a| a.on_board(firmware)).next().unwrap_or_default();
    let holds = |mission| differences(firmware, mission, &on_board).is_empty();
    let end = match outcome {
        Outcome::Verified { .. } if holds(&new) => End::Verified,
        Outcome::RestoredPrevious { .. } if holds(&previous) => End::PreviousBack,
        Outcome::Unknown { .. } if holds(&new) || holds(&previous) => End::UnknownSaid,
        Outcome::Unknown { .. } => End::MixedSaid,
        _ => End::Wrong,
    };
    (end, took_s)
}

/// A mission whose places are no one else's.
fn mission(legs: usize, away_deg: f64) -> Mission {
    let place = |k: usize| LatLon { lat_deg: 47.397 + away_deg, lon_deg: 8.545 + 1e-4 * k as f64 };
    let legs = (0..legs).map(|k| MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], place(k), 50.0));
    Mission {
        home: Some(Home { lat_e7: 473_970_000, lon_e7: 85_450_000, alt_m: 441.0 }),
        items: legs.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware::parallel::Silent;

    #[test]
    fn no_vehicle_that_was_not_meant_is_changed() {
        for kind in [Flavour::ArduPilot, Flavour::Px4] {
            for other in [Other::SameId, Other::Exchanged, Other::Station] {
                let t = others::tally((kind, other), 40, 1, &Silent);
                assert_eq!((t.not_meant, t.wrong_statement), (0, 0), "{t:?}");
                assert!(t.done > 0 && t.done < t.runs, "{t:?}");
            }
        }
    }

    #[test]
    fn no_upload_over_a_bad_or_cut_link_leaves_a_mixed_mission_unsaid() {
        let study = run(12, 1, &Silent);
        assert_eq!(study.wrong(), 0, "{study}");
        for t in &study.transfers {
            assert_eq!(t.verified + t.previous_back + t.unknown_and_said, t.runs, "{study}");
            assert!(t.verified > 0, "{study}");
            // A link that is or comes back settles everything.
            assert!(t.link == Link::CutForGood || t.unknown_and_said == 0, "{study}");
        }
        let cut = |l| study.transfers.iter().filter(|t| t.link == l).map(|t| t.previous_back).sum::<usize>();
        assert!(cut(Link::Cut) > 0, "some were cut in the middle: {study}");
    }
}
