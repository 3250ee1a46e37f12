//! The linear model against the ordinary filter, and every slope against differences.

use super::reference::Reference;
use super::*;
use crate::earth::{self, Geodetic};
use crate::effects::{self, find};
use crate::filter::{Filter, FixOutcome, Fusion};
use crate::identify::Serial;
use crate::identify::noise::FIGURES;
use crate::identify::tests::{fly, noise};
use crate::math::{cos, exp, sin};
use crate::model::EffectSetting;
use crate::rotation::c_nb_from_euler;
use crate::sample::{AttitudeHint, FixVelocity, ImuStream, Sample};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};

fn flight() -> (Flight, Model) {
    let model = Model::default();
    (Flight::prepare(&fly(&model, 1), &model).unwrap(), model)
}

fn random_walks() -> Noise {
    Noise { gauss_markov_m: 0.3, stamp_s: 0.004, position_scale: 1.1, ..noise() }
}

/// The live filter with this noise over a flight; each outcome goes to `each`.
fn live(
    flight: &Flight,
    model: &Model,
    noise: &Noise,
    fusion: fn(Filter) -> Fusion,
    mut each: impl FnMut(&FixOutcome),
) -> Filter {
    let mut filter = Filter::new(&noise.of(model), flight.initial());
    filter.set_stream(flight.stream().kind, (0.0, 0.0));
    let mut fusion = fusion(filter);
    let mut fixes = flight.fixes().iter().peekable();
    for sample in flight.samples_of(model).iter() {
        while let Some(fix) = fixes.next_if(|f| f.t_s <= sample.t_s) {
            fusion.push_fix(*fix);
        }
        fusion.push_imu(*sample);
        std::iter::from_fn(|| fusion.poll()).for_each(|outcome| each(&outcome));
    }
    fusion.filter().clone()
}

/// Mean squared normalised innovation of the live filter with this noise over the fixes that count.
fn live_nis(flight: &Flight, model: &Model, noise: &Noise, options: &Options) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    live(flight, model, noise, Fusion::without_window, |outcome| {
        if options.part(outcome.stamp_s - flight.initial().t_s) == Some(0) {
            sum += outcome.position.nis + outcome.velocity.nis;
            count += outcome.position.dof + outcome.velocity.dof;
        }
    });
    sum / f64::from(u32::try_from(count).unwrap())
}

/// The live filter as it runs, fix by fix about a trajectory of its own, and the flight linearised as a whole about the smoothed one: the same values
/// and sigmas of the constants.
#[test]
fn both_uses_of_the_linear_model_agree_about_the_constants() {
    let (flight, plain) = flight();
    let noise = noise();
    for names in [&["gps_latency", "gps_lever_arm"][..], &["accel_scale_factor"], &["gyro_g_sensitivity"]] {
        let mut model = plain.clone();
        names.iter().for_each(|name| model.set(EffectSetting::unknown(find(name).unwrap())));
        let filter = live(&flight, &model, &noise, Fusion::new, |_| {});
        let prior = model.effects.clone();
        for (setting, values) in model.effects.iter_mut().zip(filter.calibration().parameters()) {
            setting.values.clone_from(values);
            setting.sigmas.fill(0.0);
        }
        let watched = Watched { effects: model.effects.clone() };
        let reference = Reference::find(&flight, &model, &noise, &Serial);
        let problem = Problem::new(&flight, &model, &reference, &watched, &Serial);
        let run = problem.run(&noise, &Options { settle_s: 0.0, ..Options::default() }.all());
        let mut information = run.information[0].clone();
        for (column, (e, p)) in watched.slots().into_iter().enumerate() {
            let weight = prior[e].sigmas[p].powi(-2);
            information.matrix[(column, column)] += weight;
            information.score[column] += weight * (prior[e].values[p] - model.effects[e].values[p]);
        }
        let covariance = information.matrix.clone().try_inverse().unwrap();
        let step = &covariance * &information.score;
        for (column, slot) in filter.layout().slots().iter().enumerate() {
            let (sigma, own) = (filter.covariance().sigma(slot.state), covariance[(column, column)].sqrt());
            assert!(step[column].abs() < 0.3 * sigma, "{names:?} {column}: {} of {sigma}", step[column]);
            assert!((own / sigma - 1.0).abs() < 0.3, "{names:?} {column}: {own} {sigma}");
        }
    }
}

#[test]
fn the_innovations_are_those_of_the_live_filter() {
    let (flight, model) = flight();
    let options = Options::default();
    for noise in [noise(), Noise { gyro: 3.0 * noise().gyro, gauss_markov_m: 0.3, ..noise() }] {
        let reference = Reference::find(&flight, &model, &noise, &Serial);
        let run =
            Problem::new(&flight, &model, &reference, &Watched::default(), &Serial).run(&noise, &options);
        let live = live_nis(&flight, &model, &noise, &options);
        assert!((run.nis_per_dof(0) - live).abs() < 0.01, "{run:?} {live}");
    }
}

#[test]
fn slopes_by_noise_are_those_of_the_likelihood() {
    let (flight, model) = flight();
    let options = Options::default();
    let noise = random_walks();
    let reference = Reference::find(&flight, &model, &noise, &Serial);
    let mut problem = Problem::new(&flight, &model, &reference, &Watched::default(), &Serial);
    problem.set_walk(BiasWalk { gyro: 1e-5, accel: 1e-4 });
    let slope = problem.slope(&noise, &options);
    let at = |noise: &Noise| problem.run(noise, &options).log_likelihood[0];
    assert_eq!(slope.log_likelihood, at(&noise));
    let h: f64 = 1e-4;
    for k in 0..FIGURES {
        let by = |h: f64| {
            let mut v = noise.get();
            v[k] *= exp(h);
            Noise::from_figures(&v)
        };
        let wanted = (at(&by(h)) - at(&by(-h))) / (2.0 * h);
        assert!((slope.by_figure[k] - wanted).abs() < 1e-3 * (1.0 + wanted.abs()), "{k}: {slope:?} {wanted}");
    }
    let walked = |gyro: f64, accel: f64| {
        let mut moved = problem.clone();
        moved.set_walk(BiasWalk { gyro: gyro.sqrt(), accel: accel.sqrt() });
        moved.run(&noise, &options).log_likelihood[0]
    };
    for (k, v) in [1e-10, 1e-8].into_iter().enumerate() {
        let h = 3e-2 * v;
        let other = if k == 0 { 1e-8 } else { 1e-10 };
        let at = |v: f64| if k == 0 { walked(v, other) } else { walked(other, v) };
        let wanted = (at(v + h) - at(v - h)) / (2.0 * h);
        assert!((slope.by_walk[k] - wanted).abs() < 5e-3 * (wanted.abs() + 1.0), "{k}: {slope:?} {wanted}");
    }
}

/// Every parameter of every continuous effect, with the flight linearised anew at the moved value.
#[test]
fn the_score_is_the_slope_of_the_likelihood() {
    let (flight, model) = flight();
    let options = Options::default().all();
    let linear: Vec<EffectSetting> = effects::REGISTRY
        .iter()
        .filter(|e| e.groups().iter().all(|g| g.is_state()) && !e.is_empty())
        .filter(|e| !e.name().ends_with("temperature"))
        .map(|e| EffectSetting { sigmas: vec![0.0; e.len()], ..EffectSetting::unknown(*e) })
        .collect();
    let watched = Watched { effects: linear.clone() };
    let noise = noise();
    let reference = Reference::find(&flight, &model, &noise, &Serial);
    let problem = Problem::new(&flight, &model, &reference, &watched, &Serial);
    let run = problem.run(&noise, &options);
    let information = &run.information[0];
    for (column, (e, p)) in watched.slots().into_iter().enumerate() {
        let sigma = information.matrix[(column, column)].sqrt().recip();
        let at = |by: f64| {
            let mut moved = model.clone();
            let mut s = linear[e].clone();
            s.values[p] += by;
            moved.set(s);
            let reference = reference.with(&flight, &moved);
            Problem::new(&flight, &moved, &reference, &Watched::default(), &Serial)
                .run(&noise, &options)
                .log_likelihood[0]
        };
        let h = 0.3 * sigma;
        let (up, down, here) = (at(h), at(-h), run.log_likelihood[0]);
        let slope = (up - down) / 0.6;
        let curvature = (2.0 * here - up - down) / 0.09;
        let score = information.score[column] * sigma;
        let name = linear[e].effect.name();
        assert!((slope - score).abs() < 0.1 + 0.05 * score.abs(), "{name} {p}: {slope} {score}");
        assert!((curvature - 1.0).abs() < 0.2, "{name} {p}: {curvature}");
        let mut step = vec![0.0; watched.slots().len()];
        step[column] = h;
        let mut moved = problem.clone();
        moved.move_by(&step);
        let moved = moved.run(&noise, &options).log_likelihood[0];
        assert!((moved - up).abs() < 0.02, "{name} {p}: moved {moved}, anew {up}");
    }
}

/// A jump as an effect with columns of its own and as a shock found on the way back say the same.
#[test]
fn shocks_are_jumps() {
    let (flight, model) = flight();
    let (options, noise) = (Options::default(), random_walks());
    let reference = Reference::find(&flight, &model, &noise, &Serial);
    let problem = Problem::new(&flight, &model, &reference, &Watched::default(), &Serial);
    let shocks = problem.shocks(&noise, &options);
    for (name, k) in [("gps_bias_step", 150), ("gyro_bias_step", 222)] {
        let t_s = shocks[k].t_s;
        let step = EffectSetting::known(find(name).unwrap(), &[t_s, 0.0, 0.0, 0.0]).unwrap();
        let watched = Watched { effects: vec![step] };
        let run = Problem::new(&flight, &model, &reference, &watched, &Serial).run(&noise, &options);
        let (score, matrix) = if name == "gps_bias_step" { shocks[k].fix } else { shocks[k].gyro };
        let information = &run.information[0];
        for i in 0..3 {
            let scale = information.matrix[(i, i)].sqrt();
            assert!((score[i] - information.score[i]).abs() < 0.03 * scale, "{name} {score} {information:?}");
            for j in 0..3 {
                let wanted = information.matrix[(i, j)];
                let size = scale * information.matrix[(j, j)].sqrt();
                assert!((matrix[(i, j)] - wanted).abs() < 0.03 * size, "{name} {matrix} {information:?}");
            }
        }
    }
}

/// What the vehicle did in a gap only the fixes show. A trajectory at other times keeps it, on both sides of the gap and within.
#[test]
fn a_trajectory_at_other_times_turns_in_gaps_as_before() {
    let model = Model::default();
    let mut samples = fly(&model, 1);
    let lost = |t_s: f64| [20.3, 33.1, 47.7, 61.0].iter().any(|from| (0.0..1.7).contains(&(t_s - from)));
    samples.retain(|s| !matches!(s, Sample::Imu(imu) if lost(imu.t_s)));
    let flight = Flight::prepare(&samples, &model).unwrap();
    let reference = Reference::find(&flight, &model, &noise(), &Serial);
    for by_s in [-0.11, -0.03, 0.004, 0.03, 0.11] {
        let mut late = model.clone();
        late.set(EffectSetting::known(&effects::GpsLatency, &[reference.delays_s[0] + by_s]).unwrap());
        let bend = reference.with(&flight, &late).with(&flight, &model).bend(&reference);
        assert!(bend < 0.02, "{by_s} s and back: {bend} rad");
    }
}

/// Vibration of half a g does not hide a clock that drifts: fixes are compared with the motion of their own time, and not with what the
/// acceleration of one instant makes of it.
#[test]
fn a_drifting_clock_is_seen_through_vibration() {
    const RATE: f64 = 1.5e-3;
    let model = Model::default();
    let mut samples = fly(&model, 5);
    for sample in &mut samples {
        match sample {
            Sample::Imu(imu) => imu.accel.z += 7.0 * sin(imu.t_s * 0.47 * std::f64::consts::TAU * 50.0),
            Sample::Fix(fix) => fix.t_s /= 1.0 - RATE,
            _ => {}
        }
    }
    let flight = Flight::prepare(&samples, &model).unwrap();
    let noise = Noise { accel: 5.0 * noise().accel, ..noise() };
    let likelihood = |rate: f64| {
        let mut model = model.clone();
        model.set(EffectSetting::known(&effects::ClockDrift, &[rate]).unwrap());
        let found = Reference::find(&flight, &model, &noise, &Serial);
        Problem::new(&flight, &model, &found, &Watched::default(), &Serial)
            .run(&noise, &Options::default())
            .log_likelihood[0]
    };
    let [half, whole, twice] = [0.5, 1.0, 2.0].map(|share| likelihood(share * RATE) - likelihood(0.0));
    assert!(whole > half && whole > twice + 30.0 && whole > 30.0, "{half} {whole} {twice}");
}

/// The linear model says the same about any trajectory near the vehicle's: that one 40 m beside it, whose attitude wobbles from fix to
/// fix as corrections make it, leads back to the same place and to the same likelihood.
#[test]
fn a_trajectory_aside_leads_back_to_the_same_one() {
    let (flight, model) = flight();
    let (options, noise) = (Options::default(), Noise { gyro: 5.0 * noise().gyro, ..noise() });
    let linear = |r: &Reference| Problem::new(&flight, &model, r, &Watched::default(), &Serial);
    let found = Reference::find(&flight, &model, &noise, &Serial);
    let straight = found.smoothed(&linear(&found), &noise);
    let mut aside = straight.clone();
    for (k, knot) in aside.knots.iter_mut().enumerate() {
        let [roll, pitch, yaw] = [1.1, 1.7, 2.3].map(|f| 3e-3 * sin(f * k as f64));
        let mut by = [0.0; STATES];
        by[index::ATTITUDE..index::ATTITUDE + 3].copy_from_slice(&[roll, pitch, yaw]);
        knot.nav = moved(&knot.nav, &by);
        knot.nav.r_e += knot.nav.geodetic().c_en() * Vector3::new(0.0, 0.0, 40.0);
    }
    let likelihood = |r: &Reference| linear(r).run(&noise, &options).log_likelihood[0];
    let (wanted, got) = (likelihood(&straight), likelihood(&aside));
    let back = aside.smoothed(&linear(&aside), &noise);
    let apart = |k: usize| (back.knots[k].nav.r_e - straight.knots[k].nav.r_e).norm();
    let farthest = (0..back.knots.len()).map(apart).fold(0.0, f64::max);
    assert!((got - wanted).abs() < 1.0, "{got} instead of {wanted}");
    assert!(farthest < 0.3 && back.bend(&straight) < 2e-3, "{farthest} m, {} rad", back.bend(&straight));
}

/// Very noisy accelerometers: their noise drives the columns of their own scale factors and moves the trajectory, and the scores go with
/// it in every flight. What noise can make of a score is known, and no effect gets odds by it.
#[test]
fn noise_of_the_samples_is_no_scale_factor() {
    let mut model = Model::default();
    (model.imu.gyro_noise, model.imu.accel_noise) = (0.006, 0.5);
    let noise = Noise { gyro: 0.006, accel: 0.5, ..noise() };
    let options = Options::default().all();
    let scale = EffectSetting::unknown(&effects::ACCEL_SCALE_FACTOR);
    let watched = Watched { effects: vec![scale] };
    let (mut raw, mut allowed) = (0.0, 0.0);
    for seed in 1..=6 {
        let flight = Flight::prepare(&fly(&model, seed), &model).unwrap();
        assert!(flight.is_noisy());
        let reference = Reference::find(&flight, &model, &noise, &Serial);
        let run = Problem::new(&flight, &model, &reference, &watched, &Serial).run(&noise, &options);
        let about = About::new(&flight, &model, &reference, &watched);
        let through =
            Problem::run_through(&about, &[walk(&model)], (&noise, &options), None, &Serial).remove(0);
        let own = &run.information[0];
        assert!((&own.imitated - &through.information[0].imitated).amax() < 1e-6 * own.imitated.amax());
        for k in 0..3 {
            let (score, known) = (own.score[k], own.matrix[(k, k)]);
            raw += score / known.sqrt() / 18.0;
            allowed += score * score / (known + own.imitated[k]) / 18.0;
        }
    }
    assert!(raw > 1.0, "the scores of flights without an effect are {raw} sigma off in the mean");
    assert!(allowed < 1.2, "{allowed} is the mean square in sigmas, with what noise can make of it");
    // Good samples are not asked.
    let (flight, model) = self::flight();
    let reference = Reference::find(&flight, &model, &self::noise(), &Serial);
    let run = Problem::new(&flight, &model, &reference, &watched, &Serial).run(&self::noise(), &options);
    assert!(!flight.is_noisy() && run.information[0].imitated.amax() == 0.0);
}

/// A unit that is held level for half a minute, turned onto its side in two seconds, and held so for as long; nothing is wrong with it but noise.
fn turned_by_hand(model: &Model) -> Vec<Sample> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut normal = |sigma: f64| {
        Vector3::from_fn(|_, _| {
            sigma * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng)
        })
    };
    let place = Geodetic::from_degrees(47.0, 8.0, 500.0);
    let (hz, half_turn) = (50.0, 0.5 * std::f64::consts::FRAC_PI_2);
    let mut samples = vec![Sample::Stream(ImuStream::default())];
    for i in 0..3100 {
        let t_s = f64::from(i) / hz;
        let phase = std::f64::consts::PI * ((t_s - 30.0) / 2.0).clamp(0.0, 1.0);
        let roll = half_turn * (1.0 - cos(phase));
        let c_nb = c_nb_from_euler(roll, 0.0, 0.0);
        let still = NavState::from_ned(place, &Vector3::zeros(), &c_nb);
        let turn = Vector3::x() * (half_turn * sin(phase) * std::f64::consts::FRAC_PI_2);
        let to_body = still.q_eb.inverse();
        let gyro = turn + to_body * earth::rotation_rate() + normal(model.imu.gyro_noise * hz.sqrt());
        let accel = to_body * -earth::gravity(&still.r_e) + normal(model.imu.accel_noise * hz.sqrt());
        samples.push(Sample::Imu(ImuSample { t_s, gyro, accel, temperature_degc: None }));
        if i % 5 == 0 {
            samples.push(Sample::Attitude(AttitudeHint { t_s, roll_pitch_yaw: still.euler().into() }));
        }
        if i % 10 == 0 {
            let v = normal(0.05);
            samples.push(Sample::Fix(GnssFix {
                t_s,
                position: place,
                velocity: FixVelocity::Horizontal([v.x, v.y]),
                position_sigma_m: Some([0.5; 3]),
                velocity_sigma_m_per_s: Some([0.05; 3]),
                yaw_rad: None,
            }));
        }
    }
    samples
}

/// Rest shows nothing of a scale factor, but that of 4 % makes the noise of the corrected rate 4 % less: a minute of rest was 7 nats likelier for it.
#[test]
fn a_scale_factor_that_shrinks_the_noise_of_a_rest_is_no_likelier() {
    let model = Model::default();
    let flight = Flight::prepare(&turned_by_hand(&model), &model).unwrap();
    assert!(flight.by_hand().rests(10.0, 11.0).is_some() && flight.by_hand().rests(40.0, 41.0).is_some());
    let (noise, options) = (noise(), Options::default().all());
    let reference = Reference::find(&flight, &model, &noise, &Serial);
    // The unit does not turn about its z axis.
    let [with, without] = [0.04, 0.0].map(|z| {
        let mut model = model.clone();
        model.set(EffectSetting::known(&effects::GYRO_SCALE_FACTOR, &[0.0, 0.0, z]).unwrap());
        let reference = reference.with(&flight, &model);
        Problem::new(&flight, &model, &reference, &Watched::default(), &Serial)
            .run(&noise, &options)
            .log_likelihood[0]
    });
    assert!((with - without).abs() < 1.0, "{} nats", with - without);
    let scale = EffectSetting::unknown(&effects::GYRO_SCALE_FACTOR);
    let watched = Watched { effects: vec![scale] };
    let run = Problem::new(&flight, &model, &reference, &watched, &Serial).run(&noise, &options);
    let information = &run.information[0];
    let z = (information.score[2], information.matrix[(2, 2)]);
    assert!(z.0.abs() * 0.04 < 1.0 && z.1.sqrt() * 0.04 < 1.0, "score {} and information {}", z.0, z.1);
}

/// A delay that is tried moves the instants between which the unit rests, but means over other samples are no evidence: for delays of 10 to 150 ms a
/// minute of rest was 11 nats less to 17 more likely. Nor on a lag of the gyros beside it, whose interpolation takes noise away.
#[test]
fn what_a_rest_shows_does_not_depend_on_the_delay_that_is_tried() {
    let model = Model::default();
    let flight = Flight::prepare(&turned_by_hand(&model), &model).unwrap();
    let (noise, options) = (noise(), Options::default().all());
    let reference = Reference::find(&flight, &model, &noise, &Serial);
    let likely = |delay_s: f64, lag_s: f64| {
        let mut late = model.clone();
        late.set(EffectSetting::known(&effects::GpsLatency, &[delay_s]).unwrap());
        late.set(EffectSetting::known(find("gyro_accel_delay").unwrap(), &[lag_s]).unwrap());
        let reference = reference.with(&flight, &late);
        let problem = Problem::new(&flight, &late, &reference, &Watched::default(), &Serial);
        problem.run(&noise, &options).log_likelihood[0]
    };
    for lag_s in [0.0, 0.01] {
        let none = likely(0.0, lag_s);
        for delay_s in [-0.15, -0.06, -0.04, -0.02, 0.02, 0.04, 0.06, 0.15] {
            let more = likely(delay_s, lag_s) - none;
            assert!(more.abs() < 2.0, "{more} nats for {delay_s} s beside {lag_s} s");
        }
    }
}
