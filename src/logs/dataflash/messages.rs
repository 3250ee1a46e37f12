//! From messages to measurements and notes.

use super::fixes::{accuracies, arrival_us, fix, utc_s};
use super::inertial::{self, Raw};
use super::notes::{self, Filter, class_of_firmware, class_of_parameter, version};
use super::{Entry, air, health, magnetic, operating};
use crate::logs::source::{Choice, Source, Survey};
use crate::logs::{Item, LogNote, Record, VehicleClass};
use crate::sensors::gnss::Course;
use crate::timeline::{Measurement, Stamp};
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::{GnssFix, ImuStream, SampleKind};
use std::collections::VecDeque;

/// Turns messages into measurements.
#[derive(Debug)]
pub(super) struct Messages {
    pub(super) queue: VecDeque<Record>,
    choice: Choice,
    /// All inertial sources are counted and nothing else is given.
    survey: Option<Survey>,
    raw: Raw,
    streaming: bool,
    /// A fix with the times at which it was logged and at which it arrived, µs.
    waiting: Option<(u64, u64, GnssFix)>,
    course: Course,
    /// What flies by the name of the firmware, and by its parameters.
    class: (Option<VehicleClass>, Option<VehicleClass>),
    /// Which of its navigation filters flies.
    filter: Filter,
    /// Time of the newest message, µs: parameters may have none of their own.
    newest_us: u64,
    /// Messages so far.
    taken: u64,
}

impl Messages {
    pub(super) fn new(choice: Choice) -> Self {
        Self {
            queue: VecDeque::new(),
            choice,
            survey: None,
            raw: Raw::default(),
            streaming: false,
            waiting: None,
            course: Course::default(),
            class: (None, None),
            filter: Filter::default(),
            newest_us: 0,
            taken: 0,
        }
    }

    pub(super) fn surveying() -> Self {
        Self { survey: Some(Survey::default()), ..Self::new(Choice::of(Source::IMU)) }
    }

    pub(super) fn into_survey(self) -> Survey {
        self.survey.unwrap_or_default()
    }

    /// Messages so far.
    pub(super) fn taken(&self) -> u64 {
        self.taken
    }

    /// What flies.
    pub(super) fn kind(&self) -> Option<VehicleKind> {
        self.class()?.kind()
    }

    /// The firmware says which family it is, its parameters what is carried by what.
    fn class(&self) -> Option<VehicleClass> {
        match self.class {
            (Some(VehicleClass::FixedWing), Some(VehicleClass::Vtol)) => Some(VehicleClass::Vtol),
            (Some(VehicleClass::Multirotor), Some(VehicleClass::Helicopter)) => {
                Some(VehicleClass::Helicopter)
            }
            (firmware, parameter) => firmware.or(parameter),
        }
    }

    fn learn_class(&mut self, entry: &Entry, change: impl FnOnce(&mut Self)) {
        let before = self.class();
        change(self);
        if let Some(class) = self.class().filter(|class| Some(*class) != before) {
            self.note(entry, LogNote::Vehicle(class));
        }
    }

    fn note(&mut self, entry: &Entry, note: LogNote) {
        self.newest_us = entry.stamp_us().unwrap_or(self.newest_us);
        self.queue.push_back(Record { t_us: self.newest_us, item: Item::Note(note) });
    }

    fn put(&mut self, t_us: u64, measurement: Measurement) {
        self.queue.push_back(Record { t_us, item: Item::Measurement(measurement) });
    }

    pub(super) fn release_fix(&mut self) {
        if let Some((t_us, arrived_us, fix)) = self.waiting.take() {
            self.put(t_us, Measurement::Fix(Some(Stamp::Usec(arrived_us)), fix));
        }
    }

    /// Takes a message; nothing where its content is wrong.
    pub(super) fn take(&mut self, entry: &Entry) -> Option<()> {
        self.taken += 1;
        if let Some((family, source)) = inertial::source(entry) {
            return self.inertial(family, source, entry);
        }
        if self.survey.is_some() {
            return Some(());
        }
        if let Some(compass) = magnetic::compass(entry) {
            if let Some((t_us, sample)) = magnetic::sample(entry, compass)? {
                self.put(t_us, Measurement::Field(Stamp::Usec(t_us), sample));
            }
            return Some(());
        }
        if let Some((t_us, sample)) = air::sample(entry) {
            self.put(t_us, Measurement::Air(Some(Stamp::Usec(t_us)), sample));
        }
        // Firmware before 4.1 has no instance field and names further instances GPS2.
        if entry.number("I").is_some_and(|i| i != 0.0) {
            return Some(());
        }
        match entry.format.name.as_str() {
            "GPS" => {
                self.release_fix();
                // Without a fix there is nothing wrong.
                let stamp_us = entry.stamp_us();
                self.waiting =
                    stamp_us.and_then(|t_us| Some((t_us, t_us, fix(entry, t_us, &mut self.course)?)));
                if let Some(utc_s) = utc_s(entry).filter(|_| self.waiting.is_some()) {
                    self.note(entry, LogNote::Utc(utc_s));
                }
                health::gnss(entry).into_iter().for_each(|note| self.note(entry, LogNote::Health(note)));
            }
            "GPA" => {
                let t_us = entry.stamp_us()?;
                if let Some((_, arrived_us, fix)) = self.waiting.as_mut().filter(|(t, ..)| *t == t_us) {
                    accuracies(fix, entry);
                    *arrived_us = arrival_us(entry, t_us);
                }
                self.release_fix();
            }
            "ATT" => {
                let (t_us, angles) = (entry.stamp_us()?, notes::attitude(entry)?);
                health::demanded(entry).into_iter().for_each(|note| self.note(entry, LogNote::Health(note)));
                self.put(t_us, Measurement::Attitude(Stamp::Usec(t_us), angles));
            }
            "MSG" => self.text(entry),
            "DSF" => {
                let note = health::logger(entry, self.taken);
                note.into_iter().for_each(|note| self.note(entry, LogNote::Health(note)));
            }
            "PARM" => {
                if let Some((name, value)) = entry.text("Name").zip(entry.number("Value")) {
                    let class = class_of_parameter(name, value);
                    self.learn_class(entry, |own| own.class.1 = class.or(own.class.1));
                    self.filter.parameter(name, value);
                    self.note(entry, LogNote::Parameter { name: name.to_owned(), value });
                }
            }
            _ => self.other(entry),
        }
        Some(())
    }

    fn text(&mut self, entry: &Entry) {
        let Some(text) = entry.text("Message") else { return };
        let class = class_of_firmware(text);
        self.learn_class(entry, |own| own.class.0 = class.or(own.class.0));
        if let Some((major, minor)) = version(text) {
            self.note(entry, LogNote::Version(major, minor));
        }
        if let Some(board) = notes::board(text) {
            self.note(entry, LogNote::Board(board));
        }
        self.note(entry, LogNote::Health(health::text(text)));
    }

    fn other(&mut self, entry: &Entry) {
        let values = self.filter.values(entry);
        if !values.is_empty() {
            self.note(entry, LogNote::Filter(values));
        }
        if let Some(found) = notes::other_attitude(entry) {
            self.note(entry, LogNote::Attitude(found.0, found.1));
        }
        if let Some((t_us, values)) = entry.stamp_us().zip(operating::of(entry, self.class())) {
            self.put(t_us, Measurement::Operating(Some(Stamp::Usec(t_us)), values));
        }
        for note in health::notes(entry, self.class(), self.filter.flies(entry)) {
            self.note(entry, LogNote::Health(note));
        }
    }

    fn inertial(&mut self, family: &str, source: Source, entry: &Entry) -> Option<()> {
        if self.survey.is_none() && source != self.choice.source {
            return Some(());
        }
        let Some(found) = inertial::sample(family, source.unit, entry, &mut self.raw)? else {
            return Some(());
        };
        if let Some(survey) = &mut self.survey {
            let sample = [&found.sample.gyro, &found.sample.accel];
            survey.push(source, found.t_us, sample, found.interval_s, found.is_clipped());
            return Some(());
        }
        if !self.streaming {
            self.streaming = true;
            let kind = if self.choice.continuous { SampleKind::IntervalMean } else { SampleKind::Point };
            let stream = ImuStream { message: self.choice.words(), kind, ..Default::default() };
            self.put(found.t_us, Measurement::Stream(stream));
        }
        let t_us = self.choice.stamp_us(found.t_us, found.interval_s);
        self.put(t_us, Measurement::Imu(Stamp::Usec(t_us), found.sample));
        Some(())
    }
}
