//! What a filter did, step by step, for whoever wants to go back over it: transitions, updates, and the state and
//! covariance in between. Recording changes nothing in the filter.

use super::Filter;
use super::calibration::Calibration;
use super::covariance::{Covariance, NAV};
use super::nav_map::dense_rows;
use crate::mechanization::NavState;
use nalgebra::{Matrix3, Vector3};

/// One group of rows that was applied.
#[derive(Debug, Clone)]
pub struct Update {
    /// Sparse rows of H.
    pub h: Vec<Vec<(usize, f64)>>,
    /// Innovations.
    pub residual: Vec<f64>,
    /// P Hᵀ before the update, a column per row.
    pub ph: Vec<Vec<f64>>,
    /// Innovation covariance; the identity where there is no row.
    pub s: Matrix3<f64>,
    /// Its inverse.
    pub inverse: Matrix3<f64>,
    /// Change of coordinates of the navigation errors after the update.
    pub turn: Option<Box<[[f64; NAV]; NAV]>>,
}

/// The filter at one time, and how it got there from the node before: a transition, then updates.
#[derive(Debug, Clone)]
pub struct Node {
    /// Time, s.
    pub t_s: f64,
    /// Length of the transition, s.
    pub dt_s: f64,
    /// Its first nine rows, 9 × n; the rest is the identity, but for `decay` of the Gauss-Markov states.
    pub phi: Vec<f64>,
    /// What is left of the Gauss-Markov error.
    pub decay: f64,
    /// The updates at this time, in their order.
    pub updates: Vec<Update>,
    /// Position, velocity, attitude after them.
    pub nav: NavState,
    /// Biases and parameters after them.
    pub calibration: Calibration,
    /// Gauss-Markov position error of the fixes after them, north-east-down, m.
    pub wander: Vector3<f64>,
    /// Lower triangle of the covariance after them, row by row.
    pub p: Vec<f64>,
    /// Density of the noise of gyros, (rad/s)²/Hz, and accelerometers, (m/s²)²/Hz.
    pub noise: (f64, f64),
}

/// The recording.
#[derive(Debug, Clone, Default)]
pub struct Tape {
    spacing_s: f64,
    n: usize,
    phi: Vec<f64>,
    decay: f64,
    dt_s: f64,
    updates: Vec<Update>,
    nodes: Vec<Node>,
    scratch: Vec<f64>,
}

impl Tape {
    /// A node at every fix, and this long after the last one without, s.
    pub(super) fn new(spacing_s: f64, n: usize) -> Self {
        let mut tape = Self { spacing_s, n, ..Self::default() };
        tape.begin();
        tape
    }

    fn begin(&mut self) {
        self.phi.clear();
        self.phi.resize(NAV * self.n, 0.0);
        (0..NAV).for_each(|i| self.phi[i * self.n + i] = 1.0);
        (self.decay, self.dt_s) = (1.0, 0.0);
    }

    /// Φ ← Φ_step Φ.
    fn step(&mut self, step: &[f64], decay: f64, dt_s: f64) {
        let n = self.n;
        let mut next = std::mem::take(&mut self.scratch);
        next.clear();
        next.resize(NAV * n, 0.0);
        for (row, out) in step.chunks_exact(n).zip(next.chunks_exact_mut(n)) {
            for (c, old) in row.iter().zip(self.phi.chunks_exact(n)).filter(|(c, _)| **c != 0.0) {
                out.iter_mut().zip(old).for_each(|(o, x)| *o += c * x);
            }
            out[NAV..].iter_mut().zip(&row[NAV..]).for_each(|(o, c)| *o += c);
        }
        std::mem::swap(&mut self.phi, &mut next);
        self.scratch = next;
        self.decay *= decay;
        self.dt_s += dt_s;
    }

    pub(super) fn update(&mut self, update: Update) {
        self.updates.push(update);
    }

    pub(super) fn turn(&mut self, turn: &[[f64; NAV]; NAV]) {
        if let Some(last) = self.updates.last_mut() {
            last.turn = Some(Box::new(*turn));
        }
    }

    fn put(&mut self, filter: &Filter) {
        let imu = &filter.model.imu;
        let node = Node {
            t_s: filter.t_s,
            dt_s: self.dt_s,
            phi: std::mem::take(&mut self.phi),
            decay: self.decay,
            updates: std::mem::take(&mut self.updates),
            nav: filter.nav,
            calibration: filter.calibration.clone(),
            wander: filter.wander,
            p: lower(&filter.p),
            noise: (
                imu.gyro_noise.powi(2) + filter.extra_noise.0,
                imu.accel_noise.powi(2) + filter.extra_noise.1,
            ),
        };
        self.nodes.push(node);
        self.begin();
    }
}

fn lower(p: &Covariance) -> Vec<f64> {
    (0..p.len()).flat_map(|i| (0..=i).map(move |j| p.at(i, j))).collect()
}

impl Filter {
    /// Records from here on: a node at every fix, and this long after the last one without, s.
    pub fn record(&mut self, spacing_s: f64) {
        let mut tape = Box::new(Tape::new(spacing_s, self.layout.len()));
        tape.put(self);
        self.tape = Some(tape);
    }

    /// How many nodes are recorded since the last were taken.
    pub fn recorded(&self) -> usize {
        self.tape.as_ref().map_or(0, |t| t.nodes.len())
    }

    /// Takes the nodes of the recording so far; it goes on.
    pub fn take_nodes(&mut self) -> Vec<Node> {
        self.tape.as_mut().map(|t| std::mem::take(&mut t.nodes)).unwrap_or_default()
    }

    /// After a time step.
    pub(super) fn tape_step(&mut self, dt_s: f64, decay: f64) {
        let Some(mut tape) = self.tape.take() else { return };
        tape.step(&dense_rows(&self.phi, self.layout.len()), decay, dt_s);
        if tape.dt_s >= tape.spacing_s {
            tape.put(self);
        }
        self.tape = Some(tape);
    }

    /// After a fix.
    pub(super) fn tape_fix(&mut self) {
        let Some(mut tape) = self.tape.take() else { return };
        tape.put(self);
        self.tape = Some(tape);
    }
}
