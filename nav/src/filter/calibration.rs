//! From raw samples to motion and back: the current values of biases and effect parameters, the inverse of the
//! sensor model and its Jacobian with respect to every constant state.

use super::layout::{Layout, index};
use crate::effects::{ActsOn, Conditions, Instant, MAX_PARAMETERS, Surroundings};
use crate::mechanization::Motion;
use crate::model::Model;
use crate::sample::ImuSample;
use nalgebra::{Matrix3, Vector3};

/// Reference of the temperature effects, °C.
const REFERENCE_DEGC: f64 = 25.0;
/// Fixed-point steps of the inverse at most; errors of 1 % leave 1e-8 of the value.
const INVERSE_STEPS: usize = 4;
/// A step shorter than this is the last one, (rad/s)² and (m/s²)²: with errors of 1 % it leaves 1e-9 rad/s (0.2 millidegrees/h) and
/// 1e-7 m/s² (10 nano-g).
const SHORT_STEP: (f64, f64) = (1e-14, 1e-10);

/// Current values of everything constant.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Gyro bias, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Accelerometer bias, m/s².
    pub accel_bias: Vector3<f64>,
    /// Parameters of each effect of the model, SI.
    parameters: Vec<Vec<f64>>,
    /// What the samples around the present one show.
    pub around: Surroundings,
    /// What the vehicle does beside moving.
    pub conditions: Conditions,
    /// What the effects that are linear add together, found anew with every parameter.
    linear: LinearPart,
}

/// What linear effects add to rate and force, and which effects are not linear.
#[derive(Debug, Clone, Default, PartialEq)]
struct LinearPart {
    /// To the rate, per rate and per force.
    gyro: [Matrix3<f64>; 2],
    /// To the specific force, likewise.
    accel: [Matrix3<f64>; 2],
    /// Places in the model of the others that act on samples.
    others: Vec<usize>,
}

impl LinearPart {
    fn of(model: &Model, parameters: &[Vec<f64>]) -> Self {
        let mut out = Self::default();
        for (e, (setting, p)) in model.effects.iter().zip(parameters).enumerate() {
            let effect = setting.effect;
            if !effect.acts_on(ActsOn::Samples) {
                continue;
            }
            if !effect.is_linear() {
                out.others.push(e);
                continue;
            }
            for axis in 0..3 {
                let unit = Vector3::ith(axis, 1.0);
                for (by, rate, force) in [(0, unit, Vector3::zeros()), (1, Vector3::zeros(), unit)] {
                    let x = Instant { rate, force, ..Instant::default() };
                    let (mut gyro, mut accel) =
                        (out.gyro[by].column_mut(axis), out.accel[by].column_mut(axis));
                    gyro += effect.gyro(p, &x);
                    accel += effect.accel(p, &x);
                }
            }
        }
        out
    }
}

/// How motion depends on the constant states: one column per state from the gyro bias on.
#[derive(Debug, Clone, Default)]
pub struct MotionJacobian {
    /// ∂ω/∂x, rad/s per unit.
    pub rate: Vec<Vector3<f64>>,
    /// ∂f/∂x, m/s² per unit.
    pub force: Vec<Vector3<f64>>,
}

impl Calibration {
    /// The values that a model starts from.
    pub fn new(model: &Model) -> Self {
        let parameters: Vec<_> = model.effects.iter().map(|s| s.values.clone()).collect();
        Self {
            gyro_bias: model.imu.gyro_bias.into(),
            accel_bias: model.imu.accel_bias.into(),
            linear: LinearPart::of(model, &parameters),
            parameters,
            around: Surroundings::default(),
            conditions: Conditions::default(),
        }
    }

    /// Parameters of each effect of the model, SI.
    pub fn parameters(&self) -> &[Vec<f64>] {
        &self.parameters
    }

    /// The same biases with the values of another model's effects.
    #[must_use]
    pub fn with_effects_of(&self, model: &Model) -> Self {
        let Self { gyro_bias, accel_bias, around, conditions, .. } = *self;
        Self { gyro_bias, accel_bias, around, conditions, ..Self::new(model) }
    }

    /// The value of a constant state.
    pub fn get(&self, layout: &Layout, state: usize) -> f64 {
        match state {
            s if s < index::ACCEL_BIAS => self.gyro_bias[s - index::GYRO_BIAS],
            s if s < index::EFFECTS => self.accel_bias[s - index::ACCEL_BIAS],
            s => layout
                .slots()
                .iter()
                .find(|slot| slot.state == s)
                .map_or(0.0, |slot| self.parameters[slot.effect][slot.parameter]),
        }
    }

    /// Adds a correction to every constant state; `dx` is the whole state vector.
    pub fn correct(&mut self, model: &Model, layout: &Layout, dx: &[f64]) {
        for k in 0..3 {
            self.gyro_bias[k] += dx[index::GYRO_BIAS + k];
            self.accel_bias[k] += dx[index::ACCEL_BIAS + k];
        }
        for slot in layout.slots() {
            self.parameters[slot.effect][slot.parameter] += dx[slot.state];
        }
        self.linear = LinearPart::of(model, &self.parameters);
    }

    fn instant(&self, sample: &ImuSample, motion: &Motion) -> Instant {
        Instant {
            t_s: sample.t_s,
            rate: motion.rate,
            force: motion.force,
            temperature_above_25_degc: sample.temperature_degc.map_or(0.0, |t| t - REFERENCE_DEGC),
            around: self.around,
            conditions: self.conditions,
        }
    }

    /// How much older than the specific force the reported rate is, s.
    pub fn rate_lag_s(&self, model: &Model) -> f64 {
        model.effects.iter().zip(&self.parameters).map(|(s, p)| s.effect.rate_lag_s(p)).sum()
    }

    /// What the sensors would show for this motion (the paper, eq. (1), with every effect).
    pub fn measure(&self, model: &Model, sample: &ImuSample, motion: &Motion) -> Motion {
        let Motion { rate, force } = motion;
        let LinearPart { gyro, accel, others } = &self.linear;
        let mut out = Motion {
            rate: rate + self.gyro_bias + gyro[0] * rate + gyro[1] * force,
            force: force + self.accel_bias + accel[0] * rate + accel[1] * force,
        };
        if others.is_empty() {
            return out;
        }
        let x = self.instant(sample, motion);
        for (setting, p) in
            others.iter().filter_map(|e| Some((model.effects.get(*e)?, self.parameters.get(*e)?)))
        {
            out.rate += setting.effect.gyro(p, &x);
            out.force += setting.effect.accel(p, &x);
        }
        out
    }

    /// The motion behind a raw sample: the sensor model inverted by fixed-point iteration.
    pub fn motion(&self, model: &Model, sample: &ImuSample) -> Motion {
        let biases = Motion { rate: self.gyro_bias, force: self.accel_bias };
        self.motion_from(model, sample, &biases)
    }

    /// The same where the errors of the sensors are known roughly: those of the sample before save a step or two.
    pub fn motion_from(&self, model: &Model, sample: &ImuSample, errors: &Motion) -> Motion {
        let mut motion = Motion { rate: sample.gyro - errors.rate, force: sample.accel - errors.force };
        for _ in 0..INVERSE_STEPS {
            let shown = self.measure(model, sample, &motion);
            let (dw, df) = (sample.gyro - shown.rate, sample.accel - shown.force);
            motion.rate += dw;
            motion.force += df;
            if dw.norm_squared() < SHORT_STEP.0 && df.norm_squared() < SHORT_STEP.1 {
                break;
            }
        }
        motion
    }

    /// ∂motion/∂x at a motion, first order in the effects: δω = −δb_g − E δp − G δf, δf = −δb_a − A δp.
    pub fn jacobian(
        &self,
        model: &Model,
        layout: &Layout,
        sample: &ImuSample,
        motion: &Motion,
        out: &mut MotionJacobian,
    ) {
        let m = layout.len() - index::GYRO_BIAS;
        for columns in [&mut out.rate, &mut out.force] {
            columns.clear();
            columns.resize(m, Vector3::zeros());
        }
        for k in 0..3 {
            out.rate[k][k] = 1.0;
            out.force[3 + k][k] = 1.0;
        }
        let x = self.instant(sample, motion);
        let (mut by_force, mut by_rate) = (Matrix3::zeros(), Matrix3::zeros());
        let mut slots = layout.slots();
        for (e, (setting, p)) in model.effects.iter().zip(&self.parameters).enumerate() {
            let (own, rest) = slots.split_at(slots.iter().take_while(|s| s.effect == e).count());
            slots = rest;
            let effect = setting.effect;
            if !effect.acts_on(ActsOn::Samples) {
                continue;
            }
            if let Some(g) = effect.gyro_by_force(p, &x) {
                by_force += g;
            }
            by_rate += effect.accel_by_rate(p, &x).unwrap_or_default();
            let Some(first) = own.first().map(|s| s.state - index::GYRO_BIAS) else { continue };
            if own.len() == p.len() {
                // States of one effect follow each other.
                let columns = first..first + p.len();
                effect.imu_jacobian(p, &x, &mut out.rate[columns.clone()], &mut out.force[columns]);
                continue;
            }
            let (mut gyro, mut accel) =
                ([Vector3::zeros(); MAX_PARAMETERS], [Vector3::zeros(); MAX_PARAMETERS]);
            effect.imu_jacobian(p, &x, &mut gyro[..p.len()], &mut accel[..p.len()]);
            for slot in own {
                let column = slot.state - index::GYRO_BIAS;
                out.rate[column] = gyro[slot.parameter];
                out.force[column] = accel[slot.parameter];
            }
        }
        for (rate, force) in out.rate.iter_mut().zip(&mut out.force) {
            (*rate, *force) = (-*rate, -*force);
            if *force != Vector3::zeros() {
                *rate -= by_force * *force;
            }
        }
        if by_rate != Matrix3::zeros() {
            out.force.iter_mut().zip(&out.rate).for_each(|(force, rate)| *force -= by_rate * rate);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{self, REGISTRY};
    use crate::model::{EffectSetting, GElements};

    fn everything() -> Model {
        let mut model = Model::default().with_g(GElements::Full, None);
        for effect in REGISTRY {
            let mut s = EffectSetting::unknown(*effect);
            for (k, v) in s.values.iter_mut().enumerate() {
                *v = s.sigmas[k] * (0.3 - 0.1 * k as f64);
            }
            model.set(s);
        }
        model
    }

    fn sample() -> ImuSample {
        ImuSample {
            t_s: 3.0,
            gyro: Vector3::new(0.3, -0.2, 0.5),
            accel: Vector3::new(1.0, -2.0, -12.0),
            temperature_degc: Some(40.0),
        }
    }

    #[test]
    fn the_inverse_undoes_the_sensor_model() {
        let model = everything();
        let mut c = Calibration::new(&model);
        c.gyro_bias = Vector3::new(0.01, -0.02, 0.03);
        c.accel_bias = Vector3::new(-0.1, 0.2, 0.3);
        let motion = c.motion(&model, &sample());
        let back = c.measure(&model, &sample(), &motion);
        assert!((back.rate - sample().gyro).norm() < 1e-10);
        assert!((back.force - sample().accel).norm() < 1e-8);
    }

    #[test]
    fn the_jacobian_matches_finite_differences_of_the_inverse() {
        let model = everything();
        let layout = Layout::new(&model);
        let c = Calibration::new(&model);
        let motion = c.motion(&model, &sample());
        let mut jacobian = MotionJacobian::default();
        c.jacobian(&model, &layout, &sample(), &motion, &mut jacobian);
        for state in index::GYRO_BIAS..layout.len() {
            let h = 1e-5;
            let mut dx = vec![0.0; layout.len()];
            let at = |sign: f64, dx: &mut Vec<f64>| {
                dx[state] = sign * h;
                let mut moved = c.clone();
                moved.correct(&model, &layout, dx);
                moved.motion(&model, &sample())
            };
            let (plus, minus) = (at(1.0, &mut dx), at(-1.0, &mut dx));
            let (w, f) = ((plus.rate - minus.rate) / (2.0 * h), (plus.force - minus.force) / (2.0 * h));
            let column = state - index::GYRO_BIAS;
            // First order in the effects: products of two effects (scale × bias, below 1 %) are left out.
            assert!((w - jacobian.rate[column]).norm() < 0.01 * (w.norm() + 1e-9), "{state}: {w}");
            assert!((f - jacobian.force[column]).norm() < 0.01 * (f.norm() + 1e-9), "{state}: {f}");
        }
        assert!(effects::find("gyro_g_sensitivity").is_some());
    }
}
