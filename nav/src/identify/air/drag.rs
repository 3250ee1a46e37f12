//! Drag of a multirotor, and the wind that goes with it.
//!
//! Thrust is along body z, so that the specific force along body x and y is drag: a function of the velocity less the wind in body axes
//! ([`AirDriver`]). Beside it there is what does not go with the air: an offset of the accelerometers, and thrust that is not along z, so that a part
//! of it is on the other axes. Both are the same in body axes; the wind is the same in the axes of the Earth, so that two headings or two directions separate
//! them. Drag of rotors and of the body differ at two speeds. Gravity has no part in a specific force.

use super::super::aids::choose::{Chosen, Widths};
use super::super::aids::judged::{BLOCK_S, Judged};
use super::super::aids::series::{self, BOUNDED, Figures, Known, Noise, RATE, Row, States};
use super::super::statistics::{high, mean, rms};
use super::{Air, AirFound, AirQuantity, Carriage, Wind, by_wind, density};
use crate::earth::STANDARD_GRAVITY;
use crate::effects::{
    AirDriver, AirInstant, DRAG_QUADRATIC, DRAG_ROTOR, DRAG_THRUST, Effect, SEA_LEVEL_DENSITY,
};
use crate::rss;
use nalgebra::{DVector, Vector2, Vector3};

/// What drag is made of; the last is a tolerance of the coefficients.
static CATALOGUE: [&dyn Effect; 3] = [&DRAG_ROTOR, &DRAG_QUADRATIC, &DRAG_THRUST];
/// What of each is never named, 1-sigma: .01 1/s and .002 m²/kg are .1 m/s² at 10 m/s. Of what goes with the thrust a coefficient of .25 1/s has .14 RMS where any share of it does: with .1
/// 49 of 63 values of a family of flights were within 2 sigma. A law with half of it (momentum theory has all, the firmwares' estimators nothing) made the coefficient of ten flights
/// of ArduPilot's simulated copter 3 to 15 % too high.
const TOLERANCES: [f64; 3] = [0.01, 0.002, 0.15];
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
        let velocity = self.c.c_nb.inverse() * (self.c.v_n - Vector3::new(wind.x, wind.y, 0.0));
        let thrust = -self.force.z / STANDARD_GRAVITY;
        AirInstant { velocity, density: self.density, thrust, axis, ..AirInstant::default() }
    }

    /// Specific force with these values, and with what does not go with the air.
    fn expected(&self, values: &[f64], x: &AirInstant) -> f64 {
        let own = &values[drivers().count()..];
        drag(values, x) + own[x.axis] + own[2 + x.axis] * self.force.z
    }

    /// What one axis says.
    fn row(&self, axis: usize, wind: &Vector2<f64>, values: &[f64], with_columns: bool) -> Row {
        let x = self.ideal(axis, wind);
        let by_wind = by_wind(&self.c.c_nb, &x, |x| self.expected(values, x));
        let mut by_state = States::zeros();
        for (k, gusts) in [BOUNDED, RATE].into_iter().enumerate() {
            (by_state[k], by_state[gusts]) = (by_wind[k], by_wind[k]);
        }
        let own =
            [1.0, self.force.z].into_iter().flat_map(|v| [0, 1].map(|k| if k == axis { v } else { 0.0 }));
        let columns = drivers().map(|d| d.value(&x)).chain(own);
        Row {
            elapsed_s: self.c.elapsed_s,
            residual: self.force[axis] - self.expected(values, &x) + by_wind.dot(wind),
            noise: 1.0,
            least: 0.0,
            by_state,
            columns: if with_columns { columns.collect() } else { Vec::new() },
        }
    }
}

fn drivers() -> impl Iterator<Item = AirDriver> {
    CATALOGUE.iter().filter_map(|e| e.on_air()).flat_map(|a| a.drivers).copied()
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
    fn widths(&self) -> &Widths {
        &self.widths
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
        all.flat_map(|(i, wind)| [0, 1].map(|axis| i.row(axis, wind, values, with_columns))).collect()
    }

    fn follow(&mut self, values: &[f64], noise: &Noise) {
        self.wind = self.winds(values, noise).0;
    }

    /// Along x and y at every instant, in the wind that goes with these values.
    fn left(&self, values: &[f64], by: &[f64], noise: &Noise) -> Vec<(f64, f64)> {
        let one = |(i, wind): (&Felt, &Vector2<f64>)| {
            [0, 1].map(|axis| (i.c.elapsed_s, i.force[axis] - i.expected(values, &i.ideal(axis, wind))))
        };
        self.instants.iter().zip(&self.winds(by, noise).0).flat_map(one).collect()
    }
}

impl Drag {
    pub(super) fn new(air: &Air<'_>) -> Self {
        let ground_m = air.carriage.first().map_or(0.0, |c| c.height_m);
        let flies = |c: &Carriage| c.height_m - ground_m > FLIES[0] || c.v_n.xy().norm() > FLIES[1];
        let felt = |c: &Carriage| {
            Some(Felt { c: *c, force: c.force.filter(|_| flies(c))?, density: density(c.height_m) })
        };
        let instants: Vec<Felt> = air.carriage.iter().filter_map(felt).collect();
        let mut widths = Widths::new(&CATALOGUE, &TOLERANCES, |_| true);
        widths.close(CATALOGUE.len() - 1);
        Self {
            widths: [OFFSET, OFFSET, CANT, CANT].into_iter().fold(widths, Widths::always),
            wind: vec![Vector2::zeros(); instants.len()],
            instants,
        }
    }

    /// Nothing where the flight is too short.
    pub(super) fn judged(mut self) -> Option<AirFound> {
        let (values, noise, blocks) = self.fitted()?;
        let first = self.chosen(&values, &noise, &blocks).named;
        // The wind and the sigmas are those of what is named alone.
        self.follow(&first, &noise);
        let blocks = series::pass(&self.rows(&first, true), &noise, BLOCK_S).blocks;
        let mut chosen = self.chosen(&first, &noise, &blocks);
        self.follow(&chosen.named, &noise);
        for setting in chosen.findings.iter_mut().map(|f| &mut f.setting) {
            let both = setting.sigmas.iter_mut().zip(&setting.values);
            both.for_each(|(sigma, value)| *sigma = rss(*sigma, KNOWN_TO * value));
        }
        Some(self.found(&chosen, &noise))
    }

    /// The wind at every instant, and the variance of its components.
    fn winds(&self, values: &[f64], noise: &Noise) -> (Vec<Vector2<f64>>, Vector2<f64>) {
        // One of the two rows of each instant.
        let rows = series::pass(&self.rows(values, false), noise, BLOCK_S).smoothed().into_iter().step_by(2);
        let (winds, variances): (Vec<_>, Vec<_>) = rows.map(|(x, p)| (x.xy(), p.diagonal().xy())).unzip();
        (winds, mean_of(&variances))
    }

    fn found(&self, chosen: &Chosen, noise: &Noise) -> AirFound {
        let zero = vec![0.0; self.widths.len()];
        let [before, after] = [&zero, &chosen.named].map(|v| self.left(v, &chosen.named, noise));
        let all: Vec<AirInstant> = self
            .instants
            .iter()
            .zip(&self.wind)
            .flat_map(|(i, w)| [0, 1].map(|axis| i.ideal(axis, w)))
            .collect();
        let sizes = all.iter().map(|x| (drag(&chosen.named, x), x.velocity.norm()));
        let speed = |x: &AirInstant| x.velocity[x.axis];
        let every = all.len().div_ceil(600).max(1) | 1;
        let point = |k: usize| {
            let along = speed(&all[k]);
            [along.abs(), before[k].1 * along.signum(), after[k].1 * along.signum()]
        };
        AirFound {
            kind: AirQuantity::Drag,
            sensor: 0,
            instants: self.instants.len(),
            largest: sizes.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).unwrap_or_default(),
            largest_sigma: 0.0,
            residual: [&before, &after].map(|of| rms(of.iter().map(|l| l.1))),
            held_out: [&zero, &chosen.fitted].map(|v| self.held_out_rms(v, &chosen.fitted, noise)),
            unexplained: self.held_out_rms(&chosen.fitted, &chosen.fitted, noise),
            noise: [noise.sigma, noise.walk],
            known_to: chosen.first_sigma * high(all.iter().map(|x| speed(x).abs())),
            effects: chosen.findings.clone(),
            shared: Vec::new(),
            removed: chosen.removed.clone(),
            not_found: chosen.not_found.clone(),
            wind: (!chosen.findings.is_empty()).then(|| self.wind(chosen, noise)),
            points: (0..all.len()).step_by(every).map(point).collect(),
            density: mean(self.instants.iter().map(|i| i.density)) / SEA_LEVEL_DENSITY,
        }
    }

    /// The wind, with what coefficients, offsets and tolerances leave open.
    fn wind(&self, chosen: &Chosen, noise: &Noise) -> Wind {
        let (winds, own) = self.winds(&chosen.named, noise);
        let mean = mean_of(&winds);
        let by_value = |k: usize| {
            let (by, mut shifted) = (chosen.covariance[(k, k)].sqrt().max(1e-9), chosen.named.clone());
            shifted[k] += by;
            (mean_of(&self.winds(&shifted, noise).0) - mean) / by
        };
        let slopes: Vec<Vector2<f64>> = (0..self.widths.len()).map(by_value).collect();
        let by_values = |axis: usize| {
            let slope = DVector::from_iterator(slopes.len(), slopes.iter().map(|s| s[axis]));
            slope.dot(&(&chosen.covariance * &slope)).max(0.0)
        };
        let squares: Vec<Vector2<f64>> = winds.iter().map(|w| (w - mean).map(|d| d * d)).collect();
        Wind {
            mean: mean.into(),
            sigma: [0, 1].map(|axis| (own[axis].max(0.0) + by_values(axis)).sqrt()),
            changed: (0.5 * mean_of(&squares).sum()).sqrt(),
            gusts: noise.bounded,
            track: self
                .instants
                .iter()
                .map(|i| i.c.elapsed_s)
                .zip(winds.into_iter().map(|w| (w, 0.0)))
                .collect(),
        }
    }
}

fn mean_of(all: &[Vector2<f64>]) -> Vector2<f64> {
    all.iter().sum::<Vector2<f64>>() / all.len().max(1) as f64
}
