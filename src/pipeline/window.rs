//! The part of a long flight in which the vehicle moves most, chosen without keeping the rest: what is analysed at once does not grow with the
//! length of a recording. Hours on the ground or in cruise say nothing of the sensors that a few minutes of them do not say.

use super::{Consumer, Recorded};
use crate::inputs::Input;
use crate::logs::LogError;
use crate::sensors::ConverterOptions;
use gaware_nav::sample::{ImuSample, Sample};
use nalgebra::Vector3;

/// Samples are averaged over this time before they are compared: vibration is no motion, s.
const SMOOTHED_S: f64 = 1.0;
/// A window begins at a multiple of this, s.
const STEP_S: f64 = 60.0;
/// Rotation that counts as much as 1 m/s² of specific force, rad/s: a gyro that is off by a thousandth and an accelerometer that is off by as much
/// leave equal errors of velocity after some seconds.
const RATE_OF_FORCE: f64 = 0.1;

/// Samples of a log, and which part of it they are.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Excerpt {
    /// In order.
    pub samples: Vec<Sample>,
    /// Where the part lies in a longer log; nothing where it is all of it.
    pub part: Option<LogPart>,
}

/// A part of a log, s after its first inertial sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogPart {
    /// Begin.
    pub from_s: f64,
    /// End.
    pub to_s: f64,
    /// Length of the log.
    pub of_s: f64,
}

/// MotionByMinute, minute by minute.
#[derive(Debug, Clone, Default)]
struct MotionByMinute {
    first_s: Option<f64>,
    last_s: f64,
    /// Sums of the second that runs: begin, number, rate, force.
    second: (f64, f64, Vector3<f64>, Vector3<f64>),
    /// By minute: seconds, sum of the force, sum of its square, sum of the square of the rate.
    minutes: Vec<(f64, Vector3<f64>, f64, f64)>,
}

impl MotionByMinute {
    fn take(&mut self, imu: &ImuSample) {
        let first_s = *self.first_s.get_or_insert(imu.t_s);
        self.last_s = self.last_s.max(imu.t_s);
        if imu.t_s - self.second.0 >= SMOOTHED_S || imu.t_s < self.second.0 {
            self.close(first_s);
            self.second = (imu.t_s, 0.0, Vector3::zeros(), Vector3::zeros());
        }
        self.second.1 += 1.0;
        self.second.2 += imu.gyro;
        self.second.3 += imu.accel;
    }

    fn close(&mut self, first_s: f64) {
        let (t_s, n, rate, force) = self.second;
        if n == 0.0 {
            return;
        }
        let minute = ((t_s - first_s) / STEP_S).max(0.0) as usize;
        // A stamp far ahead is no reason for a table of years.
        if minute > self.minutes.len() + 24 * 60 {
            return;
        }
        if self.minutes.len() <= minute {
            self.minutes.resize(minute + 1, Default::default());
        }
        if let Some(sums) = self.minutes.get_mut(minute) {
            let (rate, force) = (rate / n, force / n);
            sums.0 += 1.0;
            sums.1 += force;
            sums.2 += force.norm_squared();
            sums.3 += rate.norm_squared();
        }
    }

    fn span_s(&self) -> f64 {
        self.first_s.map_or(0.0, |first| self.last_s - first)
    }

    /// The window of this length with the most motion.
    fn best(mut self, most_s: f64) -> Option<LogPart> {
        let first_s = self.first_s?;
        self.close(first_s);
        let of = |(n, force, squares, rates): &(f64, Vector3<f64>, f64, f64)| {
            let scatter = squares - force.norm_squared() / n.max(1.0);
            scatter.max(0.0) + rates / (RATE_OF_FORCE * RATE_OF_FORCE)
        };
        let motion: Vec<f64> = self.minutes.iter().map(of).collect();
        let length = ((most_s / STEP_S).round() as usize).max(1);
        let windows = motion.windows(length.min(motion.len().max(1)));
        let best = windows.enumerate().map(|(k, w)| (k, w.iter().sum::<f64>()));
        // The first of equal ones.
        let (minute, _) = best.fold((0, f64::NEG_INFINITY), |a, b| if b.1 > a.1 { b } else { a });
        let from_s = minute as f64 * STEP_S;
        Some(LogPart { from_s, to_s: (from_s + most_s).min(self.span_s()), of_s: self.span_s() })
    }
}

/// Keeps all samples as long as they are short enough, and then only how much moves.
struct MotionSurvey {
    most_s: f64,
    motion: MotionByMinute,
    kept: Option<Vec<Sample>>,
}

impl Consumer for MotionSurvey {
    fn feed(&mut self, sample: &Sample) {
        if let Sample::Imu(imu) = sample {
            self.motion.take(imu);
        }
        if self.motion.span_s() > self.most_s {
            self.kept = None;
        }
        if let Some(kept) = &mut self.kept {
            kept.push(sample.clone());
        }
    }
}

/// Keeps what lies in the window, and what is announced before it.
struct Within {
    part: LogPart,
    first_s: Option<f64>,
    now_s: f64,
    kept: Vec<Sample>,
}

impl Consumer for Within {
    fn feed(&mut self, sample: &Sample) {
        if let Sample::Imu(imu) = sample {
            self.now_s = imu.t_s - *self.first_s.get_or_insert(imu.t_s);
        }
        let inside = (self.part.from_s..=self.part.to_s).contains(&self.now_s) && self.first_s.is_some();
        if inside || matches!(sample, Sample::Stream(_)) {
            self.kept.push(sample.clone());
        }
    }
}

/// The samples of a log, at most so much of it; a longer one is read twice.
///
/// # Errors
/// A log that cannot be opened or read.
pub fn most_motion(path: &Input, options: ConverterOptions, most_s: f64) -> Result<Excerpt, LogError> {
    let survey = MotionSurvey { most_s, motion: MotionByMinute::default(), kept: Some(Vec::new()) };
    let survey = run(path, options, survey)?;
    if let Some(samples) = survey.kept {
        return Ok(Excerpt { samples, part: None });
    }
    let Some(part) = survey.motion.best(most_s) else { return Ok(Excerpt::default()) };
    let within = run(path, options, Within { part, first_s: None, now_s: 0.0, kept: Vec::new() })?;
    Ok(Excerpt { samples: within.kept, part: Some(part) })
}

fn run<C: Consumer>(path: &Input, options: ConverterOptions, consumer: C) -> Result<C, LogError> {
    let (pipeline, damage) = Recorded::open(path, options)?.run(consumer, f64::INFINITY, &|_| {})?;
    if damage.any() {
        tracing::warn!(?damage, path = %path.path().display(), "parts of the log could not be read");
    }
    Ok(pipeline.into_engine())
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::sin;

    use super::*;

    /// Stationary for an hour, turns for ten minutes, cruises in vibration for an hour.
    fn flight() -> impl Iterator<Item = ImuSample> {
        (0..130 * 600).map(|k| {
            let t_s = f64::from(k) * 0.1;
            let (gyro, accel) = match t_s / 60.0 {
                m if m < 60.0 => (Vector3::zeros(), Vector3::new(0.0, 0.0, -9.8)),
                m if m < 70.0 => {
                    (Vector3::new(0.0, 0.1, 0.2), Vector3::new(0.0, 0.0, -9.8 - 4.0 * sin(0.2 * t_s)))
                }
                _ => (Vector3::zeros(), Vector3::new(0.0, 0.0, -9.8 + if k % 2 == 0 { 8.0 } else { -8.0 })),
            };
            ImuSample { t_s: 100.0 + t_s, gyro, accel, temperature_degc: None }
        })
    }

    #[test]
    fn the_part_with_the_most_motion_is_taken_and_vibration_is_none() {
        let mut motion = MotionByMinute::default();
        flight().for_each(|s| motion.take(&s));
        let part = motion.best(1200.0).unwrap();
        assert!(
            part.from_s <= 3600.0 && part.to_s >= 4200.0 && part.to_s - part.from_s <= 1200.0,
            "{part:?}"
        );
        assert!((part.of_s - 7800.0).abs() < 1.0, "{part:?}");
    }

    #[test]
    fn a_short_flight_is_kept_whole_and_of_a_long_one_nothing_but_its_motion() {
        let survey = |most_s: f64| {
            let mut survey =
                MotionSurvey { most_s, motion: MotionByMinute::default(), kept: Some(Vec::new()) };
            flight().for_each(|s| survey.feed(&Sample::Imu(s)));
            survey.kept.map(|kept| kept.len())
        };
        assert_eq!(survey(8000.0), Some(130 * 600));
        assert_eq!(survey(3600.0), None);
        let part = LogPart { from_s: 3600.0, to_s: 3660.0, of_s: 7800.0 };
        let mut within = Within { part, first_s: None, now_s: 0.0, kept: Vec::new() };
        within.feed(&Sample::Stream(Default::default()));
        flight().for_each(|s| within.feed(&Sample::Imu(s)));
        assert_eq!(within.kept.len(), 1 + 601);
    }
}
