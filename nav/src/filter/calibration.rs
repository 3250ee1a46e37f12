//! From raw samples to motion and back: the current values of biases and effect parameters, the inverse of the
//! sensor model and its Jacobian with respect to every constant state.

use super::layout::{Layout, index};
use crate::effects::{Instant, MAX_PARAMETERS, Surroundings};
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
    pub parameters: Vec<Vec<f64>>,
    /// What the samples around the present one show.
    pub around: Surroundings,
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
        Self {
            gyro_bias: model.imu.gyro_bias.into(),
            accel_bias: model.imu.accel_bias.into(),
            parameters: model.effects.iter().map(|s| s.values.clone()).collect(),
            around: Surroundings::default(),
        }
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
    pub fn correct(&mut self, layout: &Layout, dx: &[f64]) {
        for k in 0..3 {
            self.gyro_bias[k] += dx[index::GYRO_BIAS + k];
            self.accel_bias[k] += dx[index::ACCEL_BIAS + k];
        }
        for slot in layout.slots() {
            self.parameters[slot.effect][slot.parameter] += dx[slot.state];
        }
    }

    fn instant(&self, sample: &ImuSample, motion: &Motion) -> Instant {
        Instant {
            t_s: sample.t_s,
            rate: motion.rate,
            force: motion.force,
            temperature_above_25_degc: sample.temperature_degc.map_or(0.0, |t| t - REFERENCE_DEGC),
            around: self.around,
        }
    }

    /// How much older than the specific force the reported rate is, s.
    pub fn rate_lag_s(&self, model: &Model) -> f64 {
        model.effects.iter().zip(&self.parameters).map(|(s, p)| s.effect.rate_lag_s(p)).sum()
    }

    /// What the sensors would show for this motion (the paper, eq. (1), with every effect).
    pub fn measure(&self, model: &Model, sample: &ImuSample, motion: &Motion) -> Motion {
        let x = self.instant(sample, motion);
        let mut out = Motion { rate: motion.rate + self.gyro_bias, force: motion.force + self.accel_bias };
        for (setting, p) in model.effects.iter().zip(&self.parameters) {
            if let Some(effect) = setting.effect.on_samples() {
                out.rate += effect.gyro(p, &x);
                out.force += effect.accel(p, &x);
            }
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
            out.rate[k][k] = -1.0;
            out.force[3 + k][k] = -1.0;
        }
        let x = self.instant(sample, motion);
        let (mut by_force, mut by_rate) = (Matrix3::zeros(), Matrix3::zeros());
        let mut slots = layout.slots().iter().peekable();
        for (e, (setting, p)) in model.effects.iter().zip(&self.parameters).enumerate() {
            let Some(effect) = setting.effect.on_samples() else {
                while slots.next_if(|s| s.effect == e).is_some() {}
                continue;
            };
            if let Some(g) = effect.gyro_by_force(p, &x) {
                by_force += g;
            }
            by_rate += setting.effect.accel_by_rate(p, &x).unwrap_or_default();
            if slots.peek().is_none_or(|s| s.effect != e) {
                continue;
            }
            let (mut gyro, mut accel) =
                ([Vector3::zeros(); MAX_PARAMETERS], [Vector3::zeros(); MAX_PARAMETERS]);
            effect.imu_jacobian(p, &x, &mut gyro[..p.len()], &mut accel[..p.len()]);
            while let Some(slot) = slots.next_if(|s| s.effect == e) {
                let column = slot.state - index::GYRO_BIAS;
                out.rate[column] = -gyro[slot.parameter];
                out.force[column] = -accel[slot.parameter];
            }
        }
        for (rate, force) in out.rate.iter_mut().zip(&out.force) {
            if *force != Vector3::zeros() {
                *rate -= by_force * force;
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
                moved.correct(&layout, dx);
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
