use super::*;
use crate::outputs::Outputs;
use gaware_nav::effects::{self, Effect};
use gaware_nav::identify::linear::Problem;
use gaware_nav::identify::linear::reference::Reference;
use gaware_nav::identify::noise::Noise;
use gaware_nav::identify::residual::CHANNELS;
use gaware_nav::identify::watched::Watched;
use gaware_nav::math::acos;
use gaware_nav::model::EffectSetting;
use gaware_sitl::blind::{Family, Kind, fly};
use gaware_sitl::truth::Truth;

fn explain(hidden: &[EffectSetting], seed: u64) -> Explained {
    let blind = fly(hidden, Kind::Rich, Family::Tuning, seed);
    let explained = samples(&[blind.samples], &[], &Model::default(), &Settings::default(), &|_| {});
    each_effect_stands_once(&explained.explanation);
    explained
}

/// Every effect of the catalogue is in exactly one of the lists.
fn each_effect_stands_once(e: &Explanation) {
    for effect in effects::REGISTRY {
        let name = effect.name();
        let lists = [
            e.effects.iter().any(|x| x.names.contains(&name)),
            e.not_found.iter().any(|x| x.name == name),
            e.removed.contains(&name),
            e.negligible.iter().any(|x| x.name == name),
            e.assumed.iter().any(|x| x.name == name),
        ];
        assert_eq!(lists.iter().filter(|l| **l).count(), 1, "{name}: {lists:?}, {}", e.summary);
    }
}

/// An aircraft at 60 m/s whose receiver has correlated errors of a metre.
fn fast(hidden: &[EffectSetting], seed: u64) -> Vec<Sample> {
    use gaware_sitl::sensors::{Flight as Simulated, SensorConfig};
    use gaware_sitl::trajectory::{Flown, fixed_wing::FixedWing, signal::Signal};
    let mut truth = Model::default();
    truth.imu.gyro_bias = [2e-3, -1e-3, 3e-3];
    truth.gnss.position_sigma_m = [0.6, 0.6, 1.0];
    truth.gnss.position_correlation_s = 60.0;
    truth.gnss.position_wander_sigma_m = [1.2, 1.2, 1.9];
    hidden.iter().for_each(|h| truth.set(h.clone()));
    let deg = f64::to_radians;
    let (mut bank, mut climb) = (Signal::constant(0.0), Signal::constant(0.0));
    let mut speed = Signal::constant(0.0).step(10.0, 15.0, 60.0);
    for k in 0..6 {
        let at = 40.0 + 30.0 * f64::from(k);
        let side = if k % 2 == 0 { 1.0 } else { -1.0 };
        bank = bank.pulse(at, at + 16.0, 2.0, side * deg(40.0 + 4.0 * f64::from(k)));
        speed = speed.pulse(at + 18.0, at + 24.0, 4.0, 8.0);
        climb = climb.pulse(at + 17.0, at + 24.0, 2.0, deg(6.0));
    }
    let wing = FixedWing::from_signals(240.0, speed, climb, bank, Signal::constant(0.0));
    let sensors = SensorConfig {
        imu_rate_hz: 50.0,
        fix_rate_hz: 5.0,
        message: "RAW_IMU".into(),
        quantisation: gaware_nav::sample::Quantisation::Truncate(gaware_nav::sample::Steps::RAW_IMU),
        attitude_rate_hz: 5.0,
        time_jitter_s: 2e-3,
        ..SensorConfig::default()
    };
    let flight = Simulated::new(Box::new(Flown::new(wing)), &truth, sensors, seed);
    flight.take_while(|(_, t)| t.t_s < 220.0).map(|(s, _)| s).collect()
}

/// Position 0.10 s and velocity 0.22 s old: not an error of positions that is Gauss-Markov with metres.
#[test]
fn a_velocity_older_than_its_position_is_named_and_not_taken_for_noise() {
    let hidden = [
        EffectSetting::known(&effects::GpsLatency, &[0.10]).unwrap(),
        EffectSetting::known(&effects::GpsVelocityLatency, &[0.12]).unwrap(),
    ];
    for seed in [1, 2] {
        let explained =
            samples(&[fast(&hidden, seed)], &[], &Model::default(), &Settings::default(), &|_| {});
        let e = &explained.explanation;
        each_effect_stands_once(e);
        let mut names: Vec<_> = e.effects.iter().map(|x| x.names.clone()).collect();
        names.sort();
        assert_eq!(names, [["gps_latency"], ["gps_velocity_latency"]], "{}", e.summary);
        for h in &hidden {
            let found = explained.model.get(h.effect.name()).unwrap();
            // Samples are stamped up to 2 ms late.
            assert!((found.values[0] - h.values[0]).abs() < 2.0 * found.sigmas[0] + 2e-3, "{found:?}");
        }
        assert_eq!(e.verdict, contract::Verdict::Explained, "{}", e.summary);
        assert!(e.noise.iter().all(|n| n.plausible), "{:?}", e.noise);
    }
}

/// A receiver whose errors are far larger than it claims is not a flight in which nothing is missing.
#[test]
fn noise_far_beyond_what_is_claimed_is_a_finding() {
    let mut flown = fast(&[], 3);
    let mut errors = gaware_sitl::noise::Noise::new(3, gaware_sitl::noise::Purpose::Wind);
    for sample in &mut flown {
        if let Sample::Fix(fix) = sample {
            fix.velocity_sigma_m_per_s = Some([0.08, 0.08, 0.08]);
            if let gaware_nav::sample::FixVelocity::Full(v) = &mut fix.velocity {
                v.iter_mut().for_each(|v| *v += 0.34 * errors.normal());
            } else if let gaware_nav::sample::FixVelocity::Horizontal(v) = &mut fix.velocity {
                v.iter_mut().for_each(|v| *v += 0.34 * errors.normal());
            }
        }
    }
    let explained = samples(&[flown], &[], &Model::default(), &Settings::default(), &|_| {});
    let e = &explained.explanation;
    let velocity = e.noise.iter().find(|n| n.name == "gnss_velocity").unwrap();
    // 0.35 m/s where 0.08 are claimed.
    assert!((velocity.assumed - 0.08).abs() < 1e-9 && !velocity.plausible, "{velocity:?}");
    assert!((velocity.fitted - 0.35).abs() < 4.0 * velocity.sigma && velocity.sigma < 0.03, "{velocity:?}");
    assert_eq!(velocity.finding, Some("gnss_velocity_noise"));
    assert_eq!(e.verdict, contract::Verdict::Unexplained, "{}", e.summary);
    assert!(e.summary.contains("gnss_velocity_noise"), "{}", e.summary);
}

/// Noise of the samples as PX4's simulator makes it: it moves values by several sigma, so that none is proposed.
#[test]
fn nothing_is_proposed_from_samples_that_are_noisier_than_any_unit() {
    let late = [EffectSetting::known(&effects::GpsLatency, &[0.12]).unwrap()];
    let mut flown = fast(&late, 4);
    let of = |explained: &Explained| {
        let findings = autopilot::findings(explained);
        let latency = findings.into_iter().find(|f| f.names.contains(&"gps_latency"));
        latency.map(|f| f.barred.is_some())
    };
    let good = samples(&[flown.clone()], &[], &Model::default(), &Settings::default(), &|_| {});
    assert_eq!(of(&good), Some(false));
    assert!(!good.explanation.summary.contains("no parameter"));
    let mut errors = gaware_sitl::noise::Noise::new(4, gaware_sitl::noise::Purpose::Wind);
    for sample in &mut flown {
        if let Sample::Imu(imu) = sample {
            imu.gyro.iter_mut().for_each(|w| *w += 0.05 * errors.normal());
            imu.accel.iter_mut().for_each(|f| *f += 0.7 * errors.normal());
        }
    }
    let noisy = samples(&[flown], &[], &Model::default(), &Settings::default(), &|_| {});
    assert_ne!(of(&noisy), Some(false));
    assert!(noisy.explanation.summary.contains("no parameter is proposed"), "{}", noisy.explanation.summary);
}

#[test]
fn a_hidden_delay_is_named_and_the_residual_shrinks() {
    let hidden = EffectSetting::known(&effects::GpsLatency, &[0.17]).unwrap();
    let explained = explain(&[hidden], 3);
    let e = &explained.explanation;
    assert_eq!(e.verdict, contract::Verdict::Explained, "{}", e.summary);
    assert_eq!(e.effects.len(), 1);
    assert_eq!(e.effects[0].names, ["gps_latency"]);
    let found = explained.model.get("gps_latency").unwrap();
    assert!((found.values[0] - 0.17).abs() < 4.0 * found.sigmas[0] + 0.005, "{found:?}");
    let residual = e.residual.as_ref().unwrap();
    assert!(residual.held_out.before > 1.3 && (0.9..1.1).contains(&residual.held_out.after), "{residual:?}");
    let back = Model::from_toml(&explained.model.to_toml()).unwrap();
    assert!((back.get("gps_latency").unwrap().values[0] - found.values[0]).abs() < 1e-9);
    // The report holds what it says and needs nothing from elsewhere.
    let folder = std::env::temp_dir().join(format!("gaware-explain-{}", std::process::id()));
    write(&explained, &folder, &Outputs::default()).unwrap();
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(page.contains("gps_latency") && page.contains("<svg"));
    for outside in ["<script src", "src=\"http", "href=\"http", "<link", "@import", "url(http"] {
        assert!(!page.contains(outside), "{outside}");
    }
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("report.json")).unwrap()).unwrap();
    assert_eq!(json["schema"], "gaware.explanation/1");
    assert!(json["effects"][0]["parameters"]["gps_latency"]["value_s"].is_number());
    assert!(json["where"].is_array() && json["gap"]["held_out"]["before"].is_number());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn too_little_to_say_names_nothing() {
    let whole = fly(&[], Kind::Rich, Family::Tuning, 4).samples;
    let without_fixes: Vec<Sample> = whole.iter().filter(|s| !matches!(s, Sample::Fix(_))).cloned().collect();
    let short: Vec<Sample> = whole.into_iter().take(1500).collect();
    let standing: Vec<Sample> =
        gaware_sitl::scenario::scenario("bench").unwrap().flight(1).take(20_000).map(|(s, _)| s).collect();
    for (flight, said) in [
        (short, "at least 40 s"),
        (without_fixes, "no GNSS fixes"),
        (Vec::new(), "no inertial samples"),
        (standing, "stationary"),
    ] {
        let e = samples(&[flight], &[], &Model::default(), &Settings::default(), &|_| {}).explanation;
        assert_eq!(e.verdict, contract::Verdict::TooLittleData);
        assert!(e.effects.is_empty() && e.residual.is_none());
        assert!(e.places.is_empty() && e.regimes.is_empty() && e.unexplained_terms.is_empty());
        let told = e.summary.starts_with("Too little data") && e.summary.contains(said);
        assert!(told, "{} does not say {said}", e.summary);
    }
}

/// A simulated aircraft with its truth, and the flight with the noise that is in it.
fn simulated(seed: u64) -> (Flight, Model, Noise, Vec<Truth>) {
    let mut scenario = gaware_sitl::scenario::scenario("fixed_wing").unwrap();
    scenario.model.effects.clear();
    scenario.sensors.imu_rate_hz = 50.0;
    scenario.sensors.quantisation = gaware_nav::sample::Quantisation::None;
    let (mut samples, mut truths) = (Vec::new(), Vec::new());
    for (sample, truth) in scenario.flight(seed) {
        if matches!(sample, Sample::Imu(_)) {
            truths.push(truth);
        }
        samples.push(sample);
    }
    let mut model = scenario.model;
    model.imu.gyro_bias = [0.0; 3];
    model.imu.accel_bias = [0.0; 3];
    let flight = Flight::prepare(&samples, &model).unwrap();
    let noise = Noise {
        gyro: model.imu.gyro_noise,
        accel: model.imu.accel_noise,
        position_scale: 1.0,
        height_scale: 1.0,
        velocity_scale: 1.0,
        gauss_markov_m: model.gnss.position_wander_sigma_m[0],
        correlation_s: model.gnss.position_correlation_s,
        stamp_s: 1e-4,
    };
    (flight, model, noise, truths)
}

/// Over several flights, as the errors of one hang together, and without the ends, where a filter that only looks back is as good.
#[test]
fn the_smoothed_trajectory_has_half_of_the_errors_of_the_filter() {
    let (mut before, mut after, mut n) = ([0.0; 2], [0.0; 2], 0.0);
    for seed in 5..10 {
        let (flight, model, noise, truths) = simulated(seed);
        let filtered = Reference::filtered(&flight, &model, &noise);
        let problem = Problem::new(&flight, &model, &filtered, &Watched::default(), &Threads(1));
        let smoothed = filtered.smoothed(&problem, &noise);
        let start_s = flight.initial().t_s;
        let knots = filtered.knots.iter().zip(&smoothed.knots);
        for (old, new) in knots.filter(|(k, _)| k.t_s > start_s + 20.0) {
            let at = truths.partition_point(|t| t.t_s < new.t_s - 1e-6);
            let Some(truth) = truths.get(at).filter(|t| (t.t_s - new.t_s).abs() < 1e-6) else { continue };
            let errors = |nav: &gaware_nav::mechanization::NavState| {
                let turn = truth.c_nb.transpose() * nav.c_nb();
                let angle = acos(((turn.trace() - 1.0) * 0.5).clamp(-1.0, 1.0));
                [angle, (nav.v_n() - truth.v_n).norm()]
            };
            let (old, new) = (errors(&old.nav), errors(&new.nav));
            for k in 0..2 {
                before[k] += old[k] * old[k];
                after[k] += new[k] * new[k];
            }
            n += 1.0;
        }
    }
    let [attitude, velocity] = [0, 1].map(|k| f64::sqrt(after[k] / before[k]));
    let found = format!("attitude {attitude:.2} of the filter's, velocity {velocity:.2}, {n} epochs");
    println!("{found}");
    assert!(n > 2500.0 && attitude < 0.5 && velocity < 0.6, "{found}");
}

#[test]
fn residuals_of_a_right_model_have_the_size_that_it_gives_them() {
    let (mut sums, mut found) = ([[0.0; 2]; 12], 0);
    for seed in 1..4 {
        let (flight, model, noise, _) = simulated(seed);
        let reference = Reference::find(&flight, &model, &noise, &Threads(1));
        let problem = Problem::new(&flight, &model, &reference, &Watched::default(), &Threads(1));
        let points = residual::points(&flight, &model, (&reference, &problem), &noise);
        let places = residual::places(&points);
        println!("seed {seed}: {places:?}");
        found += places.len();
        for point in &points {
            for (c, sum) in sums.iter_mut().enumerate() {
                if let Some(z) = point.normalised(c) {
                    *sum = [sum[0] + z * z, sum[1] + 1.0];
                }
            }
        }
    }
    for (name, [sum, n]) in CHANNELS.iter().zip(sums).filter(|(_, s)| s[1] > 0.0) {
        println!("{name}: {:.3}", sum / n);
        assert!((0.6..1.4).contains(&(sum / n)), "{name}: {}", sum / n);
    }
    assert!(found <= 1, "{found} places stand out where nothing is wrong");
}

/// Constants of the vehicle are shared, biases and noise belong to each flight; a flight that took no part judges.
#[test]
fn several_flights_speak_together_and_another_one_judges() {
    let hidden = EffectSetting::known(&effects::GpsLatency, &[0.12]).unwrap();
    let flown = |seed| {
        let samples = fly(std::slice::from_ref(&hidden), Kind::Coordinated, Family::Tuning, seed).samples;
        let end = |s: &Sample| matches!(s, Sample::Imu(i) if i.t_s > 110.0);
        samples.into_iter().take_while(|s| !end(s)).collect::<Vec<_>>()
    };
    let explained =
        samples(&[flown(21), flown(22)], &[flown(23)], &Model::default(), &Settings::default(), &|_| {});
    let e = &explained.explanation;
    assert_eq!(e.verdict, contract::Verdict::Explained, "{}", e.summary);
    assert_eq!(e.effects[0].names, ["gps_latency"]);
    assert_eq!(explained.residuals.len(), 2);
    let residual = e.residual.as_ref().unwrap();
    assert!(residual.held_out.after < residual.held_out.before, "{residual:?}");
    assert!(e.leave_one_out.iter().all(|l| l.held_out_log_likelihood > 0.0), "{:?}", e.leave_one_out);
    let found = explained.model.get("gps_latency").unwrap();
    assert!((found.values[0] - 0.12).abs() < 4.0 * found.sigmas[0] + 0.005, "{found:?}");
    assert!(explained.model.get("gps_smoothing").is_none());
}

/// An event belongs to one flight: its instant is given in that flight's own time, with the number of the log.
#[test]
fn an_event_of_the_second_flight_is_found_there() {
    let step = EffectSetting::known(&effects::GpsBiasStep, &[70.0, 12.0, -9.0, 6.0]).unwrap();
    let flown = |hidden: &[EffectSetting], seed| {
        let samples = fly(hidden, Kind::Rich, Family::Tuning, seed).samples;
        let end = |s: &Sample| matches!(s, Sample::Imu(i) if i.t_s > 110.0);
        samples.into_iter().take_while(|s| !end(s)).collect::<Vec<_>>()
    };
    let explained =
        samples(&[flown(&[], 31), flown(&[step], 32)], &[], &Model::default(), &Settings::default(), &|_| {});
    let e = &explained.explanation;
    assert_eq!(e.effects.len(), 1, "{}", e.summary);
    assert_eq!(
        (&e.effects[0].names[..], e.effects[0].log),
        (&["gps_bias_step"][..], Some(1)),
        "{}",
        e.summary
    );
    let found = explained.model.get("gps_bias_step").unwrap();
    assert!((found.values[0] - 70.0).abs() < 1.0, "{found:?}");
    assert!((found.values[1] - 12.0).abs() < 4.0 * found.sigmas[1], "{found:?}");
}

/// An error of a gyro in proportion to a product of rate and force, which no effect of the catalogue is: it is named as a formula, with its
/// size, a file that defines it, and the residual against what drives it.
#[test]
fn an_effect_outside_the_catalogue_is_named_as_a_formula() {
    const NAME: &str = "formula:gyro~w_z*f_x";
    let mut flown = fly(&[], Kind::Rich, Family::Tuning, 41).samples;
    for sample in &mut flown {
        if let Sample::Imu(imu) = sample {
            imu.gyro.y += 1.5e-2 * imu.accel.x * imu.gyro.z;
        }
    }
    let explained = samples(&[flown], &[], &Model::default(), &Settings::default(), &|_| {});
    let e = &explained.explanation;
    let names: Vec<_> = e.effects.iter().map(|x| &x.names[..]).collect();
    assert_eq!(names, [[NAME]], "{}", e.summary);
    assert!(e.unexplained_terms.is_empty(), "{}", e.summary);
    // On this flight it is a fifth too small beside the tolerances, 3.6 of its sigmas (docs/formulas.md).
    let found = explained.model.get(NAME).unwrap();
    assert!((0.75..1.1).contains(&(found.values[1] / 1.5e-2)), "{found:?}");
    let files = files(&explained).unwrap();
    let of = |name: &str| files.iter().find(|f| f.0 == name).map(|f| f.1.clone()).unwrap();
    assert!(of("effects.toml").contains(NAME) && of("model.toml").contains(NAME));
    assert!(Model::from_toml(&of("model.toml")).unwrap().get(NAME).is_some());
    assert!(of("report.html").contains("Residual against driver"));
}

/// A driver is the motion itself, not what sensors with their biases show of it.
#[test]
fn values_of_a_product_of_motion_are_within_their_sigmas() {
    const NAME: &str = "formula:gyro~w_z*f_x";
    for seed in [42, 43, 44] {
        let own = EffectSetting::known(effects::find(NAME).unwrap(), &[0.0, 1.5e-2, 0.0]).unwrap();
        let flown = fly(std::slice::from_ref(&own), Kind::Rich, Family::Tuning, seed).samples;
        let explained = samples(&[flown], &[], &Model::default(), &Settings::default(), &|_| {});
        let found = explained.model.get(NAME).unwrap();
        let (value, sigma) = (found.values[1] / own.values[1], found.sigmas[1] / own.values[1]);
        assert!((value - 1.0).abs() < 2.0 * sigma && sigma < 0.1, "{seed}: {value} ± {sigma}");
    }
}

/// What the simulator does to samples that follow one another is found again.
#[test]
fn samples_told_twice_are_named() {
    let hidden = effects::find("samples_repeated").map(|e| EffectSetting::known(e, &[]).unwrap()).unwrap();
    let e = explain(&[hidden], 51).explanation;
    assert_eq!(e.verdict, contract::Verdict::Explained, "{}", e.summary);
    assert_eq!(e.effects[0].names, ["samples_repeated"], "{}", e.summary);
}

/// A clean flight: nothing is named, nothing is left over, and the page says how small an effect stays unseen.
#[test]
fn a_clean_flight_tells_what_it_could_not_have_shown() {
    let explained = explain(&[], 61);
    let e = &explained.explanation;
    assert_eq!(e.verdict, contract::Verdict::NothingMissing, "{}", e.summary);
    assert!(e.unexplained_terms.is_empty());
    let latency = e.not_found.iter().find(|n| n.name == "gps_latency").unwrap();
    let sigma = latency.parameters["sigma_s"].as_f64().unwrap();
    assert!((0.001..0.01).contains(&sigma), "{sigma}");
    assert!(crate::report::explanation::html(&explained).unwrap().contains("tested, not significant"));
}

/// Each of these alone, in the flight that shows it: its name and nothing else, its size within 2 sigma.
#[test]
fn effects_of_time_are_named_with_their_size() {
    let hidden: [(&'static dyn Effect, Vec<f64>, u64); 3] = [
        (&effects::GyroAccelDelay, vec![0.012], 71),
        (&effects::GyroAccelDelay, vec![-0.025], 72),
        (&effects::ClockDrift, vec![4e-4], 73),
    ];
    for (effect, values, seed) in hidden {
        let explained = explain(&[EffectSetting::known(effect, &values).unwrap()], seed);
        let e = &explained.explanation;
        let names: Vec<_> = e.effects.iter().map(|x| &x.names[..]).collect();
        assert_eq!(names, [[effect.name()]], "{}", e.summary);
        assert_eq!(e.verdict, contract::Verdict::Explained, "{}", e.summary);
        let found = explained.model.get(effect.name()).unwrap();
        println!("{found:?} of {values:?}");
        for ((value, sigma), truth) in found.values.iter().zip(&found.sigmas).zip(&values) {
            assert!((value - truth).abs() < 2.0 * sigma, "{found:?} of {values:?}");
        }
    }
}

/// Accelerometers away from the gyros look exactly like an antenna on the other side: never the one alone where it may be the other.
#[test]
fn accelerometers_away_from_the_gyros_are_named_where_the_antenna_is_known() {
    let (arm, name) = ([0.4, -0.25, 0.2], "accel_lever_arm");
    let hidden = EffectSetting::known(&effects::AccelLeverArm, &arm).unwrap();
    let flown = fly(&[hidden], Kind::Rich, Family::Tuning, 75).samples;
    let explain = |model: &Model| {
        let explained = samples(std::slice::from_ref(&flown), &[], model, &Settings::default(), &|_| {});
        each_effect_stands_once(&explained.explanation);
        explained
    };
    let unknown = explain(&Model::default()).explanation;
    assert!(unknown.effects.iter().all(|x| x.names == ["gps_lever_arm"]), "{}", unknown.summary);
    let why = unknown.not_found.iter().find(|n| n.name == name).unwrap();
    assert!(why.reason.is_some_and(|r| r.contains("no motion separates")), "{why:?}");
    let mut measured = Model::default();
    measured.set(EffectSetting::known(&effects::GpsLeverArm, &[0.0; 3]).unwrap());
    let explained = explain(&measured);
    let e = &explained.explanation;
    assert_eq!(e.effects.len(), 1, "{}", e.summary);
    let mut names = e.effects[0].names.clone();
    names.sort_unstable();
    assert_eq!(names, [name, "gps_lever_arm"], "{}", e.summary);
    // The best of the two is one or the other; their values are opposite.
    let (best, sign) = explained.model.get(name).map_or(("gps_lever_arm", -1.0), |_| (name, 1.0));
    let found = explained.model.get(best).unwrap();
    for ((value, sigma), truth) in found.values.iter().zip(&found.sigmas).zip(&arm) {
        assert!((value - sign * truth).abs() < 2.0 * sigma && *sigma < 0.1, "{found:?}");
    }
    assert!(e.effects[0].separate_by.as_ref().is_some_and(|s| s.contains("No motion separates them")));
}

#[test]
fn the_time_left_is_stated_once_it_can_be_known() {
    let took = Duration::from_secs(10);
    assert_eq!(Phase::Choosing.time_left(took), "");
    assert_eq!(Phase::Judging.time_left(took), ", at most about 8 s left");
    assert_eq!(Phase::Smoothing.time_left(Duration::ZERO), ", at most about 1 s left");
}

/// An hour of 200 Hz with 5 fixes a second took 459 MB and 75 s of processor time (docs/explain.md).
#[test]
fn what_an_explanation_will_take_is_said_before() {
    let hour = Workload { samples: 720_000, fixes: 18_000 }.words();
    assert!(
        hour.contains(
            "about 27 to 450 s of processor time (up to 2700 s where much is missing) and 477 MB of memory"
        ),
        "{hour}"
    );
    let short = Workload { samples: 1000, fixes: 20 }.words();
    assert!(short.contains("about a second"), "{short}");
}
