//! Effects as data: what an effect adds to the gyros, the accelerometers, the position or the velocity of fixes is a parameter times an expression, per
//! axis. Users write them in files (`gaware.effects/1`), and a name like `formula:gyro~current` is one by itself: all three gyros, each with a
//! coefficient of its own.
//!
//! An effect of a model lives as long as the program, like those of the catalogue. So does one that is defined here: it is leaked, once for
//! each name, and a second definition of the same name must be the same.

pub mod expression;
mod file;
pub mod grammar;
mod target;

use super::linear::Sensor;
use super::{ActsOn, Effect, FixInstant, Instant, ParameterGroup, REGISTRY, Shape, Unit};
use crate::math::{cos, sin};
use expression::{Dimension, Expression, ExpressionError};
pub use file::{check, is_one, load, written};
use nalgebra::{Matrix3, Vector3};
use std::sync::{PoisonError, RwLock};
pub use target::Target;

/// What begins the name of an effect that is a formula.
pub const FORMULA: &str = "formula:";

/// Why a definition is none.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DefinitionError {
    /// The file is no TOML, or holds what it must not.
    #[error("{0}")]
    Syntax(String),
    /// Of another kind or version.
    #[error("schema \"{0}\" is not \"gaware.effects/1\"")]
    Schema(String),
    /// An expression that is none.
    #[error("effect \"{name}\": {source}")]
    Expression {
        /// Of the effect.
        name: String,
        /// What is wrong.
        source: ExpressionError,
    },
    /// Anything else about an effect.
    #[error("effect \"{name}\": {reason}")]
    Effect {
        /// Of the effect.
        name: String,
        /// What is wrong.
        reason: String,
    },
}

/// What a definition says, before it is an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Definition {
    /// Name.
    pub name: String,
    /// What it adds to.
    pub target: Target,
    /// What drives each axis (x, y, z of a sensor; north, east, down of a fix), if anything.
    pub drivers: [Option<Expression>; 3],
    /// Prior 1-sigma of every coefficient in the unit of the effect; `None`: what a disturbance of a consumer unit comes to.
    pub prior_sigma: Option<f64>,
    /// One line for people.
    pub description: String,
    /// What usually causes it.
    pub cause: String,
    /// What to do about it.
    pub remedy: String,
}

/// An effect that is data.
#[derive(Debug)]
pub struct DataEffect {
    definition: &'static Definition,
    groups: &'static [ParameterGroup],
    /// Axis and driver of each parameter.
    cells: Vec<(usize, Option<Expression>)>,
    /// Whether one driver is that of all axes.
    uniform: bool,
    /// Whether its axes turn with the vehicle ([`Definition::turns`]).
    turns: bool,
}

/// So many effects at most: each lives as long as the program.
const MOST: usize = 4096;

/// Every effect that was defined.
static DEFINED: RwLock<Vec<&'static DataEffect>> = RwLock::new(Vec::new());

fn defined(name: &str) -> Option<&'static DataEffect> {
    let all = DEFINED.read().unwrap_or_else(PoisonError::into_inner);
    all.iter().find(|e| e.definition.name == name).copied()
}

/// The effect of this name, if it was defined or is a formula.
pub fn find(name: &str) -> Option<&'static dyn Effect> {
    if let Some(effect) = defined(name) {
        return Some(effect);
    }
    define(Definition::of_formula(name)?).ok()
}

/// The definition of an effect that is data.
pub fn definition(name: &str) -> Option<&'static Definition> {
    find(name)?;
    defined(name).map(|e| e.definition)
}

/// What an effect that is data adds, with these parameters, to what it acts on; `None` for all others.
pub fn added(name: &str, p: &[f64], x: &Instant) -> Option<(Target, Vector3<f64>)> {
    let effect = defined(name)?;
    Some((effect.definition.target, effect.added(effect.definition.target, p, x)))
}

/// Unit in SI of the coefficients of an effect that is data.
pub fn si_unit(definition: &Definition) -> String {
    let dimension = definition.drivers.iter().flatten().next().map(Expression::dimension);
    let base = definition.target.si_unit();
    match dimension.map(|d| per(d).0).filter(|per| !per.is_empty()) {
        Some(per) => format!("{base}/{}", per.replace("²)", "2)").replace('²', "^2").replace('·', "*")),
        None => base.to_owned(),
    }
}

/// Makes an effect of a definition.
///
/// # Errors
/// A name that is taken, an effect that drives nothing.
pub fn define(definition: Definition) -> Result<&'static dyn Effect, DefinitionError> {
    let name = definition.name.clone();
    let failed = |reason: &str| DefinitionError::Effect { name: name.clone(), reason: reason.to_owned() };
    if REGISTRY.iter().any(|e| e.name() == name) || super::MISTAKES.iter().any(|e| e.name() == name) {
        return Err(failed("the catalogue has an effect of this name"));
    }
    if let Some(old) = defined(&name) {
        return if *old.definition == definition {
            Ok(old)
        } else {
            Err(failed("it is defined otherwise already"))
        };
    }
    let effect = DataEffect::new(definition).map_err(|reason| failed(&reason))?;
    let mut all = DEFINED.write().unwrap_or_else(PoisonError::into_inner);
    // Another thread may have been first.
    if let Some(old) = all.iter().find(|e| e.definition.name == name) {
        return Ok(*old);
    }
    if all.len() == MOST {
        return Err(failed("too many effects are defined"));
    }
    let effect: &'static DataEffect = Box::leak(Box::new(effect));
    all.push(effect);
    Ok(effect)
}

impl Definition {
    /// Whether its coefficients are ahead of the vehicle, right of it and down, turned to north and east by the heading.
    pub fn turns(&self) -> bool {
        self.drivers.iter().all(|d| d.as_ref().is_some_and(|d| self.target.turns_with(d)))
    }

    /// Its axes.
    pub fn axes(&self) -> &'static [&'static str; 3] {
        if self.turns() { &["ahead", "right", "down"] } else { self.target.axes() }
    }

    /// Of a name like `formula:gyro~w_x*|w_x|`.
    pub fn of_formula(name: &str) -> Option<Self> {
        let (target, driver) = name.strip_prefix(FORMULA)?.split_once('~')?;
        let target = Target::of_name(target)?;
        let driver = Expression::parse(driver).ok().filter(|d| target.can_have(d))?;
        Some(Self {
            name: name.to_owned(),
            target,
            description: if target.turns_with(&driver) {
                format!("the {} of fixes is off in axes that turn with the vehicle", target.name())
            } else {
                format!("{} {driver}, in a way that is not in the catalogue", target.goes_with())
            },
            cause: grammar::cause(target, &driver).to_owned(),
            remedy: "confirm it on a second flight (gaware effects confirm), find the coupling, and keep it in the model until then"
                .to_owned(),
            drivers: std::array::from_fn(|_| Some(driver.clone())),
            prior_sigma: None,
        })
    }
}

/// Symbol and suffix of what a coefficient is divided by.
fn per(dimension: Dimension) -> (String, String) {
    let known = [
        ([0, 0, 0, 0, 0], "", ""),
        ([0, 0, 1, 0, 0], "A", "a"),
        ([0, 0, 2, 0, 0], "A²", "a2"),
        ([0, 0, 0, 1, 0], "V", "v"),
        ([0, 0, 0, 0, 1], "°C", "degc"),
        ([0, 0, 0, 0, 2], "°C²", "degc2"),
        ([0, 1, 0, 0, 0], "s", "s"),
        ([0, 2, 0, 0, 0], "s²", "s2"),
        ([1, 0, 0, 0, 0], "m", "m"),
        ([1, -1, 0, 0, 0], "(m/s)", "m_per_s"),
        ([2, -2, 0, 0, 0], "(m/s)²", "m2_per_s2"),
        ([1, -2, 0, 0, 0], "(m/s²)", "m_per_s2"),
        ([2, -4, 0, 0, 0], "(m/s²)²", "m2_per_s4"),
        ([0, -1, 0, 0, 0], "(rad/s)", "rad_per_s"),
        ([0, -2, 0, 0, 0], "(rad/s)²", "rad2_per_s2"),
        ([1, -3, 0, 0, 0], "(rad/s·m/s²)", "rad_m_per_s3"),
    ];
    if let Some((_, symbol, suffix)) = known.iter().find(|k| k.0 == dimension.0) {
        return ((*symbol).to_owned(), (*suffix).to_owned());
    }
    let powers = |join: &str, names: [&str; 5]| {
        let one = |(name, power): (&str, i8)| (power != 0).then(|| format!("{name}{power}"));
        names.into_iter().zip(dimension.0).filter_map(one).collect::<Vec<_>>().join(join)
    };
    let suffix = powers("_", ["m", "s", "a", "v", "degc"]).replace('-', "m");
    (format!("({})", powers("·", ["m", "s", "A", "V", "°C"])), suffix)
}

/// The unit of a coefficient: what the target is printed in, per driver.
fn unit_of(target: Target, dimension: Dimension) -> Unit {
    let base = target.unit();
    let (symbol, suffix) = per(dimension);
    if symbol.is_empty() {
        return base;
    }
    let leak = |text: String| -> &'static str { Box::leak(text.into_boxed_str()) };
    Unit {
        symbol: leak(format!("{}/{symbol}", base.symbol)),
        suffix: leak(format!("{}_per_{suffix}", base.suffix)),
        si: base.si,
    }
}

/// What a unit may be written as: as printed, or with what a keyboard has.
fn is_unit(written: &str, unit: Unit) -> bool {
    let plain =
        |t: &str| t.replace('°', "deg").replace('²', "2").replace(['(', ')', ' '], "").replace('·', "*");
    plain(written) == plain(unit.symbol) || written == unit.suffix
}

impl DataEffect {
    fn new(definition: Definition) -> Result<Self, String> {
        let drivers: Vec<&Expression> = definition.drivers.iter().flatten().collect();
        let first = drivers.first().ok_or("it has no driver")?;
        let dimension = first.dimension();
        if drivers.iter().any(|d| d.dimension() != dimension) {
            return Err("the drivers of its axes have different units".to_owned());
        }
        if !drivers.iter().all(|d| definition.target.can_have(d)) {
            return Err("temperature and vibration drive sensors, not fixes".to_owned());
        }
        let unit = unit_of(definition.target, dimension);
        let prior_sigma = match definition.prior_sigma {
            Some(sigma) if sigma.is_finite() && sigma > 0.0 => sigma * unit.si,
            Some(_) => return Err("prior_sigma must be positive".to_owned()),
            None => definition.target.disturbance() / grammar::typical(first),
        };
        let axes: Vec<usize> = (0..3).filter(|k| definition.drivers[*k].is_some()).collect();
        // One axis is a number, more of them are a vector.
        let cells: Vec<(usize, Option<Expression>)> = match axes[..] {
            [axis] => vec![(axis, definition.drivers[axis].clone())],
            _ => definition.drivers.iter().cloned().enumerate().collect(),
        };
        let shape = if cells.len() == 1 { Shape::Scalar } else { Shape::Vector };
        let all = definition.axes();
        let names: &'static [&'static str] = match cells[..] {
            [(axis, _)] => &all[axis..=axis],
            _ => all,
        };
        let uniform = cells.iter().all(|c| c.1 == cells[0].1);
        let groups = Box::leak(Box::new([ParameterGroup { unit, shape, names, prior_sigma }]));
        let turns = definition.turns();
        Ok(Self { groups, cells, uniform, turns, definition: Box::leak(Box::new(definition)) })
    }

    fn driver(&self, of: fn(&Expression) -> bool) -> bool {
        self.cells.iter().filter_map(|c| c.1.as_ref()).any(of)
    }

    fn added(&self, to: Target, p: &[f64], x: &Instant) -> Vector3<f64> {
        let mut out = Vector3::zeros();
        if to == self.definition.target {
            let mut columns = [Vector3::zeros(); 3];
            self.fill(&mut columns, x);
            columns.iter().zip(p).for_each(|(column, p)| out += column * *p);
        }
        out
    }
}

impl DataEffect {
    /// Derivative of what is added to a sensor by what the other one measures: an error of an accelerometer's bias reaches the gyros through a
    /// driver such as `w_z*f_x`.
    fn by_motion(&self, to: Target, of: Sensor, p: &[f64], x: &Instant) -> Option<Matrix3<f64>> {
        let reach = |d: &Expression| d.needs_motion(of);
        (to == self.definition.target && self.cells.iter().filter_map(|c| c.1.as_ref()).any(reach)).then(
            || {
                let mut out = Matrix3::zeros();
                for ((axis, driver), p) in self.cells.iter().zip(p).filter(|(_, p)| **p != 0.0) {
                    let by = driver.as_ref().map_or([0.0; 3], |d| d.by_motion(x, of));
                    (0..3).for_each(|k| out[(*axis, k)] += p * known(by[k]));
                }
                out
            },
        )
    }
}

/// A driver that is not reported drives nothing.
fn known(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

impl Effect for DataEffect {
    fn name(&self) -> &'static str {
        &self.definition.name
    }

    fn description(&self) -> &'static str {
        &self.definition.description
    }

    fn cause(&self) -> &'static str {
        &self.definition.cause
    }

    fn remedy(&self) -> &'static str {
        &self.definition.remedy
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        self.groups
    }

    fn needs_temperature(&self) -> bool {
        self.driver(Expression::needs_temperature)
    }

    fn needs_vibration(&self) -> bool {
        self.driver(Expression::needs_vibration)
    }

    fn prior_cost(&self) -> f64 {
        if self.definition.name.starts_with(FORMULA) { grammar::cost() } else { 0.0 }
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == if self.definition.target.is_of_fix() { ActsOn::Fixes } else { ActsOn::Samples }
    }

    fn needs_conditions(&self) -> bool {
        true
    }

    fn needs_surroundings(&self) -> bool {
        self.acts_on(ActsOn::Samples) && self.driver(Expression::needs_surroundings)
    }

    fn fix(&self, p: &[f64], x: &FixInstant) -> [Vector3<f64>; 2] {
        let x = x.instant();
        [Target::Position, Target::Velocity].map(|to| self.added(to, p, &x))
    }

    fn fix_jacobian(
        &self,
        _p: &[f64],
        x: &FixInstant,
        position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
    ) {
        match self.definition.target {
            Target::Position => self.fill(position, &x.instant()),
            Target::Velocity => self.fill(velocity, &x.instant()),
            _ => {}
        }
    }

    fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        self.added(Target::Gyro, p, x)
    }

    fn accel(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        self.added(Target::Accel, p, x)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, gyro: &mut [Vector3<f64>], accel: &mut [Vector3<f64>]) {
        match self.definition.target {
            Target::Gyro => self.fill(gyro, x),
            Target::Accel => self.fill(accel, x),
            _ => {}
        }
    }

    fn gyro_by_force(&self, p: &[f64], x: &Instant) -> Option<Matrix3<f64>> {
        self.by_motion(Target::Gyro, Sensor::Accel, p, x)
    }

    fn accel_by_rate(&self, p: &[f64], x: &Instant) -> Option<Matrix3<f64>> {
        self.by_motion(Target::Accel, Sensor::Gyro, p, x)
    }
}

impl DataEffect {
    /// ∂/∂p of what is added to its target, a column a parameter.
    fn fill(&self, columns: &mut [Vector3<f64>], x: &Instant) {
        let of = |driver: &Option<Expression>| driver.as_ref().map_or(0.0, |d| known(d.value(x)));
        if self.turns {
            let heading = of(&self.definition.drivers[0]);
            let (s, c) = (sin(heading), cos(heading));
            let turned = [Vector3::new(c, s, 0.0), Vector3::new(-s, c, 0.0), Vector3::z()];
            columns.iter_mut().zip(turned).for_each(|(column, turned)| *column = turned);
            return;
        }
        let shared = self.uniform.then(|| self.cells.first().map_or(0.0, |c| of(&c.1)));
        for (column, (axis, driver)) in columns.iter_mut().zip(&self.cells) {
            column[*axis] = shared.unwrap_or_else(|| of(driver));
        }
    }
}

#[cfg(test)]
mod tests;
