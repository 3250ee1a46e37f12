//! One vehicle of many, for Monte Carlo studies.

use crate::noise::{Noise, Purpose};
use gaware_nav::effects::Kernel;
use gaware_nav::model::Model;

/// A model whose biases and uncertain parameters are drawn from their prior sigmas, as far as a receiver can have them. Values with sigma 0 stay.
pub fn draw_vehicle(model: &Model, seed: u64) -> Model {
    let mut noise = Noise::new(seed, Purpose::HiddenTruth);
    let mut drawn = model.clone();
    for axis in 0..3 {
        drawn.imu.gyro_bias[axis] += noise.normal() * model.imu.gyro_bias_sigma;
    }
    for axis in 0..3 {
        drawn.imu.accel_bias[axis] += noise.normal() * model.imu.accel_bias_sigma;
    }
    for setting in &mut drawn.effects {
        for (value, sigma) in setting.values.iter_mut().zip(&setting.sigmas) {
            *value += noise.normal() * sigma;
        }
    }
    causal(&mut drawn);
    drawn
}

/// A fix does not come before it was measured, and a receiver smooths over what it has measured before it sends: no corner is sharpened, and none is
/// known beforehand.
fn causal(drawn: &mut Model) {
    let mut delay_s = 0.0;
    for setting in drawn.effects.iter_mut().filter(|s| s.effect.delays_fixes()) {
        setting.values.iter_mut().for_each(|v| *v = v.max(0.0));
        delay_s += setting.effect.fix_delay_s(&setting.values, 0.0);
    }
    let most_s2 = 0.5 * delay_s * delay_s;
    for setting in drawn.effects.iter_mut().filter(|s| !s.effect.kernel(&s.values).is_none()) {
        if let [smoothing_s2, skew_s3] = setting.values.as_mut_slice() {
            *smoothing_s2 = smoothing_s2.abs().min(most_s2);
            // The later of its two instants is √(2κ + δ²) − δ after the mean.
            let before_s = if delay_s > 0.0 { (most_s2 - *smoothing_s2) / delay_s } else { 0.0 };
            let by_ahead_s2 = -Kernel::BY_AHEAD * *smoothing_s2;
            *skew_s3 =
                skew_s3.clamp(-by_ahead_s2 * Kernel::SPAN_S, by_ahead_s2 * before_s.min(Kernel::SPAN_S));
        }
    }
}
