//! The compasses of a vehicle after a flight: how far each points off, by which effect, and how sure that is.
//!
//! The trajectory is that of inertial unit and fixes; a compass is three more rows of the same linear model at each fix
//! ([`linear::field`](super::linear)), so that what the flight leaves open about the attitude counts against what it says of a compass. Nothing
//! here changes the trajectory: a compass among motors never makes a heading worse.

mod heading;
mod orientation;

pub use super::aids::Finding as CompassFinding;
use super::aids::choose::{self, Chosen, Confirm, Widths};
use super::aids::{Settled, at_time};
use super::evidence::{self, Column};
use super::flight::Flight;
use super::linear::field::FieldAtFix;
use super::pass::{Information, Options};
use crate::effects::{COMPASS, FieldInstant};
use crate::operating::Channel;
use crate::rotation::skew;
pub use heading::{Heading, Level};
use nalgebra::{Matrix3, Vector3};
pub use orientation::Orientation;
use std::f64::consts::PI;

/// Samples of a compass this far from a fix are used for it: compasses are read at 10 Hz and more, s.
const NEAR_S: f64 = 0.15;
/// Fewer fixes with a compass than this say nothing of it.
pub const ENOUGH: usize = 60;
/// Length of the blocks that are taken for independent of each other, s.
pub(super) const BLOCK_S: f64 = 20.0;
/// Noise of a compass to start from, and the least that is assumed (half a step of `RAW_IMU` and the noise of common magnetometers), T.
const SIGMA_T: (f64, f64) = (1e-6, 2e-7);
/// What is left of each effect of [`COMPASS`] by an ordinary calibration, 1-sigma, SI: 15 mG, .2 mG/A, 1.5°, 2 %, .1 s, .5°. ArduPilot's
/// calibrator is content with a fitness of 16 mG RMS (`COMPASS_CAL_FIT`), PX4's with a mean residual of .01 G (`mag_calibration.cpp`).
pub(super) const TOLERANCES: [f64; 6] = [15e-7, 0.2e-7, 0.026, 0.02, 0.1, 0.0087];
/// Passes: effects multiply the attitude error, and the noise is fitted.
const PASSES: usize = 4;

/// What is known beside a flight.
#[derive(Debug, Clone, Copy)]
pub struct Given {
    /// The Earth's field at the place and date, north, east, down, T.
    pub field_n: Vector3<f64>,
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

impl Instant {
    fn is_held_out(&self) -> bool {
        choose::is_held_out((self.elapsed_s / BLOCK_S) as usize)
    }
}

/// The same instants with these errors undone.
fn corrected(of: &[Instant], values: &[f64]) -> Vec<Instant> {
    of.iter().map(|i| Instant { measured: undone(i, values), ..*i }).collect()
}

/// RMS residual per axis, T.
fn rms(of: &mut dyn Iterator<Item = &Instant>) -> f64 {
    let (sum, count) =
        of.fold((0.0, 0.0), |(s, n), i| (s + (i.measured - i.x.field).norm_squared() / 3.0, n + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}

/// A flight ready to judge its compasses.
#[derive(Debug)]
pub struct Compasses<'a> {
    flight: &'a Flight,
    settled: &'a Settled,
}

impl<'a> Compasses<'a> {
    /// The trajectory that they are judged by.
    pub fn new(flight: &'a Flight, settled: &'a Settled) -> Self {
        Self { flight, settled }
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
        let widths = Widths::new(COMPASS, &TOLERANCES, |effect| effect != "mag_current" || has_current);
        let (values, blocks, sigma) = self.fitted(&turned, &widths)?;
        let all: Vec<Instant> = turned.iter().flatten().copied().collect();
        let error =
            |values: &[f64], _: &[f64]| rms(&mut corrected(&all, values).iter().filter(|i| i.is_held_out()));
        let confirm = Confirm { held_out_error: &error, unfounded: &|_| None };
        let chosen = choose::choose(&blocks, &self.settled.prior, &widths, &values, &confirm);
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
            let c_nb = knot.nav.c_nb();
            let next = rates.partition_point(|s| s.t_s < knot.t_s);
            let rate = rates.get(next).map_or_else(Vector3::zeros, |s| s.gyro);
            let between = at_time(&own, knot.t_s, NEAR_S, |a, b, s| a.lerp(b, s));
            let measured = between.or_else(|| turned_to(&own, knot.t_s, &rate))?;
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
        let sigmas = self.settled.prior.iter().map(|p| p.0).chain([PI]);
        let columns = Column::open(sigmas.map(|sigma| (sigma, 0.0)));
        let fit = evidence::fit(&information, &columns)?;
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
        let turned: Vec<Instant> = turned.iter().flatten().copied().collect();
        let all = corrected(&turned, &chosen.named);
        let held = corrected(&turned, &chosen.fitted);
        let count = reported.len().max(1) as f64;
        let current = || reported.iter().map(|i| i.x.current_a);
        // In the wrong axes they are others.
        let is_known = orientation.as_ref().is_none_or(Orientation::is_known);
        let effects = if is_known { chosen.findings.clone() } else { Vec::new() };
        CompassFound {
            compass,
            instants: reported.len(),
            orientation,
            heading: Heading::of(&reported, &given.field_n, yaw_sigma),
            corrected: Heading::of(&all, &given.field_n, yaw_sigma),
            length_t: [reported.iter().map(|i| i.measured.norm()).sum::<f64>() / count, given.field_n.norm()],
            residual_t: [rms(&mut reported.iter()), rms(&mut all.iter())],
            held_out_t: [&reported, &held].map(|of| rms(&mut of.iter().filter(|i| i.is_held_out()))),
            noise: (sigma, chosen.correlated),
            effects,
            removed: chosen.removed.clone(),
            not_found: chosen.not_found.clone(),
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
        on.field_jacobian(p, &i.x, &mut own);
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

/// The nearest sample as it would be at this time, with the vehicle turning as it does then: for a compass that is logged less often than there are fixes
/// (PX4 logs twice a second).
fn turned_to(own: &[(f64, Vector3<f64>)], t_s: f64, rate: &Vector3<f64>) -> Option<Vector3<f64>> {
    let next = own.partition_point(|s| s.0 < t_s);
    let both = [next.checked_sub(1).and_then(|k| own.get(k)), own.get(next)];
    let off = |s: &&(f64, Vector3<f64>)| (s.0 - t_s).abs();
    let (at_s, field) = both.into_iter().flatten().min_by(|a, b| off(a).total_cmp(&off(b)))?;
    let dt = t_s - at_s;
    // What the vehicle itself carries does not turn: at half a radian per second a tenth of it is left, which is no more than its calibration leaves.
    (dt.abs() <= NEAR_S).then(|| crate::rotation::exp(&(rate * -dt)) * field)
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
