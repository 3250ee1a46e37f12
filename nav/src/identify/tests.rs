//! Score and information against differences of the likelihood itself, and against chance.

use super::*;
use crate::earth::Geodetic;
use crate::effects;
use crate::math::{cos, ln, sin};
use crate::mechanization::{Increment, Motion, NavState, step};
use crate::model::{EffectSetting, Model};
use crate::operating::{Channel, Operating, OperatingSample};
use crate::rotation::c_nb_from_euler;
use crate::sample::{AttitudeHint, FixVelocity, GnssFix, ImuSample, ImuStream, Sample, SampleKind};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};

const RATE_HZ: f64 = 50.0;

/// A vehicle that weaves, climbs and changes speed for 90 s, with noise, through the effects of a model.
pub(crate) fn fly(model: &Model, seed: u64) -> Vec<Sample> {
    fly_in_gusts(model, seed, 0.0)
}

/// The same in gusts of two to five hertz that lift it by so many m/s² and pitch it as they do.
pub(crate) fn fly_in_gusts(model: &Model, seed: u64, lift: f64) -> Vec<Sample> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let mut nav = NavState::from_ned(
        Geodetic::from_degrees(47.0, 8.0, 500.0),
        &Vector3::new(20.0, 0.0, 0.0),
        &c_nb_from_euler(0.0, 0.0, 0.0),
    );
    let calibration = crate::filter::calibration::Calibration::new(model);
    let motion = |t: f64, nav: &NavState| {
        let up = nav.c_nb().transpose() * Vector3::new(0.0, 0.0, -9.8);
        let push = Vector3::new(sin(0.3 * t), 0.8 * cos(0.23 * t), -3.0 * sin(0.4 * t).max(0.0));
        let level = nav.euler();
        let rate = Vector3::new(
            0.5 * sin(0.7 * t) - 0.3 * level.x,
            0.2 * cos(0.5 * t) - 0.3 * level.y,
            0.3 * sin(0.2 * t),
        );
        let gust = sin(13.1 * t) + sin(19.7 * t + 1.0) + sin(29.3 * t + 2.0);
        let (pitch, heave) = (-0.01 * lift * gust, Vector3::z() * (lift * gust));
        Motion { rate: rate + Vector3::y() * pitch, force: up + push + heave }
    };
    let mut samples = vec![Sample::Stream(ImuStream::default())];
    let delay = calibration
        .parameters()
        .iter()
        .zip(&model.effects)
        .map(|(p, s)| s.effect.fix_delay_s(p, 0.0))
        .sum::<f64>();
    let late = (delay * RATE_HZ).round() as usize;
    let mut path: Vec<NavState> = Vec::new();
    let mut now = motion(0.0, &nav);
    for i in 0..(90.0 * RATE_HZ) as usize {
        let t_s = i as f64 / RATE_HZ;
        let ideal = ImuSample { t_s, gyro: now.rate, accel: now.force, temperature_degc: None };
        let shown = calibration.measure(model, &ideal, &now);
        let noise = |scale: f64, normal: &mut dyn FnMut() -> f64| {
            Vector3::new(normal(), normal(), normal()) * (scale * RATE_HZ.sqrt())
        };
        let gyro = shown.rate + noise(model.imu.gyro_noise, &mut normal);
        let accel = shown.force + noise(model.imu.accel_noise, &mut normal);
        samples.push(Sample::Imu(ImuSample { gyro, accel, ..ideal }));
        path.push(nav);
        if i % 5 == 0 {
            samples.push(Sample::Attitude(AttitudeHint { t_s, roll_pitch_yaw: nav.euler().into() }));
        }
        if i % 10 == 0 && i >= late {
            let then = &path[i - late];
            let c_en = then.geodetic().c_en();
            let white = c_en * Vector3::new(normal(), normal(), normal()) * 0.5;
            let v = then.v_n() + Vector3::new(normal(), normal(), 0.0) * 0.1;
            samples.push(Sample::Fix(GnssFix {
                t_s,
                position: Geodetic::from_ecef(&(then.r_e + white)),
                velocity: FixVelocity::Horizontal([v.x, v.y]),
                position_sigma_m: Some([0.5; 3]),
                velocity_sigma_m_per_s: Some([0.1; 3]),
                yaw_rad: None,
            }));
        }
        // The motion at the end of the step depends on the attitude there: one correction is enough.
        let dt = 1.0 / RATE_HZ;
        let guess = step(&nav, &Increment::between(&now, &now, SampleKind::Point, dt));
        let next = motion(t_s + dt, &guess);
        nav = step(&nav, &Increment::between(&now, &next, SampleKind::Point, dt));
        now = next;
    }
    samples
}

pub(super) fn noise() -> noise::Noise {
    noise::Noise {
        gyro: Model::default().imu.gyro_noise,
        accel: Model::default().imu.accel_noise,
        position_scale: 1.0,
        height_scale: 1.0,
        velocity_scale: 1.0,
        gauss_markov_m: 0.02,
        correlation_s: 60.0,
        stamp_s: 0.0,
    }
}

#[test]
fn a_hidden_delay_is_found_and_nothing_on_a_clean_flight() {
    let settings = select::Settings::default();
    let model = Model::default();
    let clean = flight::Flight::prepare(&fly(&model, 2), &model).unwrap();
    let nothing = select::select(&[&clean], &model, &settings, &Serial);
    assert!(nothing.added.is_empty(), "{:?}", nothing.steps);
    let mut with = model.clone();
    with.set(EffectSetting::known(&effects::GpsLatency, &[0.12]).unwrap());
    let late = flight::Flight::prepare(&fly(&with, 2), &model).unwrap();
    let found = select::select(&[&late], &model, &settings, &Serial);
    assert_eq!(found.steps.len(), 1, "{:?}", found.steps);
    let judged = judge::judge(&[&late], &[], found, &settings, &Serial);
    assert_eq!(judged.selection.added[0].setting.effect.name(), "gps_latency");
    assert!((judged.selection.added[0].setting.values[0] - 0.12).abs() < 0.01);
    assert!(judged.held_out[0].nis_per_dof > judged.held_out[1].nis_per_dof + 0.1);
    assert!(judged.left_out[0].held_out() > 10.0);
}

/// A jump can be seen only where it happens: that holds for the second one as well, in a block that is held out at first.
#[test]
fn no_jump_of_several_is_held_out() {
    let (model, settings) = (Model::default(), select::Settings::default());
    let (first_s, second_s, step) = (40.0, 57.0, Vector3::new(0.004, -0.006, 0.005));
    let mut samples = fly(&model, 2);
    for sample in &mut samples {
        match sample {
            Sample::Imu(imu) if imu.t_s > first_s => imu.gyro += step,
            Sample::Fix(fix) if fix.t_s > second_s => fix.position.height_m += 12.0,
            _ => {}
        }
    }
    let flight = flight::Flight::prepare(&samples, &model).unwrap();
    let found = select::select(&[&flight], &model, &settings, &Serial);
    let part = |t_s: f64| found.options.part(t_s - flight.initial().t_s);
    assert_eq!((part(first_s), part(second_s)), (Some(0), Some(0)), "{:?}", found.options);
    assert_eq!(settings.options.part(second_s - flight.initial().t_s), Some(1));
    let judged = judge::judge(&[&flight], &[], found, &settings, &Serial);
    let mut names: Vec<_> = judged.selection.added.iter().map(|a| a.setting.effect.name()).collect();
    names.sort_unstable();
    assert_eq!((names, judged.removed), (vec!["gps_bias_step", "gyro_bias_step"], vec![]));
    for added in &judged.selection.added {
        let setting = &added.setting;
        let true_s = if setting.effect.name() == "gyro_bias_step" { first_s } else { second_s };
        let (off_s, sigma_s) = (setting.values[0] - true_s, setting.sigmas[0]);
        assert!((0.02..1.0).contains(&sigma_s) && off_s.abs() < 3.0 * sigma_s, "{off_s} ± {sigma_s} s");
    }
}

#[test]
fn a_bayes_factor_pays_for_what_it_cannot_see() {
    let mut information = pass::Information::zeros(1);
    let column = [evidence::Column { at: 0, sigma: 1.0, offset: 0.0 }];
    // No information: no evidence either way.
    let fit = evidence::fit(&information, &column).unwrap();
    assert_eq!((fit.evidence, fit.gain), (0.0, 0.0));
    // Known to 0.01 of the prior and found at zero: the odds fall by the ratio of the widths.
    information.matrix[(0, 0)] = 1e4;
    let fit = evidence::fit(&information, &column).unwrap();
    assert!((fit.evidence + 0.5 * ln(10_001f64)).abs() < 1e-9);
    // Found five sigma away.
    information.score[0] = 500.0;
    let fit = evidence::fit(&information, &column).unwrap();
    assert!((fit.step[0] - 0.05).abs() < 1e-4 && (fit.gain - 12.5).abs() < 0.01, "{fit:?}");
}

#[test]
fn with_hardly_any_prior_the_sigma_is_that_of_the_information() {
    let mut information = pass::Information::zeros(2);
    information.matrix[(0, 0)] = 4.0;
    information.matrix[(1, 1)] = 1e4;
    information.matrix[(0, 1)] = 100.0;
    information.matrix[(1, 0)] = 100.0;
    information.score[1] = 50.0;
    let columns = evidence::Column::open([(1.0, 0.0), (6.0, 0.0)]);
    let alone = evidence::fit(&information, &columns[1..]).unwrap();
    assert!((alone.covariance[(0, 0)].sqrt() - 0.01).abs() < 1e-5 && (alone.step[0] - 5e-3).abs() < 1e-5);
    // Beside something else that imitates it in part: 1/√(10⁴ − 100²/(4 + 1)).
    let beside = evidence::fit(&information, &columns).unwrap();
    assert!((beside.covariance[(1, 1)].sqrt() - 8000.0f64.sqrt().recip()).abs() < 1e-5, "{beside:?}");
}

/// Samples with a disturbance of each inertial sample.
fn disturbed(samples: Vec<Sample>, by: &dyn Fn(&mut ImuSample)) -> Vec<Sample> {
    let mut samples = samples;
    for sample in &mut samples {
        if let Sample::Imu(imu) = sample {
            by(imu);
        }
    }
    samples
}

/// What is named of a flight whose samples are disturbed, formulas among the candidates; with reports of a current.
fn named(seed: u64, by: &dyn Fn(&mut ImuSample)) -> Vec<select::Added> {
    named_in(disturbed(fly(&Model::default(), seed), by))
}

/// The same of a flight whose fixes are disturbed: position or velocity, north-east-down, by the heading and the height above the start.
fn named_of_fixes(seed: u64, by: &dyn Fn(f64, f64) -> [Vector3<f64>; 2]) -> Vec<select::Added> {
    let mut samples = fly(&Model::default(), seed);
    let (mut heading, start_m) = (0.0, 500.0);
    for sample in &mut samples {
        match sample {
            Sample::Attitude(hint) => heading = hint.roll_pitch_yaw[2],
            Sample::Fix(fix) => {
                let [position, velocity] = by(heading, fix.position.height_m - start_m);
                let moved = fix.position.to_ecef() + fix.position.c_en() * position;
                fix.position = Geodetic::from_ecef(&moved);
                if let FixVelocity::Horizontal([north, east]) = &mut fix.velocity {
                    (*north, *east) = (*north + velocity.x, *east + velocity.y);
                }
            }
            _ => {}
        }
    }
    named_in(samples)
}

fn named_in(mut samples: Vec<Sample>) -> Vec<select::Added> {
    let (model, settings) = (Model::default(), select::Settings::default());
    let report = |k: u32| {
        let t_s = f64::from(k) * 0.2;
        let values = Operating::default().with(Channel::Current, current(t_s));
        Sample::Operating(OperatingSample { t_s, values })
    };
    samples.extend((0..450).map(report));
    let flight = flight::Flight::prepare(&samples, &model).unwrap();
    let catalogue = select::select(&[&flight], &model, &settings, &Serial);
    let selection = beyond::select(&[&flight], &model, catalogue, &settings, &Serial);
    let selection = judge::confirm(&[&flight], &[], selection, &settings, &Serial).selection;
    selection.added
}

fn current(t_s: f64) -> f64 {
    10.0 + 6.0 * sin(0.37 * t_s) + 3.0 * sin(1.1 * t_s)
}

#[test]
fn an_effect_outside_the_catalogue_is_named_as_a_formula_with_its_value() {
    let by_current = named(3, &|imu| imu.gyro.z += 4e-4 * current(imu.t_s));
    let names: Vec<&str> = by_current.iter().map(|a| a.setting.effect.name()).collect();
    assert_eq!(names, ["formula:gyro~current"]);
    let setting = &by_current[0].setting;
    assert!((setting.values[2] - 4e-4).abs() < 3.0 * setting.sigmas[2], "{setting:?}");
    assert!(setting.values[..2].iter().zip(&setting.sigmas).all(|(v, s)| v.abs() < 3.5 * s), "{setting:?}");
    // With its mean alone, f_z times a rate would be a misalignment.
    for seed in 3..7 {
        let by_product = named(seed, &|imu| imu.gyro.y += 4e-3 * imu.gyro.x * imu.accel.z);
        let names: Vec<&str> = by_product.iter().map(|a| a.setting.effect.name()).collect();
        assert_eq!(names, ["formula:gyro~w_x*f_z"], "seed {seed}");
        let setting = &by_product[0].setting;
        assert!((setting.values[1] - 4e-3).abs() < 3.0 * setting.sigmas[1], "{setting:?}");
    }
}

#[test]
fn what_fixes_go_with_is_named_as_a_formula_with_its_value() {
    let zero = Vector3::zeros();
    let by_heading =
        named_of_fixes(3, &|heading, _| [Vector3::new(0.0, 4.0 * sin(2.0 * heading), 0.0), zero]);
    let names: Vec<&str> = by_heading.iter().map(|a| a.setting.effect.name()).collect();
    assert_eq!(names, ["formula:position~sin(2*heading)"]);
    let setting = &by_heading[0].setting;
    assert!((setting.values[1] - 4.0).abs() < 3.0 * setting.sigmas[1], "{setting:?}");
    assert!(setting.values[0].abs() < 3.5 * setting.sigmas[0], "{setting:?}");
    let by_height = named_of_fixes(4, &|_, height| [zero, Vector3::new(4e-3 * height, 0.0, 0.0)]);
    let names: Vec<&str> = by_height.iter().map(|a| a.setting.effect.name()).collect();
    assert_eq!(names, ["formula:velocity~height"]);
    let setting = &by_height[0].setting;
    assert!((setting.values[0] - 4e-3).abs() < 3.0 * setting.sigmas[0], "{setting:?}");
}

#[test]
fn a_clean_flight_and_one_of_the_catalogue_have_no_formula() {
    // The threshold lets a second name through in one flight of 27 at most (2 of 200 are measured): of eight, one may have it.
    let mut alone = 0;
    for seed in 30..38 {
        assert!(named(seed, &|_| ()).is_empty(), "seed {seed}");
        let scaled = named(seed, &|imu| imu.gyro.y += 2e-2 * imu.gyro.y);
        let names: Vec<&str> = scaled.iter().map(|a| a.setting.effect.name()).collect();
        assert!(
            names[0] == "gyro_scale_factor" && names.iter().all(|n| !n.starts_with("formula:")),
            "{names:?}"
        );
        alone += usize::from(names.len() == 1);
    }
    assert!(alone >= 7, "{alone} of 8");
}

#[test]
fn a_second_flight_confirms_a_formula_or_contradicts_it() {
    let settings = select::Settings::default();
    let confirmed = |size: f64| {
        let model = Model::default();
        let mut samples = disturbed(fly(&model, 9), &|imu| imu.gyro.z += size * current(imu.t_s));
        samples.extend((0..450).map(|k| {
            let t_s = f64::from(k) * 0.2;
            let values = Operating::default().with(Channel::Current, current(t_s));
            Sample::Operating(OperatingSample { t_s, values })
        }));
        let flight = flight::Flight::prepare(&samples, &model).unwrap();
        let effect = effects::find("formula:gyro~current").unwrap();
        let earlier = EffectSetting { effect, values: vec![0.0, 0.0, 4e-4], sigmas: vec![3e-5; 3] };
        beyond::confirm(&[&flight], &model, &[earlier], &settings, &Serial).remove(0)
    };
    let same = confirmed(4e-4);
    assert!(same.evidence > 5.0 && same.differences().iter().all(|z| z.abs() < 3.5), "{same:?}");
    let other = confirmed(-4e-4);
    assert!(other.differences()[2] < -5.0, "{other:?}");
    assert!(confirmed(0.0).differences()[2] < -3.0);
}

/// A search that may add nothing says what it would have added; one that may does, and leaves nothing over.
#[test]
fn what_a_search_that_has_enough_effects_leaves_over_is_said() {
    let model = Model::default();
    let by = |imu: &mut ImuSample| imu.gyro.y += 4e-3 * imu.gyro.x * imu.accel.z;
    let flight = flight::Flight::prepare(&disturbed(fly(&model, 4), &by), &model).unwrap();
    let left_over = |most_effects: usize| {
        let settings = select::Settings { most_effects, ..select::Settings::default() };
        let catalogue = select::select(&[&flight], &model, &settings, &Serial);
        let selection = beyond::select(&[&flight], &model, catalogue, &settings, &Serial);
        let judged = judge::judge(&[&flight], &[], selection, &settings, &Serial);
        let left_over = beyond::left_over(&[&flight], &judged, &settings, &Serial);
        (judged.selection.added.len(), left_over)
    };
    let (added, all) = left_over(0);
    assert_eq!((added, all[0].effect.name()), (0, "formula:gyro~w_x*f_z"));
    assert!((all[0].values[1] - 4e-3).abs() < 4.0 * all[0].sigmas[1], "{:?}", all[0]);
    let (added, all) = left_over(12);
    assert!(added == 1 && all.is_empty(), "{all:?}");
}

#[test]
fn a_swapped_or_reversed_axis_and_a_wrong_unit_are_named() {
    let (model, settings) = (Model::default(), select::Settings::default());
    for name in ["gyro_x_reversed", "accel_xy_swapped", "gyro_in_deg_per_s"] {
        let mistake = effects::find(name).unwrap();
        let samples = disturbed(fly(&model, 4), &|imu| {
            [imu.gyro, imu.accel] = mistake.source(&imu.gyro, &imu.accel);
        });
        let flight = flight::Flight::prepare(&samples, &model).unwrap();
        let found = select::select(&[&flight], &model, &settings, &Serial);
        let groups: Vec<_> = found.steps.iter().map(|s| s.group.clone()).collect();
        assert_eq!(groups, [[name]], "{:?}", found.steps);
        let judged = judge::judge(&[&flight], &[], found, &settings, &Serial);
        assert_eq!(judged.selection.added.len(), 1, "{name} {:?}", judged.removed);
        assert!(judged.held_out[0].nis_per_dof > 2.0 * judged.held_out[1].nis_per_dof, "{name}");
    }
}

/// Samples as a source with a fault reports them.
fn mistaken(samples: Vec<Sample>, mistake: &dyn effects::Effect) -> Vec<Sample> {
    let mut before: Option<effects::ReportedSample> = None;
    let mut samples = samples;
    for sample in &mut samples {
        if let Sample::Imu(imu) = sample {
            let finished = [imu.gyro, imu.accel];
            let reported = mistake.source_after(finished, before.as_ref());
            before = Some(effects::ReportedSample {
                raw: finished,
                reported,
                count: before.map_or(0, |b| b.count) + 1,
            });
            [imu.gyro, imu.accel] = reported;
        }
    }
    samples
}

#[test]
fn clipped_and_repeated_samples_are_named() {
    let (model, settings) = (Model::default(), select::Settings::default());
    let clip = |sensor: usize, limit: f64| {
        // Lower than any part's range: this vehicle flies gently.
        disturbed(fly(&model, 6), &|imu| {
            let v = if sensor == 0 { &mut imu.gyro } else { &mut imu.accel };
            *v = v.map(|x| x.clamp(-limit, limit));
        })
    };
    let reported = |name: &str| mistaken(fly(&model, 6), effects::find(name).unwrap());
    for (name, samples) in [
        ("accel_clipped", clip(1, 11.0)),
        ("gyro_clipped", clip(0, 0.4)),
        ("samples_repeated", reported("samples_repeated")),
    ] {
        let flight = flight::Flight::prepare(&samples, &model).unwrap();
        let found = select::select(&[&flight], &model, &settings, &Serial);
        assert_eq!(found.steps[0].group, [name], "{:?}", found.steps[0]);
        let judged = judge::confirm(&[&flight], &[], found, &settings, &Serial);
        let left: Vec<_> = judged.selection.added.iter().map(|a| a.setting.effect.name()).collect();
        assert_eq!(left[0], name, "{left:?} {:?}", judged.removed);
    }
}
