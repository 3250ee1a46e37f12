//! The random-effects model of one parameter over the flights of a fleet.
//!
//! y_i = m_u + d_u (t_i − t̄_u) + Σ_k β_k [firmware_i ≥ k] + r_i + e_i, with e_i ~ N(0, s_i²) the error that the flight reports, and r_i ~ N(0, τ²) the
//! turn-on spread. For a given τ² this is weighted least squares; the units' own columns are projected out first (Frisch & Waugh 1933; Lovell
//! 1963), so that the cost grows with the flights only. τ² is that of restricted maximum likelihood (Patterson & Thompson 1971): Σ w_i² ρ_i² is as
//! large as expected, Σ w_i (1 − h_i), with weights w_i = 1/(s_i² + τ²), residuals ρ_i and leverages h_i; zero where it is less from the start. The
//! moment estimate of Paule & Mandel (1982) weights precise and vague flights alike and scatters more.

use nalgebra::{DMatrix, DVector};
use schemars::JsonSchema;
use serde::Serialize;

/// The estimate of one flight, free of its prior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Index of the unit.
    pub unit: usize,
    /// Index of the firmware, in the order in which they came.
    pub firmware: usize,
    /// Time, days.
    pub time_d: f64,
    /// Value.
    pub value: f64,
    /// 1-sigma of its error.
    pub sigma: f64,
}

/// Which columns a fit has beside the constants of the units.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Design {
    /// For each unit whether it drifts.
    pub slopes: Vec<bool>,
    /// For each firmware whether values shift with it; that of the first is never used.
    pub shifts: Vec<bool>,
}

/// A value with its 1-sigma.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, JsonSchema)]
pub struct Estimated {
    /// Value.
    pub value: f64,
    /// 1-sigma.
    pub sigma: f64,
}

/// One unit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UnitFit {
    /// Flights.
    pub flights: usize,
    /// Mean time of its flights as weighted, days.
    pub mean_time_d: f64,
    /// Constant part with the first firmware at the mean time.
    pub constant: Estimated,
    /// Drift per day, where the design has it.
    pub slope: Option<Estimated>,
    /// Weighted sum of squares of its residuals.
    pub squares: f64,
    /// Its degrees of freedom, without the part that shifts take.
    pub freedom: usize,
}

/// The whole fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// By index; `None` for a unit without flights.
    pub units: Vec<Option<UnitFit>>,
    /// Shift that came with each firmware; `None` where the design has none or the flights cannot separate it from the units.
    pub shifts: Vec<Option<Estimated>>,
    /// Turn-on spread τ.
    pub spread: Estimated,
    /// Degrees of freedom.
    pub freedom: usize,
}

impl Fit {
    /// What is expected of a flight: the constant part of its unit with drift and shifts up to its firmware.
    pub fn expected(&self, flight: &Observation) -> Option<f64> {
        let unit = self.units.get(flight.unit).copied().flatten()?;
        let drift = unit.slope.map_or(0.0, |s| s.value * (flight.time_d - unit.mean_time_d));
        let shifts: f64 = self.shifts.iter().take(flight.firmware + 1).flatten().map(|s| s.value).sum();
        Some(unit.constant.value + drift + shifts)
    }
}

/// Columns of shifts that keep less than this share of their square beside the units' own are confounded with them.
const CONFOUNDED: f64 = 1e-9;

/// Fits. `None` where there are no degrees of freedom.
pub fn fit(observations: &[Observation], units: usize, design: &Design) -> Option<Fit> {
    let at_zero = solve(observations, units, design, 0.0);
    if at_zero.freedom == 0 {
        return None;
    }
    let mut spread2 = 0.0;
    if at_zero.score > 0.0 {
        // Beyond the scatter of the values the score is negative.
        let mut high = observations.iter().map(|o| o.sigma * o.sigma).fold(f64::MIN_POSITIVE, f64::max);
        while solve(observations, units, design, high).score > 0.0 && high.is_finite() {
            high *= 4.0;
        }
        let mut low = 0.0;
        // To a relative error far below that of any estimate of a spread.
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if solve(observations, units, design, middle).score > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        spread2 = 0.5 * (low + high);
    }
    let solved = solve(observations, units, design, spread2);
    // From the information on τ².
    let sigma2 = (2.0 / solved.information).sqrt();
    let spread = spread2.sqrt();
    let sigma = if spread > 0.0 { sigma2 / (2.0 * spread) } else { sigma2.sqrt() };
    Some(Fit {
        units: solved.units,
        shifts: solved.shifts,
        spread: Estimated { value: spread, sigma },
        freedom: solved.freedom,
    })
}

struct Solved {
    units: Vec<Option<UnitFit>>,
    shifts: Vec<Option<Estimated>>,
    /// Derivative of the restricted likelihood by τ², times two.
    score: f64,
    /// tr(PP) up to products of leverages.
    information: f64,
    freedom: usize,
}

/// One unit with its own columns projected out.
struct Block {
    /// Weighted sums: of weights, and of weights times squared time about the mean (0 without a slope).
    weight: f64,
    spread: f64,
    mean_time_d: f64,
    /// Weighted mean and slope of the values, and of each column of shifts.
    value: [f64; 2],
    columns: Vec<[f64; 2]>,
    rows: Vec<Row>,
}

struct Row {
    weight: f64,
    /// Share of the row in the unit's own columns.
    leverage: f64,
    value: f64,
    columns: Vec<f64>,
}

fn block(own: &[&Observation], slope: bool, shifts: &[usize], spread2: f64) -> Block {
    let weights: Vec<f64> = own.iter().map(|o| 1.0 / (o.sigma * o.sigma + spread2)).collect();
    let weight: f64 = weights.iter().sum();
    let total = weight;
    let mean = |f: &dyn Fn(&Observation) -> f64| {
        own.iter().zip(&weights).map(|(o, w)| w * f(o)).sum::<f64>() / weight
    };
    let mean_time_d = mean(&|o| o.time_d);
    let about = |o: &Observation| o.time_d - mean_time_d;
    let spread = if slope { weight * mean(&|o| about(o) * about(o)) } else { 0.0 };
    let line = |f: &dyn Fn(&Observation) -> f64| {
        let along = if spread > 0.0 { weight * mean(&|o| f(o) * about(o)) / spread } else { 0.0 };
        [mean(f), along]
    };
    let column = |k: usize| move |o: &Observation| f64::from(u8::from(o.firmware >= k));
    let value = line(&|o| o.value);
    let columns: Vec<[f64; 2]> = shifts.iter().map(|k| line(&column(*k))).collect();
    let rows = own
        .iter()
        .zip(&weights)
        .map(|(o, weight)| Row {
            weight: *weight,
            leverage: weight / total + if spread > 0.0 { weight * about(o).powi(2) / spread } else { 0.0 },
            value: o.value - value[0] - value[1] * about(o),
            columns: shifts
                .iter()
                .zip(&columns)
                .map(|(k, line)| column(*k)(o) - line[0] - line[1] * about(o))
                .collect(),
        })
        .collect();
    Block { weight, spread, mean_time_d, value, columns, rows }
}

fn solve(observations: &[Observation], units: usize, design: &Design, spread2: f64) -> Solved {
    let firmwares = observations.iter().map(|o| o.firmware + 1).max().unwrap_or(0);
    let wanted: Vec<usize> =
        (1..firmwares).filter(|k| design.shifts.get(*k).copied().unwrap_or(false)).collect();
    let blocks: Vec<Option<Block>> = (0..units)
        .map(|u| {
            let own: Vec<&Observation> = observations.iter().filter(|o| o.unit == u).collect();
            let slope = design.slopes.get(u).copied().unwrap_or(false);
            (!own.is_empty()).then(|| block(&own, slope, &wanted, spread2))
        })
        .collect();
    let (shift, covariance, kept) = shifts(&blocks, wanted.len());
    let mut solved =
        Solved { units: Vec::new(), shifts: vec![None; firmwares], score: 0.0, information: 0.0, freedom: 0 };
    for (j, k) in wanted.iter().enumerate().filter(|(j, _)| kept.contains(j)) {
        solved.shifts[*k] = Some(Estimated { value: shift[j], sigma: covariance[(j, j)].max(0.0).sqrt() });
    }
    let mut own_columns = 0;
    for block in &blocks {
        let unit = block.as_ref().map(|b| unit_fit(b, &shift, &covariance));
        if let Some(block) = block {
            for row in &block.rows {
                let h = row.leverage + row.weight * quadratic(&row.columns, &covariance);
                let residual = row.value - dot(&row.columns, &shift);
                solved.score += (row.weight * residual).powi(2) - row.weight * (1.0 - h);
                solved.information += row.weight.powi(2) * (1.0 - h).max(0.0);
            }
            own_columns += 1 + usize::from(block.spread > 0.0);
        }
        solved.units.push(unit);
    }
    solved.freedom = observations.len().saturating_sub(own_columns + kept.len());
    solved
}

fn dot(x: &[f64], shift: &DVector<f64>) -> f64 {
    x.iter().zip(shift.iter()).map(|(x, b)| x * b).sum()
}

fn quadratic(x: &[f64], covariance: &DMatrix<f64>) -> f64 {
    let row = |i: usize| x.iter().enumerate().map(|(j, y)| covariance[(i, j)] * y).sum::<f64>();
    x.iter().enumerate().map(|(i, x)| x * row(i)).sum()
}

/// The shifts with their covariance; those that are confounded with the units are zero and left out.
fn shifts(blocks: &[Option<Block>], n: usize) -> (DVector<f64>, DMatrix<f64>, Vec<usize>) {
    let (mut normal, mut right) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
    let mut whole = vec![0.0; n];
    for block in blocks.iter().flatten() {
        for row in &block.rows {
            for (i, x) in row.columns.iter().enumerate() {
                right[i] += row.weight * x * row.value;
                whole[i] += row.weight;
                for (j, y) in row.columns.iter().enumerate() {
                    normal[(i, j)] += row.weight * x * y;
                }
            }
        }
    }
    let mut kept: Vec<usize> = (0..n).filter(|k| normal[(*k, *k)] > CONFOUNDED * whole[*k]).collect();
    loop {
        let part = normal.select_rows(&kept).select_columns(&kept);
        let (mut shift, mut covariance) = (DVector::zeros(n), DMatrix::zeros(n, n));
        if kept.is_empty() {
            return (shift, covariance, kept);
        }
        // Columns that are combinations of others go, the last first.
        let Some(inverse) =
            part.cholesky().map(|c| c.inverse()).filter(|i| i.iter().all(|v: &f64| v.is_finite()))
        else {
            kept.pop();
            continue;
        };
        let own = &inverse * right.select_rows(&kept);
        for (a, i) in kept.iter().enumerate() {
            shift[*i] = own[a];
            for (b, j) in kept.iter().enumerate() {
                covariance[(*i, *j)] = inverse[(a, b)];
            }
        }
        return (shift, covariance, kept);
    }
}

fn unit_fit(block: &Block, shift: &DVector<f64>, covariance: &DMatrix<f64>) -> UnitFit {
    let part = |which: usize, own: f64| {
        let column: Vec<f64> = block.columns.iter().map(|c| c[which]).collect();
        let variance = own + quadratic(&column, covariance);
        Estimated { value: block.value[which] - dot(&column, shift), sigma: variance.sqrt() }
    };
    let residual = |row: &Row| row.value - dot(&row.columns, shift);
    UnitFit {
        flights: block.rows.len(),
        mean_time_d: block.mean_time_d,
        constant: part(0, 1.0 / block.weight),
        slope: (block.spread > 0.0).then(|| part(1, 1.0 / block.spread)),
        squares: block.rows.iter().map(|row| row.weight * residual(row).powi(2)).sum(),
        freedom: block.rows.len().saturating_sub(1 + usize::from(block.spread > 0.0)),
    }
}

/// Mean and spread of values with errors of their own, with the sigma of the mean.
pub fn mean_and_spread(values: &[Estimated]) -> Option<(Estimated, f64)> {
    let observations: Vec<Observation> = values
        .iter()
        .map(|v| Observation { unit: 0, firmware: 0, time_d: 0.0, value: v.value, sigma: v.sigma })
        .collect();
    let fit = fit(&observations, 1, &Design::default())?;
    Some((fit.units.first().copied().flatten()?.constant, fit.spread.value))
}
