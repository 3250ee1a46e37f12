//! The information bound along a known trajectory: what any unbiased filter could know at best.
//!
//! For a system whose noise does not depend on its state the posterior Cramér-Rao bound obeys the covariance recursion of
//! the Kalman filter linearised at the truth (Tichavský, Muravchik & Nehorai 1998, eq. 21). The same recursion predicts
//! what a planned maneuver will make known. No random numbers are involved.

use crate::filter::{Filter, Initial};
use crate::mechanization::{Motion, NavState};
use crate::model::Model;
use crate::sample::{FixVelocity, GnssFix, ImuSample, SampleKind};

/// The recursion at one instant.
#[derive(Debug, Clone)]
pub struct InformationBound {
    filter: Filter,
    /// Where the true trajectory is.
    at: Option<NavState>,
}

impl InformationBound {
    /// From the true start. The values of `model` must be the true ones, its sigmas the prior ones.
    pub fn new(model: &Model, start: &Initial) -> Self {
        Self::from_filter(&Filter::new(model, start))
    }

    /// Goes on from the present covariance of a filter, taking its estimate as the truth.
    pub fn from_filter(filter: &Filter) -> Self {
        let mut filter = filter.clone();
        filter.know_what_lies_between();
        Self { filter, at: None }
    }

    /// Says how samples come about and how much variance per hertz their rounding adds.
    pub fn set_stream(&mut self, kind: SampleKind, extra_noise: (f64, f64)) {
        self.filter.set_stream(kind, extra_noise);
    }

    /// Goes on to `t_s` with the true motion there.
    pub fn advance(&mut self, t_s: f64, motion: &Motion, temperature_degc: Option<f64>) {
        let ideal = ImuSample { t_s, gyro: motion.rate, accel: motion.force, temperature_degc };
        let shown = self.filter.calibration().measure(self.filter.model(), &ideal, motion);
        self.filter.take(&ImuSample { gyro: shown.rate, accel: shown.force, ..ideal });
    }

    /// Says where the true trajectory is, so that integration errors do not add up: the state is there from the next fix on.
    pub fn set_nav(&mut self, nav: NavState) {
        self.at = Some(nav);
    }

    /// A fix at the present time with this kind of velocity; sigmas from `like` or the model.
    pub fn fix(&mut self, velocity: FixVelocity, like: Option<&GnssFix>) {
        if let Some(nav) = self.at.take() {
            self.filter.set_nav(nav);
        }
        let fix = GnssFix {
            t_s: self.filter.t_s(),
            position: self.filter.nav().geodetic(),
            velocity,
            position_sigma_m: like.and_then(|f| f.position_sigma_m),
            velocity_sigma_m_per_s: like.and_then(|f| f.velocity_sigma_m_per_s),
            yaw_rad: None,
        };
        self.filter.update_covariance(&fix);
    }

    /// The recursion's state: its covariance is the bound.
    pub fn filter(&self) -> &Filter {
        &self.filter
    }
}
