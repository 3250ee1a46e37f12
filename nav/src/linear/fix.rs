//! What a fix measures, linearised at its time of validity: a pure function of the trajectory there, the sensors and the fix, for the live
//! filter and for the explanation of a whole flight.

use crate::earth;
use crate::effects::{Antenna, FixInstant, MAX_PARAMETERS, Older};
use crate::filter::calibration::Calibration;
use crate::filter::force_rate::ForceRates;
use crate::mechanization::{self, Motion, NavState};
use crate::model::{EffectSetting, Model};
use crate::sample::GnssFix;
use nalgebra::{Matrix3, Vector3};

/// The vehicle at the time of validity of a fix.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AtFix<'a> {
    pub(crate) nav: &'a NavState,
    pub(crate) motion: &'a Motion,
    /// The specific force as the last sample shows it, m/s².
    pub(crate) shown: Vector3<f64>,
    pub(crate) model: &'a Model,
    pub(crate) calibration: &'a Calibration,
    /// The samples around it, where they are known.
    pub(crate) rates: Option<&'a ForceRates>,
    pub(crate) t_s: f64,
    /// Since the start, s.
    pub(crate) elapsed_s: f64,
}

/// Position or velocity of a fix, north-east-down: residual, and its derivatives.
#[derive(Debug, Clone, Default)]
pub(crate) struct Measured {
    /// How many of north, east, down there are.
    pub(crate) rows: usize,
    /// What was measured less what the trajectory says, m or m/s.
    pub(crate) residual: Vector3<f64>,
    /// 1-sigma by the fix or, where it has none, the model, m or m/s.
    pub(crate) sigma: [f64; 3],
    /// By the error in body axes of what is measured: C_b^n.
    pub(crate) own: Matrix3<f64>,
    /// By the attitude error in body axes.
    pub(crate) attitude: Matrix3<f64>,
    /// By an error of the time stamp: the vehicle moves by this much per second.
    pub(crate) drift: Vector3<f64>,
}

impl AtFix<'_> {
    /// What the effects of a fix depend on.
    pub(crate) fn instant(&self) -> FixInstant {
        let Self { nav, motion, t_s, .. } = *self;
        let c_ne = earth::c_en_at(&nav.r_e).transpose();
        let effects = || self.model.effects.iter().map(|s| s.effect).zip(self.calibration.parameters());
        let (a_n, c_nb) = (c_ne * mechanization::acceleration(nav, &motion.force), c_ne * nav.c_eb());
        let antenna = Antenna::of(
            effects().map(|(e, p)| (e, p.as_slice())),
            self.rates.map_or_else(Default::default, |r| r.of_rate_at(t_s)),
        );
        let smooths = self.rates.filter(|_| !antenna.kernel.is_none());
        let smoothed = smooths.map_or_else(Vector3::zeros, |r| r.smoothed(t_s, antenna.kernel));
        let smoothed_a_n = a_n + c_nb * smoothed;
        let x = FixInstant {
            t_s,
            v_n: c_ne * nav.v_e,
            a_n,
            smoothed_a_n,
            skewed_n: self.rates.map_or_else(Vector3::zeros, |r| c_nb * r.skewed(t_s, antenna.kernel)),
            c_nb,
            rate_eb: motion.rate - nav.q_eb.inverse() * earth::rotation_rate(),
            force_rate: self.rates.map_or_else(Vector3::zeros, |r| r.at(t_s)),
            antenna,
            older: Older { acceleration: smoothed_a_n, ..Older::default() },
            elapsed_s: self.elapsed_s,
            conditions: self.calibration.conditions,
        };
        let lag_s = effects().map(|(e, p)| e.velocity_delay_s(p)).sum();
        let older = self.rates.map_or(x.older, |r| r.older(lag_s, &x, &self.shown, &motion.force));
        FixInstant { older, ..x }
    }

    /// Position and velocity, about the trajectory.
    pub(crate) fn measured(&self, fix: &GnssFix, x: &FixInstant) -> [Measured; 2] {
        let c_ne = earth::c_en_at(&self.nav.r_e).transpose();
        let gnss = &self.model.gnss;
        let group = |rows, residual, sigma, drift| Measured {
            rows,
            residual,
            sigma,
            own: x.c_nb,
            attitude: Matrix3::zeros(),
            drift,
        };
        let position = c_ne * (fix.position.to_ecef() - self.nav.r_e);
        let mut out = [
            group(3, position, fix.position_sigma_m.unwrap_or(gnss.position_sigma_m), x.v_n),
            group(
                fix.velocity.rows(),
                Vector3::from(fix.velocity.components()) - x.v_n,
                fix.velocity_sigma_m_per_s.unwrap_or(gnss.velocity_sigma_m_per_s),
                x.smoothed_a_n,
            ),
        ];
        for (setting, p) in self.model.effects.iter().zip(self.calibration.parameters()) {
            let (added, turned) = (setting.effect.fix(p, x), setting.effect.fix_by_attitude(p, x));
            for (kind, out) in out.iter_mut().enumerate() {
                out.residual -= added[kind];
                if let Some(turned) = turned {
                    out.attitude += turned[kind];
                }
            }
        }
        out
    }
}

/// Derivatives of position and velocity of a fix by the parameters of an effect with these values.
pub(crate) fn columns(
    setting: &EffectSetting,
    p: &[f64],
    x: &FixInstant,
) -> [[Vector3<f64>; MAX_PARAMETERS]; 2] {
    let n = p.len();
    let mut columns = [[Vector3::zeros(); MAX_PARAMETERS]; 2];
    let [position, velocity] = &mut columns;
    setting.effect.fix_jacobian(p, x, &mut position[..n], &mut velocity[..n]);
    columns
}
