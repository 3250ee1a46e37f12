//! Expressions over what an effect may depend on: `throttle`, `w_x*|w_x|`, `lag(temperature, 100) - temperature`. A small recursive-descent
//! parser with dimensions (Aho, Lam, Sethi & Ullman 2006, section 4.4), and a stack machine that evaluates the result once per sample.

use crate::effects::Instant;
use crate::effects::linear::Sensor;
use crate::math::{cos, sin};
use crate::operating::{Channel, LAGS_S};
use nalgebra::Vector3;
use std::fmt;

/// Powers of metre, second, ampere, volt, degree Celsius; angles have no dimension.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dimension(pub [i8; 5]);

const NONE: Dimension = Dimension([0; 5]);
/// Of an angular rate, rad/s.
const RATE: Dimension = Dimension([0, -1, 0, 0, 0]);
/// Of a specific force, m/s².
const FORCE: Dimension = Dimension([1, -2, 0, 0, 0]);

impl Dimension {
    fn times(self, other: Self, sign: i8) -> Self {
        Self(std::array::from_fn(|k| self.0[k].saturating_add(sign.saturating_mul(other.0[k]))))
    }
}

/// A quantity that expressions know.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Variable {
    Force(usize),
    Rate(usize),
    RateDerivative(usize),
    ForceSize,
    RateSize,
    Vibration(usize),
    Temperature,
    Lagged(usize),
    Operating(Channel),
    /// Per density of the air, m²/s²: half the square of the airspeed.
    DynamicPressure,
    Speed,
    Height,
    Heading,
    Time,
}

const AXES: [&str; 3] = ["x", "y", "z"];

impl Variable {
    fn of(name: &str) -> Option<Self> {
        if let Some((stem, axis)) = name.rsplit_once('_')
            && let Some(axis) = AXES.iter().position(|a| *a == axis)
        {
            return Some(match stem {
                "f" => Self::Force(axis),
                "w" => Self::Rate(axis),
                "wdot" => Self::RateDerivative(axis),
                "vibration" => Self::Vibration(axis),
                _ => return None,
            });
        }
        Some(match name {
            "f" => Self::ForceSize,
            "w" => Self::RateSize,
            "temperature" => Self::Temperature,
            "dynamic_pressure" => Self::DynamicPressure,
            "speed" => Self::Speed,
            "height" => Self::Height,
            "heading" => Self::Heading,
            "time" => Self::Time,
            _ => Self::Operating(Channel::all().find(|c| c.name() == name)?),
        })
    }

    fn dimension(self) -> Dimension {
        Dimension(match self {
            Self::Force(_) | Self::ForceSize => return FORCE,
            Self::Rate(_) | Self::RateSize => return RATE,
            Self::RateDerivative(_) => [0, -2, 0, 0, 0],
            Self::Vibration(_) => [2, -4, 0, 0, 0],
            Self::Temperature | Self::Lagged(_) => [0, 0, 0, 0, 1],
            Self::Operating(Channel::Current) => [0, 0, 1, 0, 0],
            Self::Operating(Channel::Voltage) => [0, 0, 0, 1, 0],
            Self::Operating(Channel::Airspeed) | Self::Speed => [1, -1, 0, 0, 0],
            Self::DynamicPressure => [2, -2, 0, 0, 0],
            Self::Height => [1, 0, 0, 0, 0],
            Self::Time => [0, 1, 0, 0, 0],
            Self::Operating(_) | Self::Heading => [0; 5],
        })
    }

    /// Its value; not a number where nothing reports it.
    fn value(self, x: &Instant) -> f64 {
        let conditions = &x.conditions;
        let reported = |channel| conditions.operating.get(channel).unwrap_or(f64::NAN);
        match self {
            Self::Force(k) => x.force[k],
            Self::Rate(k) => x.rate[k],
            Self::RateDerivative(k) => x.around.rate_derivatives[0][k],
            Self::ForceSize => x.force.norm(),
            Self::RateSize => x.rate.norm(),
            Self::Vibration(k) => x.around.vibration[k],
            Self::Temperature => x.temperature_above_25_degc,
            Self::Lagged(k) => conditions.lagged_degc[k],
            Self::Operating(channel) => reported(channel),
            Self::DynamicPressure => 0.5 * reported(Channel::Airspeed).powi(2),
            Self::Speed => conditions.speed,
            Self::Height => conditions.height_m,
            Self::Heading => conditions.heading_rad,
            Self::Time => conditions.elapsed_s,
        }
    }
}

/// One step of the stack machine.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Number(f64),
    Variable(Variable),
    Add,
    Subtract,
    Multiply,
    Divide,
    Negate,
    Absolute,
    Sign,
    Sine,
    Cosine,
    Power(i8),
    Equal(f64),
    /// One above this, otherwise zero.
    Above(f64),
    /// What is beyond a dead zone of so much to both sides.
    Dead(f64),
}

impl Step {
    /// What one with a single operand makes of it, and the slope there.
    fn of(self, a: f64) -> (f64, f64) {
        let sign = if a == 0.0 { 0.0 } else { a.signum() };
        match self {
            Self::Negate => (-a, -1.0),
            Self::Absolute => (a.abs(), sign),
            Self::Sign => (sign, 0.0),
            Self::Sine => (sin(a), cos(a)),
            Self::Cosine => (cos(a), -sin(a)),
            Self::Power(n) => (a.powi(i32::from(n)), f64::from(n) * a.powi(i32::from(n) - 1)),
            Self::Equal(v) if a.is_finite() => (f64::from(u8::from(a == v)), 0.0),
            Self::Above(v) if a.is_finite() => (f64::from(u8::from(a > v)), 0.0),
            Self::Dead(v) if a.abs() > v => (a - v.copysign(a), 1.0),
            Self::Dead(_) if a.is_finite() => (0.0, 0.0),
            _ => (f64::NAN, 0.0),
        }
    }
}

/// Values on the stack at once.
const DEPTH: usize = 16;
/// Steps of an expression.
const MOST_STEPS: usize = 64;
/// Parentheses within each other.
const MOST_NESTED: usize = 16;

/// Why a text is no expression.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason} at \"{}\"", rest.chars().take(24).collect::<String>())]
pub struct ExpressionError {
    /// What is wrong.
    pub reason: String,
    /// The text from there on.
    pub rest: String,
}

/// An expression.
#[derive(Debug, Clone, PartialEq)]
pub struct Expression {
    text: String,
    steps: Vec<Step>,
    dimension: Dimension,
}

impl Expression {
    /// Reads a text.
    ///
    /// # Errors
    /// Unknown names, what does not end, sums of different dimensions.
    pub fn parse(text: &str) -> Result<Self, ExpressionError> {
        let mut parser = Parser { rest: text, steps: Vec::new(), nested: 0 };
        let dimension = parser.sum()?;
        if !parser.rest.trim().is_empty() {
            return Err(parser.error("an operator is expected"));
        }
        let mut depth = 0_usize;
        for step in &parser.steps {
            match step {
                Step::Number(_) | Step::Variable(_) => depth += 1,
                Step::Add | Step::Subtract | Step::Multiply | Step::Divide => depth -= 1,
                _ => {}
            }
            if depth > DEPTH {
                return Err(parser.error("the expression is nested too deeply"));
            }
        }
        let text = text.split_whitespace().collect();
        Ok(Self { text, steps: parser.steps, dimension })
    }

    /// Its value; not a number where something that it depends on is not reported.
    pub fn value(&self, x: &Instant) -> f64 {
        self.run(x, |_| []).0
    }

    /// Its derivative by the axes of the specific force, or of the angular rate.
    pub fn by_motion(&self, x: &Instant, of: Sensor) -> [f64; 3] {
        let size = |v: &Vector3<f64>| v.try_normalize(0.0).unwrap_or_default();
        let axis = |k: usize| std::array::from_fn(|i| f64::from(u8::from(i == k)));
        self.run(x, |v| match (v, of) {
            (Variable::Force(k), Sensor::Accel) | (Variable::Rate(k), Sensor::Gyro) => axis(k),
            (Variable::ForceSize, Sensor::Accel) => size(&x.force).into(),
            (Variable::RateSize, Sensor::Gyro) => size(&x.rate).into(),
            _ => [0.0; 3],
        })
        .1
    }

    /// Value and derivatives together (forward-mode differentiation), `seed` being the derivatives of each variable.
    fn run<const N: usize>(&self, x: &Instant, seed: impl Fn(Variable) -> [f64; N]) -> (f64, [f64; N]) {
        let mut stack = [(0.0, [0.0; N]); DEPTH];
        let mut top = 0;
        for step in &self.steps {
            match *step {
                Step::Number(_) | Step::Variable(_) => {
                    stack[top] = match *step {
                        Step::Variable(v) => (v.value(x), seed(v)),
                        Step::Number(v) => (v, [0.0; N]),
                        _ => (f64::NAN, [0.0; N]),
                    };
                    top += 1;
                }
                Step::Add | Step::Subtract | Step::Multiply | Step::Divide => {
                    let ((a, by_a), (b, by_b)) = (stack[top - 2], stack[top - 1]);
                    top -= 1;
                    let (value, a_slope, b_slope) = match step {
                        Step::Add => (a + b, 1.0, 1.0),
                        Step::Subtract => (a - b, 1.0, -1.0),
                        Step::Multiply => (a * b, b, a),
                        _ => (a / b, 1.0 / b, -a / (b * b)),
                    };
                    stack[top - 1] = (value, std::array::from_fn(|k| a_slope * by_a[k] + b_slope * by_b[k]));
                }
                one => {
                    let (a, by_a) = stack[top - 1];
                    let (value, slope) = one.of(a);
                    stack[top - 1] = (value, by_a.map(|by| slope * by));
                }
            }
        }
        stack[0]
    }

    /// Without spaces.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Of its value.
    pub fn dimension(&self) -> Dimension {
        self.dimension
    }

    fn any(&self, of: fn(&Variable) -> bool) -> bool {
        self.steps.iter().any(|s| matches!(s, Step::Variable(v) if of(v)))
    }

    /// Whether it depends on a temperature.
    pub fn needs_temperature(&self) -> bool {
        self.any(|v| matches!(v, Variable::Temperature | Variable::Lagged(_)))
    }

    /// Whether it depends on what samples around the present one show.
    pub fn needs_surroundings(&self) -> bool {
        self.any(|v| matches!(v, Variable::RateDerivative(_) | Variable::Vibration(_)))
    }

    /// Whether it depends on what this sensor measures.
    pub fn needs_motion(&self, of: Sensor) -> bool {
        match of {
            Sensor::Accel => self.any(|v| matches!(v, Variable::Force(_) | Variable::ForceSize)),
            Sensor::Gyro => self.any(|v| matches!(v, Variable::Rate(_) | Variable::RateSize)),
        }
    }

    /// Whether it depends on vibration.
    pub fn needs_vibration(&self) -> bool {
        self.any(|v| matches!(v, Variable::Vibration(_)))
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

struct Parser<'a> {
    rest: &'a str,
    steps: Vec<Step>,
    nested: usize,
}

impl<'a> Parser<'a> {
    fn error(&self, reason: &str) -> ExpressionError {
        ExpressionError { reason: reason.to_owned(), rest: self.rest.to_owned() }
    }

    fn eat(&mut self, c: char) -> bool {
        self.rest = self.rest.trim_start();
        let rest = self.rest.strip_prefix(c);
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    fn expect(&mut self, c: char) -> Result<(), ExpressionError> {
        if self.eat(c) { Ok(()) } else { Err(self.error(&format!("\"{c}\" is expected"))) }
    }

    fn push(&mut self, step: Step) -> Result<(), ExpressionError> {
        if self.steps.len() == MOST_STEPS {
            return Err(self.error("the expression is too long"));
        }
        self.steps.push(step);
        Ok(())
    }

    fn sum(&mut self) -> Result<Dimension, ExpressionError> {
        self.nested += 1;
        if self.nested > MOST_NESTED {
            return Err(self.error("too many parentheses"));
        }
        let dimension = self.product()?;
        loop {
            let step = match self.eat('+') {
                true => Step::Add,
                false if self.eat('-') => Step::Subtract,
                false => break,
            };
            if self.product()? != dimension {
                return Err(self.error("a sum of different units ends"));
            }
            self.push(step)?;
        }
        self.nested -= 1;
        Ok(dimension)
    }

    fn product(&mut self) -> Result<Dimension, ExpressionError> {
        let mut dimension = self.power()?;
        loop {
            let (step, sign) = match self.eat('*') {
                true => (Step::Multiply, 1),
                false if self.eat('/') => (Step::Divide, -1),
                false => return Ok(dimension),
            };
            dimension = dimension.times(self.power()?, sign);
            self.push(step)?;
        }
    }

    fn power(&mut self) -> Result<Dimension, ExpressionError> {
        if self.eat('-') {
            let dimension = self.atom()?;
            self.push(Step::Negate)?;
            return Ok(dimension);
        }
        let dimension = self.atom()?;
        if !self.eat('^') {
            return Ok(dimension);
        }
        let n = self.number()?;
        if !(1.0..=4.0).contains(&n) || n.fract() != 0.0 {
            return Err(self.error("powers are 1 to 4"));
        }
        self.push(Step::Power(n as i8))?;
        Ok((1..n as i8).fold(dimension, |product, _| product.times(dimension, 1)))
    }

    fn number(&mut self) -> Result<f64, ExpressionError> {
        self.rest = self.rest.trim_start();
        let digits = |c: char| c.is_ascii_digit() || c == '.';
        let end = self.rest.find(|c| !digits(c)).unwrap_or(self.rest.len());
        let (number, rest) = self.rest.split_at(end);
        let value: f64 = number.parse().map_err(|_| self.error("a number is expected"))?;
        self.rest = rest;
        Ok(value)
    }

    fn word(&mut self) -> &'a str {
        self.rest = self.rest.trim_start();
        let end = self.rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest;
        word
    }

    fn atom(&mut self) -> Result<Dimension, ExpressionError> {
        if self.eat('(') {
            let dimension = self.sum()?;
            self.expect(')')?;
            return Ok(dimension);
        }
        if self.eat('|') {
            let dimension = self.sum()?;
            self.expect('|')?;
            self.push(Step::Absolute)?;
            return Ok(dimension);
        }
        self.rest = self.rest.trim_start();
        if self.rest.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
            let value = self.number()?;
            self.push(Step::Number(value))?;
            return Ok(NONE);
        }
        let before = self.rest;
        let word = self.word();
        if self.eat('(') {
            let dimension = self.function(word, before)?;
            self.expect(')')?;
            return Ok(dimension);
        }
        let Some(variable) = Variable::of(word) else {
            self.rest = before;
            return Err(self.error("there is no such quantity"));
        };
        self.push(Step::Variable(variable))?;
        Ok(variable.dimension())
    }

    fn function(&mut self, name: &str, before: &'a str) -> Result<Dimension, ExpressionError> {
        if name == "lag" {
            if self.word() != "temperature" {
                return Err(
                    self.error("lag(temperature, SECONDS) is the only lag; other quantities have none")
                );
            }
            let tau = if self.eat(',') { self.number()? } else { LAGS_S[2] };
            let Some(k) = LAGS_S.iter().position(|t| *t == tau) else {
                return Err(self.error("a lag is one of 10, 30, 100 (the usual one) and 300 s, found"));
            };
            self.push(Step::Variable(Variable::Lagged(k)))?;
            return Ok(Variable::Lagged(k).dimension());
        }
        let dimension = self.sum()?;
        let (step, dimension) = match name {
            "abs" => (Step::Absolute, dimension),
            "sign" => (Step::Sign, NONE),
            "sin" | "cos" if dimension != NONE => return Err(self.error("sin and cos take an angle")),
            "sin" => (Step::Sine, NONE),
            "cos" => (Step::Cosine, NONE),
            "is" | "above" | "dead" => {
                self.expect(',')?;
                let limit = self.number()?;
                match name {
                    "is" => (Step::Equal(limit), NONE),
                    "above" => (Step::Above(limit), NONE),
                    _ => (Step::Dead(limit), dimension),
                }
            }
            _ => {
                self.rest = before;
                return Err(self.error(
                    "functions are abs, sign, sin, cos, lag(temperature, s), is(mode, n), above(…, n), dead(…, n); found",
                ));
            }
        };
        self.push(step)?;
        Ok(dimension)
    }
}

#[cfg(test)]
mod tests;
