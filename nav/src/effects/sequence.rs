//! Faults of a source that show from sample to sample: values clipped at the end of the range, samples reported twice. Discrete like those of [`source`](super::source), and named on the same scale.

use super::effect::undo_one_by_one;
use super::{ActsOn, Effect, ParameterGroup, ReportedSample};
use crate::earth::STANDARD_GRAVITY;
use crate::math::ln;
use crate::sample::ImuSample;
use nalgebra::Vector3;

/// Which sensor of the inertial unit: 0 gyros, 1 accelerometers.
type Sensor = usize;

/// What happens between the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Act {
    /// Values end at the end of the range.
    Clip(Sensor),
    /// Every other sample is the one before.
    Repeat,
}

/// One fault.
#[derive(Debug)]
pub struct SequenceMistake {
    name: &'static str,
    description: &'static str,
    act: Act,
}

/// Range in the simulator: the smallest of common parts, ±250 deg/s and ±2 g (MPU-6000 and ICM-20689 data sheets).
const RANGE: [f64; 2] = [250.0 / 180.0 * std::f64::consts::PI, 2.0 * STANDARD_GRAVITY];
/// A flat top is at least so many samples at the very same largest value …
const FLAT: usize = 3;
/// … and slopes beside it are taken over so many samples.
const SLOPE: usize = 4;
/// Samples are reported twice where more than this share of them equals the one before: quiet whole numbers do now and then.
const REPEATED: f64 = 0.2;

const fn mistake(name: &'static str, description: &'static str, act: Act) -> SequenceMistake {
    SequenceMistake { name, description, act }
}

/// The gyros end at the end of their range.
pub static GYRO_CLIPPED: SequenceMistake =
    mistake("gyro_clipped", "the gyros are clipped at the end of their range", Act::Clip(0));
/// The accelerometers end at the end of their range.
pub static ACCEL_CLIPPED: SequenceMistake =
    mistake("accel_clipped", "the accelerometers are clipped at the end of their range", Act::Clip(1));
/// Samples come twice.
pub static SAMPLES_REPEATED: SequenceMistake = mistake(
    "samples_repeated",
    "inertial samples are reported twice, the second time under a new time stamp",
    Act::Repeat,
);

fn of(sample: &ImuSample, sensor: Sensor) -> &Vector3<f64> {
    if sensor == 0 { &sample.gyro } else { &sample.accel }
}

fn set(sample: &mut ImuSample, sensor: Sensor, axis: usize, value: f64) {
    let v = if sensor == 0 { &mut sample.gyro } else { &mut sample.accel };
    v[axis] = value;
}

fn repeats(now: &ImuSample, last: &ImuSample) -> bool {
    now.gyro == last.gyro && now.accel == last.accel
}

/// Stretches at the largest value of an axis in one direction: first and last sample of each.
fn flat_tops(samples: &[ImuSample], sensor: Sensor, axis: usize, sign: f64) -> Vec<(usize, usize)> {
    let value = |s: &ImuSample| sign * of(s, sensor)[axis];
    let top = samples.iter().map(value).fold(f64::NEG_INFINITY, f64::max);
    let mut out: Vec<(usize, usize)> = Vec::new();
    for (k, _) in samples.iter().enumerate().filter(|(_, s)| value(s) >= top) {
        match out.last_mut() {
            Some((_, end)) if *end + 1 == k => *end = k,
            _ => out.push((k, k)),
        }
    }
    let clipped = top > 0.0 && out.iter().any(|(from, to)| to - from + 1 >= FLAT);
    if clipped { out } else { Vec::new() }
}

/// Puts what the neighbours on both sides suggest in place of a flat top (a cubic by Hermite).
fn round_off(samples: &mut [ImuSample], (from, to): (usize, usize), sensor: Sensor, axis: usize, sign: f64) {
    let (Some(first), after) = (from.checked_sub(SLOPE), to + SLOPE) else { return };
    if after >= samples.len() {
        return;
    }
    let at = |k: usize| (samples[k].t_s, sign * of(&samples[k], sensor)[axis]);
    let slope = |a: (f64, f64), b: (f64, f64)| (b.1 - a.1) / (b.0 - a.0);
    let (left, right) = (at(from - 1), at(to + 1));
    let (rise, fall) = (slope(at(first), left), slope(right, at(after)));
    let span = right.0 - left.0;
    let top = at(from).1;
    for sample in &mut samples[from..=to] {
        let u = (sample.t_s - left.0) / span;
        let (v, w) = (u * u, u * u * u);
        let cubic = (2.0 * w - 3.0 * v + 1.0) * left.1
            + (w - 2.0 * v + u) * span * rise
            + (3.0 * v - 2.0 * w) * right.1
            + (w - v) * span * fall;
        // The true value lies beyond the end of the range.
        set(sample, sensor, axis, sign * cubic.max(top));
    }
}

/// Logarithm of the odds that samples equal the ones before on purpose, against chance on every axis by itself. A vehicle that
/// is stationary repeats itself for long; what is reported twice is followed by something new.
fn repeated_by_purpose(samples: &[ImuSample]) -> f64 {
    let (mut n, mut all, mut axes) = (0.0f64, 0.0f64, [0.0f64; 6]);
    for w in samples.windows(4) {
        let same = repeats(&w[2], &w[1]);
        if same && (repeats(&w[1], &w[0]) || repeats(&w[3], &w[2])) {
            continue;
        }
        n += 1.0;
        if same {
            all += 1.0;
        } else {
            for (axis, sum) in axes.iter_mut().enumerate() {
                let value = |s: &ImuSample| of(s, axis / 3)[axis % 3];
                *sum += f64::from(u8::from(value(&w[2]) == value(&w[1])));
            }
        }
    }
    let fresh = n - all;
    if all == 0.0 || fresh == 0.0 {
        return 0.0;
    }
    let (share, chance) = (all / n, axes.iter().map(|a| (a / fresh).max(1.0 / n)).product::<f64>());
    if share > chance { all * ln(share / chance) + fresh * ln((1.0 - share) / (1.0 - chance)) } else { 0.0 }
}

const SIDES: [(usize, f64); 6] = [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)];

impl Effect for SequenceMistake {
    of_fault!();

    fn needs_neighbours(&self) -> bool {
        true
    }

    fn source_after(&self, now: [Vector3<f64>; 2], before: Option<&ReportedSample>) -> [Vector3<f64>; 2] {
        let mut told = now;
        match (self.act, before) {
            (Act::Clip(sensor), _) => {
                told[sensor] = now[sensor].map(|v| v.clamp(-RANGE[sensor], RANGE[sensor]))
            }
            (Act::Repeat, Some(before)) if before.count % 2 == 1 => told = before.reported,
            _ => {}
        }
        told
    }

    fn undo_source_after(&self, now: &ImuSample, last: Option<&ImuSample>) -> Option<ImuSample> {
        match (self.act, last) {
            (Act::Clip(_), _) => Some(*now),
            (Act::Repeat, last) => last.is_none_or(|l| !repeats(now, l)).then_some(*now),
        }
    }

    fn undo_sequence(&self, samples: &[ImuSample]) -> Vec<ImuSample> {
        let Act::Clip(sensor) = self.act else {
            return undo_one_by_one(self, samples);
        };
        let mut out = samples.to_vec();
        for (axis, sign) in SIDES {
            for top in flat_tops(samples, sensor, axis, sign) {
                round_off(&mut out, top, sensor, axis, sign);
            }
        }
        out
    }

    fn reported_by(&self, samples: &[ImuSample]) -> f64 {
        if self.act == Act::Repeat { repeated_by_purpose(samples) } else { 0.0 }
    }

    fn shows_in(&self, samples: &[ImuSample]) -> bool {
        match self.act {
            Act::Clip(sensor) => {
                SIDES.iter().any(|(axis, sign)| !flat_tops(samples, sensor, *axis, *sign).is_empty())
            }
            Act::Repeat => {
                let repeated = samples.windows(2).filter(|w| repeats(&w[1], &w[0])).count();
                repeated as f64 > REPEATED * samples.len() as f64
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::math::sin;

    use super::*;

    /// A swing of both sensors about all axes, reported with a fault.
    fn told(mistake: &SequenceMistake, size: f64) -> (Vec<ImuSample>, Vec<ImuSample>) {
        let (mut ideal, mut told) = (Vec::new(), Vec::new());
        let mut before: Option<ReportedSample> = None;
        for k in 0..350 {
            let t_s = f64::from(k) * 0.02;
            let swing = |a: f64| Vector3::new(sin(0.9 * t_s + a), sin(0.8 * t_s), sin(0.5 * t_s - a));
            let sample = ImuSample {
                t_s,
                gyro: swing(0.3) * size * RANGE[0],
                accel: swing(-0.3) * size * RANGE[1],
                temperature_degc: None,
            };
            let finished = [sample.gyro, sample.accel];
            let [gyro, accel] = mistake.source_after(finished, before.as_ref());
            let count = before.as_ref().map_or(0, |b| b.count) + 1;
            before = Some(ReportedSample { raw: finished, reported: [gyro, accel], count });
            ideal.push(sample);
            told.push(ImuSample { gyro, accel, ..sample });
        }
        (ideal, told)
    }

    fn worst(a: &[ImuSample], b: &[ImuSample]) -> f64 {
        let at = |t_s: f64| a.iter().find(|s| (s.t_s - t_s).abs() < 1e-9);
        b.iter()
            .filter_map(|s| Some((s, at(s.t_s)?)))
            .map(|(s, t)| ((s.gyro - t.gyro) / RANGE[0]).norm().max(((s.accel - t.accel) / RANGE[1]).norm()))
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_clipped_swing_ends_at_the_range_and_is_rounded_off_again() {
        for (mistake, sensor) in [(&GYRO_CLIPPED, 0), (&ACCEL_CLIPPED, 1)] {
            let (ideal, clipped) = told(mistake, 1.3);
            assert!(clipped.iter().all(|s| of(s, sensor).amax() <= RANGE[sensor]));
            assert!(clipped.iter().zip(&ideal).all(|(c, i)| of(c, 1 - sensor) == of(i, 1 - sensor)));
            assert!(mistake.shows_in(&clipped) && !mistake.shows_in(&ideal));
            let undone = mistake.undo_sequence(&clipped);
            assert!(worst(&ideal, &undone) < 0.35 * worst(&ideal, &clipped), "{}", worst(&ideal, &undone));
        }
    }

    #[test]
    fn what_is_within_the_range_stays() {
        let (ideal, told) = told(&ACCEL_CLIPPED, 0.9);
        assert_eq!(ideal, told);
    }

    #[test]
    fn a_repeated_sample_is_left_out() {
        let (ideal, twice) = told(&SAMPLES_REPEATED, 0.5);
        assert!(worst(&ideal, &twice) > 1e-3 && SAMPLES_REPEATED.shows_in(&twice));
        let undone = SAMPLES_REPEATED.undo_sequence(&twice);
        assert!(worst(&ideal, &undone) < 1e-12);
        assert_eq!(undone.len(), 175);
        assert!(!SAMPLES_REPEATED.shows_in(&ideal));
    }

    #[test]
    fn samples_that_are_told_twice_speak_for_themselves_and_quiet_ones_do_not() {
        let (ideal, twice) = told(&SAMPLES_REPEATED, 0.5);
        assert!(SAMPLES_REPEATED.reported_by(&twice) > 1000.0, "{}", SAMPLES_REPEATED.reported_by(&twice));
        assert_eq!(SAMPLES_REPEATED.reported_by(&ideal), 0.0);
        // Whole numbers of a quiet sensor: each axis changes now and then, as chance will have it.
        let quiet: Vec<ImuSample> = ideal
            .iter()
            .enumerate()
            .map(|(k, s)| {
                let digit =
                    |axis: usize| f64::from(u8::from(((k * 7919 + axis * 104_729) % 97).is_multiple_of(5)));
                let v = |at: usize| Vector3::new(digit(at), digit(at + 1), digit(at + 2));
                ImuSample { gyro: v(0), accel: v(3), ..*s }
            })
            .collect();
        assert!(SAMPLES_REPEATED.reported_by(&quiet) < 20.0, "{}", SAMPLES_REPEATED.reported_by(&quiet));
    }
}
