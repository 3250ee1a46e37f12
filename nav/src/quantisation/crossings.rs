//! Whether a source rounds its integers or truncates them, by how often a value that passes through zero is caught there.
//!
//! Of a value that goes from two counts or more on one side of zero to as many on the other within two samples, the one in between is about as likely
//! anywhere near zero. Rounding gives each count a bin of one step, truncation gives zero one of two: of the counts −1, 0 and 1 a third is zero, or a half.
//! Measured on 150 to 10,000 crossings (2026-11-30): ArduPilot, PX4 and the recordings made by others 48 to 77 % (more where the motion is slow against the
//! samples), rounded samples of simulated flights 33 to 37 %.

use crate::math::ln;
use crate::model::{Model, QuantisationBelief};
use crate::sample::{ImuSample, ImuStream, Quantisation, Steps};

/// A crossing comes from so many counts beyond zero, and leads to as many.
const BEYOND: f64 = 2.0;
/// The source is taken for one that rounds once that is likelier by so many nats: one in 20,000 sources that truncate is wronged (Wald 1945).
const SURE: f64 = 10.0;

/// What the crossings of a stream so far say.
#[derive(Debug, Clone)]
pub(crate) struct Crossings {
    /// How its message and the model say that it is read.
    said: Quantisation,
    /// Of a stream of which nothing but its name says that it truncates. A model that says it is right.
    steps: Option<Steps>,
    last: Option<[[f64; 6]; 2]>,
    /// Logarithm of the odds that the source rounds.
    log_odds: f64,
    rounds: bool,
}

impl Crossings {
    pub(crate) fn of(stream: &ImuStream, model: &Model) -> Self {
        let says_nothing =
            model.imu.quantisation == QuantisationBelief::Auto && model.get("imu_truncation").is_none();
        let steps = match stream.quantisation {
            Quantisation::Truncate(steps) if says_nothing => Some(steps),
            _ => None,
        };
        let said = model.quantisation_of(stream);
        Self { said, steps, last: None, log_odds: 0.0, rounds: false }
    }

    /// The next sample; how the stream is to be read from here on, where that is not how it was until now.
    pub(crate) fn push(&mut self, sample: &ImuSample) -> Option<Quantisation> {
        let steps = self.steps?;
        let [g, a] = [sample.gyro / steps.gyro, sample.accel / steps.accel];
        let counts = [g.x, g.y, g.z, a.x, a.y, a.z].map(f64::round);
        let [first, middle] = self.last.unwrap_or([[0.0; 6], counts]);
        for ((from, at), to) in first.iter().zip(&middle).zip(&counts) {
            if from.abs() >= BEYOND && to.abs() >= BEYOND && from * to < 0.0 && at.abs() <= 1.0 {
                self.log_odds += if *at == 0.0 { ln(2.0 / 3.0) } else { ln(4.0 / 3.0) };
            }
        }
        self.last = Some([middle, counts]);
        let before = self.rounds;
        self.rounds = self.log_odds > if before { 0.0 } else { SURE };
        (self.rounds != before).then(|| self.quantisation())
    }

    /// How the stream is to be read: as its message stands for, unless the samples contradict that.
    pub(crate) fn quantisation(&self) -> Quantisation {
        self.steps.filter(|_| self.rounds).map_or(self.said, Quantisation::Round)
    }
}

/// How a stream is to be read whose samples, all of them there, contradict its message.
pub(crate) fn contradicted(stream: &ImuStream, samples: &[ImuSample], model: &Model) -> Option<Quantisation> {
    let mut crossings = Crossings::of(stream, model);
    for sample in samples {
        crossings.push(sample);
    }
    crossings.rounds.then(|| crossings.quantisation())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    /// What is found of a vehicle that rolls to and fro by so many counts per sample, its samples `turned` into integers.
    fn found(turned: fn(f64) -> f64, slope: f64) -> Quantisation {
        let steps = Steps::RAW_IMU;
        let stream = ImuStream { quantisation: Quantisation::Truncate(steps), ..ImuStream::default() };
        let mut crossings = Crossings::of(&stream, &Model::default());
        for k in 0..60_000 {
            // A triangle of 100 samples whose phase moves on: zero is passed everywhere.
            let t = f64::from(k) * 1.00037 % 100.0;
            let counts = slope * (if t < 50.0 { t - 25.0 } else { 75.0 - t });
            let gyro = Vector3::new(turned(counts) * steps.gyro, 0.0, 0.0);
            let accel = Vector3::new(0.0, 0.0, turned(-1000.3) * steps.accel);
            crossings.push(&ImuSample { t_s: f64::from(k) * 0.02, gyro, accel, temperature_degc: None });
        }
        crossings.quantisation()
    }

    #[test]
    fn a_source_that_rounds_is_known_by_its_crossings_of_zero() {
        for slope in [4.1, 6.3, 9.0] {
            assert_eq!(found(f64::round, slope), Quantisation::Round(Steps::RAW_IMU), "{slope}");
            assert_eq!(found(f64::trunc, slope), Quantisation::Truncate(Steps::RAW_IMU), "{slope}");
        }
        // So slow that what is two counts off before and after can only be zero in between: nothing is claimed.
        assert_eq!(found(f64::round, 2.1), Quantisation::Truncate(Steps::RAW_IMU));
    }

    #[test]
    fn a_model_that_says_how_samples_are_read_is_right() {
        let stream =
            ImuStream { quantisation: Quantisation::Truncate(Steps::RAW_IMU), ..ImuStream::default() };
        let read = |model: &Model| Crossings { rounds: true, ..Crossings::of(&stream, model) }.quantisation();
        let mut model = Model::default();
        assert_eq!(read(&model), Quantisation::Round(Steps::RAW_IMU));
        model.imu.quantisation = QuantisationBelief::Truncate;
        assert_eq!(read(&model), stream.quantisation);
    }
}
