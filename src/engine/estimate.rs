//! Estimates in the units of screens, whether a filter runs, ran before a restart, or has not run yet.

use super::snapshot::{Estimate, Estimate3, EstimateMatrix, Motion, ParameterEstimate};
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::filter::Filter;
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::filter::layout::{Layout, index};
use gaware_nav::math::{atan2, hypot};
use gaware_nav::model::Model;
use gaware_nav::sample::ImuSample;
use nalgebra::Vector3;

/// The effect that has a place of its own on every screen.
const G: &str = "gyro_g_sensitivity";
/// 1-sigma of an angle of which nothing is known: evenly spread over the circle, deg.
pub const UNKNOWN_ANGLE_DEG: f64 = 103.923_048_454_132_64;
/// 1-sigma of roll and pitch that gravity alone shows while it is not known whether the vehicle stands, deg.
const LEVELLED_DEG: f64 = 20.0;

/// An estimate this many prior sigmas away from its prior value is no draw from that prior.
pub const BEYOND_PRIOR: f64 = 4.0;

/// Values and sigmas of every constant state, from the gyro bias on, SI.
#[derive(Debug, Clone)]
pub struct Constants {
    /// Order and names.
    pub layout: Layout,
    /// The values of all parameters, estimated or not.
    pub calibration: Calibration,
    /// 1-sigma now.
    pub sigma: Vec<f64>,
    /// 1-sigma at the start.
    pub start: Vec<f64>,
    /// 1-sigma before anything was measured: another only where the unit's file says so.
    pub unmeasured: Vec<f64>,
}

fn unmeasured(model: &Model, layout: &Layout, start: &[f64]) -> Vec<f64> {
    layout
        .names()
        .iter()
        .zip(start)
        .map(|(state, sigma)| model.unmeasured_sigma(state.name, *sigma))
        .collect()
}

impl Constants {
    /// What a filter knows.
    pub fn of_filter(filter: &Filter) -> Self {
        let states = index::GYRO_BIAS..index::GYRO_BIAS + filter.layout().names().len();
        let start = filter.initial_sigmas()[states.clone()].to_vec();
        Self {
            unmeasured: unmeasured(filter.model(), filter.layout(), &start),
            layout: filter.layout().clone(),
            calibration: filter.calibration().clone(),
            sigma: states.map(|s| filter.covariance().sigma(s)).collect(),
            start,
        }
    }

    /// What is known before any flight.
    pub fn of_model(model: &Model) -> Self {
        let layout = Layout::new(model);
        let mut sigma = vec![model.imu.gyro_bias_sigma; 3];
        sigma.extend([model.imu.accel_bias_sigma; 3]);
        sigma.extend(layout.slots().iter().map(|s| model.effects[s.effect].sigmas[s.parameter]));
        let unmeasured = unmeasured(model, &layout, &sigma);
        Self { calibration: Calibration::new(model), start: sigma.clone(), sigma, unmeasured, layout }
    }

    /// Names of the states whose estimates the prior of the model cannot explain.
    pub fn beyond_prior(&self, model: &Model) -> Vec<&'static str> {
        let (before, start) = (Calibration::new(model), index::GYRO_BIAS);
        let states = self.layout.names().iter().zip(&self.start).enumerate();
        states
            .filter(|(k, (_, sigma))| {
                let of = |c: &Calibration| c.get(&self.layout, start + k);
                (of(&self.calibration) - of(&before)).abs() > BEYOND_PRIOR * **sigma
            })
            .map(|(_, (name, _))| name.name)
            .collect()
    }

    /// Biases, G and effects in the units of screens; attitude is left at zero.
    pub fn estimate(&self, model: &Model) -> Estimate {
        let names = self.layout.names();
        let vector = |from: usize| {
            let scaled = |of: &dyn Fn(usize) -> f64| {
                [0, 1, 2].map(|k| of(from + k) / names.get(from + k).map_or(1.0, |n| n.unit.si))
            };
            Estimate3 {
                value: scaled(&|k| self.calibration.get(&self.layout, index::GYRO_BIAS + k)),
                sigma: scaled(&|k| self.sigma[k]),
            }
        };
        Estimate {
            attitude_deg: Estimate3::default(),
            gyro_bias_deg_per_h: vector(0),
            accel_bias_mg: vector(3),
            g_sensitivity_deg_per_h_per_g: self.g_matrix(model),
            effects: self.others(),
        }
    }

    fn g_matrix(&self, model: &Model) -> EstimateMatrix {
        let mut out = EstimateMatrix::default();
        for (e, setting) in model.effects.iter().enumerate().filter(|(_, s)| s.effect.name() == G) {
            let unit = setting.effect.groups().first().map_or(1.0, |g| g.unit.si);
            let values = self.calibration.parameters().get(e).map_or(&[][..], Vec::as_slice);
            for (cell, value) in out.value.as_flattened_mut().iter_mut().zip(values) {
                *cell = value / unit;
            }
            for slot in self.layout.slots().iter().filter(|s| s.effect == e) {
                out.sigma.as_flattened_mut()[slot.parameter] =
                    self.sigma[slot.state - index::GYRO_BIAS] / unit;
            }
        }
        out
    }

    fn others(&self) -> Vec<ParameterEstimate> {
        let names = self.layout.names().iter().zip(&self.sigma).enumerate();
        names
            .skip(index::EFFECTS - index::GYRO_BIAS)
            .filter(|(_, (n, _))| n.effect != G)
            .map(|(k, (n, sigma))| ParameterEstimate {
                effect: n.effect.to_owned(),
                name: n.name.to_owned(),
                unit: n.unit.symbol.to_owned(),
                value: self.calibration.get(&self.layout, index::GYRO_BIAS + k) / n.unit.si,
                sigma: sigma / n.unit.si,
            })
            .collect()
    }
}

/// Roll, pitch, yaw of a filter, with the sigmas (rad) of all that the estimator holds for possible.
pub fn attitude(filter: &Filter, sigma: &Vector3<f64>) -> Estimate3 {
    let value = filter.nav().euler().map(f64::to_degrees);
    Estimate3 { value: value.into(), sigma: sigma.map(|s| s.to_degrees().min(UNKNOWN_ANGLE_DEG)).into() }
}

/// Attitude while no filter runs: levelled by gravity if there are samples.
pub fn levelled(mean: Option<&ImuSample>) -> Estimate3 {
    let Some(f) = mean.map(|m| m.accel) else {
        return Estimate3 { value: [0.0; 3], sigma: [UNKNOWN_ANGLE_DEG; 3] };
    };
    let (roll, pitch) = (atan2(-f.y, -f.z), atan2(f.x, hypot(f.y, f.z)));
    Estimate3 {
        value: [roll.to_degrees(), pitch.to_degrees(), 0.0],
        sigma: [LEVELLED_DEG, LEVELLED_DEG, UNKNOWN_ANGLE_DEG],
    }
}

/// Where the vehicle is and what it feels.
pub fn motion(filter: &Filter) -> Motion {
    let place = filter.nav().geodetic();
    let now = filter.motion();
    Motion {
        lat_deg: place.lat_rad.to_degrees(),
        lon_deg: place.lon_rad.to_degrees(),
        height_m: place.height_m,
        velocity_ned_m_per_s: filter.nav().v_n().into(),
        specific_force_g: (now.force / STANDARD_GRAVITY).into(),
        rate_deg_per_s: now.rate.map(f64::to_degrees).into(),
        position_sigma_m: filter.ned_sigmas()[0].into(),
    }
}
