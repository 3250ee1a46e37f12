//! The file, and what a model makes of it.

use super::*;
use gaware_nav::earth::Geodetic;
use gaware_nav::filter::Initial;
use gaware_nav::mechanization::NavState;
use nalgebra::{Matrix3, Vector3};

fn initial() -> Initial {
    let place = Geodetic::from_degrees(47.0, 8.0, 400.0);
    Initial {
        t_s: 0.0,
        nav: NavState::from_ned(place, &Vector3::zeros(), &Matrix3::identity()),
        position_sigma_m: [1.0; 3],
        velocity_sigma_m_per_s: [0.1; 3],
        attitude_sigma_rad: [0.1; 3],
    }
}

fn unit() -> Unit {
    let filter = Filter::new(&Model::standard(), &initial());
    let origin = Origin { date: "2026-11-24".into(), hardware_id: Some("ab12".into()), ..Origin::default() };
    let mut unit = Unit::of_filter(&filter, origin);
    for (name, value, sigma) in [("g11", 120.0, 8.0), ("g33", -250.0, 9.0), ("sg_x", 900.0, 200.0)] {
        let state = unit.states.iter_mut().find(|s| s.name == name).unwrap();
        (state.value, state.sigma) = (value, sigma);
    }
    unit
}

#[test]
fn a_file_comes_back_as_it_was_written_and_holds_nothing_of_the_receiver() {
    let unit = unit();
    assert_eq!(Unit::parse(&unit.to_toml()).unwrap(), unit);
    assert!(unit.get("bg_x").is_some() && unit.get("g33").is_some());
    assert!(unit.states.iter().all(|s| !s.effect.starts_with("gps")), "{:?}", unit.states);
    assert_eq!(unit.measured(), ["g11", "g33", "sg_x"]);
}

#[test]
fn a_damaged_file_is_refused_in_words() {
    let text = unit().to_toml();
    for (from, to, said) in [
        ("gaware.unit/1", "gaware.unit/9", "its schema"),
        ("2026-11-24", "yesterday", "is no date"),
        ("sigma = 8.0", "sigma = -8.0", "g11 has no finite value"),
        ("covariance = [[", "covariance = [[1.0], [", "lower triangle"),
        ("name = \"g12\"", "name = \"g11\"", "g11 stands in it twice"),
        ("unit = \"deg/h\"", "unit = \"deg/s\"", "in \"deg/s\", and must be in \"deg/h\""),
        ("unit = \"ppm\"", "unit = \"%\"", "must be in \"ppm\""),
    ] {
        assert!(text.contains(from), "{from}");
        let reason = Unit::parse(&text.replacen(from, to, 1)).unwrap_err();
        assert!(reason.contains(said), "{reason}");
    }
}

#[test]
fn a_model_takes_its_values_for_priors_that_age() {
    let unit = unit();
    let sigma = |today: &str| {
        let mut model = Model::standard();
        unit.apply(&mut model, today);
        let g = model.get("gyro_g_sensitivity").unwrap();
        let si = gaware_nav::effects::unit::DEG_PER_H_PER_G.si;
        assert!((g.values[0] / si - 120.0).abs() < 1e-9);
        assert!(model.is_tolerance("gyro_scale_factor"));
        assert!((model.get("gyro_scale_factor").unwrap().values[0] - 900e-6).abs() < 1e-12);
        (g.sigmas[0] / si, model.imu.gyro_bias_sigma)
    };
    let (now, bias) = sigma("2026-11-24");
    assert!((now - 8.0).abs() < 1e-9, "{now}");
    assert!(bias <= Model::standard().imu.gyro_bias_sigma);
    let (later, _) = sigma("2027-11-24");
    assert!(later > 5.0 * now, "{later}");
}

/// A recording says more of bias and G together than of each: a filter that begins with the file knows the sum as well as the file does.
#[test]
fn a_filter_begins_with_all_of_the_covariance() {
    let mut unit = unit();
    let k = |unit: &Unit, name: &str| unit.states.iter().position(|s| s.name == name).unwrap();
    let (bias, g) = (k(&unit, "bg_x"), k(&unit, "g13"));
    let sigma = |unit: &Unit, k: usize| unit.covariance[k][k].sqrt();
    let (low, high) = (bias.min(g), bias.max(g));
    unit.covariance[high][low] = 0.9 * sigma(&unit, low) * sigma(&unit, high);
    let unit = Unit::parse(&unit.to_toml()).unwrap();
    let mut model = Model::standard();
    unit.apply(&mut model, "2026-11-24");
    let filter = Filter::new(&model, &initial());
    let at = |name: &str| filter.layout().find(name).unwrap();
    let p = filter.covariance();
    let correlation = p.at(at("bg_x"), at("g13")) / (p.sigma(at("bg_x")) * p.sigma(at("g13")));
    // A turn-on adds a tenth of the prior to the bias alone, which is as large as its own sigma.
    assert!(correlation > 0.85, "{correlation}");
    let sum = Unit::of_filter(&filter, Origin { date: "2026-11-24".into(), ..Origin::default() });
    assert!((sum.correlation(k(&sum, "bg_x"), k(&sum, "g13")) - correlation).abs() < 1e-9);
    // A recording keeps the model as a file: it holds all of it.
    let read = Model::from_toml(&model.to_toml()).unwrap();
    assert_eq!(read.joint, model.joint);
    // Correlations that nothing can have are refused.
    let mut wrong = unit;
    wrong.covariance[high][low] *= 1.2;
    assert!(Unit::parse(&wrong.to_toml()).unwrap_err().contains("positive"));
}

#[test]
fn what_a_model_takes_for_known_stays_known() {
    let mut model = Model::standard();
    let known = EffectSetting::known(&gaware_nav::effects::GYRO_G_SENSITIVITY, &[0.0; 9]).unwrap();
    model.set(known);
    unit().apply(&mut model, "2026-11-24");
    assert!(model.get("gyro_g_sensitivity").unwrap().values.iter().all(|v| *v == 0.0));
}

#[test]
fn another_result_within_four_sigma_agrees_and_one_beyond_contradicts() {
    let (old, mut new) = (unit(), unit());
    let state = new.states.iter_mut().find(|s| s.name == "g33").unwrap();
    state.value = -220.0;
    assert_eq!(old.contradictions(&new), Vec::<String>::new());
    new.states.iter_mut().find(|s| s.name == "g33").unwrap().value = -120.0;
    let said = old.contradictions(&new);
    assert!(said.len() == 1 && said[0].starts_with("g33: -250.0"), "{said:?}");
}

#[test]
fn a_result_that_began_from_an_earlier_one_keeps_where_that_came_from() {
    let (before, mut next) = (unit(), unit());
    next.origin = Origin { date: "2026-12-01".into(), from: vec!["second".into()], ..Origin::default() };
    let state = next.states.iter_mut().find(|s| s.name == "g33").unwrap();
    // The earlier result was where the filter began.
    (state.sigma, state.prior_sigma) = (6.0, 9.0);
    let both = next.after(&before);
    assert_eq!(both.origin.hardware_id.as_deref(), Some("ab12"));
    assert!(both.measured().contains(&"g33"), "{:?}", both.get("g33"));
}

/// By the id that the vehicle names, whatever the file is called; the newest of several, and no other vehicle's.
#[test]
fn a_unit_is_found_by_its_hardware_id() {
    let folder = std::env::temp_dir().join(format!("gaware-units-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let write = |name: &str, id: &str, date: &str| {
        let mut unit = unit();
        (unit.origin.hardware_id, unit.origin.date) = (Some(id.into()), date.into());
        std::fs::write(folder.join(name), unit.to_toml()).unwrap();
    };
    write("a.toml", "ab12", "2026-01-01");
    write("b.toml", "ab12", "2026-03-01");
    write("c.toml", "cd34", "2026-05-01");
    std::fs::write(folder.join("d.toml"), "not = 'a unit'").unwrap();
    assert_eq!(find(&folder, "ab12").unwrap(), Some(folder.join("b.toml")));
    assert_eq!(find(&folder, "ef56").unwrap(), None);
    assert_eq!(file_of(Path::new("units"), "../x"), Path::new("units/___x.toml"));
}

#[test]
fn a_file_of_other_hardware_is_refused() {
    let (unit, path) = (unit(), Path::new("unit.toml"));
    assert!(unit.check_hardware(path, Some("ab12")).is_ok() && unit.check_hardware(path, None).is_ok());
    let error = unit.check_hardware(path, Some("cd34")).unwrap_err().to_string();
    assert!(error.contains("ab12") && error.contains("cd34"), "{error}");
}

/// What comes of six sides by hand of a unit with the given values where the estimate begins from this file.
fn turned_by_hand(truth: &Model, file: Option<&Unit>) -> crate::engine::Engine {
    use gaware_sitl::sensors::Flight;
    use gaware_sitl::trajectory::{Flown, hand::Hand};
    use gaware_sitl::truth::Trajectory;
    let base = gaware_sitl::scenario::scenario("hand").unwrap();
    let mut model = Model::standard();
    file.into_iter().for_each(|unit| unit.apply(&mut model, "2026-11-24"));
    let path = Flown::with_step(Hand::six_sides(20.0), 0.02);
    let place = Some(path.clone().truth_at(0.0).place);
    let options = crate::engine::EngineOptions { place, ..Default::default() };
    let mut engine = crate::engine::Engine::new(model, options);
    let mut sensors = base.sensors.clone();
    (sensors.imu_rate_hz, sensors.attitude_rate_hz) = (50.0, 5.0);
    (sensors.quantisation, sensors.message) = (gaware_nav::sample::Quantisation::None, "HIGHRES_IMU".into());
    for (sample, _) in Flight::new(Box::new(path), truth, sensors, 7) {
        if !matches!(sample, gaware_nav::sample::Sample::Fix(_)) {
            engine.feed(&sample);
        }
    }
    engine
}

/// A file of another unit is found out by what is measured, said, and believed no more; that of the unit itself is not.
#[test]
fn a_file_that_the_data_contradict_is_said_and_not_believed() {
    let mut truth = gaware_sitl::sensors::draw_vehicle(&Model::standard(), 5);
    truth.gnss = gaware_sitl::scenario::scenario("hand").unwrap().model.gnss.clone();
    let alone = turned_by_hand(&truth, None);
    let origin = Origin { date: "2026-11-24".into(), ..Origin::default() };
    let own = Unit::of_filter(alone.filter().unwrap(), origin);
    let said = |engine: &crate::engine::Engine| {
        engine.summary().warnings.iter().any(|w| w.contains("the unit's file is inconsistent"))
    };
    let with_own = turned_by_hand(&truth, Some(&own));
    assert!(!said(&with_own), "{:?}", with_own.summary().warnings);
    assert!(with_own.filter().unwrap().model().joint.is_some());
    // Another part on the board: twelve sigmas off in one element.
    let mut other = own.clone();
    let state = other.states.iter_mut().find(|s| s.name == "g21").unwrap();
    state.value += 12.0 * state.sigma.max(8.0);
    let with_other = turned_by_hand(&truth, Some(&other));
    assert!(said(&with_other), "{:?}", with_other.summary().warnings);
    let g = with_other.summary().estimate.g_sensitivity_deg_per_h_per_g;
    let values = &truth.get("gyro_g_sensitivity").unwrap().values;
    for (k, true_si) in values.iter().enumerate() {
        let off = g.value[k / 3][k % 3] - true_si / gaware_nav::effects::unit::DEG_PER_H_PER_G.si;
        let sigma = g.sigma[k / 3][k % 3];
        assert!(off.abs() < 4.0 * sigma, "g{}{}: {off} ± {sigma}", k / 3 + 1, k % 3 + 1);
    }
}

/// What flights show of a model that began from the file.
#[test]
fn an_explanation_far_from_the_file_contradicts_it() {
    let unit = unit();
    let mut before = Model::standard();
    unit.apply(&mut before, "2026-11-24");
    let shown = |value: f64| {
        let mut after = before.clone();
        let mut g = after.get("gyro_g_sensitivity").unwrap().clone();
        let si = gaware_nav::effects::unit::DEG_PER_H_PER_G.si;
        (g.values[0], g.sigmas[0]) = (value * si, 4.0 * si);
        after.set(g);
        unit.contradicted_by(&before, &after)
    };
    assert_eq!(shown(135.0), None);
    assert!(shown(160.0).is_some_and(|said| said.starts_with("g11: 120")));
}
