//! A sensor at the end of its range: values that run into a limit with a corner and stay there.
//!
//! A steady turn is steady too, but it is entered smoothly, and noise goes on. Where the limit is follows from the samples: boards set
//! ranges that no message carries.

use super::stuck::StuckSensor;

/// Equal values in a row that are a plateau.
const PLATEAU: u32 = 5;
/// Least step into a plateau that is a corner, rad/s and m/s²: ten counts of `RAW_IMU`, and five.
const CORNER: [f64; 2] = [0.01, 0.05];
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
    /// The limits found, upper and lower.
    limits: [Option<f64>; 2],
}

impl Axis {
    /// Whether this value is at a limit, and whether that limit is new.
    fn push(&mut self, value: f64, corner: f64, least: f64) -> (bool, bool) {
        let step = self.last.replace(value).map_or(0.0, |last| (value - last).abs());
        if step == 0.0 {
            self.run = self.run.saturating_add(1);
        } else {
            (self.run, self.corner) = (1, step >= corner);
        }
        (self.high, self.low) = (self.high.max(value), self.low.min(value));
        let [upper, lower] = &mut self.limits;
        // What is exceeded was no limit.
        *upper = upper.filter(|l| value <= *l);
        *lower = lower.filter(|l| value >= *l);
        let plateau = self.run >= PLATEAU && self.corner && value.abs() >= least;
        let mut new = false;
        for (limit, extreme) in [(upper, self.high), (lower, self.low)] {
            if plateau && value == extreme && limit.is_none() {
                *limit = Some(value);
                new = true;
            }
        }
        (self.limits.contains(&Some(value)), new)
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
        for (k, (axis, value)) in self.axes.iter_mut().zip(values).enumerate() {
            let kind = usize::from(k >= 3);
            let [corner, least] = [CORNER, LEAST].map(|of| of.get(kind).copied().unwrap_or(f64::INFINITY));
            let (at_limit, new) = axis.push(value, corner, least);
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
        let swing = |t: f64| [count((0.9 * t.sin()).clamp(-0.5, 0.5)), 0.0, 0.0, 0.0, 0.0, -9.81];
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
                if t < at { 0.0 } else { (to - from) * (1.0 - (-(t - at) / 0.8).exp()) }
            };
            let load = 1.0 + settle(1.0, 2.0, 5.0) + settle(2.0, 2.4, 30.0);
            [0.0, count(0.3 * (load - 1.0)), count(0.5 * (load - 1.0)), 0.0, 0.0, count(-9.81 * load)]
        };
        assert!(watch(3000, turn).iter().all(|c| *c == Clipped::default()));
        let same = watch(3000, |_| [0.3, 0.0, 0.0, 0.0, 0.0, -19.0]);
        assert!(same.iter().all(|c| *c == Clipped::default()));
        let swing = |t: f64| [count(0.9 * t.sin()), 0.0, 0.0, 0.0, 0.0, count(-9.81 - 5.0 * (0.7 * t).sin())];
        assert!(watch(3000, swing).iter().all(|c| *c == Clipped::default()));
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
