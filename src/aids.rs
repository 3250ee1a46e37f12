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

/// Beyond this mean squared normalised innovation no trajectory judges a sensor. Of 53 public logs eleven are beyond (7.6 to 48000): fixes that
/// jump, stamps of several vehicles, a crash; compasses were called turned and barometers a kilometre off. Where findings hold it is at most 5.6.
const BELIEVED_NIS: f64 = 6.0;

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

    /// Why nothing is said of compasses and of barometers and airspeed, where the log holds any.
    fn not_judged(fields: bool, air: bool, why: &str) -> Self {
        let notes = |of: &str| vec![format!("{of} are not judged: {why}.")];
        Self {
            compasses: fields
                .then(|| CompassReport { notes: notes("The compasses"), ..CompassReport::default() }),
            air: air.then(|| AirReport { notes: notes("Barometers and airspeed"), ..AirReport::default() }),
        }
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
        Err(why) => Aids::not_judged(fields, air, &why.to_string()),
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
    let (fields, air) = (!flight.fields().is_empty(), !flight.air().is_empty());
    if !fields && !air {
        return Aids::default();
    }
    let settled = Settled::new(flight, model, noise, &Threads(cores()));
    let nis = settled.nis_per_dof();
    if nis > BELIEVED_NIS {
        let why = format!(
            "inertial data and fixes are inconsistent with each other ({nis:.0} times as much as their noise allows), so there is no motion to compare with"
        );
        return Aids::not_judged(fields, air, &why);
    }
    Aids {
        compasses: fields.then(|| compass::of_flight(flight, &settled, start_unix_s, on_board)),
        air: air::of_flight(flight, &settled, on_board),
    }
}

#[cfg(test)]
pub(crate) mod testing {
    //! Flights for the tests of all sensors.

    use gaware_nav::effects;
    use gaware_nav::model::EffectSetting;
    use gaware_nav::sample::Sample;
    use gaware_sitl::powertrain::Carrier;
    use gaware_sitl::scenario::{self, Airframe};
    use gaware_sitl::sensors::SensorConfig;

    /// A flight of a scenario with these effects and sensors, and with what the vehicle does beside moving.
    pub(crate) fn flown(
        name: &str,
        injected: &[(&str, Vec<f64>)],
        seed: u64,
        set: impl FnOnce(&mut SensorConfig),
    ) -> Vec<Sample> {
        let mut scenario = scenario::scenario(name).unwrap();
        for (effect, values) in injected {
            scenario.model.set(EffectSetting::known(effects::find(effect).unwrap(), values).unwrap());
        }
        let wings = scenario.airframe == Airframe::FixedWing;
        scenario.sensors.operating_rate_hz = 10.0;
        scenario.sensors.carrier = Some(if wings { Carrier::Wings } else { Carrier::Rotors });
        set(&mut scenario.sensors);
        scenario.flight(seed).map(|(sample, _)| sample).collect()
    }
}
