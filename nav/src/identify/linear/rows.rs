//! What a fix measures, linearised at its time of validity.

use super::track::Track;
use super::{STATES, index};
use crate::effects::{Antenna, FixInstant, MAX_PARAMETERS, Older};
use crate::filter::calibration::Calibration;
use crate::filter::watch::Watched;
use crate::mechanization::{self, NavState};
use crate::model::Model;
use crate::sample::{FixVelocity, GnssFix};
use nalgebra::{Matrix3, Vector3};

/// Which figure of the noise scales a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Horizontal,
    Height,
    Velocity,
}

/// One scalar measurement.
#[derive(Debug, Clone)]
pub(super) struct Row {
    pub(super) kind: Kind,
    /// What was measured less what the trajectory says.
    pub(super) residual: f64,
    /// Its derivative by the states.
    pub(super) h: [f64; STATES],
    /// 1-sigma before scaling.
    pub(super) sigma: f64,
    /// Its own derivative by each watched parameter of an effect; terms have none.
    pub(super) direct: Vec<f64>,
}

impl Row {
    /// Whether it belongs to the position.
    pub(super) fn is_position(&self) -> bool {
        self.kind != Kind::Velocity
    }
}

/// What effects add to a fix: position and velocity, and their derivatives by the attitude.
#[derive(Default)]
struct Added {
    sum: [Vector3<f64>; 2],
    by_attitude: [Matrix3<f64>; 2],
}

impl Added {
    fn new(model: &Model, calibration: &Calibration, x: &FixInstant) -> Self {
        let mut out = Self::default();
        for (setting, p) in model.effects.iter().zip(&calibration.parameters) {
            let sum = setting.effect.fix(p, x);
            let turned = setting.effect.fix_by_attitude(p, x).unwrap_or_default();
            for kind in 0..2 {
                out.sum[kind] += sum[kind];
                out.by_attitude[kind] += turned[kind];
            }
        }
        out
    }
}

/// Derivatives by the watched parameters: position, velocity.
fn direct(watched: &Watched, x: &FixInstant) -> [Vec<Vector3<f64>>; 2] {
    let mut out = [Vec::new(), Vec::new()];
    for setting in &watched.effects {
        let n = setting.effect.len();
        let mut columns = [[Vector3::zeros(); MAX_PARAMETERS]; 2];
        let [p, v] = &mut columns;
        setting.effect.fix_jacobian(&setting.values, x, &mut p[..n], &mut v[..n]);
        for k in setting.states() {
            out.iter_mut().zip(&columns).for_each(|(o, c)| o.push(c[k]));
        }
    }
    out
}

/// The rows of a fix about `nav`, with the sensors as they are there: the track must have come to its time of validity.
pub(super) fn of(fix: &GnssFix, nav: &NavState, track: &Track<'_>) -> Vec<Row> {
    let (here, model, watched) = (track.here(), track.model(), track.watched());
    let c_ne = nav.geodetic().c_en().transpose();
    let x = FixInstant {
        t_s: here.t_s,
        v_n: c_ne * nav.v_e,
        a_n: c_ne * mechanization::acceleration(nav, &here.motion.force),
        c_nb: c_ne * nav.c_eb(),
        rate_eb: here.motion.rate - nav.q_eb.inverse() * crate::earth::rotation_rate(),
        force_rate: track.force_rate(),
        antenna: Antenna::of(
            model
                .effects
                .iter()
                .map(|s| s.effect)
                .zip(track.calibration().parameters.iter().map(Vec::as_slice)),
            track.rate_derivatives(),
        ),
        older: Older::default(),
        elapsed_s: track.elapsed_s(),
    };
    let x = FixInstant { older: track.older(&x), ..x };
    let added = Added::new(model, track.calibration(), &x);
    let direct = direct(watched, &x);
    let (velocity, velocity_rows) = match fix.velocity {
        FixVelocity::None => (Vector3::zeros(), 0),
        FixVelocity::Horizontal([n, e]) => (Vector3::new(n, e, 0.0), 2),
        FixVelocity::Full(v) => (Vector3::from(v), 3),
    };
    let residuals =
        [c_ne * (fix.position.to_ecef() - nav.r_e) - added.sum[0], velocity - x.v_n - added.sum[1]];
    let sigmas = [
        fix.position_sigma_m.unwrap_or(model.gnss.position_sigma_m),
        fix.velocity_sigma_m_per_s.unwrap_or(model.gnss.velocity_sigma_m_per_s),
    ];
    // The vehicle moves while a stamp is wrong: by this much per second.
    let drift = [x.v_n, x.a_n];
    let row = |group: usize, i: usize| {
        let mut h = [0.0; STATES];
        for j in 0..3 {
            h[[index::POSITION, index::VELOCITY][group] + j] = x.c_nb[(i, j)];
            h[index::ATTITUDE + j] = added.by_attitude[group][(i, j)];
        }
        h[index::STAMP] = drift[group][i];
        h[index::CLOCK] = drift[group][i];
        if group == 0 {
            h[index::GAUSS_MARKOV + i] = 1.0;
        }
        Row {
            kind: match (group, i) {
                (0, 2) => Kind::Height,
                (0, _) => Kind::Horizontal,
                _ => Kind::Velocity,
            },
            residual: residuals[group][i],
            h,
            sigma: sigmas[group][i],
            direct: direct[group].iter().map(|c| c[i]).collect(),
        }
    };
    (0..3).map(|i| row(0, i)).chain((0..velocity_rows).map(|i| row(1, i))).collect()
}
