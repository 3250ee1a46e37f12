//! What a flight that is planned will show of the sensors beside the inertial unit: the information of the rows that are used after a flight, along a flight
//! without errors. The noise is the usual one of each sensor, and what is left of its other effects counts as after a flight.

use super::choose::{THRESHOLD, Widths, sigmas_alone};
use crate::effects::{COMPASS, FieldInstant, Unit};
use crate::identify::air::{AirForeseen, Carriage};
use crate::identify::compass;
use crate::identify::pass::Information;
use crate::rotation::skew;
use crate::rss;
use crate::sample::AirKind;
use nalgebra::{Vector2, Vector3};

/// Noise of a compass at a fix, T: 5 mG of sensor, rounding and what motors leave.
const FIELD_SIGMA_T: f64 = 5e-7;
/// Roll and pitch of a trajectory are known to this, rad.
const TILT: f64 = 0.005;

/// A plan asks for so many sigmas: 7.2 nats, where [`THRESHOLD`] is enough for a name. With 3.2 it ended after two maneuvers instead of five, and a scale of 20 % was not separated from an
/// offset of the pressure.
const NAMED_FROM: f64 = 3.8;
const _: () = assert!(0.5 * NAMED_FROM * NAMED_FROM > THRESHOLD);

/// Reports have other noise than the usual one: on simulated flights their sigmas are .5 to 2.8 times those foreseen (`study planned`).
const RESERVE: f64 = 2.0;

/// A parameter of a sensor.
#[derive(Debug, Clone, Copy)]
pub struct Foreseen {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: Unit,
    /// 1-sigma with which a flight would report it where its effect alone is wrong, in that unit.
    pub sigma: f64,
    /// Sigma from which an error of its usual size is named, with the reserve for what a report says beside it and with what no flight can show, in that unit.
    pub target: f64,
}

impl Foreseen {
    /// Each parameter of a sensor by the information about it. `prior`: that of the parameters before those of the sensor.
    pub(in crate::identify) fn of(
        information: Information,
        prior: &[(f64, f64)],
        widths: &Widths,
    ) -> Vec<Self> {
        let sigmas = sigmas_alone(information, prior, widths);
        let names = |e: usize| {
            let groups = widths.catalogue[e].groups().iter();
            groups.flat_map(|g| g.names.iter().map(move |name| (*name, g)))
        };
        let mut seen = vec![0; widths.catalogue.len()];
        let one = |(e, sigma): (usize, f64)| {
            let (name, group) = names(e).nth(seen[e])?;
            let unit = group.unit;
            seen[e] += 1;
            let target = rss(group.prior_sigma / NAMED_FROM / RESERVE, widths.least(e)) / unit.si;
            Some(Self { name, unit, sigma: sigma / unit.si, target })
        };
        sigmas.into_iter().filter_map(one).collect()
    }
}

/// A sensor that is planned for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Planned {
    /// A compass.
    Compass,
    /// A pitot tube.
    Airspeed,
    /// A barometer.
    Barometer,
}

/// What is known of the flight.
#[derive(Debug, Clone, Copy)]
pub struct Setting {
    /// Whether wings carry the vehicle.
    pub is_wing: bool,
    /// Wind toward north and east, m/s.
    pub wind: Vector2<f64>,
    /// Height of the start, m.
    pub home_height_m: f64,
    /// The Earth's field, north, east, down, T.
    pub field_n: Vector3<f64>,
    /// Current at full throttle, A.
    pub full_current_a: f64,
}

/// The information about one or more sensors along a flight.
#[derive(Clone)]
pub struct Foresight {
    setting: Setting,
    sensors: Vec<Sensor>,
}

#[derive(Clone)]
enum Sensor {
    Compass(Information),
    Air(Box<AirForeseen>),
}

impl std::fmt::Debug for Foresight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Foresight").field("sensors", &self.sensors.len()).finish_non_exhaustive()
    }
}

/// Parameters of the attitude, before those of a compass.
const ATTITUDE: usize = 3;

fn compass_widths() -> Widths {
    Widths::new(COMPASS, &compass::TOLERANCES, |_| true)
}

impl Foresight {
    /// Nothing flown yet.
    pub fn new(planned: &[Planned], setting: Setting) -> Self {
        let air = |kind| {
            let has_airspeed = planned.contains(&Planned::Airspeed);
            Sensor::Air(Box::new(AirForeseen::new(kind, &setting, has_airspeed)))
        };
        let sensor = |p: &Planned| match p {
            Planned::Compass => Sensor::Compass(Information::zeros(ATTITUDE + compass_widths().len())),
            Planned::Airspeed => air(AirKind::Airspeed),
            Planned::Barometer => air(AirKind::Barometer),
        };
        Self { setting, sensors: planned.iter().map(sensor).collect() }
    }

    /// The vehicle at the next fix, and its angular rate in body axes, rad/s.
    pub fn take(&mut self, now: &Carriage, rate: &Vector3<f64>) {
        let setting = self.setting;
        for sensor in &mut self.sensors {
            match sensor {
                Sensor::Air(air) => air.take(now, &setting.wind),
                Sensor::Compass(information) => field(information, now, rate, &setting),
            }
        }
    }

    /// Every parameter that a flight can show, with a heading that is known to `yaw_sigma`, rad.
    pub fn parameters(&self, yaw_sigma: f64) -> Vec<Foreseen> {
        let one = |sensor: &Sensor| match sensor {
            Sensor::Air(air) => air.sigmas(),
            Sensor::Compass(information) => {
                let mut information = information.clone();
                information.finish();
                let prior = [(TILT, 0.0), (TILT, 0.0), (yaw_sigma, 0.0)];
                Foreseen::of(information, &prior, &compass_widths())
            }
        };
        self.sensors.iter().flat_map(one).collect()
    }
}

/// Three rows of a compass: its parameters, and errors of the attitude about north, east and down that stay the same for the flight.
fn field(information: &mut Information, now: &Carriage, rate: &Vector3<f64>, setting: &Setting) {
    let to_body = now.c_nb.inverse();
    let down = Vector3::z();
    let field = to_body * setting.field_n;
    let x = FieldInstant {
        field,
        by_declination: to_body * down.cross(&setting.field_n),
        rate: *rate,
        current_a: now.throttle * setting.full_current_a,
    };
    let by_attitude = skew(&field) * to_body.matrix();
    let mut columns: Vec<Vector3<f64>> = (0..ATTITUDE).map(|k| by_attitude.column(k).into()).collect();
    for effect in COMPASS {
        let mut own = vec![Vector3::zeros(); effect.len()];
        if let Some(on) = effect.on_field() {
            on.field_jacobian(&vec![0.0; own.len()], &x, &mut own);
        }
        columns.extend(own);
    }
    for axis in 0..3 {
        let row: Vec<f64> = columns.iter().map(|c| c[axis]).collect();
        information.take(&row, 0.0, FIELD_SIGMA_T.powi(-2));
    }
}
