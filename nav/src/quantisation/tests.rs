use super::*;
use crate::math::{exp, sin};
use proptest::prelude::*;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};

const STEP: Quantisation = Quantisation::Truncate(Steps { gyro: 1.0, accel: 1.0 });

/// What `n` samples at 50 Hz of a rate with white noise (steps) show, for centre of the bin and dequantiser.
struct Shown {
    bias: [f64; 2],
    /// Variance that quantisation adds to 5 s means, per sample.
    added: f64,
    predicted: f64,
}

fn show(rate: impl Fn(f64) -> f64, sigma: f64, seed: u64) -> Shown {
    const WARM_UP: u32 = 500;
    const BLOCK: u32 = 250;
    const BLOCKS: u32 = 60;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut dequantiser = Dequantiser::new(STEP);
    let n = f64::from(BLOCK * BLOCKS);
    let (mut sums, mut predicted, mut block, mut squares) = ([0.0; 2], 0.0, 0.0, 0.0);
    for k in 0..WARM_UP + BLOCK * BLOCKS {
        let t_s = f64::from(k) * 0.02;
        let noise: f64 = StandardNormal.sample(&mut rng);
        let truth = rate(t_s);
        let gyro = Vector3::repeat((truth + sigma * noise).trunc());
        let sample = ImuSample { t_s, gyro, accel: Vector3::zeros(), temperature_degc: None };
        let back = [STEP.undo(&sample).gyro.x, dequantiser.undo(&sample).gyro.x];
        if k >= WARM_UP {
            for (sum, value) in sums.iter_mut().zip(back) {
                *sum += value - truth - sigma * noise;
            }
            predicted += dequantiser.variance().0.x;
            block += back[1] - truth;
            if (k - WARM_UP + 1).is_multiple_of(BLOCK) {
                squares += block * block / f64::from(BLOCK);
                block = 0.0;
            }
        }
    }
    let added = squares / f64::from(BLOCKS) - sigma * sigma;
    Shown { bias: sums.map(|s| s / n), added, predicted: predicted / n }
}

/// Mean rates from -3 to 3 steps.
fn rates() -> impl Iterator<Item = (f64, u64)> {
    (0..=24_u32).map(|i| (f64::from(i) * 0.25 - 3.0, u64::from(i)))
}

#[test]
fn a_dithered_mean_in_the_dead_zone_is_found_again() {
    for sigma in [0.5, 0.7, 1.0, 1.5, 2.0, 3.0] {
        let (mut worst, mut rms) = (0.0_f64, [0.0; 2]);
        for (rate, seed) in rates() {
            let shown = show(|_| rate, sigma, seed);
            worst = worst.max(shown.bias[1].abs());
            for (sum, bias) in rms.iter_mut().zip(shown.bias) {
                *sum += bias * bias;
            }
        }
        assert!(worst < 0.06, "sigma {sigma}: {worst}");
        if sigma <= 1.0 {
            assert!(rms[1].sqrt() < 0.3 * rms[0].sqrt(), "sigma {sigma}: {rms:?}");
        }
    }
}

#[test]
fn noise_behind_a_low_pass_dithers_as_well() {
    // One step RMS, 20 Hz first-order low-pass, 200 Hz: neighbours are half alike.
    let keep = exp(-std::f64::consts::TAU * 20.0 * 0.005_f64);
    for rate in [0.3, 0.8, -1.2] {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(11);
        let mut dequantiser = Dequantiser::new(STEP);
        let (mut noise, mut sums, n) = (0.0, [0.0; 2], 60_000_u32);
        for k in 0..n {
            let white: f64 = StandardNormal.sample(&mut rng);
            noise = keep * noise + (1.0 - keep * keep).sqrt() * white;
            let sample = ImuSample {
                t_s: f64::from(k) * 0.005,
                gyro: Vector3::repeat((rate + noise).trunc()),
                accel: Vector3::zeros(),
                temperature_degc: None,
            };
            sums[0] += STEP.undo(&sample).gyro.x - rate - noise;
            sums[1] += dequantiser.undo(&sample).gyro.x - rate - noise;
        }
        let [centre, this] = sums.map(|s| (s / f64::from(n)).abs());
        assert!(this < 0.02 && this < 0.5 * centre, "{rate}: {centre} {this}");
    }
}

#[test]
fn without_dither_it_is_no_worse_than_the_centre_of_the_bin() {
    for sigma in [0.1, 0.2, 0.3] {
        let mut sums = [0.0; 2];
        for (rate, seed) in rates() {
            for (sum, bias) in sums.iter_mut().zip(show(|_| rate, sigma, seed).bias) {
                *sum += bias * bias;
            }
        }
        assert!(sums[1] < sums[0], "sigma {sigma}: {sums:?}");
    }
    // After a turn the mean must not stay at the edge of the dead zone.
    let shown = show(|t| if t < 5.0 { 40.0 } else { 0.0 }, 0.1, 1);
    assert!(shown.bias[1].abs() < 0.02, "{:?}", shown.bias);
}

#[test]
fn large_motion_passes_as_through_the_centres() {
    for (amplitude, period) in [(5.0, 10.0), (20.0, 5.0), (100.0, 2.0)] {
        let shown = show(|t| 0.3 + amplitude * sin(std::f64::consts::TAU * t / period), 1.0, 7);
        assert!(shown.bias[1].abs() < 0.02, "{amplitude}: {:?}", shown.bias);
    }
}

/// Share of a swing of 0.4 step in half a second that arrives, where noise dithers it.
fn arriving(rate: f64, sigma: f64) -> f64 {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
    let mut dequantiser = Dequantiser::new(STEP);
    let (mut along, mut all) = (0.0, 0.0);
    for k in 0..400_000_u32 {
        let t_s = f64::from(k) * 0.02;
        let swing = 0.4 * sin(std::f64::consts::TAU * 2.0 * t_s);
        let noise: f64 = StandardNormal.sample(&mut rng);
        let gyro = Vector3::repeat((rate + swing + sigma * noise).trunc());
        let sample = ImuSample { t_s, gyro, accel: Vector3::zeros(), temperature_degc: None };
        along += (dequantiser.undo(&sample).gyro.x - rate) * swing;
        all += swing * swing;
    }
    along / all
}

/// The mean of the normal distribution inside the bin lacks 6 to 15 % of it at 1.2 steps and 8 to 21 % at 1 step.
#[test]
fn fast_motion_within_the_noise_passes_in_full() {
    for sigma in [1.0, 1.2, 2.0] {
        for rate in [0.0, 0.6, 1.5, 5.0] {
            let share = arriving(rate, sigma);
            // Measured with an uncertainty of 0.006 times sigma.
            assert!((share - 1.0).abs() < 0.02 * sigma, "rate {rate}, noise {sigma}: {share}");
        }
    }
}

#[test]
fn the_variance_told_is_the_one_means_show() {
    for sigma in [0.5, 1.0, 2.0] {
        let (mut added, mut predicted) = (0.0, 0.0);
        for (rate, seed) in rates() {
            let shown = show(|_| rate, sigma, seed);
            added += shown.added / 25.0;
            predicted += shown.predicted / 25.0;
        }
        // Measured at sigma 2 with an uncertainty of 0.15.
        assert!((predicted - added).abs() < 0.05 + 0.1 * sigma * sigma, "{sigma}: {predicted} {added}");
    }
    // Counts that have stood still for minutes: anything from -1 to 1.
    let mut dequantiser = Dequantiser::new(STEP);
    for k in 0..20_000_u32 {
        dequantiser.undo(&ImuSample {
            t_s: f64::from(k) * 0.02,
            gyro: Vector3::zeros(),
            accel: Vector3::zeros(),
            temperature_degc: None,
        });
    }
    assert!((dequantiser.variance().0.x - 1.0 / 3.0).abs() < 0.01, "{:?}", dequantiser.variance());
}

#[test]
fn a_shock_after_a_minute_of_rest_leaves_numbers() {
    let mut dequantiser = Dequantiser::new(STEP);
    for k in 0..3100_u32 {
        let rate = if k < 3000 { 0.0 } else { 30_000.0 };
        let sample = ImuSample {
            t_s: f64::from(k) * 0.02,
            gyro: Vector3::repeat(rate),
            accel: Vector3::repeat(-rate),
            temperature_degc: None,
        };
        let back = dequantiser.undo(&sample);
        assert!((back.gyro - sample.gyro).amax() <= 1.0 && (back.accel - sample.accel).amax() <= 1.0, "{k}");
    }
}

#[test]
fn sources_that_do_not_truncate_pass_unchanged() {
    let sample = ImuSample {
        t_s: 1.0,
        gyro: Vector3::new(0.4e-3, 1.0, -1.0),
        accel: Vector3::new(0.0, 0.1, -9.8),
        temperature_degc: None,
    };
    for q in [Quantisation::None, Quantisation::Round(Steps::RAW_IMU)] {
        assert_eq!(Dequantiser::new(q).undo(&sample), sample);
    }
}

proptest! {
    #[test]
    fn undoing_truncation_leaves_at_most_half_a_step_outside_the_dead_zone(v in -1.0..1.0f64) {
        let q = Quantisation::Truncate(Steps::RAW_IMU);
        let (gyro, accel) = q.apply(&Vector3::repeat(v), &Vector3::repeat(v));
        let back = q.undo(&ImuSample { t_s: 0.0, gyro, accel, temperature_degc: None });
        let limit = if v.abs() < Steps::RAW_IMU.gyro { Steps::RAW_IMU.gyro } else { 0.5 * Steps::RAW_IMU.gyro };
        prop_assert!((back.gyro.x - v).abs() <= limit * 1.000_001);
    }
}

#[test]
fn truncation_goes_toward_zero() {
    let q = Quantisation::Truncate(Steps { gyro: 1.0, accel: 1.0 });
    let (g, _) = q.apply(&Vector3::new(1.9, -1.9, 0.9), &Vector3::zeros());
    assert_eq!(g, Vector3::new(1.0, -1.0, 0.0));
}

/// Half a minute at rest, over all mean rates inside the dead zone and beside it: errors of the mean are as large as they are said to be, however little noise
/// there is. Two counts that take turns passed for dither: NEES 2.6 and 8 % beyond three sigmas at a tenth of a step.
#[test]
fn the_constant_error_at_rest_is_as_large_as_said() {
    for sigma in [0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 1.0] {
        for first in [-1.3, 4.0] {
            let (mut squares, mut beyond, mut n) = (0.0, 0.0, 0.0);
            for k in 0..131_u32 {
                let rate = first + f64::from(k) * 0.02;
                let mut rng = Xoshiro256PlusPlus::seed_from_u64(u64::from(k));
                let mut dequantiser = Dequantiser::new(STEP);
                let (mut sum, mut said) = (0.0, 0.0);
                for i in 0..1_500_u32 {
                    let noise: f64 = StandardNormal.sample(&mut rng);
                    let gyro = Vector3::repeat((rate + sigma * noise).trunc());
                    let t_s = f64::from(i) * 0.02;
                    let sample = ImuSample { t_s, gyro, accel: Vector3::zeros(), temperature_degc: None };
                    let back = dequantiser.undo(&sample).gyro.x;
                    let at_rest = dequantiser.at_rest();
                    sum += back - at_rest.mean[0].x - rate;
                    said += at_rest.variance[0].x;
                }
                let (error, variance) = (sum / 1_500.0, (said + sigma * sigma) / 1_500.0);
                squares += error * error / variance;
                beyond += f64::from(u8::from(error * error > 9.0 * variance));
                n += 1.0;
            }
            let (nees, beyond) = (squares / n, beyond / n);
            assert!(nees < 1.2 && beyond < 0.02, "sigma {sigma} from {first}: {nees} {beyond}");
        }
    }
}

/// With a tenth of a step of noise two counts that take turns show the edge between them: far more than the count alone.
#[test]
fn two_counts_that_take_turns_show_the_edge_between_them() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut dequantiser = Dequantiser::new(STEP);
    for i in 0..1_500_u32 {
        let noise: f64 = StandardNormal.sample(&mut rng);
        let gyro = Vector3::new((5.05 + 0.1 * noise).trunc(), (5.5 + 0.1 * noise).trunc(), 0.0);
        dequantiser.undo(&ImuSample { t_s: f64::from(i) * 0.02, gyro, accel: gyro, temperature_degc: None });
    }
    let variance = dequantiser.at_rest().variance[0];
    assert!(variance.x < 0.02 && (variance.y - 1.0 / 12.0).abs() < 2e-3, "{variance}");
    assert!((variance.z - 1.0 / 3.0).abs() < 2e-3, "{variance}");
}

/// Hands that shake before they put it down pass through counts that the noise never reaches: of the rest they show nothing.
#[test]
fn what_counts_show_of_a_rest_begins_when_the_motion_ends() {
    let mut dequantiser = Dequantiser::new(STEP);
    for i in 0..1_000_u32 {
        let t_s = f64::from(i) * 0.02;
        let shaken = if i < 200 { 5.0 * (1.0 - t_s / 4.0) * sin(20.0 * t_s) } else { 0.0 };
        let gyro = Vector3::repeat((5.5 + shaken).trunc());
        if i < 250 {
            dequantiser.moves();
        }
        dequantiser.undo(&ImuSample { t_s, gyro, accel: gyro, temperature_degc: None });
    }
    let at_rest = dequantiser.at_rest();
    assert!((at_rest.variance[0].x - 1.0 / 12.0).abs() < 2e-3 && at_rest.mean[0].x == 0.0, "{at_rest:?}");
}
