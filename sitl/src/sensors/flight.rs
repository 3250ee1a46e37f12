//! A flight, sample by sample in order of arrival.

use super::*;
use crate::trajectory::dragged::Dragged;

/// A flight as its sensors report it: samples in order of arrival, each with the truth at the time it was measured
/// (for a fix its time of validity). The first item is the [`Sample::Stream`].
pub struct Flight {
    trajectory: Box<dyn Trajectory>,
    sensors: Sensors,
    announced: bool,
    imu: u64,
    fix: u64,
    attitude: u64,
    field: u64,
    air: u64,
    operating: u64,
}

impl std::fmt::Debug for Flight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Flight").field("sensors", &self.sensors).finish_non_exhaustive()
    }
}

impl Flight {
    /// Flies a trajectory with these sensors.
    pub fn new(trajectory: Box<dyn Trajectory>, model: &Model, config: SensorConfig, seed: u64) -> Self {
        let wind = config.wind;
        let trajectory: Box<dyn Trajectory> = match wind == WindTrack::default() {
            true => trajectory,
            false => Box::new(Carried { inner: trajectory, wind }),
        };
        Self {
            trajectory: Dragged::by_model(trajectory, model, wind, seed),
            sensors: Sensors::new(model, config, seed),
            announced: false,
            imu: 0,
            fix: 0,
            attitude: 0,
            field: 0,
            air: 0,
            operating: 0,
        }
    }

    /// The next fix, or `None` in an outage or before there was anything to measure.
    fn next_fix(&mut self, stamp_s: f64) -> Option<(Sample, Truth)> {
        self.fix += 1;
        // Drawn in any case, so that an outage leaves the noise of later fixes alone.
        let (fix, valid_s) = self.sensors.fix(stamp_s, |t_s| self.trajectory.truth_at(t_s));
        let truth = self.trajectory.truth_at(valid_s.max(0.0));
        (valid_s >= 0.0 && !self.sensors.in_outage(stamp_s)).then_some((Sample::Fix(fix), truth))
    }
}

impl Iterator for Flight {
    type Item = (Sample, Truth);

    fn next(&mut self) -> Option<Self::Item> {
        if !self.announced {
            self.announced = true;
            return Some((Sample::Stream(self.sensors.stream()), self.trajectory.truth_at(0.0)));
        }
        let end = self.trajectory.duration_s();
        loop {
            let config = self.sensors.config();
            let due = |count: u64, rate: f64| if rate > 0.0 { count as f64 / rate } else { f64::INFINITY };
            let imu = due(self.imu, config.imu_rate_hz);
            let fix = config.fix_phase_s + due(self.fix, config.fix_rate_hz);
            let attitude = due(self.attitude, config.attitude_rate_hz);
            // The powertrain is as the last inertial sample saw it, so that reports come after it.
            let operating = due(self.operating, config.operating_rate_hz);
            if imu.min(fix).min(attitude) > end {
                return None;
            }
            let compass = (self.field % u64::from(COMPASSES)) as u8;
            let field = due(self.field / u64::from(COMPASSES), config.field_rate_hz);
            if field < imu.min(fix).min(attitude) {
                self.field += 1;
                let truth = self.trajectory.truth_at(field);
                if let Some(shown) = self.sensors.field(compass, &truth) {
                    return Some((Sample::Field(FieldSample { t_s: field, compass, field: shown }), truth));
                }
                continue;
            }
            let sensors = AIR_SENSORS.len() as u64;
            let air = due(self.air / sensors, config.air_rate_hz);
            if air < imu.min(fix).min(attitude) {
                let which = (self.air % sensors) as usize;
                self.air += 1;
                let truth = self.trajectory.truth_at(air);
                return Some((Sample::Air(self.sensors.air(which, &truth, None)), truth));
            }
            if operating < imu.min(fix).min(attitude) {
                self.operating += 1;
                let truth = self.trajectory.truth_at(operating);
                let values = self.sensors.operating();
                return Some((Sample::Operating(OperatingSample { t_s: operating, values }), truth));
            }
            if imu <= fix && imu <= attitude {
                self.imu += 1;
                let truth = self.trajectory.truth_at(imu);
                return Some((Sample::Imu(self.sensors.imu(&truth)), truth));
            }
            if fix <= attitude {
                if let Some(item) = self.next_fix(fix) {
                    return Some(item);
                }
            } else {
                self.attitude += 1;
                let truth = self.trajectory.truth_at(attitude);
                return Some((Sample::Attitude(self.sensors.attitude(&truth)), truth));
            }
        }
    }
}
