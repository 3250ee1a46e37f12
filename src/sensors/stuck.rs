//! A sensor that no longer measures: its values do not change while the vehicle moves.
//!
//! Noise, vibration and the last digit change the values of a sensor that works. A quiet one on the bench may repeat itself, so
//! repetition counts only beside motion: of the fixes, of the time just before, or of the other axes.

use gaware_nav::earth::STANDARD_GRAVITY;
use serde::{Deserialize, Serialize};

/// All values unchanged for so long are frozen, µs.
const FROZEN_US: u64 = 1_000_000;
/// A gyro unchanged for so long beside moving ones is stuck, µs, …
const STUCK_US: u64 = 2_000_000;
/// … and one at zero, where truncation has a dead zone of two steps.
const STUCK_AT_ZERO_US: u64 = 10_000_000;
/// An accelerometer of a vehicle that has moved by its fixes all the while, away from zero: vibration is always there.
const STUCK_IN_FLIGHT_US: u64 = 2_000_000;
/// Fewer equal values in a row prove nothing.
const ENOUGH: u32 = 40;
/// Samples further apart than this begin anew, µs.
const APART_US: u64 = 1_000_000;
/// Time over which motion before a freeze is remembered, µs.
const BUCKET_US: u64 = 1_000_000;
/// Range of the other axes that is motion: rad/s and m/s².
const MOTION: [f64; 2] = [0.2, 3.0];

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

    fn width(&self) -> f64 {
        self.high - self.low
    }
}

/// One axis since its last change.
#[derive(Debug, Clone, Copy)]
struct Axis {
    value: f64,
    since_us: u64,
    /// Equal values in a row.
    run: u32,
    /// The axes of the same kind since then.
    others: [Range; 3],
    /// When their range became motion, µs.
    motion_us: Option<u64>,
}

/// What is remembered of a stream of samples.
#[derive(Debug, Clone)]
struct Memory {
    now_us: u64,
    axes: [Axis; 6],
    /// Ranges of this second and the one before, as long as values changed.
    bucket: [Range; 6],
    before: [f64; 6],
    bucket_us: u64,
}

/// Watches the values of one source.
#[derive(Debug, Clone, Default)]
pub struct StuckWatch {
    memory: Option<Memory>,
    /// Since when the vehicle moves by its fixes, µs. A take-off begins with values that have not changed for long.
    moving_since_us: Option<u64>,
}

/// Axes 0 to 2 are gyros, 3 to 5 accelerometers: of the kind of `k`.
fn kind_of(k: usize, values: &[f64; 6]) -> [f64; 3] {
    let [x, y, z, fx, fy, fz] = *values;
    if k < 3 { [x, y, z] } else { [fx, fy, fz] }
}

fn moved(ranges: &[f64; 6]) -> bool {
    ranges.iter().enumerate().any(|(k, width)| *width > MOTION[usize::from(k >= 3)])
}

impl StuckWatch {
    /// Takes rates, rad/s, and specific forces, m/s², of a sample; `moving`: by its fixes the vehicle moves. Gives what does not change, if anything.
    pub fn push(&mut self, t_us: u64, values: [f64; 6], moving: bool) -> Option<StuckSensor> {
        let fresh = || Memory {
            now_us: t_us,
            axes: std::array::from_fn(|k| Axis {
                value: values.get(k).copied().unwrap_or(0.0),
                since_us: t_us,
                run: 1,
                others: kind_of(k, &values).map(Range::at),
                motion_us: None,
            }),
            bucket: values.map(Range::at),
            before: [0.0; 6],
            bucket_us: t_us,
        };
        let memory = self.memory.get_or_insert_with(fresh);
        if t_us < memory.now_us || t_us - memory.now_us > APART_US {
            *memory = fresh();
        }
        memory.take(t_us, &values);
        let since_us = *self.moving_since_us.get_or_insert(t_us);
        if !moving {
            self.moving_since_us = None;
        }
        memory.stuck(moving.then(|| t_us.saturating_sub(since_us)))
    }
}

impl Memory {
    fn take(&mut self, t_us: u64, values: &[f64; 6]) {
        self.now_us = t_us;
        let mut changed = false;
        for (k, (axis, value)) in self.axes.iter_mut().zip(values).enumerate() {
            let others = kind_of(k, values);
            if axis.value == *value {
                axis.run = axis.run.saturating_add(1);
                axis.others.iter_mut().zip(others).for_each(|(range, v)| range.take(v));
                if axis.motion_us.is_none()
                    && axis.others.iter().any(|r| r.width() > MOTION[usize::from(k >= 3)])
                {
                    axis.motion_us = Some(t_us);
                }
            } else {
                changed = true;
                *axis = Axis {
                    value: *value,
                    since_us: t_us,
                    run: 1,
                    others: others.map(Range::at),
                    motion_us: None,
                };
            }
        }
        if !changed {
            return;
        }
        if t_us - self.bucket_us > BUCKET_US {
            self.before = self.bucket.map(|r| r.width());
            (self.bucket, self.bucket_us) = (values.map(Range::at), t_us);
        }
        self.bucket.iter_mut().zip(values).for_each(|(range, v)| range.take(*v));
    }

    /// `moved_for_us`: since when the vehicle moves by its fixes.
    fn stuck(&self, moved_for_us: Option<u64>) -> Option<StuckSensor> {
        let moved_for = |least: u64| moved_for_us.is_some_and(|for_us| for_us >= least);
        // Of slow streams a second holds too few values.
        let unchanged_us =
            |axis: &Axis| if axis.run < ENOUGH { 0 } else { self.now_us.saturating_sub(axis.since_us) };
        if self.axes.iter().all(|a| unchanged_us(a) >= FROZEN_US) {
            let moved = moved(&self.before) || moved(&self.bucket.map(|r| r.width()));
            return (moved_for(FROZEN_US) || moved).then_some(StuckSensor::All);
        }
        let stuck = |(k, axis): (usize, &Axis)| {
            let in_flight = k >= 3 && axis.value != 0.0 && moved_for(STUCK_IN_FLIGHT_US);
            if in_flight && unchanged_us(axis) >= STUCK_IN_FLIGHT_US {
                return Some(StuckSensor::axis(k));
            }
            let limit_us = if axis.value == 0.0 { STUCK_AT_ZERO_US } else { STUCK_US };
            let motion = axis.motion_us.is_some_and(|from| self.now_us.saturating_sub(from) >= STUCK_US);
            (unchanged_us(axis) >= limit_us && motion).then(|| StuckSensor::axis(k))
        };
        self.axes.iter().enumerate().find_map(stuck)
    }
}

#[cfg(test)]
mod tests {
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
        let wave = |f: f64, a: f64| (a * (f * t).sin() * 1000.0).round() / 1000.0;
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
