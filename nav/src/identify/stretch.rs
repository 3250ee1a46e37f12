//! The part of a recording that can be explained: from one start to the end, without a restart, without a change of the calibration that the
//! samples carry, and without a gap in the samples that nothing bridges.

use super::by_hand::ByHand;
use super::guess::{self, Guesses};
use super::linear::Unseen;
use crate::estimator::{Estimator, Stage};
use crate::filter::Initial;
use crate::model::Model;
use crate::operating::OperatingSeries;
use crate::quantisation::crossings;
use crate::sample::{AirSample, FieldSample, GnssFix, ImuSample, ImuStream, Sample};

/// A filter that has heading starts with these 1-sigmas whatever the search said of them, rad.
const START_ATTITUDE_SIGMA: [f64; 3] = [0.06, 0.06, 0.14];
/// A flight must hold this much after the start, s …
pub const ENOUGH_S: f64 = 40.0;
/// … and this many fixes.
pub const ENOUGH_FIXES: usize = 40;
/// Fixes are at most this old, s …
const LONGEST_DELAY_S: f64 = 0.5;
/// … and a receiver that smooths still shows this much after their time of validity, s.
const AFTER_S: f64 = 0.1;

/// News of a calibration are at most this old, s: a heartbeat comes every second.
const CALIBRATION_NEWS_S: f64 = 1.2;

/// Why a recording cannot be explained.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TooLittle {
    /// No inertial samples.
    #[error("there are no inertial samples")]
    NoImu,
    /// No fixes.
    #[error(
        "there are no GNSS fixes, and the vehicle was not turned by hand: turn it to six sides (gaware ground), or fly with a receiver"
    )]
    NoFixes,
    /// The estimation never got going.
    #[error(
        "the heading never became known: the vehicle must move, or the log must hold the autopilot's attitude"
    )]
    NoStart,
    /// Too short.
    #[error("only {seconds:.0} s with {fixes} fixes after the start; at least 40 s with 40 fixes are needed")]
    TooShort {
        /// Seconds after the start.
        seconds: f64,
        /// Fixes after the start.
        fixes: usize,
    },
    /// Gaps that nothing bridges leave too little.
    #[error(
        "the longest stretch without a gap in the samples is {seconds:.0} s with {fixes} fixes, and the log holds no attitude of the autopilot that leads across the gaps; at \
         least 40 s with 40 fixes are needed"
    )]
    Gaps {
        /// Seconds of the stretch.
        seconds: f64,
        /// Its fixes.
        fixes: usize,
    },
    /// It never moved.
    #[error(
        "the vehicle is stationary: turn it to six sides by hand (gaware ground), or fly turns, climbs and changes of speed"
    )]
    Standing,
}

/// A stretch with its start.
pub(super) struct Stretch {
    pub(super) stream: ImuStream,
    pub(super) initial: Initial,
    /// Inertial samples after the start.
    pub(super) raw: Vec<ImuSample>,
    /// Fixes after the start.
    pub(super) fixes: Vec<GnssFix>,
    /// Rest and place of a unit that was turned by hand.
    pub(super) by_hand: ByHand,
    /// What its compasses measured.
    pub(super) fields: Vec<FieldSample>,
    /// What its barometers and airspeed sensors measured.
    pub(super) air: Vec<AirSample>,
    pub(super) unseen: Unseen,
    pub(super) guesses: Guesses,
    /// How much of the recording gaps cut off that nothing bridges, s.
    pub(super) unbridged_s: f64,
    pub(super) operating: OperatingSeries,
}

impl Stretch {
    /// The longest one of a recording. `model` finds the start.
    pub(super) fn of(samples: &[Sample], model: &Model) -> Result<Self, TooLittle> {
        let whole = longest_stretch(samples);
        let mut stream = announced(samples, whole);
        let all = inertial(whole);
        let mut unseen = Unseen::of(&all, stream.kind);
        let blind_s = guess::learn(whole, &all, &mut unseen);
        let stretch = longest_bridged(whole, &blind_s);
        let recorded_s = span_s(&all);
        let mut raw = if blind_s.is_empty() { all } else { inertial(stretch) };
        let unbridged_s = recorded_s - span_s(&raw);
        let mut fixes: Vec<GnssFix> = stretch
            .iter()
            .filter_map(|s| match s {
                Sample::Fix(fix) => Some(*fix),
                _ => None,
            })
            .collect();
        if raw.is_empty() {
            return Err(TooLittle::NoImu);
        }
        let said = samples.iter().filter(|s| matches!(s, Sample::Stream(_) | Sample::Place(_)));
        let has_receiver = !fixes.is_empty();
        let (by_hand, placed) = ByHand::of(said.take(2), stretch, &raw, model);
        fixes.extend(placed);
        if fixes.is_empty() {
            return Err(TooLittle::NoFixes);
        }
        let initial = start(samples, stretch, model, has_receiver).ok_or(TooLittle::NoStart)?;
        raw.retain(|s| s.t_s > initial.t_s);
        if let Some(quantisation) = crossings::contradicted(&stream, &raw, model) {
            stream.quantisation = quantisation;
        }
        fixes.retain(|f| f.t_s > initial.t_s);
        fixes.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        let fixes = without_unseen(fixes, &unseen);
        unseen.add_touchdowns(&fixes, stream.kind);
        let seconds = raw.last().map_or(0.0, |s| s.t_s - initial.t_s);
        if seconds < ENOUGH_S || fixes.len() < ENOUGH_FIXES {
            let fixes = fixes.len();
            return Err(match blind_s.is_empty() {
                true => TooLittle::TooShort { seconds, fixes },
                false => TooLittle::Gaps { seconds, fixes },
            });
        }
        let guesses = Guesses::of(stretch, &unseen);
        let field = |s: &Sample| match s {
            Sample::Field(field) if field.t_s > initial.t_s => Some(*field),
            _ => None,
        };
        let of_air = |s: &Sample| match s {
            Sample::Air(air) if air.t_s > initial.t_s => Some(*air),
            _ => None,
        };
        let air = stretch.iter().filter_map(of_air).collect();
        let operating = OperatingSeries::of(stretch);
        let fields = stretch.iter().filter_map(field).collect();
        Ok(Self {
            stream,
            initial,
            raw,
            fixes,
            fields,
            air,
            by_hand,
            unseen,
            guesses,
            unbridged_s,
            operating,
        })
    }
}

/// A fix that is valid within a gap measures motion that no sample shows. Its delay is not known yet: the same fixes count for
/// every model. Where the samples are nothing but gaps, all fixes stay.
fn without_unseen(fixes: Vec<GnssFix>, unseen: &Unseen) -> Vec<GnssFix> {
    let shown = |f: &&GnssFix| !unseen.hides(f.t_s - LONGEST_DELAY_S, f.t_s + AFTER_S);
    let seen: Vec<GnssFix> = fixes.iter().filter(shown).copied().collect();
    if 2 * seen.len() > fixes.len() { seen } else { fixes }
}

/// Where the estimation starts: in a recording with a receiver not before its heading is known.
fn start(samples: &[Sample], stretch: &[Sample], model: &Model, has_receiver: bool) -> Option<Initial> {
    let mut estimator = Estimator::new(model.clone());
    // The announcement may lie before the stretch.
    if let Some(first) = samples.iter().find(|s| matches!(s, Sample::Stream(_))) {
        estimator.feed(first);
    }
    if let Some(place) = samples.iter().find(|s| matches!(s, Sample::Place(_))) {
        estimator.feed(place);
    }
    stretch.iter().find_map(|sample| {
        estimator.feed(sample);
        let waits = has_receiver && estimator.on_ground_without_fixes() == Some(false);
        start_of(&estimator).filter(|_| !waits)
    })
}

/// What the source last said of the samples of a stretch, or before it.
fn announced(samples: &[Sample], stretch: &[Sample]) -> ImuStream {
    let stream = |s: &Sample| match s {
        Sample::Stream(s) => Some(s.clone()),
        _ => None,
    };
    let own = stretch.iter().rev().find_map(stream);
    own.or_else(|| samples.iter().find_map(stream)).unwrap_or_default()
}

fn span_s(raw: &[ImuSample]) -> f64 {
    raw.first().zip(raw.last()).map_or(0.0, |(a, b)| b.t_s - a.t_s)
}

fn start_of(estimator: &Estimator) -> Option<Initial> {
    if estimator.stage() != Stage::Running {
        return None;
    }
    let filter = estimator.filter()?;
    Some(Initial {
        t_s: filter.t_s(),
        nav: *filter.nav(),
        position_sigma_m: [8.0; 3],
        velocity_sigma_m_per_s: [2.0; 3],
        attitude_sigma_rad: START_ATTITUDE_SIGMA,
    })
}

/// The inertial samples of a stretch in order of time.
fn inertial(stretch: &[Sample]) -> Vec<ImuSample> {
    let mut raw: Vec<ImuSample> = Vec::new();
    for sample in stretch {
        match sample {
            Sample::Imu(imu) if raw.last().is_none_or(|l| imu.t_s > l.t_s) => raw.push(*imu),
            _ => {}
        }
    }
    raw
}

/// The longest part of a stretch between the ends of gaps that nothing bridges.
fn longest_bridged<'a>(stretch: &'a [Sample], blind_s: &[f64]) -> &'a [Sample] {
    let mut best: &[Sample] = &[];
    let mut rest = stretch;
    let begins = |s: &Sample, at_s: f64| matches!(s, Sample::Imu(imu) if imu.t_s >= at_s);
    for end_s in blind_s {
        let at = rest.iter().position(|s| begins(s, *end_s)).unwrap_or(rest.len());
        let (own, after) = rest.split_at(at);
        rest = after;
        if own.len() > best.len() {
            best = own;
        }
    }
    if rest.len() > best.len() { rest } else { best }
}

/// The longest stretch between two restarts or calibrations.
fn longest_stretch(samples: &[Sample]) -> &[Sample] {
    let parts = samples.split(|s| matches!(s, Sample::Restart(_) | Sample::Recalibrated));
    let mut best: &[Sample] = &[];
    let mut from = 0;
    for part in parts {
        let end = samples.get(from + part.len());
        from += part.len() + 1;
        let own = if end == Some(&Sample::Recalibrated) { without_end(part) } else { part };
        if own.len() > best.len() {
            best = own;
        }
    }
    best
}

/// What was recorded before the autopilot may have changed its calibration: it says so a moment later.
fn without_end(part: &[Sample]) -> &[Sample] {
    let time = |s: &Sample| if let Sample::Imu(imu) = s { Some(imu.t_s) } else { None };
    let Some(last_s) = part.iter().rev().find_map(time) else { return part };
    let before = |s: &Sample| time(s).is_some_and(|t_s| t_s < last_s - CALIBRATION_NEWS_S);
    part.split_at(part.iter().rposition(before).map_or(0, |k| k + 1)).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::RestartReason;
    use nalgebra::Vector3;

    fn imu(t_s: f64) -> Sample {
        Sample::Imu(ImuSample {
            t_s,
            gyro: Vector3::zeros(),
            accel: Vector3::zeros(),
            temperature_degc: None,
        })
    }

    /// A flight of a minute, disarmed after it, and half a minute on the ground with another calibration.
    #[test]
    fn a_stretch_ends_where_the_calibration_changes() {
        let flight = (0..600).map(|k| imu(f64::from(k) * 0.1));
        let after = (600..900).map(|k| imu(f64::from(k) * 0.1));
        let all: Vec<Sample> = flight.chain([Sample::Recalibrated]).chain(after).collect();
        let stretch = longest_stretch(&all);
        assert_eq!(stretch.first(), Some(&imu(0.0)));
        let Some(Sample::Imu(last)) = stretch.last() else { panic!("{stretch:?}") };
        assert!((57.0..59.0).contains(&last.t_s), "{}: the news is late", last.t_s);
    }

    #[test]
    fn the_longest_of_several_stretches_is_taken_whole() {
        let part = |from: u32, to: u32| (from..to).map(|k| imu(f64::from(k) * 0.1));
        let restart = Sample::Restart(RestartReason::Reboot);
        let all: Vec<Sample> = part(0, 100)
            .chain([Sample::Recalibrated])
            .chain(part(100, 400))
            .chain([restart])
            .chain(part(0, 50))
            .collect();
        assert_eq!(longest_stretch(&all), &all[101..401]);
        assert_eq!(longest_stretch(&[]), &[] as &[Sample]);
    }
}
