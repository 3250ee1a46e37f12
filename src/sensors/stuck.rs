//! A sensor that no longer measures: its values do not change while the vehicle moves.
//!
//! Whole counts of a quiet vehicle repeat for seconds: a calm hover, a simulation without vibration, a landed aircraft. So a repetition counts only where
//! it is improbable for this very axis, by the share of its samples that repeat and by its longest repetitions so far, and only beside a second
//! witness: the other axes that move now, fixes that move, an attitude that turns, or values that no vehicle at rest has.

use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::{exp, ln};
use serde::{Deserialize, Serialize};

/// All values unchanged for so long are frozen, µs.
const FROZEN_US: u64 = 1_000_000;
/// One axis unchanged for so long beside moving ones is stuck, µs, …
const STUCK_US: u64 = 2_000_000;
/// … and one within a count of zero, where truncation has a dead zone of two steps.
const STUCK_AT_ZERO_US: u64 = 10_000_000;
/// Fewer equal values in a row prove nothing.
const ENOUGH: u32 = 40;
/// Samples further apart than this begin anew, µs.
const APART_US: u64 = 1_000_000;
/// The other axes are looked at in steps of so many µs, over the last two of them.
const BUCKET_US: u64 = 1_000_000;
/// Range of the other axes over that time that is motion: rad/s and m/s².
const MOTION: [f64; 2] = [0.2, 3.0];
/// Mean rate and specific force of a vehicle at rest, rad/s, and m/s² off gravity: as `engine/stationary` has them.
const REST: [f64; 2] = [0.03, 0.5];
/// Change of roll or pitch that is motion, rad.
const TURNED: f64 = 0.05;
/// A repetition is improbable below this probability, with the share of repeated samples before it …
const CHANCE: f64 = 1e-9;
/// … over about so many samples, …
const SHARE_SAMPLES: f64 = 500.0;
/// … and where it is so many times as long as the longest before it, …
const LONGER: f64 = 3.0;
/// … which is forgotten within this time, µs, and which excuses no more than the last figure, µs. In the calm hover of the recorded flight
/// (`sitl_calm_hover.tlog`) an axis repeats for up to 8 s in flight and 68 s on the ground.
const FORGOTTEN_US: f64 = 120e6;
const MOST_US: u64 = 30_000_000;

/// Which values do not change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StuckSensor {
    /// All of them.
    All,
    /// A gyro: 0 to 2 for x, y, z.
    Gyro(u8),
    /// An accelerometer.
    Accelerometer(u8),
}

impl StuckSensor {
    /// Of the six values of a sample, gyros first.
    pub(super) fn axis(k: usize) -> Self {
        let axis = (k % 3) as u8;
        if k < 3 { Self::Gyro(axis) } else { Self::Accelerometer(axis) }
    }

    /// Its name.
    pub fn words(self) -> String {
        let letter = |axis: u8| ["x", "y", "z"].get(usize::from(axis)).copied().unwrap_or("?");
        match self {
            Self::All => "the inertial unit".to_owned(),
            Self::Gyro(axis) => format!("gyro {}", letter(axis)),
            Self::Accelerometer(axis) => format!("accelerometer {}", letter(axis)),
        }
    }

    /// A value of it in the unit of screens.
    pub fn value_words(self, value: f64) -> String {
        match self {
            Self::Accelerometer(_) => format!("{:.2} g", value / STANDARD_GRAVITY),
            _ => format!("{:.1} deg/s", value.to_degrees()),
        }
    }
}

/// Smallest and largest of some values.
#[derive(Debug, Clone, Copy)]
struct Range {
    low: f64,
    high: f64,
}

impl Range {
    fn at(value: f64) -> Self {
        Self { low: value, high: value }
    }

    fn take(&mut self, value: f64) {
        (self.low, self.high) = (self.low.min(value), self.high.max(value));
    }

    /// Of both together.
    fn width_with(&self, other: &Self) -> f64 {
        self.high.max(other.high) - self.low.min(other.low)
    }
}

/// Repetitions of an axis, or of all of them together.
#[derive(Debug, Clone, Copy)]
struct Repeats {
    since_us: u64,
    /// Equal values in a row.
    run: u32,
    /// Share of the samples that repeat, once there was a change.
    share: Option<f64>,
    /// Longest repetition so far that was no fault, µs.
    longest_us: f64,
    /// Whether the present one is called a fault.
    fault: bool,
}

impl Repeats {
    fn at(t_us: u64) -> Self {
        Self { since_us: t_us, run: 1, share: None, longest_us: 0.0, fault: false }
    }

    fn take(&mut self, t_us: u64, same: bool) {
        if same {
            self.run = self.run.saturating_add(1);
            return;
        }
        if !self.fault {
            let (run, for_us) = (f64::from(self.run), self.for_us(t_us) as f64);
            let (repeated, weight) = ((run - 1.0) / run, 1.0 - exp(-run / SHARE_SAMPLES));
            self.share = Some(self.share.map_or(repeated, |share| share + (repeated - share) * weight));
            self.longest_us = (self.longest_us * exp(-for_us / FORGOTTEN_US)).max(for_us);
        }
        (self.since_us, self.run, self.fault) = (t_us, 1, false);
    }

    fn for_us(&self, t_us: u64) -> u64 {
        t_us.saturating_sub(self.since_us)
    }

    /// Whether values that work would hardly repeat for so long.
    fn is_improbable(&self, t_us: u64, least_us: u64) -> bool {
        // Of slow streams a second holds too few values; what has never changed says nothing of its noise.
        let chance = self.share.map_or(f64::NEG_INFINITY, |share| f64::from(self.run) * ln(share.max(1e-3)));
        let usual_us = (LONGER * self.longest_us).min(MOST_US as f64);
        let for_us = self.for_us(t_us);
        self.run >= ENOUGH && for_us >= least_us && for_us as f64 >= usual_us && chance < ln(CHANCE)
    }
}

/// One axis.
#[derive(Debug, Clone, Copy)]
struct Axis {
    value: f64,
    repeats: Repeats,
    /// The smallest change so far: its resolution.
    step: f64,
    /// When the other axes of the kind moved first and last while this one repeated, µs.
    others_moved_us: Option<(u64, u64)>,
}

/// What is remembered of a stream of samples.
#[derive(Debug, Clone)]
struct Memory {
    now_us: u64,
    axes: [Axis; 6],
    all: Repeats,
    /// Ranges of this second and the one before, and when this one began.
    buckets: [[Range; 6]; 2],
    bucket_us: u64,
    /// Roll and pitch when the values changed last.
    attitude: Option<[f64; 2]>,
}

/// Watches the values of one source.
#[derive(Debug, Clone, Default)]
pub struct StuckWatch {
    memory: Option<Memory>,
    /// Since when the vehicle moves by its fixes, µs. A take-off begins with values that have not changed for long.
    moving_since_us: Option<u64>,
    /// Roll and pitch as the autopilot reports them, rad.
    attitude: Option<[f64; 2]>,
}

impl StuckWatch {
    /// Takes roll and pitch as the autopilot reports them, rad.
    pub fn attitude(&mut self, roll_pitch: [f64; 2]) {
        self.attitude = Some(roll_pitch);
    }

    /// Takes rates, rad/s, and specific forces, m/s², of a sample; `moving`: by its fixes the vehicle moves. Gives what does not change, if anything.
    pub fn push(&mut self, t_us: u64, values: [f64; 6], moving: bool) -> Option<StuckSensor> {
        let attitude = self.attitude;
        let memory = self.memory.get_or_insert_with(|| Memory::from(t_us, values, attitude));
        if t_us < memory.now_us || t_us - memory.now_us > APART_US {
            memory.begin_anew(t_us, values, attitude);
        }
        memory.take(t_us, &values, attitude);
        let since_us = *self.moving_since_us.get_or_insert(t_us);
        if !moving {
            self.moving_since_us = None;
        }
        memory.stuck(moving.then(|| t_us.saturating_sub(since_us)), attitude)
    }
}

impl Memory {
    fn from(t_us: u64, values: [f64; 6], attitude: Option<[f64; 2]>) -> Self {
        let axis =
            |value| Axis { value, repeats: Repeats::at(t_us), step: f64::INFINITY, others_moved_us: None };
        Self {
            now_us: t_us,
            axes: values.map(axis),
            all: Repeats::at(t_us),
            buckets: [values.map(Range::at); 2],
            bucket_us: t_us,
            attitude,
        }
    }

    /// After a pause: how each axis usually repeats stays known.
    fn begin_anew(&mut self, t_us: u64, values: [f64; 6], attitude: Option<[f64; 2]>) {
        let fresh = Self::from(t_us, values, attitude);
        let axes = std::mem::replace(&mut self.axes, fresh.axes);
        let all = std::mem::replace(&mut self.all, fresh.all);
        let keep = |now: &mut Repeats, before: &Repeats| {
            (now.share, now.longest_us) = (before.share, before.longest_us);
        };
        for (now, before) in self.axes.iter_mut().zip(&axes) {
            keep(&mut now.repeats, &before.repeats);
            now.step = before.step;
        }
        keep(&mut self.all, &all);
        (self.buckets, self.bucket_us, self.attitude) = (fresh.buckets, t_us, attitude);
    }

    fn take(&mut self, t_us: u64, values: &[f64; 6], attitude: Option<[f64; 2]>) {
        self.now_us = t_us;
        let mut changed = false;
        for (axis, value) in self.axes.iter_mut().zip(values) {
            let same = axis.value == *value;
            axis.repeats.take(t_us, same);
            if !same {
                changed = true;
                axis.step = axis.step.min((value - axis.value).abs());
                (axis.value, axis.others_moved_us) = (*value, None);
            }
        }
        self.all.take(t_us, !changed);
        if changed {
            self.attitude = attitude;
        }
        let [now, before] = &mut self.buckets;
        now.iter_mut().zip(values).for_each(|(range, v)| range.take(*v));
        if t_us - self.bucket_us < BUCKET_US {
            return;
        }
        let widths: Vec<f64> = now.iter().zip(before.iter()).map(|(a, b)| a.width_with(b)).collect();
        // Both buckets lie within the repetition.
        let from_us = self.bucket_us.saturating_sub(BUCKET_US);
        for (k, axis) in self.axes.iter_mut().enumerate() {
            let kind = usize::from(k >= 3);
            let others = widths
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != k && usize::from(*other >= 3) == kind);
            let limit = MOTION.get(kind).copied().unwrap_or(f64::INFINITY);
            if axis.repeats.since_us <= from_us && others.into_iter().any(|(_, width)| *width > limit) {
                axis.others_moved_us = Some((axis.others_moved_us.map_or(t_us, |(first, _)| first), t_us));
            }
        }
        (*before, *now, self.bucket_us) = (*now, values.map(Range::at), t_us);
    }

    /// `moved_for_us`: since when the vehicle moves by its fixes.
    fn stuck(&mut self, moved_for_us: Option<u64>, attitude: Option<[f64; 2]>) -> Option<StuckSensor> {
        let now_us = self.now_us;
        let moved_for = |least: u64| moved_for_us.is_some_and(|for_us| for_us >= least);
        let turned = attitude
            .zip(self.attitude)
            .is_some_and(|([r, p], [r0, p0])| (r - r0).abs().max((p - p0).abs()) > TURNED);
        let witness = moved_for(FROZEN_US) || turned || !self.is_at_rest();
        if self.all.fault || (witness && self.all.is_improbable(now_us, FROZEN_US)) {
            self.all.fault = true;
            // Whatever each axis does belongs to that.
            self.axes.iter_mut().for_each(|axis| axis.repeats.fault = true);
            return Some(StuckSensor::All);
        }
        for (k, axis) in self.axes.iter_mut().enumerate() {
            let near_zero = axis.value.abs() <= axis.step && (axis.value == 0.0 || axis.step.is_finite());
            let least_us = if near_zero { STUCK_AT_ZERO_US } else { STUCK_US };
            // One jump lies in two buckets: what moves does so for longer.
            let moving = axis.others_moved_us.is_some_and(|(first, last)| {
                last.saturating_sub(first) >= STUCK_US && now_us.saturating_sub(last) <= BUCKET_US
            });
            // Where vibration was seen before it is always there in flight; a gyro shows none of it.
            let in_flight = k >= 3 && !near_zero && moved_for(STUCK_US) && axis.repeats.share.is_some();
            if axis.repeats.fault || ((moving || in_flight) && axis.repeats.is_improbable(now_us, least_us)) {
                axis.repeats.fault = true;
                return Some(StuckSensor::axis(k));
            }
        }
        None
    }

    /// Whether the values are those of a vehicle at rest.
    fn is_at_rest(&self) -> bool {
        let [x, y, z, fx, fy, fz] = self.axes.map(|axis| axis.value);
        let (rate, force) = ((x * x + y * y + z * z).sqrt(), (fx * fx + fy * fy + fz * fz).sqrt());
        rate < REST[0] && (force - STANDARD_GRAVITY).abs() < REST[1]
    }
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::sin;

    use super::*;

    /// Samples at 50 Hz; gives what was found at each.
    fn watch(
        n: u64,
        moving: impl Fn(u64) -> bool,
        values: impl Fn(u64) -> [f64; 6],
    ) -> Vec<Option<StuckSensor>> {
        let mut watch = StuckWatch::default();
        (0..n).map(|k| watch.push(1_000_000 + 20_000 * k, values(k), moving(k))).collect()
    }

    /// A turning and climbing vehicle in whole counts.
    fn flying(k: u64) -> [f64; 6] {
        let t = k as f64 * 0.02;
        let wave = |f: f64, a: f64| (a * sin(f * t) * 1000.0).round() / 1000.0;
        [
            wave(1.1, 0.5),
            wave(1.3, 0.3),
            wave(0.7, 0.4),
            wave(0.9, 2.0),
            wave(1.7, 1.0),
            -9.8 + wave(0.5, 4.0),
        ]
    }

    /// A quiet unit on the bench: most values repeat.
    fn resting(k: u64) -> [f64; 6] {
        [0.0, 0.001, 0.0, 0.01 * f64::from(u8::from(k.is_multiple_of(97))), 0.0, -9.81]
    }

    #[test]
    fn what_works_is_never_called_stuck() {
        assert!(watch(5000, |_| true, flying).iter().all(Option::is_none));
        assert!(watch(5000, |_| false, resting).iter().all(Option::is_none));
        assert!(watch(5000, |_| false, |_| resting(1)).iter().all(Option::is_none), "at rest for good");
    }

    #[test]
    fn frozen_values_are_found_within_a_second_in_flight_and_forgotten_when_they_change() {
        let found = watch(400, |_| false, |k| flying(if (100..300).contains(&k) { 100 } else { k }));
        assert!(found[..149].iter().all(Option::is_none), "too early");
        assert!(found[151..300].iter().all(|f| *f == Some(StuckSensor::All)));
        assert!(found[300..].iter().all(Option::is_none));
        // Frozen since before the flight: the fixes show that it flies.
        let found = watch(300, |k| k > 200, |_| resting(1));
        assert_eq!((found[199], found[299]), (None, Some(StuckSensor::All)));
    }

    /// In truncated counts a calm hover repeats for seconds, each axis at its own times, on the ground and in flight.
    #[test]
    fn a_calm_hover_and_the_ground_after_it_are_no_stuck_sensor() {
        // Slow swings of a few counts, which truncation turns into steps; then a touchdown and rest.
        let hover = |k: u64| {
            let t = k as f64 * 0.02;
            let counts = |period: f64, size: f64| (size * sin(std::f64::consts::TAU * t / period)).trunc();
            if k >= 4000 {
                let bump = if k < 4010 { 300.0 } else { 0.0 };
                return [0.0, bump * 1e-3, 0.0, 0.01, 0.0, -9.81 - bump * 0.01];
            }
            [
                counts(9.0, 2.4) * 1e-3,
                counts(7.0, 300.0) * 1e-3,
                counts(31.0, 1.9) * 1e-3,
                (497.0 + counts(23.0, 1.3)) * 9.81e-3,
                counts(17.0, 2.2) * 9.81e-3,
                (-868.0 + counts(11.0, 200.0)) * 9.81e-3,
            ]
        };
        // It stands before it flies: that is how its noise is known.
        let values = |k: u64| if k < 1000 { [0.0, 0.0, 0.0, 0.0, 0.0, -9.81] } else { hover(k) };
        let found = watch(8000, |k| (1500..3900).contains(&k), values);
        let first = found.iter().position(Option::is_some);
        assert_eq!(first.map(|k| (k, found[k])), None);
    }

    /// The same vehicle with a unit that freezes: the fixes and the attitude still show it.
    #[test]
    fn a_unit_that_freezes_is_found_by_fixes_or_by_the_attitude_and_not_at_rest() {
        let frozen = |k: u64| flying(if k >= 200 { 200 } else { k });
        assert_eq!(watch(300, |_| true, frozen)[299], Some(StuckSensor::All));
        let rest = |k: u64| if k < 200 { flying(k) } else { resting(1) };
        assert_eq!(watch(900, |_| false, rest)[899], None, "it has landed");
        assert_eq!(watch(900, |_| true, rest)[899], Some(StuckSensor::All), "it flies on by its fixes");
        let mut watch = StuckWatch::default();
        let mut last = None;
        for k in 0..400_u64 {
            watch.attitude([0.002 * k as f64, 0.0]);
            last = watch.push(1_000_000 + 20_000 * k, rest(k), false);
        }
        assert_eq!(last, Some(StuckSensor::All), "its attitude turns");
    }

    /// ArduPilot's own simulation has no vibration: the vertical axis stays at 1 g until the launch has left the ground.
    #[test]
    fn a_launch_without_vibration_is_no_stuck_sensor() {
        let launch = |k: u64| {
            let mut values = flying(k);
            if k < 280 {
                values = [0.0, 0.0, 0.0, if k < 220 { 0.0 } else { values[3] + 5.0 }, 0.0, -9.816];
            }
            values
        };
        assert!(watch(2000, |k| k > 230, launch).iter().all(Option::is_none));
    }

    #[test]
    fn one_axis_is_found_by_the_motion_of_the_others() {
        for (axis, expected) in [(0, StuckSensor::Gyro(0)), (4, StuckSensor::Accelerometer(1))] {
            let found = watch(
                600,
                |_| true,
                |k| {
                    let mut values = flying(k);
                    if k >= 130 {
                        values[axis] = flying(130)[axis];
                    }
                    values
                },
            );
            assert!(found[..175].iter().all(Option::is_none));
            assert_eq!(found[599], Some(expected));
        }
        // A gyro in the dead zone of truncation needs longer.
        let dead = |k: u64| {
            let mut values = flying(k);
            values[0] = 0.0;
            values
        };
        let found = watch(600, |_| true, dead);
        assert!(found[..490].iter().all(Option::is_none) && found[599] == Some(StuckSensor::Gyro(0)));
    }
}
