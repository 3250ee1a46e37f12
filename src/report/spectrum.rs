//! Power spectral density of a sampled series by averaged modified periodograms (P. D. Welch, "The use of fast Fourier transform for the
//! estimation of power spectra", IEEE Trans. Audio Electroacoust. 15(2), 1967).

use gaware_nav::math::{cos, log10, sin};
use std::f64::consts::TAU;

/// Samples of a segment; neighbouring segments overlap by half.
const SEGMENT: usize = 64;
/// Two samples further apart than so many usual intervals belong to different segments.
const PAUSE: f64 = 1.5;
/// A mean of fewer segments scatters too much to be shown.
const FEWEST: usize = 4;

/// Frequency in Hz and power relative to white noise of unit variance in dB, of samples (time in s, value).
/// Empty for a series that is too short.
pub fn decibels(samples: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut intervals: Vec<f64> = samples.windows(2).map(|w| w[1].0 - w[0].0).collect();
    intervals.sort_by(f64::total_cmp);
    let Some(interval_s) = intervals.get(intervals.len() / 2).copied().filter(|t| *t > 0.0) else {
        return Vec::new();
    };
    let window: Vec<f64> = (0..SEGMENT).map(|k| 0.5 - 0.5 * cos(TAU * k as f64 / SEGMENT as f64)).collect();
    let weight: f64 = window.iter().map(|w| w * w).sum();
    let runs = samples.chunk_by(|a, b| b.0 - a.0 < PAUSE * interval_s);
    let segments: Vec<&[(f64, f64)]> =
        runs.flat_map(|run| run.windows(SEGMENT).step_by(SEGMENT / 2)).collect();
    if segments.len() < FEWEST {
        return Vec::new();
    }
    let power = |segment: &[(f64, f64)], bin: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for (k, ((_, value), w)) in segment.iter().zip(&window).enumerate() {
            let angle = TAU * (bin * k) as f64 / SEGMENT as f64;
            re += w * value * cos(angle);
            im -= w * value * sin(angle);
        }
        (re * re + im * im) / weight
    };
    let mean = |bin: usize| segments.iter().map(|s| power(s, bin)).sum::<f64>() / segments.len() as f64;
    (1..=SEGMENT / 2)
        .map(|bin| (bin as f64 / (SEGMENT as f64 * interval_s), 10.0 * log10(mean(bin).max(1e-12))))
        .collect()
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::powf;

    use super::*;

    #[test]
    fn a_sine_stands_at_its_frequency_with_its_power() {
        let samples: Vec<(f64, f64)> =
            (0..640).map(|k| (0.2 * f64::from(k), sin(TAU * 0.1 * f64::from(k)))).collect();
        let spectrum = decibels(&samples);
        let peak = spectrum.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!((peak.0 - 0.5).abs() < 0.05, "{peak:?}");
        // A sine of unit amplitude has the power N/4 times the coherent gain of the window over its noise gain (2/3).
        let expected = 10.0 * log10(64.0_f64 / 4.0 * 2.0 / 3.0);
        assert!((peak.1 - expected).abs() < 1.0, "{peak:?}, expected {expected}");
    }

    #[test]
    fn white_noise_of_unit_variance_is_at_zero_decibels() {
        // Signs of a linear congruential generator (Numerical Recipes).
        let mut state = 1_u32;
        let samples: Vec<(f64, f64)> = (0..6400)
            .map(|k| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (0.2 * f64::from(k), if state >> 31 == 0 { 1.0 } else { -1.0 })
            })
            .collect();
        let spectrum = decibels(&samples);
        assert_eq!(spectrum.len(), 32);
        let mean = spectrum.iter().map(|p| powf(10f64, p.1 / 10.0)).sum::<f64>() / 32.0;
        assert!((mean - 1.0).abs() < 0.1, "{mean}");
    }

    #[test]
    fn a_short_series_or_one_with_pauses_has_no_spectrum() {
        assert!(decibels(&[]).is_empty());
        let pauses: Vec<(f64, f64)> = (0..640).map(|k| (f64::from(k + 10 * (k / 40)), 1.0)).collect();
        assert!(decibels(&pauses).is_empty());
    }
}
