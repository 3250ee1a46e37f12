//! Which of several inertial sources in an autopilot's own log the samples are taken from.
//!
//! A log may hold the same motion several times: filtered samples of two or three units, raw samples at the sensor's rate, increments with their
//! intervals. A first pass counts them ([`Survey`]); the choice follows from rate, vibration, samples at the end of the range and sensors that
//! do not change, and is named in words.

use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::fmt;

/// More samples a second than this make no estimate better, Hz.
const ENOUGH_HZ: f64 = 200.0;
/// Another source must be faster by so much before it replaces the usual one.
const FASTER: f64 = 1.5;
/// Another unit must have so much less vibration and noise: samples of one flight by two good units differ by less (real_copter_sample.BIN,
/// quiver_088.bin: 1.02 to 1.3).
const QUIETER: f64 = 1.6;
/// Means that cover so much of the time follow upon each other; below, they are taken as instants. Logs that lost nothing cover 0.99 and more.
const CONTINUOUS: f64 = 0.98;
/// Fewer samples say nothing of a source.
const SOME: u64 = 50;
/// So many samples at the end of the range are a matter of chance.
const FEW_CLIPPED: u64 = 10;

/// A source: the name of its messages and the number of its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Source {
    /// Kind of message; an earlier kind is preferred where nothing else decides.
    pub kind: Kind,
    /// Unit, from 0.
    pub unit: u8,
}

/// Kinds of messages with inertial samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// ArduPilot: filtered samples.
    Imu,
    /// ArduPilot: increments with their intervals.
    Increments,
    /// ArduPilot: samples at the sensor's own rate.
    Raw,
    /// PX4: means of the unit that flies.
    Combined,
    /// PX4: increments of one unit with their intervals.
    VehicleImu,
    /// PX4: samples of one sensor.
    Sensors,
}

impl Source {
    /// The usual source of ArduPilot's log.
    pub const IMU: Self = Self { kind: Kind::Imu, unit: 0 };
    /// The usual source of PX4's log.
    pub const COMBINED: Self = Self { kind: Kind::Combined, unit: 0 };
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self.kind {
            Kind::Imu => "IMU",
            Kind::Increments => "IMT",
            Kind::Raw => "ACC/GYR",
            Kind::Combined => "sensor_combined",
            Kind::VehicleImu => "vehicle_imu",
            Kind::Sensors => "sensor_accel/gyro",
        };
        match (self.kind, self.unit) {
            (Kind::Imu | Kind::Combined, 0) => f.write_str(name),
            (_, unit) => write!(f, "{name}[{unit}]"),
        }
    }
}

/// What was counted of a source.
#[derive(Debug, Clone, Copy, Default)]
pub struct Tally {
    samples: u64,
    first_us: u64,
    last_us: u64,
    clipped: u64,
    still: u64,
    before: Option<[Vector3<f64>; 2]>,
    /// Sum of squares of second differences of the specific force.
    rough: f64,
    covered_s: f64,
}

impl Tally {
    fn push(&mut self, t_us: u64, gyro: &Vector3<f64>, accel: &Vector3<f64>, interval_s: f64, clipped: bool) {
        if self.samples == 0 {
            self.first_us = t_us;
        }
        (self.samples, self.last_us) = (self.samples + 1, t_us.max(self.first_us));
        self.clipped += u64::from(clipped);
        self.covered_s += interval_s;
        if let Some([older, old]) = self.before {
            self.rough += (accel - 2.0 * old + older).norm_squared();
            self.still += u64::from((accel - old).norm() == 0.0 && gyro.norm() >= 0.0);
            self.before = Some([old, *accel]);
        } else {
            self.before = Some([*accel; 2]);
        }
    }

    /// Samples a second.
    pub fn rate_hz(&self) -> f64 {
        let span_s = (self.last_us - self.first_us) as f64 * 1e-6;
        if self.samples < 2 || span_s <= 0.0 { 0.0 } else { (self.samples - 1) as f64 / span_s }
    }

    /// Share of the time that the intervals of its samples cover; 0 where these have none.
    pub fn coverage(&self) -> f64 {
        let span_s = (self.last_us - self.first_us) as f64 * 1e-6;
        if span_s > 0.0 { (self.covered_s / span_s).min(1.0) } else { 0.0 }
    }

    /// Vibration and noise above half the rate, m/s².
    fn roughness(&self) -> f64 {
        (self.rough / (6.0 * self.samples.max(1) as f64)).sqrt()
    }

    fn works(&self) -> bool {
        self.samples >= SOME && self.still * 2 < self.samples
    }
}

/// All inertial sources of a log.
#[derive(Debug, Clone, Default)]
pub struct Survey(BTreeMap<Source, Tally>);

/// The source that samples are taken from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Which.
    pub source: Source,
    /// Whether its samples are means over intervals that follow upon each other without gaps.
    pub continuous: bool,
    /// Of how many sources it is the best.
    pub of: usize,
    /// Why it is not the usual one.
    pub why: Option<Why>,
}

/// Why another source than the usual one is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Why {
    /// It has more samples a second.
    Faster,
    /// It vibrates less.
    Quieter,
    /// The usual one exceeds its range.
    Clips,
    /// The usual one does not measure, or is not there.
    Absent,
}

impl Choice {
    /// A source alone.
    pub fn of(source: Source) -> Self {
        Self { source, continuous: !matches!(source.kind, Kind::Imu), of: 1, why: None }
    }

    /// Time of a sample that is the mean over an interval, s, that ends at `end_us`: its end where these follow upon each other, otherwise its middle.
    pub fn stamp_us(&self, end_us: u64, interval_s: f64) -> u64 {
        if self.continuous { end_us } else { end_us.saturating_sub((0.5e6 * interval_s) as u64) }
    }

    /// The source as results name it: which of several, and why.
    pub fn words(&self) -> String {
        let why = match self.why {
            // The usual source needs no word.
            None => return self.source.to_string(),
            Some(Why::Faster) => ", the fastest",
            Some(Why::Quieter) => ", the least vibration",
            Some(Why::Clips) => ", the least clipping",
            Some(Why::Absent) => ", the usual one has no usable samples",
        };
        format!("{} (of {} sources{why})", self.source, self.of)
    }
}

impl Survey {
    /// Counts a sample of a source. `interval_s`: that it is the mean of; 0 for a sample of an instant.
    pub fn push(
        &mut self,
        source: Source,
        t_us: u64,
        [gyro, accel]: [&Vector3<f64>; 2],
        interval_s: f64,
        clipped: bool,
    ) {
        self.0.entry(source).or_default().push(t_us, gyro, accel, interval_s, clipped);
    }

    /// The best source; nothing where there is none with samples enough.
    pub fn best(&self) -> Option<Choice> {
        let working: Vec<(Source, &Tally)> =
            self.0.iter().filter(|(_, t)| t.works()).map(|(s, t)| (*s, t)).collect();
        let (usual, own) = *working.first()?;
        let absent = self.0.keys().next() != Some(&usual);
        let mut best = (usual, own, absent.then_some(Why::Absent));
        let rate = |t: &Tally| t.rate_hz().min(ENOUGH_HZ);
        for (source, tally) in working.iter().skip(1) {
            let faster = rate(tally) / rate(best.1).max(1e-9);
            if faster > FASTER {
                best = (*source, tally, Some(Why::Faster));
            } else if faster * FASTER > 1.0 && source.kind == best.0.kind {
                let clips = best.1.clipped > FEW_CLIPPED + 10 * tally.clipped;
                let quieter =
                    best.1.roughness() > QUIETER * tally.roughness() && tally.clipped <= best.1.clipped;
                match (clips, quieter) {
                    (true, _) => best = (*source, tally, Some(Why::Clips)),
                    (_, true) => best = (*source, tally, Some(Why::Quieter)),
                    _ => {}
                }
            }
        }
        let (source, tally, why) = best;
        Some(Choice { source, continuous: tally.coverage() > CONTINUOUS, of: working.len(), why })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten seconds of a source: rate, vibration, samples at the end of the range, length of the intervals.
    fn with(survey: &mut Survey, source: Source, hz: u64, vibration: f64, clipped: u64, interval_s: f64) {
        for k in 0..10 * hz {
            let wave = vibration * if k % 2 == 0 { 1.0 } else { -1.0 } + 1e-6 * k as f64;
            let accel = Vector3::new(wave, 0.0, -9.8);
            survey.push(source, k * 1_000_000 / hz, [&Vector3::zeros(), &accel], interval_s, k < clipped);
        }
    }

    const IMU1: Source = Source { kind: Kind::Imu, unit: 1 };

    #[test]
    fn the_usual_source_stays_unless_another_is_clearly_better() {
        for (vibration, clipped, wanted, why) in [
            (1.0, 0, Source::IMU, None),
            (0.7, 0, Source::IMU, None),
            (0.2, 0, IMU1, Some(Why::Quieter)),
            (1.0, 0, Source::IMU, None),
        ] {
            let mut survey = Survey::default();
            with(&mut survey, Source::IMU, 25, 1.0, 0, 0.0);
            with(&mut survey, IMU1, 25, vibration, clipped, 0.0);
            let best = survey.best().unwrap();
            assert_eq!((best.source, best.why, best.of), (wanted, why, 2), "{vibration}");
            assert!(!best.continuous);
        }
        let mut survey = Survey::default();
        with(&mut survey, Source::IMU, 25, 1.0, 40, 0.0);
        with(&mut survey, IMU1, 25, 1.0, 0, 0.0);
        assert_eq!(survey.best().unwrap().words(), "IMU[1] (of 2 sources, the least clipping)");
    }

    #[test]
    fn a_faster_source_wins_and_one_that_does_not_measure_is_left_out() {
        let raw = Source { kind: Kind::Raw, unit: 0 };
        let mut survey = Survey::default();
        with(&mut survey, Source::IMU, 25, 1.0, 0, 0.0);
        with(&mut survey, raw, 1000, 9.0, 0, 0.005);
        assert_eq!((survey.best().unwrap().source, survey.best().unwrap().continuous), (raw, true));
        let mut survey = Survey::default();
        for k in 0..400 {
            let accel = Vector3::new(0.0, 0.0, -9.8);
            survey.push(Source::IMU, k * 5000, [&accel, &accel], 0.0, false);
        }
        with(&mut survey, IMU1, 200, 1.0, 0, 0.0);
        assert_eq!((survey.best().unwrap().source, survey.best().unwrap().why), (IMU1, Some(Why::Absent)));
        assert!(Survey::default().best().is_none());
    }

    #[test]
    fn means_with_gaps_between_them_are_taken_as_points() {
        let mut survey = Survey::default();
        with(&mut survey, Source::COMBINED, 9, 1.0, 0, 0.004);
        assert!(!survey.best().unwrap().continuous);
    }
}
