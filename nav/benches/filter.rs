//! What one step of the filter costs: `cargo bench -p gaware-nav`.
//!
//! The vehicle flies a turn, so that every block of the transition matrix is at work. A prediction takes a sample from
//! raw values to the covariance: calibration, mechanisation and P ← Φ P Φᵀ + Q. An update is one fix with position and
//! three-dimensional velocity, from the fix to the corrected state.

#![allow(missing_docs, reason = "a bench has no users")]

use criterion::{Criterion, criterion_group, criterion_main};
use gaware_nav::earth::{self, Geodetic};
use gaware_nav::filter::{Filter, Initial};
use gaware_nav::math::sin;
use gaware_nav::mechanization::NavState;
use gaware_nav::model::{GElements, Model};
use gaware_nav::rotation::c_nb_from_euler;
use gaware_nav::sample::{FixVelocity, GnssFix, ImuSample};
use nalgebra::Vector3;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// 200 Hz.
const DT_S: f64 = 0.005;
/// Samples before the filter starts over: a run without fixes must not leave the Earth.
const RUN: u32 = 2000;

fn models() -> [(&'static str, Model); 5] {
    [
        ("15 states", Model::default()),
        ("18 states", Model::default().with_g(GElements::Diagonal, None)),
        ("24 states", Model::default().with_g(GElements::Full, None)),
        ("28 states, latency and wander", Model::calibrated()),
        ("46 states, standard: with tolerances", Model::standard()),
    ]
}

/// A turn to the right at 45° of bank with some motion about it.
fn sample(step: u32) -> ImuSample {
    let t_s = f64::from(step) * DT_S;
    let wave = |rate: f64, phase: f64| sin(rate * t_s + phase);
    ImuSample {
        t_s,
        gyro: Vector3::new(0.1 * wave(3.0, 0.0), 0.2 + 0.05 * wave(2.0, 1.0), 0.2 + 0.02 * wave(5.0, 2.0)),
        accel: Vector3::new(wave(1.0, 0.5), 0.3 * wave(1.5, 0.1), -13.9 + 2.0 * wave(0.7, 0.0)),
        temperature_degc: None,
    }
}

fn start(model: &Model) -> Filter {
    let nav = NavState::from_ned(
        Geodetic::from_degrees(47.0, 8.0, 500.0),
        &Vector3::new(25.0, 5.0, -1.0),
        &c_nb_from_euler(0.78, 0.05, 0.2),
    );
    let initial = Initial {
        t_s: 0.0,
        nav,
        position_sigma_m: [1.0; 3],
        velocity_sigma_m_per_s: [0.1; 3],
        attitude_sigma_rad: [0.02; 3],
    };
    let mut filter = Filter::new(model, &initial);
    (0..RUN / 4).for_each(|k| filter.propagate(&sample(k)));
    filter
}

/// A fix a little off, as fixes are.
fn fix(filter: &Filter) -> GnssFix {
    let nav = filter.nav();
    let off = Vector3::new(1.0, -0.5, 0.7);
    GnssFix {
        t_s: filter.t_s(),
        position: Geodetic::from_ecef(&(nav.r_e + off)),
        velocity: FixVelocity::Full((nav.v_n() + off * 0.1).into()),
        position_sigma_m: None,
        velocity_sigma_m_per_s: None,
        yaw_rad: None,
    }
}

fn prediction(c: &mut Criterion) {
    let mut group = c.benchmark_group("prediction");
    let samples: Vec<ImuSample> = (0..RUN).map(sample).collect();
    for (name, model) in models() {
        let fresh = start(&model);
        let mut filter = fresh.clone();
        let mut next = samples.iter().skip(RUN as usize / 4);
        group.bench_function(name, |b| {
            b.iter(|| {
                let sample = next.next().unwrap_or_else(|| {
                    filter.clone_from(&fresh);
                    next = samples.iter().skip(RUN as usize / 4 + 1);
                    &samples[RUN as usize / 4]
                });
                filter.propagate(black_box(sample));
            });
        });
    }
    group.finish();
}

/// Only the updates are timed (with the two looks at the clock around each); between them the filter flies on for 0.1 s, as
/// it does between fixes.
fn update(c: &mut Criterion) {
    let mut group = c.benchmark_group("position and velocity update");
    let samples: Vec<ImuSample> = (0..RUN).map(sample).collect();
    for (name, model) in models() {
        let fresh = start(&model);
        group.bench_function(name, |b| {
            b.iter_custom(|times| {
                let mut filter = fresh.clone();
                let mut next = RUN as usize / 4;
                let mut sum = Duration::ZERO;
                for _ in 0..times {
                    if next + 20 > samples.len() {
                        filter.clone_from(&fresh);
                        next = RUN as usize / 4;
                    }
                    samples[next..next + 20].iter().for_each(|s| filter.propagate(s));
                    next += 20;
                    let fix = fix(&filter);
                    let start = Instant::now();
                    black_box(filter.update(black_box(&fix)));
                    sum += start.elapsed();
                }
                sum
            });
        });
    }
    group.finish();
}

fn mechanization(c: &mut Criterion) {
    let filter = start(&Model::default());
    let motion = *filter.motion();
    let inc = gaware_nav::mechanization::Increment::between(&motion, &motion, filter.kind(), DT_S);
    c.bench_function("mechanisation", |b| {
        b.iter(|| gaware_nav::mechanization::step(black_box(filter.nav()), black_box(&inc)));
    });
    c.bench_function("gravity", |b| b.iter(|| earth::gravity(black_box(&filter.nav().r_e))));
}

criterion_group!(benches, prediction, update, mechanization);
criterion_main!(benches);
