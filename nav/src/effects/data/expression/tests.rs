//! Expressions: their value, their dimension, and what is refused.

use super::*;
use crate::effects::testing::instant;
use crate::effects::{Conditions, Instant};
use crate::operating::Operating;

fn at() -> Instant {
    let operating = Operating::default()
        .with(Channel::Throttle, 0.5)
        .with(Channel::Airspeed, 20.0)
        .with(Channel::Mode, 5.0);
    let conditions =
        Conditions { operating, elapsed_s: 30.0, lagged_degc: [1.0, 2.0, 3.0, 4.0], ..Conditions::default() };
    Instant { conditions, ..instant([0.1, -0.2, 0.3], [1.0, 2.0, -9.0]) }
}

fn value(text: &str) -> f64 {
    Expression::parse(text).unwrap().value(&at())
}

#[test]
fn expressions_have_the_value_that_one_reads() {
    for (text, wanted) in [
        ("throttle", 0.5),
        ("w_y*|w_y|", -0.04),
        ("|w_x - w_z|", 0.2),
        ("2*f_x + f_z", -7.0),
        ("f_z^2/f_x", 81.0),
        ("-(f_y - f_x)*3", -3.0),
        ("lag(temperature) - temperature", -4.0),
        ("lag(temperature, 10)", 1.0),
        ("dynamic_pressure", 200.0),
        ("is(mode, 5)*throttle", 0.5),
        ("is(mode, 4)", 0.0),
        ("above(throttle, 0.4)", 1.0),
        ("above(throttle, 0.5)", 0.0),
        ("dead(throttle, 0.2)", 0.3),
        ("dead(-throttle, 0.2)", -0.3),
        ("dead(throttle, 0.6)", 0.0),
        ("sign(w_y)", -1.0),
        ("cos(heading)", 1.0),
        ("time*time", 900.0),
        ("f_x + -f_y", -1.0),
    ] {
        assert!((value(text) - wanted).abs() < 1e-6, "{text}: {}", value(text));
    }
    assert!(value("current").is_nan() && value("is(motor_1, 0)").is_nan());
}

#[test]
fn dimensions_follow_and_unlike_ones_are_no_sum() {
    let dimension = |text: &str| Expression::parse(text).unwrap().dimension();
    assert_eq!(dimension("w_x*f_z"), Dimension([1, -3, 0, 0, 0]));
    assert_eq!(dimension("f_x^2"), Dimension([2, -4, 0, 0, 0]));
    assert_eq!(dimension("current*current"), Dimension([0, 0, 2, 0, 0]));
    assert_eq!(dimension("throttle*sin(heading)"), NONE);
    let error = Expression::parse("throttle + current").unwrap_err().to_string();
    assert!(error.contains("different units"), "{error}");
}

#[test]
fn errors_say_what_and_where() {
    for (text, reason) in [
        ("curent", "no such quantity at \"curent\""),
        ("f_w", "no such quantity"),
        ("(f_x", "\")\" is expected"),
        ("f_x f_y", "operator"),
        ("f_x^2.5", "powers"),
        ("lag(current)", "temperature"),
        ("lag(temperature, 47)", "10, 30, 100"),
        ("sin(f_x)", "angle"),
        ("exp(throttle)", "functions are"),
        ("", "no such quantity"),
    ] {
        let error = Expression::parse(text).unwrap_err().to_string();
        assert!(error.contains(reason), "{text}: {error}");
    }
    assert!(Expression::parse(&"(".repeat(1000)).is_err());
    assert!(Expression::parse(&vec!["f_x"; 1000].join("*")).is_err());
    let nested = "f_x+(".repeat(15) + "f_x" + &")".repeat(15);
    assert!(Expression::parse(&nested).is_ok_and(|e| e.value(&at()).is_finite()));
}
