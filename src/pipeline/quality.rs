//! What a unit, its link and its receiver are really worth, from a recording of a minute on the ground or of an earlier flight: the figures by which
//! the live filter will weigh its samples and fixes. A plan that is made with them promises what the flight can keep.

use gaware_nav::estimator::Estimator;
use gaware_nav::math::hypot;
use gaware_nav::model::Model;
use gaware_nav::noise_meter::NoiseMeter;
use gaware_nav::quantisation::Dequantiser;
use gaware_nav::receiver::ReceiverMeter;
use gaware_nav::sample::{GnssFix, Sample};

/// The noise is looked at after so many samples each.
const EVERY: usize = 100;
/// Fixes without which the receiver is not judged.
const LEAST_FIXES: usize = 10;

/// Figures of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Gyro noise with rounding and vibration, rad/s/√Hz.
    pub gyro_noise: f64,
    /// Accelerometer noise likewise, m/s²/√Hz.
    pub accel_noise: f64,
    /// Rate of the inertial samples, Hz.
    pub imu_rate_hz: f64,
    /// What the receiver says of itself, and how often.
    pub receiver: Option<ReceiverQuality>,
}

/// What a receiver says of its fixes, and what its velocities have shown in motion: the filter weighs them by that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReceiverQuality {
    /// 1-sigma north, east, down, m, where the fixes bring it.
    pub position_sigma_m: Option<[f64; 3]>,
    /// 1-sigma north, east, down, m/s, where the fixes bring it.
    pub velocity_sigma_m_per_s: Option<[f64; 3]>,
    /// Factor on it that the live filter came to; 1 where the vehicle has not moved.
    pub velocity_factor: f64,
    /// Time between fixes, s.
    pub interval_s: f64,
    /// Scatter of the velocity while the vehicle was stationary, m/s, where it was.
    pub stationary_scatter_m_per_s: Option<f64>,
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

impl Quality {
    /// From the samples of a recording; nothing where it holds too few. `model`: what is assumed of the sensors.
    pub fn of(samples: &[Sample], model: &Model) -> Option<Self> {
        let mut dequantiser = Dequantiser::new(gaware_nav::sample::Quantisation::None);
        let mut meter = NoiseMeter::default();
        let (mut noises, mut fixes, mut count) = ((Vec::new(), Vec::new()), Vec::new(), 0_usize);
        let mut live = Estimator::new(model.clone());
        for sample in samples {
            live.feed(sample);
            match sample {
                Sample::Stream(stream) => {
                    dequantiser = Dequantiser::new(model.quantisation_of(stream));
                    meter = NoiseMeter::default();
                    count = 0;
                }
                Sample::Imu(imu) => {
                    meter.push(&dequantiser.undo(imu));
                    count += 1;
                    if count > EVERY && count.is_multiple_of(EVERY) {
                        let (gyro, accel) = total(model, &dequantiser, &meter);
                        noises.0.push(gyro);
                        noises.1.push(accel);
                    }
                }
                Sample::Fix(fix) => fixes.push(*fix),
                _ => {}
            }
        }
        let (gyro, accel) = (median(noises.0)?, median(noises.1)?);
        Some(Self {
            gyro_noise: gyro.sqrt(),
            accel_noise: accel.sqrt(),
            imu_rate_hz: 1.0 / meter.interval_s().max(1e-6),
            receiver: ReceiverQuality::of(&fixes, live.receiver()),
        })
    }

    /// The model with these figures. Noise is never taken for less than the model's: on the ground nothing vibrates.
    #[must_use]
    pub fn applied(&self, mut model: Model) -> Model {
        model.imu.gyro_noise = self.gyro_noise.max(model.imu.gyro_noise);
        model.imu.accel_noise = self.accel_noise.max(model.imu.accel_noise);
        if let Some(receiver) = self.receiver {
            model.gnss.position_sigma_m = receiver.position_sigma_m.unwrap_or(model.gnss.position_sigma_m);
            let claimed = receiver.velocity_sigma_m_per_s.unwrap_or(model.gnss.velocity_sigma_m_per_s);
            model.gnss.velocity_sigma_m_per_s = claimed.map(|s| s * receiver.velocity_factor);
        }
        model
    }

    /// In words.
    pub fn words(&self) -> String {
        let receiver = self.receiver.map_or_else(
            || "; too few fixes to judge the receiver".to_owned(),
            |r| {
                let claims = |sigma: Option<[f64; 3]>, unit: &str| {
                    sigma.map_or_else(|| format!("nothing about {unit}"), |s| format!("{:.2} {unit}", s[0]))
                };
                let stood = r.stationary_scatter_m_per_s.map_or_else(String::new, |s| {
                    format!(" (while the vehicle was stationary its velocity scattered by {s:.2} m/s)")
                });
                let shown = if r.velocity_factor == 1.0 {
                    String::new()
                } else {
                    format!(", of which the motion showed {:.2}", r.velocity_factor)
                };
                format!(
                    "; fixes at {:.1} Hz with {} and {}{shown}{stood}",
                    1.0 / r.interval_s,
                    claims(r.position_sigma_m, "m"),
                    claims(r.velocity_sigma_m_per_s, "m/s")
                )
            },
        );
        format!(
            "{:.0} Hz, gyro noise {:.4} deg/s/√Hz, accelerometer noise {:.1} mg/√Hz{receiver}",
            self.imu_rate_hz,
            self.gyro_noise.to_degrees(),
            self.accel_noise / 9.806_65e-3
        )
    }
}

/// Variances per hertz as the live filter takes them: the model's, rounding, and what exceeds both.
fn total(model: &Model, dequantiser: &Dequantiser, meter: &NoiseMeter) -> (f64, f64) {
    let rounding = dequantiser.noise_density(meter.interval_s());
    let (gyro, accel) =
        (model.imu.gyro_noise.powi(2) + rounding.0, model.imu.accel_noise.powi(2) + rounding.1);
    let excess = meter.excess(gyro, accel);
    (gyro + excess.0, accel + excess.1)
}

impl ReceiverQuality {
    fn of(fixes: &[GnssFix], meter: &ReceiverMeter) -> Option<Self> {
        if fixes.len() < LEAST_FIXES {
            return None;
        }
        let claimed = |of: fn(&GnssFix) -> Option<[f64; 3]>| {
            let all: Vec<[f64; 3]> = fixes.iter().filter_map(of).collect();
            let axis = |k: usize| median(all.iter().filter_map(|s| s.get(k).copied()).collect());
            Some([axis(0)?, axis(1)?, axis(2)?])
        };
        let interval =
            median(fixes.windows(2).map(|w| w[1].t_s - w[0].t_s).filter(|dt| *dt > 0.0).collect())?;
        let velocity_sigma_m_per_s = claimed(|f| f.velocity_sigma_m_per_s);
        Some(Self {
            position_sigma_m: claimed(|f| f.position_sigma_m),
            velocity_sigma_m_per_s,
            velocity_factor: velocity_sigma_m_per_s.map_or(1.0, |s| meter.factor(s[0])),
            interval_s: interval,
            stationary_scatter_m_per_s: stationary_scatter(fixes),
        })
    }
}

/// Scatter of the horizontal velocity of fixes that hardly move, where most of them do not: 1-sigma of one axis.
fn stationary_scatter(fixes: &[GnssFix]) -> Option<f64> {
    /// Faster is motion, m/s.
    const STILL: f64 = 1.0;
    let speeds: Vec<f64> = fixes
        .iter()
        .filter_map(|f| f.velocity.horizontal().map(|[n, e]| hypot(n, e)))
        .filter(|v| *v < STILL)
        .collect();
    let enough = speeds.len() >= LEAST_FIXES;
    enough.then(|| (speeds.iter().map(|v| v * v).sum::<f64>() / (2.0 * speeds.len() as f64)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::samples;
    use gaware_nav::sample::{ImuSample, ImuStream, SampleKind};
    use nalgebra::Vector3;

    /// White noise from sums of a fixed sequence: no generator is needed for a median.
    fn white(n: usize, sigma: f64) -> impl Iterator<Item = f64> {
        let mut state = 0x2545_F491_4F6C_DD1D_u64;
        let mut next = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..n).map(move |_| sigma * (0..12).map(|_| next()).sum::<f64>())
    }

    fn recording(density: f64, rate_hz: f64) -> Vec<Sample> {
        let n = (60.0 * rate_hz) as usize;
        let mut noise = white(6 * n, density * rate_hz.sqrt());
        let mut three = || Vector3::from_fn(|_, _| noise.next().unwrap());
        let stream =
            ImuStream { message: "HIGHRES_IMU".to_owned(), kind: SampleKind::Point, ..Default::default() };
        let imu = (0..n).map(|k| {
            let t_s = k as f64 / rate_hz;
            let (gyro, accel) = (three(), 10.0 * three() - Vector3::z() * 9.8);
            Sample::Imu(ImuSample { t_s, gyro, accel, temperature_degc: None })
        });
        std::iter::once(Sample::Stream(stream)).chain(imu).collect()
    }

    #[test]
    fn noise_is_measured_whatever_the_rate_and_a_quiet_unit_keeps_the_models() {
        let model = Model::standard();
        for rate_hz in [50.0, 200.0, 250.0] {
            let quality = Quality::of(&recording(5e-3, rate_hz), &model).unwrap();
            assert!((quality.gyro_noise / 5e-3 - 1.0).abs() < 0.15, "{rate_hz} Hz: {quality:?}");
            assert!((quality.accel_noise / 5e-2 - 1.0).abs() < 0.15, "{rate_hz} Hz: {quality:?}");
            let applied = quality.applied(model.clone());
            assert_eq!(applied.imu.gyro_noise, quality.gyro_noise);
        }
        let quiet = Quality::of(&recording(1e-5, 200.0), &model).unwrap().applied(model.clone());
        assert_eq!(
            (quiet.imu.gyro_noise, quiet.imu.accel_noise),
            (model.imu.gyro_noise, model.imu.accel_noise)
        );
        assert_eq!(Quality::of(&[], &model), None);
    }

    /// At 250 Hz 0.14, 0.07, 0.03 rad/s and 0.5, 1.7, 1.4 m/s² by axis (PX4 `simulator_sih/sih.cpp`), integrated by trapezoids: as a mean over
    /// the axes 0.0058 rad/s/√Hz and 0.082 m/s²/√Hz.
    #[test]
    #[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
    fn a_noisy_unit_of_px4_is_measured_as_what_it_is() {
        let log = crate::testing::flights().join("px4_plane_strong_noise.mcap");
        let quality = Quality::of(&samples(&log, Default::default()).unwrap(), &Model::standard()).unwrap();
        println!("{quality:?} {}", quality.words());
        assert!((quality.gyro_noise / 0.0058 - 1.0).abs() < 0.25, "{quality:?}");
        assert!((quality.accel_noise / 0.082 - 1.0).abs() < 0.25, "{quality:?}");
        let receiver = quality.receiver.unwrap();
        assert!((0.1..0.15).contains(&receiver.interval_s), "{receiver:?}");
    }

    /// The same flight at a fifth of its rate has more noise, not less certainty at the full one.
    #[test]
    #[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
    fn more_samples_of_one_flight_make_no_attitude_less_certain() {
        let log = crate::testing::flights().join("px4_plane_strong_noise.mcap");
        let all = samples(&log, Default::default()).unwrap();
        let roll_deg = |every: usize| {
            let mut estimator = gaware_nav::estimator::Estimator::new(Model::standard());
            let (mut count, mut last_s, mut sigmas) = (0_usize, 0.0, Vec::new());
            for sample in &all {
                if let Sample::Imu(imu) = sample {
                    count += 1;
                    if !count.is_multiple_of(every) {
                        continue;
                    }
                    if imu.t_s - last_s >= 1.0 {
                        last_s = imu.t_s;
                        sigmas.extend(estimator.filter().map(|f| f.euler_sigma().x.to_degrees()));
                    }
                }
                estimator.feed(sample);
            }
            println!("every {every}: {:?}", sigmas.iter().step_by(20).collect::<Vec<_>>());
            median(sigmas).unwrap()
        };
        let (full, fifth) = (roll_deg(1), roll_deg(5));
        println!("roll sigma {full:.2} deg at full rate, {fifth:.2} at a fifth of it");
        assert!(full <= 1.05 * fifth, "{full} {fifth}");
    }
}
