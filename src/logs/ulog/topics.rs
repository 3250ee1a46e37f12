//! From topics to measurements and notes.

use super::fields::{Fields, attitude, fix, vehicle_class};
use super::notes::{filter_values, is_of_filter};
use super::{Definitions, air, health, operating};
use crate::logs::source::{Choice, Kind, Source, Survey};
use crate::logs::{HealthNote, Item, LogNote, Record, TRUTH, VehicleClass};
use crate::timeline::{Measurement, Stamp};
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::{FieldSample, ImuSample, ImuStream, Quantisation, SampleKind};
use nalgebra::Vector3;
use std::collections::VecDeque;

/// T per G.
const TESLA_PER_GAUSS: f64 = 1e-4;
/// Axes end at 16 g on almost all units, m/s².
const RANGE: f64 = 156.0;

/// Turns the topics into measurements.
#[derive(Debug)]
pub(super) struct Topics {
    choice: Choice,
    /// All inertial sources are counted and nothing else is given.
    survey: Option<Survey>,
    streaming: bool,
    /// The GNSS topic that came first: the other one holds the same fixes.
    gnss_topic: Option<String>,
    /// What flies by `vehicle_status`, or else by the number of the airframe.
    class: (Option<VehicleClass>, Option<VehicleClass>),
    /// The instance of the navigation filter that flies, where several run.
    primary: u8,
    /// The newest specific force of single sensors, m/s².
    accel: [Option<Vector3<f64>>; 4],
    pub(super) given: u64,
    /// Time of the newest data, µs: parameters have none of their own.
    newest_us: u64,
}

impl Topics {
    pub(super) fn new(choice: Choice) -> Self {
        Self {
            choice,
            survey: None,
            streaming: false,
            gnss_topic: None,
            class: (None, None),
            primary: 0,
            accel: [None; 4],
            given: 0,
            newest_us: 0,
        }
    }

    pub(super) fn surveying() -> Self {
        Self { survey: Some(Survey::default()), ..Self::new(Choice::of(Source::COMBINED)) }
    }

    pub(super) fn into_survey(self) -> Survey {
        self.survey.unwrap_or_default()
    }

    /// What flies.
    pub(super) fn kind(&self) -> Option<VehicleKind> {
        self.class.0.or(self.class.1)?.kind()
    }

    pub(super) fn learn_class(
        &mut self,
        change: impl FnOnce(&mut (Option<VehicleClass>, Option<VehicleClass>)),
    ) -> Option<Record> {
        let before = self.class.0.or(self.class.1);
        change(&mut self.class);
        let class = self.class.0.or(self.class.1).filter(|class| Some(*class) != before)?;
        Some(self.record(LogNote::Vehicle(class)))
    }

    pub(super) fn record(&self, note: LogNote) -> Record {
        self.record_at(self.newest_us, note)
    }

    pub(super) fn record_at(&self, t_us: u64, note: LogNote) -> Record {
        Record { t_us, item: Item::Note(note) }
    }

    /// Takes the data of a topic; false where they are wrong.
    pub(super) fn take(
        &mut self,
        body: &[u8],
        definitions: &Definitions,
        out: &mut VecDeque<Record>,
    ) -> bool {
        let Some((id, data)) = body.split_first_chunk() else { return false };
        let Some(topic) = definitions.subscriptions.get(&u16::from_le_bytes(*id)) else { return false };
        let fields = Fields { topic, data };
        let Some(t_us) = fields.stamp() else { return true };
        if let Some(kind) = inertial(&topic.name) {
            let source = Source { kind, unit: topic.instance };
            return self.inertial(source, &fields, out);
        }
        if self.survey.is_some() {
            return true;
        }
        self.newest_us = t_us;
        let note = |note| Record { t_us, item: Item::Note(note) };
        if topic.name == "estimator_selector_status" {
            if let Some(instance) = fields.number("primary_instance") {
                self.primary = instance as u8;
                out.push_back(note(LogNote::Health(HealthNote::Lane(self.primary))));
            }
            return true;
        }
        if topic.name == "sensor_selection" {
            // sensor_combined is of the unit that is selected (modules/sensors/voted_sensors_update.cpp).
            let id = fields.number("accel_device_id").filter(|id| *id > 0.0);
            let combined = self.choice.source.kind == Kind::Combined;
            out.extend(id.filter(|_| combined).map(|id| note(LogNote::Accelerometer(id as u32))));
            return true;
        }
        if topic.name == "vehicle_magnetometer" {
            let Some(field) = fields.vector("magnetometer_ga") else { return false };
            let sample = FieldSample { t_s: 0.0, compass: topic.instance, field: field * TESLA_PER_GAUSS };
            let stamp = Stamp::Usec(fields.sampled().unwrap_or(t_us));
            out.push_back(Record { t_us, item: Item::Measurement(Measurement::Field(stamp, sample)) });
            return true;
        }
        if let Some(sample) = air::of(&fields, |topic| definitions.has_topic(topic)) {
            let stamp = Some(Stamp::Usec(fields.sampled().unwrap_or(t_us)));
            out.push_back(Record { t_us, item: Item::Measurement(Measurement::Air(stamp, sample)) });
        }
        if topic.name == "estimator_attitude" {
            let name = format!("EKF2 lane {}", topic.instance);
            out.extend(attitude(&fields).map(|rpy| note(LogNote::Attitude(name, rpy))));
            return true;
        }
        if topic.name == "vehicle_imu_status" {
            let notes = health::unit(&fields, topic.instance);
            out.extend(notes.into_iter().map(|n| note(LogNote::Health(n))));
            return true;
        }
        if topic.instance != if is_of_filter(&topic.name) { self.primary } else { 0 } {
            return true;
        }
        if let Some(values) = operating::of(&fields) {
            let item = Item::Measurement(Measurement::Operating(Some(Stamp::Usec(t_us)), values));
            out.push_back(Record { t_us, item });
        }
        let notes = health::notes(&topic.name, &fields, definitions);
        out.extend(notes.into_iter().map(|n| note(LogNote::Health(n))));
        self.main(t_us, &fields, definitions, out)
    }

    /// Takes the data of a topic of which there is one.
    fn main(
        &mut self,
        t_us: u64,
        fields: &Fields,
        definitions: &Definitions,
        out: &mut VecDeque<Record>,
    ) -> bool {
        let stamp = Stamp::Usec(t_us);
        let measurement = match fields.topic.name.as_str() {
            name @ ("vehicle_gps_position" | "sensor_gps") => {
                if self.gnss_topic.get_or_insert_with(|| name.to_owned()) != name {
                    return true;
                }
                out.extend(health::gnss(fields).map(|n| self.record(LogNote::Health(n))));
                // Without a fix there is nothing wrong.
                let Some(fix) = fix(fields) else { return true };
                // Before 2001-09-09 the receiver's clock is not set.
                let utc_s = fields.number("time_utc_usec").map(|t| t * 1e-6).filter(|t| *t > 1e9);
                out.extend(utc_s.map(|utc_s| self.record(LogNote::Utc(utc_s))));
                Some(Measurement::Fix(Some(stamp), fix))
            }
            "vehicle_attitude" => attitude(fields).map(|rpy| Measurement::Attitude(stamp, rpy)),
            "vehicle_attitude_groundtruth" => {
                let truth = attitude(fields);
                out.extend(truth.map(|rpy| self.record(LogNote::Attitude(TRUTH.to_owned(), rpy))));
                return true;
            }
            "vehicle_status" => {
                let class = vehicle_class(fields);
                out.extend(self.learn_class(|own| own.0 = class.or(own.0)));
                return true;
            }
            name => {
                let second =
                    name == "estimator_status" && definitions.has_topic("estimator_innovation_test_ratios");
                let values = if second { Vec::new() } else { filter_values(name, fields) };
                if !values.is_empty() {
                    out.push_back(self.record(LogNote::Filter(values)));
                }
                return true;
            }
        };
        let Some(measurement) = measurement else { return false };
        self.given += 1;
        out.push_back(Record { t_us, item: Item::Measurement(measurement) });
        true
    }

    /// Takes an inertial message; false where its content is wrong.
    fn inertial(&mut self, source: Source, fields: &Fields, out: &mut VecDeque<Record>) -> bool {
        if self.survey.is_none() && source != self.choice.source {
            return true;
        }
        if fields.topic.name == "sensor_accel" {
            let accel = xyz(fields);
            if let Some(place) = self.accel.get_mut(usize::from(source.unit)) {
                *place = accel;
            }
            return accel.is_some();
        }
        let Some(t_us) = fields.sampled() else { return true };
        let found = match source.kind {
            Kind::Combined => combined(fields),
            Kind::VehicleImu => increments(fields),
            _ => {
                let Some(accel) = self.accel.get(usize::from(source.unit)).copied().flatten() else {
                    return true;
                };
                xyz(fields).map(|gyro| (gyro, accel, 0.0))
            }
        };
        let Some((gyro, accel, interval_s)) = found else { return false };
        if let Some(survey) = &mut self.survey {
            survey.push(source, t_us, [&gyro, &accel], interval_s, accel.amax() >= RANGE);
            return true;
        }
        self.newest_us = t_us;
        let t_us = self.choice.stamp_us(t_us, interval_s);
        if !self.streaming {
            self.streaming = true;
            // A logger that reports its pauses has none yet.
            out.push_back(self.record(LogNote::Health(HealthNote::Pause(0.0))));
            let kind = if self.choice.continuous { SampleKind::IntervalMean } else { SampleKind::Point };
            let stream = ImuStream { message: self.choice.words(), kind, quantisation: Quantisation::None };
            out.push_back(Record { t_us, item: Item::Measurement(Measurement::Stream(stream)) });
        }
        let sample = ImuSample { t_s: 0.0, gyro, accel, temperature_degc: None };
        let measurement = Measurement::Imu(Stamp::Usec(t_us), sample);
        out.push_back(Record { t_us, item: Item::Measurement(measurement) });
        self.given += 1;
        true
    }
}

/// What kind of inertial topic this is. Of single sensors the accelerometer's values wait for those of the gyro.
fn inertial(topic: &str) -> Option<Kind> {
    Some(match topic {
        "sensor_combined" => Kind::Combined,
        "vehicle_imu" => Kind::VehicleImu,
        "sensor_gyro" | "sensor_accel" => Kind::Sensors,
        _ => return None,
    })
}

/// Rates, specific forces, and the interval that they are means over, s.
type Means = (Vector3<f64>, Vector3<f64>, f64);

fn combined(fields: &Fields) -> Option<Means> {
    let (gyro, accel) = (fields.vector("gyro_rad")?, fields.vector("accelerometer_m_s2")?);
    // Seconds in the first logs of the format, µs since.
    let interval = fields.number("gyro_integral_dt").unwrap_or(0.0);
    Some((gyro, accel, if interval < 1.0 { interval } else { 1e-6 * interval }))
}

/// Coning is in the increments already (PX4, `VehicleIMU.cpp`).
fn increments(fields: &Fields) -> Option<Means> {
    let of = |name: &str| fields.number(name).filter(|dt| *dt > 0.0).map(|dt| 1e-6 * dt);
    let (angle_s, velocity_s) = (of("delta_angle_dt")?, of("delta_velocity_dt")?);
    Some((fields.vector("delta_angle")? / angle_s, fields.vector("delta_velocity")? / velocity_s, angle_s))
}

fn xyz(fields: &Fields) -> Option<Vector3<f64>> {
    let [x, y, z] = ["x", "y", "z"].map(|name| fields.number(name));
    Some(Vector3::new(x?, y?, z?))
}
