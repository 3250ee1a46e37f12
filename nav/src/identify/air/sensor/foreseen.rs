//! A sensor before its flight: the rows that are used after one, along a flight without errors.

use super::{AirSensor, FIGURES, GUSTS, SHOWN_WIND_SIGMA, known, widths};
use crate::effects::{AIRSPEED, BAROMETER};
use crate::identify::aids::foreseen::{Foreseen, Setting};
use crate::identify::aids::series::Running;
use crate::identify::air::{Carriage, Instant, density};
use crate::identify::pass::Information;
use crate::sample::AirKind;
use nalgebra::Vector2;
use std::sync::Arc;

impl AirSensor<'static> {
    /// A sensor before its flight: only what its rows are made of.
    fn before(kind: AirKind, setting: &Setting, has_airspeed: bool) -> Self {
        Self {
            kind,
            catalogue: [BAROMETER, AIRSPEED][kind as usize],
            // Nothing that is planned warms a sensor.
            widths: widths(kind, has_airspeed.then_some([SHOWN_WIND_SIGMA; 2]), |e| e != "baro_temperature"),
            carriage: &[],
            instants: Vec::new(),
            mean_height_m: setting.home_height_m,
            is_wing: setting.is_wing,
            wind: Vec::new(),
            along: Vec::new(),
            gusts: GUSTS,
        }
    }
}

/// What a flight that is planned would show of a sensor without errors.
#[derive(Clone)]
pub(in crate::identify) struct AirForeseen {
    sensor: Arc<AirSensor<'static>>,
    running: Running,
    information: Information,
    last: Option<(f64, f64)>,
}

impl AirForeseen {
    pub(in crate::identify) fn new(kind: AirKind, setting: &Setting, has_airspeed: bool) -> Self {
        let sensor = AirSensor::before(kind, setting, has_airspeed);
        let noise = FIGURES[kind as usize].before(known(kind, GUSTS));
        let columns = sensor.widths.len();
        let running = Running::new(noise, columns, 0.0);
        Self { sensor: Arc::new(sensor), running, information: Information::zeros(columns), last: None }
    }

    /// The vehicle at the next fix, in this wind.
    pub(in crate::identify) fn take(&mut self, now: &Carriage, wind: &Vector2<f64>) {
        let sensor = &self.sensor;
        let density = density(now.height_m);
        let mut s = sensor.ideal_of(now, (wind, 0.0), [density, 0.0, 0.0]);
        let own = (now.elapsed_s, s.x.airspeed[0]);
        if let Some(last) = self.last.replace(own) {
            s.x.airspeed[1] = (own.1 - last.1) / (own.0 - last.0).max(1e-3);
        }
        let i = Instant { elapsed_s: now.elapsed_s, measured: s.value, density, temperature: 0.0 };
        for row in sensor.rows_of((&i, &s, wind), &vec![0.0; sensor.widths.len()], true) {
            self.running.take(&row, &mut self.information);
        }
    }

    /// Each parameter.
    pub(in crate::identify) fn sigmas(&self) -> Vec<Foreseen> {
        let mut information = self.information.clone();
        information.finish();
        Foreseen::of(information, &[], &self.sensor.widths)
    }
}
