//! Effects as data: what they add, what is refused, what is written.

use super::*;
use crate::effects::testing::{fix_instant, instant};
use crate::effects::{Conditions, find as find_any, unit};
use crate::operating::{Channel, Operating};

fn with_current(amperes: f64) -> Instant {
    let operating = Operating::default().with(Channel::Current, amperes);
    Instant {
        conditions: Conditions { operating, ..Conditions::default() },
        ..instant([0.1, 0.2, -0.3], [1.0, 2.0, -9.0])
    }
}

#[test]
fn a_formula_is_an_effect_by_its_name() {
    let effect = find_any("formula:gyro~current").unwrap();
    let unit = effect.groups()[0].unit;
    assert_eq!((unit.symbol, unit.suffix, effect.len()), ("deg/h/A", "deg_per_h_per_a", 3));
    let added = effect.gyro(&[0.0, 1e-5, 2e-5], &with_current(10.0));
    assert!((added - Vector3::new(0.0, 1e-4, 2e-4)).norm() < 1e-12);
    assert_eq!(effect.accel(&[1.0; 3], &with_current(10.0)), Vector3::zeros());
    // What is not reported drives nothing.
    assert_eq!(effect.gyro(&[1.0; 3], &instant([0.1; 3], [1.0; 3])), Vector3::zeros());
    assert!(std::ptr::addr_eq(effect, find_any("formula:gyro~current").unwrap()));
    assert!(find_any("formula:gyro~curent").is_none() && find_any("formula:baro~current").is_none());
    assert_eq!(find_any("formula:accel~w_x*|w_x|").unwrap().groups()[0].unit.symbol, "mg/(rad/s)²");
}

/// On a fix a formula adds to north, east and down, by the motion there.
#[test]
fn a_formula_of_fixes_acts_on_fixes_alone() {
    let effect = find_any("formula:velocity~height").unwrap();
    let names: Vec<&str> = effect.groups()[0].names.to_vec();
    assert_eq!((names, effect.groups()[0].unit.symbol), (vec!["north", "east", "down"], "m/s/m"));
    assert!(!effect.acts_on(ActsOn::Samples) && effect.needs_conditions());
    let conditions = Conditions { height_m: 50.0, ..Conditions::default() };
    let x = FixInstant { conditions, ..crate::effects::testing::fix_instant() };
    assert_eq!(effect.fix(&[0.01, 0.0, -0.02], &x), [Vector3::zeros(), Vector3::new(0.5, 0.0, -1.0)]);
    let (mut position, mut velocity) = ([Vector3::zeros(); 3], [Vector3::zeros(); 3]);
    effect.fix_jacobian(&[0.0; 3], &x, &mut position, &mut velocity);
    assert_eq!((position[1], velocity[1]), (Vector3::zeros(), Vector3::y() * 50.0));
    // The specific force is that of the body.
    let pushed = find_any("formula:position~f_z").unwrap().fix(&[1.0, 0.0, 0.0], &x)[0].x;
    let force = x.c_nb.transpose() * (x.a_n - Vector3::z() * crate::earth::STANDARD_GRAVITY);
    assert!((pushed - force.z).abs() < 1e-12);
    // It has neither temperature nor vibration.
    assert!(
        find_any("formula:position~temperature").is_none()
            && find_any("formula:velocity~vibration_x").is_none()
    );
}

#[test]
fn jacobians_are_what_the_effect_adds_per_parameter() {
    load("schema = \"gaware.effects/1\"\n[[effect]]\nname = \"mixed_axes\"\ntarget = \"accel\"\nx = \"current\"\nz = \"2*current\"").unwrap();
    for name in ["formula:gyro~w_x*f_z", "formula:accel~current*current", "mixed_axes"] {
        let (effect, x) = (find_any(name).unwrap(), with_current(3.0));
        let (mut gyro, mut accel) = ([Vector3::zeros(); 3], [Vector3::zeros(); 3]);
        effect.imu_jacobian(&[0.0; 3], &x, &mut gyro, &mut accel);
        for k in 0..3 {
            let mut p = [0.0; 3];
            p[k] = 1.0;
            assert_eq!([effect.gyro(&p, &x), effect.accel(&p, &x)], [gyro[k], accel[k]], "{name} {k}");
        }
    }
}

/// An error of one sensor reaches the other through the driver by the slope of what is added there.
#[test]
fn errors_of_one_sensor_reach_the_other_through_the_driver() {
    let names = [
        "gyro~w_z*f_x",
        "accel~w_x*|w_x|",
        "gyro~f_x/f_z",
        "accel~w_y*f_z",
        "gyro~f*sin(f_y/f)",
        "accel~1/w^2",
    ];
    let (p, h) = ([2.0, -3.0, 5.0], 1e-4);
    let x = Instant {
        rate: Vector3::new(0.3, -0.4, 0.7),
        force: Vector3::new(3.0, 2.0, -9.0),
        ..with_current(3.0)
    };
    for name in names {
        let effect = find_any(&format!("{FORMULA}{name}")).unwrap();
        let (by_force, by_rate) = (effect.gyro_by_force(&p, &x), effect.accel_by_rate(&p, &x));
        assert!(by_force.is_some() != by_rate.is_some(), "{name}");
        for k in 0..3 {
            let step = Vector3::ith(k, h);
            let [more, less] = [step, -step].map(|by| match by_force {
                Some(_) => effect.gyro(&p, &Instant { force: x.force + by, ..x }),
                None => effect.accel(&p, &Instant { rate: x.rate + by, ..x }),
            });
            let (numeric, slope) =
                ((more - less) / (2.0 * h), by_force.or(by_rate).unwrap().column(k).into_owned());
            assert!((numeric - slope).norm() < 1e-5 * (1.0 + slope.norm()), "{name}: {numeric} {slope}");
        }
    }
    let sign = find_any("formula:accel~sign(w_x)").unwrap();
    assert_eq!(sign.accel_by_rate(&p, &x), Some(nalgebra::Matrix3::zeros()));
    assert!(find_any("formula:gyro~current").unwrap().gyro_by_force(&p, &x).is_none());
}

#[test]
fn a_file_defines_effects_and_is_read_again_as_it_was_written() {
    let text = "schema = \"gaware.effects/1\"\n[[effect]]\nname = \"esc_heat\"\ntarget = \"gyro\"\nz = \"current*current\"\n\
                unit = \"deg/h/A2\"\nprior_sigma = 0.5\ncause = \"heat\"\nremedy = \"a shield\"\n";
    let effect = load(text).unwrap()[0];
    assert_eq!((effect.name(), effect.len(), effect.cause()), ("esc_heat", 1, "heat"));
    assert!((effect.groups()[0].prior_sigma / unit::DEG_PER_H.si - 0.5).abs() < 1e-12);
    assert!((effect.gyro(&[2.0], &with_current(3.0)) - Vector3::new(0.0, 0.0, 18.0)).norm() < 1e-12);
    let again = written([definition("esc_heat").unwrap()]);
    assert!(std::ptr::addr_eq(load(&again).unwrap()[0], effect), "{again}");
}

#[test]
fn errors_of_a_file_are_named() {
    let error = |body: &str| {
        load(&format!("schema = \"gaware.effects/1\"\n[[effect]]\n{body}"))
            .expect_err("must be rejected")
            .to_string()
    };
    assert!(load("schema = \"gaware.effects/2\"").unwrap_err().to_string().contains("gaware.effects/1"));
    for (body, wanted) in [
        ("name = \"a1\"\ntarget = \"gyro\"\nx = \"curent\"", "no such quantity"),
        ("name = \"a2\"\ntarget = \"compass\"\nx = \"current\"", "position or velocity"),
        ("name = \"a3\"\ntarget = \"gyro\"", "driver for all axes"),
        ("name = \"a4\"\ntarget = \"gyro\"\nx = \"current\"\nunit = \"deg/h/V\"", "deg/h/A"),
        ("name = \"a5\"\ntarget = \"gyro\"\nx = \"current\"\ny = \"voltage\"", "different units"),
        ("name = \"gps_latency\"\ntarget = \"gyro\"\nx = \"current\"", "catalogue"),
        ("name = \"A 6\"\ntarget = \"gyro\"\nx = \"current\"", "a to z"),
        ("name = \"a7\"\ntarget = \"gyro\"\nx = \"current\"\nprior_sigma = -1.0", "positive"),
        ("name = \"a8\"\ntarget = \"gyro\"\nx = \"current\"\nsigma = 1.0", "sigma"),
    ] {
        let error = error(body);
        assert!(error.contains(wanted), "{body}: {error}");
    }
    let first = "name = \"twice\"\ntarget = \"gyro\"\nx = \"current\"";
    load(&format!("schema = \"gaware.effects/1\"\n[[effect]]\n{first}")).unwrap();
    assert!(error(&first.replace("current", "voltage")).contains("otherwise"));
}

#[test]
fn every_formula_of_the_grammar_is_an_effect_of_a_sensible_prior() {
    for driver in grammar::drivers() {
        let expression = Expression::parse(driver).unwrap();
        for target in Target::ALL.into_iter().filter(|t| t.can_have(&expression)) {
            let name = format!("{FORMULA}{}~{driver}", target.name());
            let effect = find_any(&name).unwrap_or_else(|| panic!("{name}"));
            assert!(effect.groups()[0].prior_sigma.is_finite() && effect.prior_cost() > 0.0);
            assert!(!effect.description().is_empty() && effect.name() == name);
        }
    }
}

#[test]
fn an_offset_that_turns_with_the_vehicle_is_ahead_of_it_by_its_heading() {
    let effect = find_any("formula:position~heading").unwrap();
    assert_eq!(effect.groups()[0].names, ["ahead", "right", "down"]);
    let at = |heading_rad: f64| {
        let mut x = fix_instant();
        x.conditions.heading_rad = heading_rad;
        effect.fix(&[2.0, 1.0, 0.5], &x)
    };
    let [north, east] = [at(0.0), at(std::f64::consts::FRAC_PI_2)];
    assert!((north[0] - Vector3::new(2.0, 1.0, 0.5)).norm() < 1e-12, "{north:?}");
    assert!((east[0] - Vector3::new(-1.0, 2.0, 0.5)).norm() < 1e-12, "{east:?}");
    assert_eq!(east[1], Vector3::zeros());
    let (mut position, mut velocity) = ([Vector3::zeros(); 3], [Vector3::zeros(); 3]);
    let mut x = fix_instant();
    x.conditions.heading_rad = 2.0;
    effect.fix_jacobian(&[0.0; 3], &x, &mut position, &mut velocity);
    for k in 0..3 {
        let mut p = [0.0; 3];
        p[k] = 1.0;
        assert_eq!(position[k], effect.fix(&p, &x)[0]);
    }
    // A sensor has no such axes.
    assert_eq!(find_any("formula:gyro~heading").unwrap().groups()[0].names, ["x", "y", "z"]);
}
