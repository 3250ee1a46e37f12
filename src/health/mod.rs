//! How the vehicle was during a flight, as its own log says: modes, receiver, vibration, the autopilot's filter, battery, failsafes, texts.
//!
//! [`HealthLog`] gathers states and events from the records of any format, [`checks`] judges them: ok, look or bad, each with the time and in the
//! words of the autopilot's users. It knows nothing of this program's own estimate.

pub mod checks;
mod control;
mod frames;
pub mod logger;
mod power;
mod rows;
#[cfg(test)]
mod tests;

use crate::logs::filter::{self, Channel};
use crate::logs::{HealthNote, Item, Level, LogNote, Record};
use crate::timeline::{Measurement, Stamp};
use control::Control;
use frames::Frames;
use gaware_nav::math::{cos, hypot};
use gaware_nav::rotation::wrap_pi;
use gaware_nav::sample::GnssFix;
use std::collections::BTreeMap;

/// More entries of a kind are not kept: two hours at 10 Hz.
const MOST: usize = 72_000;
/// Texts kept.
const MOST_TEXTS: usize = 2000;
/// What is reported as a state comes once a second. A log that says first and later that something ended holds changes alone, as those that ArduPilot begins
/// when it is armed: it was so from the beginning.
const STATE_SPACING_S: f64 = 5.0;
/// A fix so far from where the velocity of the last one leads has jumped, m. Receivers drift by 1 to 2 m over minutes.
const JUMP_M: f64 = 5.0;
/// Two fixes in a row this fast are of a vehicle that moves by itself, m/s.
const MOVES_M_PER_S: f64 = 5.0;
/// A receiver is silent after so many of its usual spacings.
const SPACINGS: f64 = 5.0;
/// Fixes further apart than this are not compared, s.
const FIX_SPACING_S: f64 = 1.5;

/// Values over time, s since the first inertial sample once [`HealthLog::start`] is asked.
type Series<T> = Vec<(u64, T)>;

/// What a receiver says of itself at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Receiver {
    /// 3 is a 3-D fix.
    pub fix_type: u8,
    /// Satellites used.
    pub satellites: Option<f64>,
    /// Horizontal dilution of precision.
    pub hdop: Option<f64>,
}

/// States and events over a log, by the time of its entries, µs.
#[derive(Debug, Clone, Default)]
pub struct HealthLog {
    frames: Frames,
    start_us: Option<u64>,
    end_us: u64,
    first_us: Option<u64>,
    modes: Series<String>,
    armed: Series<bool>,
    air: Series<bool>,
    receiver: Series<Receiver>,
    /// Seconds in which anything else came.
    alive: Series<()>,
    jamming: Series<f64>,
    interference: Series<bool>,
    jumps: Series<f64>,
    last_fix: Option<(u64, GnssFix)>,
    /// Of all fixes, over ground.
    fastest_m_per_s: f64,
    vibration: BTreeMap<u8, Series<f64>>,
    clipped: BTreeMap<u8, Series<f64>>,
    resets: BTreeMap<&'static str, Series<f64>>,
    faults: BTreeMap<&'static str, (bool, Series<bool>)>,
    lanes: Series<u8>,
    battery: Series<(f64, Option<f64>)>,
    cells: Option<f64>,
    supply: Series<f64>,
    stopped: Series<bool>,
    control: Control,
    lost: Series<[f64; 2]>,
    pauses: Series<f64>,
    texts: Series<(Level, String)>,
    ratios: BTreeMap<Channel, Series<f64>>,
}

impl HealthLog {
    /// Takes an entry of a log.
    pub fn take(&mut self, record: &Record) {
        let t_us = record.t_us;
        self.first_us.get_or_insert(t_us);
        self.end_us = self.end_us.max(t_us);
        match &record.item {
            Item::Note(LogNote::Health(note)) => self.note(t_us, note),
            Item::Note(LogNote::Filter(values)) => self.values(t_us, values),
            Item::Measurement(Measurement::Imu(..)) => _ = self.start_us.get_or_insert(t_us),
            Item::Measurement(Measurement::Attitude(_, [roll, pitch, _])) => {
                self.control.attitude(t_us, [*roll, *pitch]);
            }
            Item::Measurement(Measurement::Operating(_, values)) => self.control.outputs(t_us, values),
            Item::Measurement(Measurement::Fix(stamp, fix)) => {
                self.fix(t_us, stamp.map(Stamp::raw_us), fix);
            }
            Item::Frame(frame) => {
                let found = self.frames.take(frame);
                if found.inertial {
                    self.start_us.get_or_insert(t_us);
                }
                found.notes.iter().for_each(|note| self.note(t_us, note));
                found.fix.iter().for_each(|(measured_us, fix)| self.fix(t_us, *measured_us, fix));
                found.lean.iter().for_each(|lean| self.control.attitude(t_us, *lean));
                found.outputs.iter().for_each(|values| self.control.outputs(t_us, values));
                if found.old_severities {
                    self.texts.iter_mut().for_each(|(_, (level, text))| *level = Level::of_words(text));
                }
                if found.ours {
                    self.values(t_us, &filter::of_frame(frame));
                }
            }
            _ => {}
        }
    }

    fn values(&mut self, t_us: u64, values: &[(Channel, f64)]) {
        use Channel::{HeadingRatio, HeightRatio, PositionRatio, VelocityRatio};
        for (channel, value) in values {
            if matches!(channel, VelocityRatio | PositionRatio | HeightRatio | HeadingRatio) {
                keep(self.ratios.entry(*channel).or_default(), t_us, *value);
            }
        }
    }

    fn note(&mut self, t_us: u64, note: &HealthNote) {
        if !matches!(note, HealthNote::Gnss { .. })
            && self.alive.last().is_none_or(|(last, ())| t_us >= last + 1_000_000)
        {
            keep(&mut self.alive, t_us, ());
        }
        match note {
            HealthNote::Mode(name) => change(&mut self.modes, t_us, name.clone()),
            HealthNote::Armed(on) => change(&mut self.armed, t_us, *on),
            HealthNote::InAir(on) => change(&mut self.air, t_us, *on),
            HealthNote::Gnss { fix_type, satellites, hdop, jamming, interference } => {
                // A message of the receiver without a solution brings its other figures only.
                if *fix_type != u8::MAX {
                    let (satellites, hdop) = (*satellites, hdop.filter(|h| *h > 0.0 && *h < 90.0));
                    keep(&mut self.receiver, t_us, Receiver { fix_type: *fix_type, satellites, hdop });
                }
                jamming.iter().for_each(|v| keep(&mut self.jamming, t_us, *v));
                change(&mut self.interference, t_us, *interference);
            }
            HealthNote::Vibration(unit, level) => {
                keep(self.vibration.entry(*unit).or_default(), t_us, *level)
            }
            HealthNote::Clipped(unit, count) => change(self.clipped.entry(*unit).or_default(), t_us, *count),
            HealthNote::Resets(what, count) => change(self.resets.entry(what).or_default(), t_us, *count),
            HealthNote::Fault { what, on, grave } => {
                let (worst, series) = self.faults.entry(what).or_default();
                *worst |= grave;
                change(series, t_us, *on);
            }
            HealthNote::Lane(lane) => change(&mut self.lanes, t_us, *lane),
            HealthNote::Battery { volts, cells, remaining } => {
                self.cells = cells.or(self.cells);
                keep(&mut self.battery, t_us, (*volts, *remaining));
            }
            HealthNote::Supply(volts) => keep(&mut self.supply, t_us, *volts),
            HealthNote::Demanded(lean) => self.control.demand(t_us, *lean),
            HealthNote::Motors(largest) => change(&mut self.stopped, t_us, *largest == 0.0),
            HealthNote::Lost(lost, kept) => keep(&mut self.lost, t_us, [*lost, *kept]),
            HealthNote::Pause(seconds) => keep(&mut self.pauses, t_us, *seconds),
            HealthNote::Text(level, text) => {
                if self.texts.len() < MOST_TEXTS {
                    self.texts.push((t_us, (*level, text.clone())));
                }
            }
        }
    }

    /// A fix that is not where the one before leads has jumped. Links deliver in bursts: the time between both is that of their stamps, where they have any.
    fn fix(&mut self, t_us: u64, measured_us: Option<u64>, fix: &GnssFix) {
        let at_us = measured_us.unwrap_or(t_us);
        let Some((before_us, before)) = self.last_fix.replace((at_us, *fix)) else { return };
        let dt = at_us.saturating_sub(before_us) as f64 * 1e-6;
        if dt <= 0.0 || dt > FIX_SPACING_S {
            return;
        }
        let velocities = (before.velocity.horizontal(), fix.velocity.horizontal());
        let (Some(a), Some(b)) = velocities else { return };
        self.fastest_m_per_s = self.fastest_m_per_s.max(hypot(a[0], a[1]).min(hypot(b[0], b[1])));
        let (north_m, east_m) = fix.position.radii();
        let north = (fix.position.lat_rad - before.position.lat_rad) * north_m;
        let east =
            wrap_pi(fix.position.lon_rad - before.position.lon_rad) * east_m * cos(fix.position.lat_rad);
        let off = hypot(north - 0.5 * dt * (a[0] + b[0]), east - 0.5 * dt * (a[1] + b[1]));
        // What a maneuver between two fixes may do: 2 g.
        if off > JUMP_M + 10.0 * dt * dt {
            keep(&mut self.jumps, t_us, off);
        }
    }

    /// Time of an entry, s since the first inertial sample.
    fn s(&self, t_us: u64) -> f64 {
        (t_us as f64 - self.start_us.or(self.first_us).unwrap_or(0) as f64) / 1e6
    }

    /// End of the log, s since the first inertial sample.
    pub fn end_s(&self) -> f64 {
        self.s(self.end_us)
    }

    /// Modes with the times at which they begin, s.
    pub fn modes(&self) -> Vec<(f64, &str)> {
        self.modes.iter().map(|(t, name)| (self.s(*t), name.as_str())).collect()
    }

    /// Spans in which it was armed, s; `None` where the log does not say.
    pub fn armed(&self) -> Option<Vec<(f64, f64)>> {
        self.spans(&self.armed)
    }

    /// Spans in which it flew: off the ground where that is reported, armed otherwise; `None` where the log says neither.
    pub fn flown(&self) -> Option<Vec<(f64, f64)>> {
        self.spans(&self.air).filter(|spans| !spans.is_empty()).or_else(|| self.armed())
    }

    /// The longest time in flight without a word of the receiver while the log has others: when it began, s, and how long.
    fn silence(&self, in_flight: &dyn Fn(f64) -> bool) -> Option<(f64, f64)> {
        let (first, last) = (self.receiver.first()?, self.alive.last()?);
        let times = || self.receiver.iter().map(|(t, _)| self.s(*t));
        let mut spacings: Vec<f64> = times().zip(times().skip(1)).map(|(a, b)| b - a).collect();
        spacings.sort_by(f64::total_cmp);
        let usual = spacings.get(spacings.len() / 2).copied().unwrap_or(0.0);
        let least = checks::SILENT_S[0].max(SPACINGS * usual);
        let ends = times().skip(1).chain([self.s(last.0).max(self.s(first.0))]);
        let gaps = times().zip(ends).filter(|(a, b)| b - a >= least && in_flight(*a));
        // Where the link or the logger lost everything, no one knows what the receiver did.
        let lively = gaps.filter(|(a, b)| {
            let others = self.alive.iter().filter(|(t, ())| (*a..*b).contains(&self.s(*t))).count();
            others as f64 > 0.5 * (b - a)
        });
        lively.map(|(a, b)| (a, b - a)).max_by(|x, y| x.1.total_cmp(&y.1))
    }

    /// Whether a receiver had a 3-D fix at all.
    pub fn has_fix(&self) -> bool {
        self.receiver.iter().any(|(_, r)| r.fix_type >= 3)
    }

    /// Whether the log says that it was never armed. Firmware that knows no arming says so too: what moves has been.
    pub fn is_of_no_flight(&self) -> bool {
        self.fastest_m_per_s < MOVES_M_PER_S && self.flown().is_some_and(|spans| spans.is_empty())
    }

    fn spans(&self, series: &Series<bool>) -> Option<Vec<(f64, f64)>> {
        if series.is_empty() {
            return None;
        }
        let mut out = Vec::new();
        let mut since = match series.first() {
            Some((t, false)) if self.s(*t) > STATE_SPACING_S => {
                Some(self.s(self.first_us.unwrap_or(0)).max(0.0))
            }
            _ => None,
        };
        for (t, on) in series {
            match (on, since) {
                (true, None) => since = Some(self.s(*t)),
                (false, Some(start)) => {
                    out.push((start, self.s(*t)));
                    since = None;
                }
                _ => {}
            }
        }
        out.extend(since.map(|start| (start, self.end_s())));
        Some(out)
    }

    /// Whether the log says anything of the vehicle's state.
    pub fn is_empty(&self) -> bool {
        self.modes.is_empty() && self.receiver.is_empty() && self.texts.is_empty() && self.ratios.is_empty()
    }
}

/// Whether a time is within one of the spans; always where these are not known.
fn in_spans(spans: &Option<Vec<(f64, f64)>>, t: f64) -> bool {
    spans.as_ref().is_none_or(|spans| spans.iter().any(|(a, b)| (*a..=*b).contains(&t)))
}

/// Appends a value, up to a bound.
fn keep<T>(series: &mut Series<T>, t_us: u64, value: T) {
    if series.len() < MOST {
        series.push((t_us, value));
    }
}

/// Appends a value that differs from the last one.
fn change<T: PartialEq>(series: &mut Series<T>, t_us: u64, value: T) {
    if series.last().is_none_or(|(_, last)| *last != value) {
        keep(series, t_us, value);
    }
}
