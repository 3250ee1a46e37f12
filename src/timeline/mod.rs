//! The time line: the one place that decides about time, for a live link and for every log format.
//!
//! Sources deliver [`Measurement`]s with their own stamps. The time line puts them on one base ([`clock`]), keeps inertial
//! samples in order, finds duplicates, gaps ([`gaps`]), restarts and changes of source, and gives every fix its place. What comes
//! out are [`Sample`]s: after a restart the stream is announced again, so that every stretch stands by itself.
//!
//! A sample that is far from its predecessor is held until the next one agrees with it: one corrupt stamp neither restarts
//! anything nor refuses what follows. Deterministic, and bounded in memory.

pub mod clock;
pub mod gaps;
#[cfg(test)]
mod stretch;

pub use clock::Stamp;
use clock::{Clock, GAP_US};
use gaps::GapMeter;
pub use gaps::Gaps;
use gaware_nav::operating::{Operating, OperatingSample};
use gaware_nav::sample::{
    AirSample, AttitudeHint, FieldSample, GnssFix, ImuSample, ImuStream, RestartReason, Sample,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
#[cfg(test)]
pub use stretch::{Stretch, stretches};

/// Stamps that go back no more than this are late or reordered, not a reboot, µs.
const REORDER_US: u64 = 1_000_000;
/// After a reboot the first samples come within this time since boot, µs.
const BOOTED_US: u64 = 60_000_000;
/// A fix may be stamped so much later than the newest inertial sample, µs: those are sent less often, or a little later.
const FIX_AHEAD_US: u64 = 500_000;
/// So many samples that follow upon each other, all behind the newest, are a clock that went back. On a link that delays each frame by
/// anything up to some seconds, n late ones come in order once in n! times: at 8 twice in 100 links of two minutes, at 12 once in months.
const BEHIND: u32 = 12;
/// Fixes that wait for inertial samples; more are dropped, oldest first.
const MAX_WAITING: usize = 64;
/// Compasses of a vehicle: ArduPilot uses 3, PX4 4.
pub const MOST_COMPASSES: usize = 4;
/// Barometers and airspeed sensors of a vehicle.
const MOST_OF_AIR: usize = 4;

/// What a source delivers, with its own stamp.
#[derive(Debug, Clone, PartialEq)]
pub enum Measurement {
    /// What the inertial samples from now on are.
    Stream(ImuStream),
    /// An inertial sample. Its `t_s` counts for nothing: the stamp does.
    Imu(Stamp, ImuSample),
    /// A fix; without a stamp it belongs to the time of its arrival.
    Fix(Option<Stamp>, GnssFix),
    /// The autopilot's own roll, pitch, yaw, rad.
    Attitude(Stamp, [f64; 3]),
    /// A sample of a compass. Its `t_s` counts for nothing: the stamp does.
    Field(Stamp, FieldSample),
    /// A sample of a barometer or of the airspeed; without a stamp it belongs to the time of its arrival.
    Air(Option<Stamp>, AirSample),
    /// What the vehicle does beside moving; without a stamp it belongs to the time of its arrival.
    Operating(Option<Stamp>, Operating),
}

/// What was refused, and why.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct TimeCounts {
    /// Inertial samples given out.
    pub imu_samples: u64,
    /// Same stamp twice.
    pub imu_duplicates: u64,
    /// Late by less than a second.
    pub imu_backward: u64,
    /// Far away in time and not confirmed by the next sample.
    pub imu_unconfirmed: u64,
    /// A stamp or values that are no numbers.
    pub imu_invalid: u64,
    /// Values that no sensor on a vehicle has.
    pub imu_implausible: u64,
    /// Fixes given out.
    pub fixes: u64,
    /// The same fix again.
    pub fix_duplicates: u64,
    /// Fixes before the first inertial sample: there is no time base to put them on.
    pub fix_before_imu: u64,
    /// Fixes whose time fits no inertial sample.
    pub fix_misplaced: u64,
    /// Fixes older than the one before.
    pub fix_backward: u64,
    /// Fixes with values that are no fix.
    pub fix_implausible: u64,
    /// Attitude hints given out.
    pub attitudes: u64,
    /// Samples of compasses given out.
    pub fields: u64,
    /// Samples of barometers and airspeed sensors given out.
    pub air: u64,
    /// Fresh starts.
    pub restarts: u64,
}

/// A sample that waits for the next one to agree.
#[derive(Debug, Clone, Copy)]
struct Held {
    t_us: u64,
    sample: ImuSample,
    why: Inconsistency,
}

/// Why a sample waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Inconsistency {
    /// It is the first.
    First,
    /// It comes after a gap.
    Gap,
    /// It is before the last one, or behind a gap that no motion state survives.
    Restart(RestartReason),
}

/// One of the counts.
type Count = fn(&mut TimeCounts) -> &mut u64;

/// Puts measurements in order. One per source of samples.
#[derive(Debug, Clone, Default)]
pub struct TimeLine {
    clock: Clock,
    stream: Option<ImuStream>,
    /// Whether samples of the present stream were given out.
    running: bool,
    held: Option<Held>,
    /// The newest of the samples behind, and how many followed upon each other.
    behind: Option<(u64, u32)>,
    /// The last temperature of this source, °C: a message without one is no jump to the reference temperature.
    temperature_degc: Option<f64>,
    imu_gaps: GapMeter,
    fix_gaps: GapMeter,
    last_fix: Option<(Option<Stamp>, GnssFix)>,
    last_fix_us: Option<u64>,
    last_attitude_us: Option<u64>,
    /// Of each compass.
    last_field_us: [Option<u64>; MOST_COMPASSES],
    /// Of each barometer and each airspeed sensor.
    last_air_us: [[Option<u64>; MOST_OF_AIR]; 2],
    /// Fixes that are ahead of the inertial samples.
    waiting: VecDeque<(u64, GnssFix)>,
    counts: TimeCounts,
}

impl TimeLine {
    /// Takes a measurement and appends what follows from it. `missing`: messages missing since the last inertial one by their
    /// running numbers, where the source has such.
    pub fn push(&mut self, measurement: &Measurement, missing: u64, out: &mut Vec<Sample>) {
        match measurement {
            Measurement::Stream(stream) => self.stream(stream, out),
            Measurement::Imu(stamp, sample) => self.imu(*stamp, sample, missing, out),
            Measurement::Fix(stamp, fix) => self.fix(*stamp, fix, out),
            Measurement::Attitude(stamp, roll_pitch_yaw) => self.attitude(*stamp, *roll_pitch_yaw, out),
            Measurement::Field(stamp, sample) => self.field(*stamp, sample, out),
            Measurement::Air(stamp, sample) => self.air(*stamp, sample, out),
            Measurement::Operating(stamp, values) => self.operating(*stamp, *values, out),
        }
    }

    /// Takes the pair of Unix and boot time that an autopilot reports.
    pub fn learn(&mut self, unix_us: u64, boot_ms: u32) {
        self.clock.learn(unix_us, boot_ms);
    }

    /// An inertial stamp on the base, for counting; it decides nothing.
    pub fn place_imu(&mut self, stamp: Stamp) -> Option<u64> {
        self.clock.place_imu(stamp)
    }

    /// Any stamp on the base, s; nothing before the first inertial sample.
    pub fn place_s(&self, stamp: Stamp) -> Option<f64> {
        self.reference_us()?;
        self.clock.place(stamp).map(seconds)
    }

    /// Time of the latest inertial sample, s.
    pub fn now_s(&self) -> Option<f64> {
        self.clock.now_us().map(seconds)
    }

    /// What was refused.
    pub fn counts(&self) -> &TimeCounts {
        &self.counts
    }

    /// Gaps in the inertial samples.
    pub fn imu_gaps(&self) -> Gaps {
        self.imu_gaps.gaps()
    }

    /// Gaps between the fixes.
    pub fn fix_gaps(&self) -> Gaps {
        self.fix_gaps.gaps()
    }

    /// Inertial samples lost on the way.
    pub fn imu_lost(&self) -> u64 {
        self.imu_gaps.lost()
    }

    /// The newest time that inertial samples speak of, confirmed or not, µs.
    fn reference_us(&self) -> Option<u64> {
        match (self.clock.now_us(), &self.held) {
            (now, Some(Held { t_us, why: Inconsistency::First | Inconsistency::Gap, .. })) => {
                now.max(Some(*t_us))
            }
            (now, _) => now,
        }
    }

    fn stream(&mut self, stream: &ImuStream, out: &mut Vec<Sample>) {
        if self.stream.as_ref() == Some(stream) {
            return;
        }
        self.stream = Some(stream.clone());
        self.imu_gaps.new_stream();
        self.temperature_degc = None;
        self.counts.imu_unconfirmed += u64::from(self.held.take().is_some());
        if self.running {
            self.running = false;
            self.counts.restarts += 1;
            out.push(Sample::Restart(RestartReason::SourceChange));
        }
        out.push(Sample::Stream(stream.clone()));
    }

    fn imu(&mut self, stamp: Stamp, sample: &ImuSample, missing: u64, out: &mut Vec<Sample>) {
        let Some(t_us) = self.clock.place_imu(stamp).filter(|_| sample.is_finite()) else {
            self.counts.imu_invalid += 1;
            return;
        };
        if !sample.is_plausible() {
            self.counts.imu_implausible += 1;
            return;
        }
        let sample = ImuSample { t_s: seconds(t_us), ..*sample };
        match self.inconsistency(t_us) {
            Some(Err(count)) => {
                *count(&mut self.counts) += 1;
                if self.has_gone_back(t_us) {
                    let why = Inconsistency::Restart(RestartReason::ClockSetBack);
                    self.confirm(&Held { t_us, sample, why }, out);
                }
            }
            Some(Ok(why)) => match self.held.take() {
                Some(held) if agrees(held.t_us, t_us) => {
                    self.confirm(&held, out);
                    self.give(t_us, &sample, missing, out);
                }
                unconfirmed => {
                    self.counts.imu_unconfirmed += u64::from(unconfirmed.is_some());
                    self.held = Some(Held { t_us, sample, why });
                }
            },
            None => {
                self.counts.imu_unconfirmed += u64::from(self.held.take().is_some());
                self.give(t_us, &sample, missing, out);
            }
        }
    }

    /// Whether samples behind the newest follow upon each other: not late ones, but a clock that was set back.
    fn has_gone_back(&mut self, t_us: u64) -> bool {
        let Some(now) = self.clock.now_us().filter(|now| t_us < *now) else { return false };
        let follows = |last: u64| t_us > last && !self.imu_gaps.is_gap(t_us - last);
        let run = match self.behind {
            Some((last, run)) if follows(last) => run + 1,
            _ => 1,
        };
        self.behind = Some((t_us, run));
        run >= BEHIND && now > t_us
    }

    /// The samples end here, for a reason that the source itself gave.
    pub fn interrupt(&mut self, reason: RestartReason, out: &mut Vec<Sample>) {
        self.held = None;
        if std::mem::replace(&mut self.running, false) {
            self.counts.restarts += 1;
            self.counts.fix_misplaced += self.waiting.len() as u64;
            self.waiting.clear();
            out.push(Sample::Restart(reason));
            out.extend(self.stream.clone().map(Sample::Stream));
        }
    }

    /// What speaks against a sample at this time: nothing, a count of those refused, or an inconsistency that the next one may settle.
    fn inconsistency(&self, t_us: u64) -> Option<Result<Inconsistency, Count>> {
        if self.held.is_some_and(|h| h.t_us == t_us) {
            return Some(Err(|c| &mut c.imu_duplicates));
        }
        let Some(now) = self.clock.now_us() else { return Some(Ok(Inconsistency::First)) };
        match t_us.checked_sub(now) {
            Some(0) => Some(Err(|c| &mut c.imu_duplicates)),
            Some(d) if d > GAP_US => Some(Ok(Inconsistency::Restart(RestartReason::ClockJump))),
            Some(d) if self.imu_gaps.is_gap(d) => Some(Ok(Inconsistency::Gap)),
            Some(_) => None,
            None => Some(went_back(t_us, now - t_us)),
        }
    }

    /// A held sample was right.
    fn confirm(&mut self, held: &Held, out: &mut Vec<Sample>) {
        if let Inconsistency::Restart(reason) = held.why {
            if let Some(now) = self.clock.now_us().filter(|now| held.t_us > *now) {
                self.imu_gaps.pause(held.t_us - now);
            }
            self.clock.restart(held.t_us);
            self.temperature_degc = None;
            self.counts.restarts += 1;
            self.counts.fix_misplaced += self.waiting.len() as u64;
            self.waiting.clear();
            (self.last_fix, self.last_fix_us, self.last_attitude_us) = (None, None, None);
            self.last_field_us = [None; MOST_COMPASSES];
            self.last_air_us = [[None; MOST_OF_AIR]; 2];
            out.push(Sample::Restart(reason));
            out.extend(self.stream.clone().map(Sample::Stream));
        }
        self.give(held.t_us, &held.sample, 0, out);
    }

    /// Gives out the next sample, and before it the fixes that waited for its time.
    fn give(&mut self, t_us: u64, sample: &ImuSample, missing: u64, out: &mut Vec<Sample>) {
        if let Some(spacing) = self.clock.now_us().and_then(|now| t_us.checked_sub(now)).filter(|d| *d > 0) {
            self.imu_gaps.push(spacing, missing);
        }
        self.clock.advance(t_us);
        self.behind = None;
        self.running = true;
        while let Some((fix_us, fix)) =
            self.waiting.pop_front_if(|(fix_us, _)| *fix_us <= t_us + FIX_AHEAD_US)
        {
            self.give_fix(fix_us, &fix, out);
        }
        self.counts.imu_samples += 1;
        self.temperature_degc = sample.temperature_degc.filter(|t| t.is_finite()).or(self.temperature_degc);
        out.push(Sample::Imu(ImuSample { temperature_degc: self.temperature_degc, ..*sample }));
    }

    fn fix(&mut self, stamp: Option<Stamp>, fix: &GnssFix, out: &mut Vec<Sample>) {
        let repeated = match (&self.last_fix, stamp) {
            (Some((Some(last), _)), Some(stamp)) => *last == stamp,
            // A receiver without a clock can still repeat itself.
            (Some((None, last)), None) => GnssFix { t_s: last.t_s, ..*fix } == *last,
            _ => false,
        };
        if repeated {
            self.counts.fix_duplicates += 1;
            return;
        }
        self.last_fix = Some((stamp, *fix));
        if !(GnssFix { t_s: 0.0, ..*fix }).is_plausible() {
            self.counts.fix_implausible += 1;
            return;
        }
        let Some(now) = self.reference_us() else {
            self.counts.fix_before_imu += 1;
            return;
        };
        let placed = stamp.map_or(Some(now), |stamp| self.clock.place_fix(stamp, now));
        let Some(t_us) = placed else {
            self.counts.fix_misplaced += 1;
            return;
        };
        // One that waits and is followed by an older one is stamped ahead of its time.
        while self.waiting.pop_back_if(|(waiting, _)| t_us < *waiting).is_some() {
            self.counts.fix_misplaced += 1;
        }
        let ahead = self.clock.now_us().is_none_or(|now| t_us > now + FIX_AHEAD_US);
        if ahead {
            if self.waiting.len() == MAX_WAITING {
                self.waiting.pop_front();
                self.counts.fix_misplaced += 1;
            }
            self.waiting.push_back((t_us, *fix));
        } else {
            self.give_fix(t_us, fix, out);
        }
    }

    fn give_fix(&mut self, t_us: u64, fix: &GnssFix, out: &mut Vec<Sample>) {
        if let Some(last) = self.last_fix_us {
            if t_us <= last {
                let late = last - t_us <= REORDER_US;
                let count = if late { &mut self.counts.fix_backward } else { &mut self.counts.fix_misplaced };
                *count += 1;
                return;
            }
            self.fix_gaps.push(t_us - last, 0);
        }
        self.last_fix_us = Some(t_us);
        self.counts.fixes += 1;
        out.push(Sample::Fix(GnssFix { t_s: seconds(t_us), ..*fix }));
    }

    fn attitude(&mut self, stamp: Stamp, roll_pitch_yaw: [f64; 3], out: &mut Vec<Sample>) {
        let hint = |t_s| AttitudeHint { t_s, roll_pitch_yaw };
        let is_good = |hint: &AttitudeHint| hint.roll_pitch_yaw.iter().all(|v| v.is_finite());
        let hint = beside(&self.clock, &mut self.last_attitude_us, Some(stamp), hint, is_good);
        self.counts.attitudes += u64::from(hint.is_some());
        out.extend(hint.map(Sample::Attitude));
    }

    fn field(&mut self, stamp: Stamp, sample: &FieldSample, out: &mut Vec<Sample>) {
        let Some(last) = self.last_field_us.get_mut(usize::from(sample.compass)) else { return };
        let at = |t_s| FieldSample { t_s, ..*sample };
        let field = beside(&self.clock, last, Some(stamp), at, FieldSample::is_plausible);
        self.counts.fields += u64::from(field.is_some());
        out.extend(field.map(Sample::Field));
    }

    fn air(&mut self, stamp: Option<Stamp>, sample: &AirSample, out: &mut Vec<Sample>) {
        let own = self.last_air_us[sample.kind as usize].get_mut(usize::from(sample.sensor));
        let Some(last) = own else { return };
        let at = |t_s| AirSample { t_s, ..*sample };
        let air = beside(&self.clock, last, stamp, at, AirSample::is_plausible);
        self.counts.air += u64::from(air.is_some());
        out.extend(air.map(Sample::Air));
    }

    /// What the vehicle does beside moving: it decides nothing, and there is no base to put it on before the first inertial sample.
    fn operating(&self, stamp: Option<Stamp>, values: Operating, out: &mut Vec<Sample>) {
        let Some(now) = self.clock.now_us().filter(|_| !values.is_empty()) else { return };
        let placed = stamp.map_or(Some(now), |stamp| self.clock.place(stamp));
        if let Some(t_us) = placed.filter(|t_us| t_us.abs_diff(now) <= GAP_US) {
            out.push(Sample::Operating(OperatingSample { t_s: seconds(t_us), values }));
        }
    }
}

/// What speaks against a sample at this time that is so much behind the newest, µs. A link delays frames by seconds, but not by ten.
fn went_back(t_us: u64, behind_us: u64) -> Result<Inconsistency, Count> {
    if behind_us <= REORDER_US {
        Err(|c| &mut c.imu_backward)
    } else if behind_us <= GAP_US {
        Err(|c| &mut c.imu_unconfirmed)
    } else if t_us <= BOOTED_US {
        Ok(Inconsistency::Restart(RestartReason::Reboot))
    } else {
        Ok(Inconsistency::Restart(RestartReason::ClockSetBack))
    }
}

/// Whether a sample follows a held one.
fn agrees(held_us: u64, t_us: u64) -> bool {
    t_us > held_us && t_us - held_us <= GAP_US
}

fn seconds(t_us: u64) -> f64 {
    t_us as f64 * 1e-6
}

/// What comes beside the inertial samples, at its place: newer than the `last` of its kind, near the present, and good. Without a stamp it belongs to the
/// time of its arrival. Before the first inertial sample there is no base to put it on.
fn beside<S>(
    clock: &Clock,
    last: &mut Option<u64>,
    stamp: Option<Stamp>,
    at: impl Fn(f64) -> S,
    is_good: impl Fn(&S) -> bool,
) -> Option<S> {
    let now = clock.now_us()?;
    let placed = stamp.map_or(Some(now), |stamp| clock.place(stamp))?;
    if placed.abs_diff(now) > GAP_US || last.is_some_and(|last| placed <= last) {
        return None;
    }
    let sample = Some(at(seconds(placed))).filter(is_good)?;
    // One stamped ahead must not keep out those that follow.
    *last = Some(placed.min(now + FIX_AHEAD_US));
    Some(sample)
}

#[cfg(test)]
mod tests;
