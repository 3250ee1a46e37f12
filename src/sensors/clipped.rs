//! A sensor at the end of its range: values that run into a limit with a corner and stay there, or whose noise ends there.
//!
//! A steady turn is steady too, but it is entered smoothly, and noise goes on. Where the limit is follows from the samples: boards set
//! ranges that no message carries. Noise shows itself by values that change their direction: where a share r of the samples does, n
//! equal values in a row have a probability of (1 − r)ⁿ at most. Motion without noise changes direction seldom.

use super::stuck::StuckSensor;
use gaware_nav::math::{ln, powf};

/// Equal values in a row that are a plateau.
const PLATEAU: u32 = 5;
/// Least step into a plateau that is a corner, rad/s and m/s²: ten counts of `RAW_IMU`, and five.
const CORNER: [f64; 2] = [0.01, 0.05];
/// Equal values in a row that noise gives with less than this probability are no chance.
const CHANCE: f64 = 1e-7;
/// Most samples that change direction: of white noise two in three, less where it is rounded.
const MOST_REVERSING: f64 = 0.6;
/// Samples over which changes of direction are averaged.
const DIRECTIONS: f64 = 100.0;
/// Limits below these are none, rad/s and m/s²: a vehicle at rest shows 1 g.
const LEAST: [f64; 2] = [0.2, 11.0];

/// One axis.
#[derive(Debug, Clone, Copy, Default)]
struct Axis {
    last: Option<f64>,
    /// Equal values so far, and whether they were entered with a corner.
    run: u32,
    corner: bool,
    high: f64,
    low: f64,
    /// Whether the last change was upward, and the share of samples that changed direction, until the last change.
    upward: bool,
    reversing: f64,
    /// The limits found, upper and lower.
    limits: [Option<f64>; 2],
}

impl Axis {
    /// Whether this value is at a limit, and whether that limit is new.
    /// `others_run`: for so many samples all other axes have been equal too.
    fn push(&mut self, value: f64, [corner, least]: [f64; 2], others_run: u32) -> (bool, bool) {
        let step = self.last.replace(value).map_or(0.0, |last| value - last);
        if step == 0.0 {
            self.run = self.run.saturating_add(1);
        } else {
            self.turn(step > 0.0);
            (self.run, self.corner) = (1, step.abs() >= corner);
        }
        (self.high, self.low) = (self.high.max(value), self.low.min(value));
        let [upper, lower] = &mut self.limits;
        // What is exceeded was no limit.
        *upper = upper.filter(|l| value <= *l);
        *lower = lower.filter(|l| value >= *l);
        let corner = self.run >= PLATEAU && self.corner;
        // Noise that ends at a value ends at a limit, whatever was seen before the sensor or its driver became like that.
        let chance = || f64::from(self.run) * ln(1.0 - self.reversing.min(MOST_REVERSING));
        let silent = others_run < self.run / 2 && chance() < ln(CHANCE);
        let mut new = false;
        for (limit, extreme, side) in [(upper, self.high, 1.0), (lower, self.low, -1.0)] {
            let at_end = (corner && value == extreme) || (silent && value * side > 0.0);
            if at_end && value.abs() >= least && limit.is_none() {
                *limit = Some(value);
                new = true;
            }
        }
        (self.limits.contains(&Some(value)), new)
    }

    /// Takes a change of the value: for the samples that were equal before it, and whether it changes the direction.
    fn turn(&mut self, upward: bool) {
        let reversal = f64::from(u8::from(upward != self.upward));
        if self.run > 1 {
            self.reversing *= powf(1.0 - 1.0 / DIRECTIONS, f64::from(self.run - 1));
        }
        self.reversing += (reversal - self.reversing) / DIRECTIONS;
        self.upward = upward;
    }
}

/// Watches the values of one source.
#[derive(Debug, Clone, Default)]
pub struct ClipWatch {
    axes: [Axis; 6],
}

/// What a sample shows of the range.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Clipped {
    /// Whether a value is at a known limit.
    pub at_limit: bool,
    /// A limit that was not known before: which sensor, and where, rad/s or m/s².
    pub new: Option<(StuckSensor, f64)>,
}

impl ClipWatch {
    /// Takes rates, rad/s, and specific forces, m/s², of a sample.
    pub fn push(&mut self, values: [f64; 6]) -> Clipped {
        let mut out = Clipped::default();
        // A unit that freezes as a whole is at no limit.
        let runs = self.axes.map(|a| a.run);
        for (k, (axis, value)) in self.axes.iter_mut().zip(values).enumerate() {
            let kind = usize::from(k >= 3);
            let bounds = [CORNER, LEAST].map(|of| of.get(kind).copied().unwrap_or(f64::INFINITY));
            let others = runs.iter().enumerate().filter(|(other, _)| *other != k);
            let others_run = others.map(|(_, run)| *run).min().unwrap_or(0);
            let (at_limit, new) = axis.push(value, bounds, others_run);
            out.at_limit |= at_limit;
            if new {
                out.new = Some((StuckSensor::axis(k), value.abs()));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::{exp, sin};

    use super::*;

    fn count(v: f64) -> f64 {
        (v * 1000.0).trunc() / 1000.0
    }

    fn watch(n: u32, values: impl Fn(f64) -> [f64; 6]) -> Vec<Clipped> {
        let mut watch = ClipWatch::default();
        (0..n).map(|k| watch.push(values(f64::from(k) * 0.02))).collect()
    }

    #[test]
    fn a_rate_that_runs_into_a_limit_is_found_and_what_is_at_the_limit_is_marked() {
        let swing = |t: f64| [count((0.9 * sin(t)).clamp(-0.5, 0.5)), 0.0, 0.0, 0.0, 0.0, -9.81];
        let found = watch(1000, swing);
        let limits: Vec<_> = found.iter().filter_map(|c| c.new).collect();
        assert_eq!(limits, [(StuckSensor::Gyro(0), 0.5), (StuckSensor::Gyro(0), 0.5)], "above and below");
        let first = found.iter().position(|c| c.new.is_some()).unwrap();
        for (k, clipped) in found.iter().enumerate().skip(first + 400) {
            assert_eq!(clipped.at_limit, swing(k as f64 * 0.02)[0].abs() == 0.5, "{k}");
        }
    }

    #[test]
    fn steady_turns_rest_and_peaks_are_no_limits() {
        // Settles exponentially on a turn of 2 g, as vehicles do, without any noise; then a second, steeper one.
        let turn = |t: f64| {
            let settle = |from: f64, to: f64, at: f64| {
                if t < at { 0.0 } else { (to - from) * (1.0 - exp(-(t - at) / 0.8)) }
            };
            let load = 1.0 + settle(1.0, 2.0, 5.0) + settle(2.0, 2.4, 30.0);
            [0.0, count(0.3 * (load - 1.0)), count(0.5 * (load - 1.0)), 0.0, 0.0, count(-9.81 * load)]
        };
        assert!(watch(3000, turn).iter().all(|c| *c == Clipped::default()));
        let same = watch(3000, |_| [0.3, 0.0, 0.0, 0.0, 0.0, -19.0]);
        assert!(same.iter().all(|c| *c == Clipped::default()));
        let swing = |t: f64| [count(0.9 * sin(t)), 0.0, 0.0, 0.0, 0.0, count(-9.81 - 5.0 * sin(0.7 * t))];
        assert!(watch(3000, swing).iter().all(|c| *c == Clipped::default()));
    }

    /// Noise of about one count, the same each time.
    fn noise(t: f64) -> f64 {
        let k = (t * 50.0).round() as u64;
        let bits = (k.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x5bd1_e995).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (bits >> 40) as f64 / f64::from(1 << 24) * 0.004 - 0.002
    }

    /// More was measured before a driver limits what it passes on, and the limit is reached without a corner.
    #[test]
    fn noise_that_ends_is_a_limit_even_where_more_was_seen_before() {
        let force = |t: f64| {
            let load = 1.0 + 0.8 * sin(0.2 * t).max(0.0) + noise(t);
            let shown = if t < 30.0 { load } else { load.min(1.3) };
            [count(noise(t + 7.0)), 0.0, 0.0, 0.0, 0.0, -9.81 * count(shown)]
        };
        let found = watch(4000, force);
        let limits: Vec<_> = found.iter().filter_map(|c| c.new).collect();
        assert_eq!(limits, [(StuckSensor::Accelerometer(2), 9.81 * 1.3)]);
        let first = found.iter().position(|c| c.new.is_some()).unwrap();
        // Beyond 1.3 g from 33.3 s on.
        assert!((1660..1760).contains(&first), "{first}");
        assert!(found[..first].iter().all(|c| !c.at_limit));
        // The last turn is at the limit for all but its begin and end.
        assert!(found[3000..].iter().filter(|c| c.at_limit).count() > 400);
    }

    #[test]
    fn noise_that_goes_on_is_no_limit() {
        let force = |t: f64| {
            let load = 1.0 + 0.8 * sin(0.2 * t).max(0.0) + 0.3 * noise(t);
            [count(0.3 + noise(t)), 0.0, 0.0, 0.0, 0.0, -9.81 * count(load)]
        };
        assert!(watch(50_000, force).iter().all(|c| *c == Clipped::default()));
    }

    #[test]
    fn a_limit_that_is_exceeded_was_none() {
        let mut clip = ClipWatch::default();
        let rate = |w: f64| [w, 0.0, 0.0, 0.0, 0.0, -9.81];
        clip.push(rate(0.0));
        assert!((0..6).any(|_| clip.push(rate(0.4)).new.is_some()));
        assert!(clip.push(rate(0.4)).at_limit);
        assert!(!clip.push(rate(0.5)).at_limit && !clip.push(rate(0.4)).at_limit);
    }
}
