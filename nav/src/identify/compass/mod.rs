//! The compasses of a vehicle after a flight: how far each points off, by which effect, and how sure that is.
//!
//! The trajectory is that of inertial unit and fixes; a compass is three more rows of the same linear model at each fix
//! ([`linear::field`](super::linear)), so that what the flight leaves open about the attitude counts against what it says of a compass. Nothing
//! here changes the trajectory: a compass among motors never makes a heading worse.

mod choose;
mod heading;
mod orientation;
mod settled;

use super::Workers;
use super::flight::Flight;
use super::linear::field::FieldAtFix;
use super::noise::Noise;
use super::pass::{Information, Options};
use crate::effects::{COMPASS, FieldInstant};
use crate::model::{EffectSetting, Model};
use crate::operating::Channel;
use crate::rotation::skew;
use choose::{Chosen, Widths};
pub use heading::{Heading, Level};
use nalgebra::{Matrix3, Vector3};
pub use orientation::Orientation;
use settled::Settled;

/// Samples of a compass this far from a fix are used for it: compasses are read at 10 Hz and more, s.
const NEAR_S: f64 = 0.15;
/// Fewer fixes with a compass than this say nothing of it.
const ENOUGH: usize = 60;
/// Length of the blocks that are taken for independent of each other, s.
pub(super) const BLOCK_S: f64 = 20.0;
/// Noise of a compass to start from, and the least that is assumed (half a step of `RAW_IMU` and the noise of common magnetometers), T.
const SIGMA_T: (f64, f64) = (1e-6, 2e-7);
/// Passes: effects multiply the attitude error, and the noise is fitted.
const PASSES: usize = 4;

/// What is known beside a flight.
#[derive(Debug, Clone, Copy)]
pub struct Given {
    /// The Earth's field at the place and date, north, east, down, T.
    pub field_n: Vector3<f64>,
}

/// An effect of a compass that the flight shows.
#[derive(Debug, Clone)]
pub struct CompassFinding {
    /// With its values and their 1-sigma.
    pub setting: EffectSetting,
    /// Logarithm of the odds that it is there.
    pub evidence: f64,
    /// By how much it makes the held-out blocks more likely, nats.
    pub held_out_gain: f64,
    /// Others that would do as well: the flight does not separate them.
    pub others: Vec<&'static str>,
}

/// One compass.
#[derive(Debug, Clone)]
pub struct CompassFound {
    /// Which, from 0.
    pub compass: u8,
    /// Fixes at which it was compared.
    pub instants: usize,
    /// How it is turned where that is not as the autopilot has it.
    pub orientation: Option<Orientation>,
    /// Its heading less ours, as reported.
    pub heading: Heading,
    /// The same after what was found is corrected.
    pub corrected: Heading,
    /// Mean length of the field as reported, and by the world model, T.
    pub length_t: [f64; 2],
    /// RMS of its residual, as reported and corrected, T.
    pub residual_t: [f64; 2],
    /// The same on held-out blocks.
    pub held_out_t: [f64; 2],
    /// Noise that was fitted, T, and by how much its error is correlated: a factor on variances.
    pub noise: (f64, f64),
    /// Effects that the flight shows.
    pub effects: Vec<CompassFinding>,
    /// Effects that held-out data did not confirm.
    pub removed: Vec<&'static str>,
    /// Effects that were tested and are not significant, with the evidence for each.
    pub not_found: Vec<(&'static str, f64)>,
    /// Current: least, mean and largest, A; nothing where it is not known.
    pub current_a: Option<[f64; 3]>,
    /// The field in level axes as reported and as corrected, μT, for a plot.
    pub circle: Vec<Level>,
}

/// A compass at a fix.
#[derive(Debug, Clone, Copy)]
struct Instant {
    elapsed_s: f64,
    c_nb: Matrix3<f64>,
    measured: Vector3<f64>,
    x: FieldInstant,
}

/// A flight ready to judge its compasses.
#[derive(Debug)]
pub struct Compasses<'a> {
    flight: &'a Flight,
    settled: Settled,
}

impl<'a> Compasses<'a> {
    /// Settles the trajectory of a flight under a model. `noise`: where it was fitted already.
    pub fn new(flight: &'a Flight, model: &Model, noise: Option<Noise>, workers: &dyn Workers) -> Self {
        Self { flight, settled: Settled::new(flight, model, noise, workers) }
    }

    /// Every compass that measured during the flight.
    pub fn all(&self, given: &Given) -> Vec<CompassFound> {
        let mut numbers: Vec<u8> = self.flight.fields().iter().map(|f| f.compass).collect();
        numbers.sort_unstable();
        numbers.dedup();
        numbers.into_iter().filter_map(|compass| self.one(compass, given)).collect()
    }

    /// One compass; nothing where it has too few samples.
    pub fn one(&self, compass: u8, given: &Given) -> Option<CompassFound> {
        let instants = self.instants(compass, given);
        if instants.iter().flatten().count() < ENOUGH {
            return None;
        }
        let has_current = self.current_range().is_some();
        let yaw_sigma = self.yaw_sigma(&instants)?;
        let orientation = orientation::find(&instants, has_current, yaw_sigma);
        let mut turned = instants.clone();
        if let Some(found) = &orientation {
            turned.iter_mut().flatten().for_each(|i| i.measured = found.undo() * i.measured);
        }
        let widths = Widths::new(has_current);
        let (values, blocks, sigma) = self.fitted(&turned, &widths)?;
        let chosen = choose::choose(&blocks, &self.settled.prior, &widths, &values);
        Some(self.found(compass, given, (&instants, &turned), orientation, (sigma, yaw_sigma), &chosen))
    }

    /// Least and largest current, A, where it is reported.
    fn current_range(&self) -> Option<(f64, f64)> {
        self.flight.operating().range(Channel::Current)
    }

    /// The compass at every fix of the linearised flight.
    fn instants(&self, compass: u8, given: &Given) -> Vec<Option<Instant>> {
        let own: Vec<(f64, Vector3<f64>)> =
            self.flight.fields().iter().filter(|f| f.compass == compass).map(|f| (f.t_s, f.field)).collect();
        let down = Vector3::z();
        let start_s = self.flight.initial().t_s;
        let rates = self.flight.samples(crate::sample::Quantisation::None);
        let knots = self.settled.reference.knots.iter();
        let at = |knot: &super::linear::reference::Knot| {
            let measured = at_time(&own, knot.t_s)?;
            let c_nb = knot.nav.c_nb();
            let next = rates.partition_point(|s| s.t_s < knot.t_s);
            let rate = rates.get(next).map_or_else(Vector3::zeros, |s| s.gyro);
            let x = FieldInstant {
                field: c_nb.transpose() * given.field_n,
                by_declination: c_nb.transpose() * down.cross(&given.field_n),
                rate,
                current_a: self.flight.operating().at(knot.t_s).get(Channel::Current).unwrap_or(0.0),
            };
            Some(Instant { elapsed_s: knot.t_s - start_s, c_nb, measured, x })
        };
        knots.map(at).collect()
    }

    /// 1-sigma of the mean heading of the trajectory over these instants, rad: that of a compass without any error of its own.
    fn yaw_sigma(&self, instants: &[Option<Instant>]) -> Option<f64> {
        let rows = |i: &Instant| FieldAtFix {
            residual: Vector3::zeros(),
            attitude: skew(&i.x.field),
            columns: vec![i.x.by_declination],
        };
        let fields: Vec<_> = instants.iter().map(|i| i.as_ref().map(rows)).collect();
        let information = self.information(&fields, 1, SIGMA_T.0).0.into_iter().reduce(|mut sum, b| {
            sum.add(&b);
            sum
        })?;
        let before = self.settled.prior.len();
        let columns: Vec<usize> = self
            .settled
            .prior
            .iter()
            .enumerate()
            .filter(|(_, p)| p.0 > 0.0)
            .map(|(k, _)| k)
            .chain([before])
            .collect();
        let sigma: Vec<f64> = columns
            .iter()
            .map(|k| self.settled.prior.get(*k).map_or(std::f64::consts::PI, |p| p.0))
            .collect();
        let fit = super::evidence::fit(&information, &columns, &sigma, &vec![0.0; columns.len()])?;
        let last = columns.len() - 1;
        Some(fit.covariance[(last, last)].max(0.0).sqrt())
    }

    fn information(&self, fields: &[Option<FieldAtFix>], own: usize, sigma: f64) -> (Vec<Information>, f64) {
        let options = Options::default().all();
        let run = self.settled.problem.run_with_field(
            (&self.settled.noise, &options),
            fields,
            (own, sigma),
            BLOCK_S,
        );
        (run.blocks, run.nis_per_dof)
    }

    /// Values of all effects together within their widest priors, with the information about them there, and the noise.
    fn fitted(
        &self,
        instants: &[Option<Instant>],
        widths: &Widths,
    ) -> Option<(Vec<f64>, Vec<Information>, f64)> {
        let mut values = vec![0.0; widths.len()];
        let (mut sigma, mut blocks) = (SIGMA_T.0, Vec::new());
        for pass in 0..PASSES {
            let fields: Vec<_> = instants.iter().map(|i| i.as_ref().map(|i| row(i, &values))).collect();
            let (found, nis) = self.information(&fields, widths.len(), sigma);
            blocks = found;
            if pass + 1 == PASSES {
                break;
            }
            let step = choose::step(&blocks, &self.settled.prior, widths, &values)?;
            values.iter_mut().zip(&step).for_each(|(v, s)| *v += s);
            if pass > 0 {
                sigma = (sigma * nis.sqrt()).max(SIGMA_T.1);
            }
        }
        Some((values, blocks, sigma))
    }

    fn found(
        &self,
        compass: u8,
        given: &Given,
        (instants, turned): (&[Option<Instant>], &[Option<Instant>]),
        orientation: Option<Orientation>,
        (sigma, yaw_sigma): (f64, f64),
        chosen: &Chosen,
    ) -> CompassFound {
        let reported: Vec<Instant> = instants.iter().flatten().copied().collect();
        let corrected = |values: &[f64]| -> Vec<Instant> {
            let undo = |i: &Instant| Instant { measured: undone(i, values), ..*i };
            turned.iter().flatten().map(undo).collect()
        };
        let all = corrected(&chosen.named_values());
        let held = corrected(&chosen.fit_values());
        let is_held = |i: &&Instant| choose::is_held_out((i.elapsed_s / BLOCK_S) as usize);
        let rms = |of: &mut dyn Iterator<Item = &Instant>| {
            let (sum, count) =
                of.fold((0.0, 0.0), |(s, n), i| (s + (i.measured - i.x.field).norm_squared() / 3.0, n + 1.0));
            (sum / f64::max(count, 1.0)).sqrt()
        };
        let count = reported.len().max(1) as f64;
        let current = || reported.iter().map(|i| i.x.current_a);
        CompassFound {
            compass,
            instants: reported.len(),
            orientation,
            heading: Heading::of(&reported, &given.field_n, yaw_sigma),
            corrected: Heading::of(&all, &given.field_n, yaw_sigma),
            length_t: [reported.iter().map(|i| i.measured.norm()).sum::<f64>() / count, given.field_n.norm()],
            residual_t: [rms(&mut reported.iter()), rms(&mut all.iter())],
            held_out_t: [rms(&mut reported.iter().filter(is_held)), rms(&mut held.iter().filter(is_held))],
            noise: (sigma, chosen.correlated),
            effects: chosen.findings(),
            removed: chosen.removed(),
            not_found: chosen.not_found(),
            current_a: self.current_range().map(|_| {
                [
                    current().fold(f64::INFINITY, f64::min),
                    current().sum::<f64>() / count,
                    current().fold(f64::NEG_INFINITY, f64::max),
                ]
            }),
            circle: heading::circle(&reported, &all),
        }
    }
}

/// What a compass with these values measured at an instant, as rows of the linear model.
fn row(i: &Instant, values: &[f64]) -> FieldAtFix {
    let mut columns = Vec::with_capacity(values.len());
    let mut expected = i.x.field;
    let mut by_field = Matrix3::identity();
    let mut at = 0;
    for effect in COMPASS {
        let Some(on) = effect.on_field() else { continue };
        let p = &values[at..at + effect.len()];
        at += effect.len();
        expected += on.field(p, &i.x);
        let mut own = vec![Vector3::zeros(); effect.len()];
        on.field_jacobian(&i.x, &mut own);
        columns.extend(own);
        by_field += derivative_by_field(p, &i.x, on);
    }
    FieldAtFix { residual: i.measured - expected, attitude: by_field * skew(&i.x.field), columns }
}

/// ∂(what an effect adds)/∂(the Earth's field in body axes), in which it is linear.
fn derivative_by_field(p: &[f64], x: &FieldInstant, on: &dyn crate::effects::FieldEffect) -> Matrix3<f64> {
    let none = FieldInstant { rate: x.rate, ..FieldInstant::default() };
    let constant = on.field(p, &none);
    let column = |k: usize| {
        let mut field = Vector3::zeros();
        field[k] = 1.0;
        on.field(p, &FieldInstant { field, ..none }) - constant
    };
    Matrix3::from_columns(&[column(0), column(1), column(2)])
}

/// The field that a compass with these errors would have measured without them.
fn undone(i: &Instant, values: &[f64]) -> Vector3<f64> {
    let none = FieldInstant { current_a: i.x.current_a, rate: i.x.rate, ..FieldInstant::default() };
    let (mut constant, mut by_field, mut at) = (Vector3::zeros(), Matrix3::identity(), 0);
    for effect in COMPASS {
        let Some(on) = effect.on_field() else { continue };
        let p = &values[at..at + effect.len()];
        at += effect.len();
        constant += on.field(p, &none);
        by_field += derivative_by_field(p, &i.x, on);
    }
    let inverse = by_field.try_inverse().unwrap_or_else(Matrix3::identity);
    inverse * (i.measured - constant)
}

/// The field at a time, on the straight line between its neighbours. A mean over more of them would be shorter in a turn.
fn at_time(samples: &[(f64, Vector3<f64>)], t_s: f64) -> Option<Vector3<f64>> {
    let next = samples.partition_point(|s| s.0 < t_s);
    let (before, after) = (samples.get(next.checked_sub(1)?)?, samples.get(next)?);
    if t_s - before.0 > NEAR_S || after.0 - t_s > NEAR_S {
        return None;
    }
    Some(before.1.lerp(&after.1, (t_s - before.0) / (after.0 - before.0)))
}
