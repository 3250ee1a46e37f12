//! The recursion against one large least-squares problem, and recording against not recording.

use super::*;
use crate::earth::Geodetic;
use crate::filter::{Filter, Initial};
use crate::model::Model;
use crate::rotation::c_nb_from_euler;
use crate::sample::{FixVelocity, GnssFix, ImuSample};
use nalgebra::Vector3;
use nalgebra::{DMatrix, DVector};

/// A filter that is wrong by all its sigmas, over a few fixes with samples in between.
fn flown() -> (Filter, Layout) {
    let mut model = Model::default();
    model.gnss.position_correlation_s = 20.0;
    model.gnss.position_wander_sigma_m = [1.0, 1.0, 1.5];
    model.imu.gyro_noise = 0.01;
    model.imu.accel_noise = 0.3;
    let place = Geodetic::from_degrees(47.0, 8.0, 300.0);
    let initial = Initial {
        t_s: 0.0,
        nav: NavState::from_ned(place, &Vector3::new(12.0, 3.0, 0.5), &c_nb_from_euler(0.05, -0.04, 0.6)),
        position_sigma_m: [3.0, 2.0, 4.0],
        velocity_sigma_m_per_s: [0.7, 0.5, 0.6],
        attitude_sigma_rad: [0.05, 0.06, 0.1],
    };
    let mut filter = Filter::new(&model, &initial);
    filter.set_gating(false);
    filter.record(0.15);
    for k in 0..24 {
        let t_s = 0.1 * f64::from(k);
        let wave = (1.7 * t_s).sin();
        filter.propagate(&ImuSample {
            t_s,
            gyro: Vector3::new(0.3 * wave, 0.1, 0.2),
            accel: Vector3::new(1.5 * wave, -0.7, -11.0 + wave),
            temperature_degc: None,
        });
        if k % 6 == 5 {
            filter.update(&GnssFix {
                t_s,
                position: Geodetic::from_degrees(47.0 + 1e-6 * f64::from(k), 8.0, 301.0 + wave),
                velocity: FixVelocity::Full([11.0 + wave, 4.0, 0.1]),
                position_sigma_m: None,
                velocity_sigma_m_per_s: None,
                yaw_rad: None,
            });
        }
    }
    let layout = filter.layout().clone();
    (filter, layout)
}

fn dense(rows: &[f64], n: usize) -> DMatrix<f64> {
    DMatrix::from_row_slice(rows.len() / n, n, rows)
}

/// The rest of a transition below its first nine rows.
fn whole(top: &[f64], n: usize, gauss_markov: Option<usize>, decay: f64) -> DMatrix<f64> {
    let mut f = DMatrix::identity(n, n);
    f.view_mut((0, 0), (NAV, n)).copy_from(&dense(top, n));
    if let Some(w) = gauss_markov {
        (w..w + 3).for_each(|k| f[(k, k)] = decay);
    }
    f
}

/// The same problem at once: unknown are the error at the start and every disturbance; each innovation is one equation. Returns
/// the errors about the filter's states with their sigmas.
fn batch(nodes: &[Node], layout: &Layout) -> Vec<(DVector<f64>, DVector<f64>)> {
    let n = layout.len();
    let unknowns = n * nodes.len();
    let mut prior = DMatrix::zeros(unknowns, unknowns);
    // How the error at the present depends on all unknowns, and the filter's own mean of it.
    let mut path = DMatrix::zeros(n, unknowns);
    let mut mean = DVector::zeros(n);
    let mut p = dense(&full(&nodes[0].p, n), n);
    path.view_mut((0, 0), (n, n)).fill_with_identity();
    prior.view_mut((0, 0), (n, n)).copy_from(&p);
    let mut at_nodes = vec![(path.clone(), mean.clone())];
    let (mut rows, mut right, mut noise): (Vec<DMatrix<f64>>, Vec<f64>, Vec<DMatrix<f64>>) =
        Default::default();
    for (k, node) in nodes.iter().enumerate().skip(1) {
        let f = whole(&node.phi, n, layout.gauss_markov(), node.decay);
        let before = predicted(node, layout);
        let q = &before - &f * &p * f.transpose();
        prior.view_mut((k * n, k * n), (n, n)).copy_from(&q);
        path = &f * path;
        path.view_mut((0, k * n), (n, n)).fill_with_identity();
        mean = &f * mean;
        for update in &node.updates {
            let d = update.residual.len();
            let mut h = DMatrix::zeros(d, n);
            update.h.iter().enumerate().for_each(|(i, row)| row.iter().for_each(|(s, c)| h[(i, *s)] += c));
            let ph = DMatrix::from_fn(n, d, |i, j| update.ph[j][i]);
            let s = DMatrix::from_fn(d, d, |i, j| update.s[(i, j)]);
            let residual = DVector::from_column_slice(&update.residual);
            right.extend((&residual + &h * &mean).iter());
            rows.push(&h * &path);
            noise.push(&s - &h * &ph);
            mean += &ph * s.try_inverse().unwrap() * residual;
            if let Some(turn) = &update.turn {
                let mut m = DMatrix::identity(n, n);
                (0..NAV).for_each(|i| (0..NAV).for_each(|j| m[(i, j)] = turn[i][j]));
                mean = &m * mean;
                path = m * path;
            }
        }
        p = dense(&full(&node.p, n), n);
        at_nodes.push((path.clone(), mean.clone()));
    }
    let m = right.len();
    let (mut b, mut r) = (DMatrix::zeros(m, unknowns), DMatrix::zeros(m, m));
    let mut at = 0;
    for (block, noise) in rows.iter().zip(&noise) {
        b.view_mut((at, 0), (block.nrows(), unknowns)).copy_from(block);
        r.view_mut((at, at), (block.nrows(), block.nrows())).copy_from(noise);
        at += block.nrows();
    }
    let cross = &prior * b.transpose();
    let gain = &cross * (&b * &cross + r).try_inverse().unwrap();
    let theta = &gain * DVector::from_vec(right);
    let posterior = prior - gain * cross.transpose();
    at_nodes
        .into_iter()
        .map(|(path, mean)| {
            let sigma = (&path * &posterior * path.transpose()).diagonal().map(|v| v.max(0.0).sqrt());
            (path * &theta - mean, sigma)
        })
        .collect()
}

/// The covariance of a node before its updates.
fn predicted(node: &Node, layout: &Layout) -> DMatrix<f64> {
    let n = layout.len();
    let mut p = dense(&full(&node.p, n), n);
    for update in node.updates.iter().rev() {
        let d = update.residual.len();
        if let Some(turn) = &update.turn {
            let mut m = DMatrix::identity(n, n);
            (0..NAV).for_each(|i| (0..NAV).for_each(|j| m[(i, j)] = turn[i][j]));
            let back = m.try_inverse().unwrap();
            p = &back * p * back.transpose();
        }
        let ph = DMatrix::from_fn(n, d, |i, j| update.ph[j][i]);
        let inverse = DMatrix::from_fn(d, d, |i, j| update.inverse[(i, j)]);
        p += &ph * inverse * ph.transpose();
    }
    p
}

/// Every node on the way back, in order of time.
fn smoothed_back(nodes: &[Node], model: &Model, layout: &Layout) -> Vec<Smoothed> {
    let mut back = Back::new(model, layout);
    let mut out: Vec<Smoothed> = nodes.iter().rev().map(|node| back.over(node.clone())).collect();
    out.reverse();
    out
}

#[test]
fn the_recursion_solves_the_least_squares_problem_of_the_whole_flight() {
    let (mut filter, layout) = flown();
    let nodes = filter.take_nodes();
    let wanted = batch(&nodes, &layout);
    let smooth = smoothed_back(&nodes, filter.model(), &layout);
    assert_eq!(smooth.len(), wanted.len());
    let mut moved_most = 0.0f64;
    for ((node, got), (dx, sigma)) in nodes.iter().zip(&smooth).zip(&wanted) {
        let expected = node.nav.displaced(&Displacement::of(dx.as_slice()));
        // Positions are of millions of metres: a double leaves nanometres.
        assert!((got.nav.r_e - expected.r_e).norm() < 1e-5, "{}", got.t_s);
        assert!((got.nav.v_e - expected.v_e).norm() < 1e-6);
        assert!(got.nav.q_eb.angle_to(&expected.q_eb) < 1e-7);
        for (k, (a, b)) in got.sigma.iter().zip(sigma.iter()).enumerate() {
            assert!((a - b).abs() < 1e-5 * b + 1e-9, "state {k}: {a} {b}");
        }
        moved_most = moved_most.max((got.nav.v_e - node.nav.v_e).norm());
    }
    assert!(moved_most > 0.1, "the smoother had nothing to do: {moved_most}");
}

#[test]
fn recording_changes_nothing_and_the_last_node_is_the_filters() {
    let (mut filter, layout) = flown();
    let smooth = smoothed_back(&filter.take_nodes(), filter.model(), &layout);
    let last = smooth.last().unwrap();
    assert!((last.nav.r_e - filter.nav().r_e).norm() < 1e-9);
    assert!(smooth.windows(2).all(|w| (w[1].t_s - w[0].t_s - w[1].dt_s).abs() < 1e-9));
    // A fix at every sixth sample; nodes every 0.2 s in between.
    assert!(smooth.iter().filter(|s| s.position.len() == 3 && s.velocity.len() == 3).count() == 4);
    assert!(smooth.len() >= 12, "{}", smooth.len());
}
