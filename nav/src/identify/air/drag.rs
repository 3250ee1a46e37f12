//! Drag of a multirotor, and the wind that goes with it.
//!
//! Thrust is along body z, so that the specific force along body x and y is drag: a function of the velocity less the wind in body axes
//! ([`AirDriver`]). Beside it there is what does not go with the air: an offset of the accelerometers, and thrust that is not along z, so that a part
//! of it is on the other axes. Both are the same in body axes; the wind is the same in the axes of the Earth, so that two headings or two directions separate
//! them. Drag of rotors and of the body differ at two speeds. Gravity has no part in a specific force.

use super::super::aids::choose::{Chosen, Widths, is_held_out};
use super::super::aids::judged::{BLOCK_S, Judged};
use super::super::aids::series::{self, BOUNDED, Figures, Known, Noise, RATE, Row, States};
use super::super::evidence;
use super::super::flight::Flight;
use super::sensor::{mean, range, rms};
use super::{Air, AirFound, Carriage, Measured, Settled, Wind, density};
use crate::earth::STANDARD_GRAVITY;
use crate::effects::{AirDriver, AirInstant, DRAG, DRAG_THRUST, Effect, SEA_LEVEL_DENSITY};
use crate::sample::SampleKind;
use nalgebra::{DVector, Vector2, Vector3};

/// What of each effect is never named, 1-sigma: .01 1/s and .002 m²/kg are .1 m/s² at 10 m/s; all that goes with the thrust.
const TOLERANCES: [f64; 3] = [0.01, 0.002, 0.1];
/// Offset of the accelerometers along x and y, 1-sigma, m/s² …
const OFFSET: f64 = 0.15;
/// … and thrust that is not along z, rad: frames and mounts of autopilots are straight to 1 or 2°.
const CANT: f64 = 0.03;
/// No coefficient is known better than this share of it: along the flights of ArduPilot's simulated copter in their true wind the law leaves .2 to 4.5 % (its rotors' drag
/// goes with the thrust).
const KNOWN_TO: f64 = 0.04;
/// Noise of the specific force, m/s²: white; and of the wind, m/s, as of an airspeed sensor: walk per √s, gusts with their correlation time, s.
const FIGURES: Figures = Figures {
    usual: [(0.1, 3.0), (0.05, 2.5), (0.5, 2.0), (8.0, 2.0)],
    limits: [(0.02, 3.0), (0.002, 1.0), (0.02, 5.0), (0.05, 30.0)],
    smooth: &[false],
};
/// A component of the wind at the start, 1-sigma, m/s.
const START: f64 = 8.0;
/// Drag of rotors where the passes begin, 1/s: without any, no force shows a wind.
const ROTORS: f64 = 0.15;
/// Passes about what was chosen.
const PASSES: usize = 2;
/// The specific force is its mean over at most so long before and after a fix, s: shorter than a vehicle takes to tilt. The means of two fixes have no sample in common.
const ABOUT_S: f64 = 0.1;
/// A vehicle that is not higher than this over its start and not faster may stand on the ground, m and m/s.
const FLIES: [f64; 2] = [3.0, 2.0];

/// The specific force at a fix.
#[derive(Debug, Clone, Copy)]
struct Felt {
    c: Carriage,
    force: Vector3<f64>,
    density: f64,
}

impl Felt {
    /// What drag depends on along an axis, in this wind.
    fn ideal(&self, axis: usize, wind: &Vector2<f64>) -> AirInstant {
        AirInstant {
            velocity: self.c.c_nb.inverse() * (self.c.v_n - Vector3::new(wind.x, wind.y, 0.0)),
            density: self.density,
            thrust: -self.force.z / STANDARD_GRAVITY,
            axis,
            ..AirInstant::default()
        }
    }
}

fn drivers() -> impl Iterator<Item = AirDriver> {
    DRAG.iter().filter_map(|e| e.on_air()).flat_map(|a| a.drivers).copied()
}

/// Specific force by drag with these values.
fn drag(values: &[f64], x: &AirInstant) -> f64 {
    drivers().zip(values).map(|(d, v)| v * d.value(x)).sum()
}

/// The drag of a flight with what its passes need.
pub(super) struct Drag {
    instants: Vec<Felt>,
    widths: Widths,
    /// The wind at each instant about which it is linearised.
    wind: Vec<Vector2<f64>>,
}

impl Judged for Drag {
    fn catalogue(&self) -> &'static [&'static dyn Effect] {
        DRAG
    }

    fn widths(&self) -> &Widths {
        &self.widths
    }

    fn widths_mut(&mut self) -> &mut Widths {
        &mut self.widths
    }

    fn noise_figures(&self) -> (&'static Figures, Known) {
        (&FIGURES, Known { given: (0.0, 1.0), start: START })
    }

    fn start(&self) -> Vec<f64> {
        let mut values = vec![0.0; self.widths.len()];
        values[0] = ROTORS;
        values
    }

    fn rows(&self, values: &[f64], with_columns: bool) -> Vec<Row> {
        let all = self.instants.iter().zip(&self.wind);
        all.flat_map(|(i, wind)| [0, 1].map(|axis| row(i, axis, wind, values, with_columns))).collect()
    }

    fn follow(&mut self, values: &[f64], noise: &Noise) {
        self.wind = self.winds(values, noise).0;
    }

    fn held_out_rms(&self, values: &[f64], noise: &Noise) -> f64 {
        let left = self.residuals(values, noise);
        let is_own = |i: &Felt| is_held_out((i.c.elapsed_s / BLOCK_S) as usize);
        rms(self.instants.iter().zip(left).filter(|(i, _)| is_own(i)).flat_map(|h| h.1))
    }
}

/// Specific force with these values, and with what does not go with the air.
fn expected(values: &[f64], i: &Felt, x: &AirInstant) -> f64 {
    let own = &values[drivers().count()..];
    drag(values, x) + own[x.axis] + own[2 + x.axis] * i.force.z
}

/// What one axis says at one instant.
fn row(i: &Felt, axis: usize, wind: &Vector2<f64>, values: &[f64], with_columns: bool) -> Row {
    /// By which the wind differs for its slope, m/s.
    const BY: f64 = 1e-3;
    let x = i.ideal(axis, wind);
    let expected = expected(values, i, &x);
    // A wind that is stronger by one m/s to the north or east.
    let there = |n: f64, e: f64| i.ideal(axis, &(wind + Vector2::new(n, e)));
    let slope = |n: f64, e: f64| (self::expected(values, i, &there(n, e)) - expected) / BY;
    let by_wind = Vector2::new(slope(BY, 0.0), slope(0.0, BY));
    let mut by_state = States::zeros();
    for k in 0..2 {
        by_state[k] = by_wind[k];
        by_state[[BOUNDED, RATE][k]] = by_wind[k];
    }
    let mut columns = Vec::new();
    if with_columns {
        let on = |k: usize, v: f64| if k == axis { v } else { 0.0 };
        columns.extend(drivers().map(|d| d.value(&x)));
        columns.extend([on(0, 1.0), on(1, 1.0), on(0, i.force.z), on(1, i.force.z)]);
    }
    let residual = i.force[axis] - expected + by_wind.dot(wind);
    Row { elapsed_s: i.c.elapsed_s, residual, noise: 1.0, least: 0.0, by_state, columns }
}

/// Means of the specific force about each point of the trajectory, as the model reads the samples.
fn forces(flight: &Flight, settled: &Settled) -> Vec<Option<Vector3<f64>>> {
    let (model, mut calibration) = (&settled.model, settled.reference.calibration.clone());
    let needs_conditions = model.effects.iter().any(|s| s.effect.needs_conditions());
    let samples = flight.samples_of(model);
    // A mean is one of the middle of its interval.
    let early_s = if flight.stream().kind == SampleKind::Point {
        0.0
    } else {
        0.5 * range(samples.iter().map(|s| s.t_s)) / samples.len().max(2) as f64
    };
    let mut force = |s: &crate::sample::ImuSample| {
        if needs_conditions {
            calibration.conditions = flight.conditions(s.t_s);
        }
        (s.t_s - early_s, calibration.motion(model, s).force)
    };
    let all: Vec<(f64, Vector3<f64>)> = samples.iter().map(&mut force).collect();
    let knots = &settled.reference.knots;
    let half_s = (0.5 * range(knots.iter().map(|k| k.t_s)) / knots.len().max(2) as f64).min(ABOUT_S);
    let about = |t_s: f64| {
        let from = all.partition_point(|f| f.0 < t_s - half_s);
        let own = &all[from..all.partition_point(|f| f.0 < t_s + half_s)];
        (!own.is_empty()).then(|| own.iter().map(|f| f.1).sum::<Vector3<f64>>() / own.len() as f64)
    };
    knots.iter().map(|k| about(k.t_s)).collect()
}

impl Drag {
    pub(super) fn new(air: &Air<'_>, flight: &Flight, settled: &Settled) -> Self {
        let ground_m = air.carriage.first().map_or(0.0, |c| c.height_m);
        let flies = |c: &Carriage| c.height_m - ground_m > FLIES[0] || c.v_n.xy().norm() > FLIES[1];
        let felt = |(c, force): (&Carriage, Option<Vector3<f64>>)| {
            Some(Felt { c: *c, force: force.filter(|_| flies(c))?, density: density(c.height_m) })
        };
        let instants: Vec<Felt> = air.carriage.iter().zip(forces(flight, settled)).filter_map(felt).collect();
        let mut widths = Widths::new(DRAG, &TOLERANCES, |_| true);
        DRAG.iter().position(|e| e.name() == DRAG_THRUST.name).into_iter().for_each(|e| widths.close(e));
        Self {
            widths: [OFFSET, OFFSET, CANT, CANT].into_iter().fold(widths, Widths::always),
            wind: vec![Vector2::zeros(); instants.len()],
            instants,
        }
    }

    /// Nothing where the flight is too short.
    pub(super) fn judged(&mut self) -> Option<AirFound> {
        let (values, mut noise, blocks) = self.fitted()?;
        let mut chosen = self.chosen(&values, &noise, &blocks);
        // The wind and the sigmas are those of what is named alone.
        for _ in 0..PASSES {
            self.follow(&chosen.named, &noise);
            let rows = self.rows(&chosen.named, true);
            let named = self.named(&chosen);
            noise = self.noise(&rows, &named, &chosen.named, Some(&noise)).1;
            chosen = self.chosen(&chosen.named, &noise, &series::pass(&rows, &noise, BLOCK_S).blocks);
        }
        self.follow(&chosen.named, &noise);
        for setting in chosen.findings.iter_mut().map(|f| &mut f.setting) {
            let values = setting.sigmas.iter_mut().zip(&setting.values);
            values.for_each(|(sigma, value)| *sigma = sigma.hypot(KNOWN_TO * value));
        }
        Some(self.found(&chosen, noise))
    }

    fn named(&self, chosen: &Chosen) -> Vec<usize> {
        let is_named = |e: &&dyn Effect| chosen.findings.iter().any(|f| f.setting.effect.name() == e.name());
        (0..DRAG.len()).filter(|e| is_named(&DRAG[*e])).collect()
    }

    /// The wind at every instant, and the variance of its components.
    fn winds(&self, values: &[f64], noise: &Noise) -> (Vec<Vector2<f64>>, Vector2<f64>) {
        let smoothed = series::pass(&self.rows(values, false), noise, BLOCK_S).smoothed();
        let own = || smoothed.iter().step_by(2);
        let variance = own().map(|s| s.1.diagonal().xy()).sum::<Vector2<f64>>();
        (own().map(|s| s.0.xy()).collect(), variance / self.instants.len().max(1) as f64)
    }

    fn mean_wind(&self, values: &[f64], noise: &Noise) -> Vector2<f64> {
        self.winds(values, noise).0.iter().sum::<Vector2<f64>>() / self.instants.len().max(1) as f64
    }

    /// What is left along x and y at every instant, in the wind that goes with these values.
    fn residuals(&self, values: &[f64], noise: &Noise) -> Vec<[f64; 2]> {
        let wind = self.winds(values, noise).0;
        let left = |i: &Felt, wind: &Vector2<f64>, axis: usize| {
            i.force[axis] - expected(values, i, &i.ideal(axis, wind))
        };
        self.instants.iter().zip(&wind).map(|(i, w)| [0, 1].map(|axis| left(i, w, axis))).collect()
    }

    fn found(&self, chosen: &Chosen, noise: Noise) -> AirFound {
        let zero = vec![0.0; self.widths.len()];
        let [before, after] = [&zero, &chosen.named].map(|v| self.residuals(v, &noise));
        let ideal: Vec<[AirInstant; 2]> =
            self.instants.iter().zip(&self.wind).map(|(i, w)| [0, 1].map(|a| i.ideal(a, w))).collect();
        let all = || ideal.iter().flatten();
        let sizes = all().map(|x| (drag(&chosen.named, x), x.velocity.norm()));
        let squares = |of: &dyn Fn(&AirInstant) -> f64| {
            mean(all().map(|x| of(x) * x.velocity[x.axis].powi(2)))
                / mean(all().map(|x| x.velocity[x.axis].powi(2))).max(1e-9)
        };
        let speed = |x: &AirInstant| x.velocity[x.axis];
        let points = all().zip(before.iter().flatten().zip(after.iter().flatten()));
        let mut speeds: Vec<f64> = all().map(|x| speed(x).abs()).collect();
        speeds.sort_by(f64::total_cmp);
        let fast = speeds.get(speeds.len() * 9 / 10).copied().unwrap_or(0.0);
        AirFound {
            kind: Measured::Drag,
            sensor: 0,
            instants: self.instants.len(),
            largest: sizes.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).unwrap_or_default(),
            residual: [&before, &after].map(|of| rms(of.iter().flatten().copied())),
            held_out: [&zero, &chosen.fitted].map(|v| self.held_out_rms(v, &noise)),
            noise: [noise.sigma, noise.walk],
            known_to: chosen.first_sigma * fast,
            effects: chosen.findings.clone(),
            removed: chosen.removed.clone(),
            not_found: chosen.not_found.clone(),
            wind: (!chosen.findings.is_empty()).then(|| self.wind(chosen, &noise)),
            points: points
                .step_by((2 * self.instants.len()).div_ceil(600).max(1) | 1)
                .map(|(x, (b, a))| [speed(x).abs(), b * speed(x).signum(), a * speed(x).signum()])
                .collect(),
            density: squares(&|x| x.density / SEA_LEVEL_DENSITY),
        }
    }

    /// The wind, with what coefficients, offsets and tolerances leave open.
    fn wind(&self, chosen: &Chosen, noise: &Noise) -> Wind {
        let (winds, own) = self.winds(&chosen.named, noise);
        let mean = winds.iter().sum::<Vector2<f64>>() / winds.len().max(1) as f64;
        let by_values = self.variance_by_values(&mean, chosen, noise);
        let changed =
            winds.iter().map(|w| (w - mean).norm_squared()).sum::<f64>() / winds.len().max(1) as f64;
        Wind {
            mean: mean.into(),
            sigma: [0, 1].map(|k| (own[k].max(0.0) + by_values[k]).sqrt()),
            changed: (0.5 * changed).sqrt(),
            gusts: noise.bounded,
            track: self.instants.iter().map(|i| i.c.elapsed_s).zip(winds).collect(),
        }
    }

    /// Variance of the mean wind by that of all parameters together.
    fn variance_by_values(&self, mean: &Vector2<f64>, chosen: &Chosen, noise: &Noise) -> Vector2<f64> {
        let values = &chosen.named;
        let wide = self.widths.with(&self.named(chosen), None);
        let open: Vec<usize> = (0..wide.len()).filter(|k| wide[*k] > 0.0).collect();
        let sigma: Vec<f64> = open.iter().map(|k| wide[*k]).collect();
        let offset: Vec<f64> = open.iter().map(|k| -values[*k]).collect();
        let run = series::pass(&self.rows(values, true), noise, f64::INFINITY);
        let Some(mut information) = run.blocks.into_iter().next() else { return Vector2::zeros() };
        information.score /= chosen.correlated;
        information.matrix /= chosen.correlated;
        let Some(fit) = evidence::fit(&information, &open, &sigma, &offset) else { return Vector2::zeros() };
        let gradient: Vec<Vector2<f64>> = open
            .iter()
            .enumerate()
            .map(|(at, k)| {
                let by = fit.covariance[(at, at)].max(0.0).sqrt().max(1e-9);
                let mut shifted = values.clone();
                shifted[*k] += by;
                (self.mean_wind(&shifted, noise) - mean) / by
            })
            .collect();
        Vector2::from_fn(|axis, _| {
            let g = DVector::from_iterator(gradient.len(), gradient.iter().map(|g| g[axis]));
            g.dot(&(&fit.covariance * &g)).max(0.0)
        })
    }
}
