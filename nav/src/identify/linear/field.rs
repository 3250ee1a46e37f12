//! A compass along a linearised flight: three more rows at the time of validity of each fix. They measure the attitude, and depend on effects
//! of the compass alone; nothing drives the motion by them, so that one linearised flight serves every compass and every effect.

use super::Problem;
use super::forward::{Keep, Runner};
use super::kalman::vectorised;
use super::rows::{Kind, Measured, Row};
use crate::identify::noise::Noise;
use crate::identify::pass::{Information, Options};
use nalgebra::{Matrix3, Vector3};
use pulp::{Simd, WithSimd};

/// What a compass measured at a fix.
#[derive(Debug, Clone)]
pub(in crate::identify) struct FieldAtFix {
    /// What was measured less what the trajectory says, T.
    pub(in crate::identify) residual: Vector3<f64>,
    /// By the attitude error in body axes.
    pub(in crate::identify) attitude: Matrix3<f64>,
    /// By each watched effect of the compass.
    pub(in crate::identify) columns: Vec<Vector3<f64>>,
}

impl FieldAtFix {
    /// Three rows; the first `before` watched parameters are no compass's.
    fn measured(&self, before: usize, sigma: f64) -> Measured {
        let row = |axis: usize| Row {
            kind: Kind::Field,
            axis,
            residual: self.residual[axis],
            sigma,
            least: 0.0,
            own: [0.0; 3],
            attitude: std::array::from_fn(|k| self.attitude[(axis, k)]),
            by_accel: [0.0; 3],
            drift: 0.0,
        };
        let direct = (0..3).flat_map(|axis| {
            std::iter::repeat_n(0.0, before).chain(self.columns.iter().map(move |c| c[axis]))
        });
        Measured { rows: (0..3).map(row).collect(), direct: direct.collect() }
    }
}

/// What a run with a compass says.
#[derive(Debug, Clone)]
pub(in crate::identify) struct FieldRun {
    /// Score and information of all watched parameters, block by block.
    pub(in crate::identify) blocks: Vec<Information>,
    /// Mean NIS of the compass per degree of freedom.
    pub(in crate::identify) nis_per_dof: f64,
}

impl Problem {
    /// Runs the filter with the compass of these fixes, or without one where all are `None`. `own`: how many effects of the compass are watched
    /// beside the problem's; `sigma`: noise of the compass, T.
    pub(in crate::identify) fn run_with_field(
        &self,
        (noise, options): (&Noise, &Options),
        fields: &[Option<FieldAtFix>],
        (own, sigma): (usize, f64),
        block_s: f64,
    ) -> FieldRun {
        let keep = Keep::Blocks(block_s);
        let runner = Runner::new(self, (noise, options), self.walk, keep, self.columns + own);
        vectorised(WithField { problem: self, options, runner, fields, sigma })
    }
}

/// A run with a compass.
struct WithField<'a> {
    problem: &'a Problem,
    options: &'a Options,
    runner: Runner<'a>,
    fields: &'a [Option<FieldAtFix>],
    sigma: f64,
}

impl WithSimd for WithField<'_> {
    type Output = FieldRun;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> FieldRun {
        let Self { problem, options, mut runner, fields, sigma } = self;
        let mut nis = (0.0, 0);
        for (epoch, field) in problem.epochs().zip(fields) {
            let part = problem.part(epoch, options).map(|_| 0);
            runner.take(simd, epoch, part);
            if let Some(field) = field {
                runner.correct(simd, &field.measured(problem.columns, sigma), part);
                if part.is_some() {
                    nis.0 += runner.updates.iter().map(|u| (u.y * u.y / u.s).min(16.0)).sum::<f64>();
                    nis.1 += runner.updates.len();
                }
            }
            runner.end_block(epoch.elapsed_s);
        }
        let nis_per_dof = nis.0 / f64::from(u32::try_from(nis.1.max(1)).unwrap_or(u32::MAX));
        FieldRun { blocks: runner.end().0.blocks, nis_per_dof }
    }
}
