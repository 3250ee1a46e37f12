//! The sensors beside the inertial unit and GNSS after a flight: compasses, barometers, airspeed and the wind. One settled trajectory judges all of them.

use crate::advice::on_board::OnBoard;
use crate::air::{self, AirReport};
use crate::compass::{self, CompassReport};
use crate::parallel::{Threads, cores};
use gaware_nav::identify::aids::Settled;
use gaware_nav::identify::flight::Flight;
use gaware_nav::identify::noise::Noise;
use gaware_nav::model::Model;
use gaware_nav::sample::Sample;

/// What a flight says of them; each where the log holds any.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Aids {
    /// Compasses.
    pub compasses: Option<CompassReport>,
    /// Barometers, airspeed, wind.
    pub air: Option<AirReport>,
}

impl Aids {
    /// What is wrong, in words; empty where nothing is.
    pub fn wrong(&self) -> String {
        let compasses = self.compasses.as_ref().map_or_else(String::new, CompassReport::wrong);
        compasses + &self.air.as_ref().map_or_else(String::new, AirReport::wrong)
    }
}

/// Judges the sensors of a recording by a trajectory of the standard model. `start_unix_s`: its date.
pub fn of_samples(samples: &[Sample], start_unix_s: Option<f64>, on_board: &OnBoard) -> Aids {
    let has = |is: fn(&Sample) -> bool| samples.iter().any(is);
    let (fields, air) = (has(|s| matches!(s, Sample::Field(_))), has(|s| matches!(s, Sample::Air(_))));
    if !fields && !air {
        return Aids::default();
    }
    let model = Model::standard();
    match Flight::prepare(samples, &model) {
        Ok(flight) => of_flight(&flight, &model, None, start_unix_s, on_board),
        Err(why) => Aids {
            compasses: fields.then(|| CompassReport {
                notes: vec![format!("The compasses are not judged: {why}.")],
                ..CompassReport::default()
            }),
            air: air.then(|| AirReport {
                notes: vec![format!("Barometers and airspeed are not judged: {why}.")],
                ..AirReport::default()
            }),
        },
    }
}

/// Judges the sensors of a flight under a model, with its noise where that was fitted.
pub fn of_flight(
    flight: &Flight,
    model: &Model,
    noise: Option<Noise>,
    start_unix_s: Option<f64>,
    on_board: &OnBoard,
) -> Aids {
    if flight.fields().is_empty() && flight.air().is_empty() {
        return Aids::default();
    }
    let settled = Settled::new(flight, model, noise, &Threads(cores()));
    let fields = !flight.fields().is_empty();
    Aids {
        compasses: fields.then(|| compass::of_flight(flight, &settled, start_unix_s, on_board)),
        air: air::of_flight(flight, &settled, on_board),
    }
}
