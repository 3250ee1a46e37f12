//! What was looked for and not found, with the sigma that these flights leave it: an effect smaller than a few of those sigmas may be
//! there all the same. The sigma is that of the information bound along the flown trajectory (van Trees 1968, section 2.4), given
//! what else was found and with hardly any prior: what the flights themselves know.

use super::evidence;
use super::pass::Information;
use crate::model::EffectSetting;

/// The prior of an effect is made so many times wider.
const WIDE: f64 = 30.0;

/// One effect that was not found.
#[derive(Debug, Clone)]
pub struct NotFound {
    /// The effect with the values that suit the flights best, and their sigmas.
    pub setting: EffectSetting,
    /// Logarithm of the odds that it is there.
    pub evidence: f64,
    /// Why there is no better limit, where there is a reason.
    pub reason: Option<&'static str>,
}

/// Columns of the information that belong to what was found, with prior sigmas and offsets.
pub(super) struct Known<'a> {
    pub(super) sigma: &'a [f64],
    pub(super) offset: &'a [f64],
}

/// An effect that was not found, whose parameters stand in `columns` (parameter, column).
pub(super) fn of(
    setting: &EffectSetting,
    columns: &[(usize, usize)],
    known: &Known<'_>,
    information: &Information,
    evidence: f64,
) -> Option<NotFound> {
    let open: Vec<usize> = (0..known.sigma.len()).filter(|k| known.sigma[*k] > 0.0).collect();
    let own: Vec<f64> = setting
        .effect
        .groups()
        .iter()
        .flat_map(|g| std::iter::repeat_n(g.prior_sigma, g.shape.len()))
        .collect();
    let all: Vec<usize> = open.iter().copied().chain(columns.iter().map(|c| c.1)).collect();
    let wide = columns.iter().map(|(parameter, _)| own[*parameter] * WIDE);
    let sigma: Vec<f64> = open.iter().map(|k| known.sigma[*k]).chain(wide).collect();
    let offset: Vec<f64> = open.iter().map(|k| known.offset[*k]).chain(columns.iter().map(|_| 0.0)).collect();
    let fit = evidence::fit(information, &all, &sigma, &offset)?;
    let mut setting = setting.clone();
    for (i, (parameter, _)) in columns.iter().enumerate() {
        let at = open.len() + i;
        setting.values[*parameter] += fit.step[at];
        setting.sigmas[*parameter] = fit.covariance[(at, at)].max(0.0).sqrt();
    }
    Some(NotFound { setting, evidence, reason: None })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::GpsLatency;

    #[test]
    fn the_sigma_is_that_of_the_information() {
        let mut information = Information::zeros(2);
        information.matrix[(0, 0)] = 4.0;
        information.matrix[(1, 1)] = 1e4;
        information.matrix[(0, 1)] = 100.0;
        information.matrix[(1, 0)] = 100.0;
        information.score[1] = 50.0;
        let unknown = EffectSetting { sigmas: vec![0.0], ..EffectSetting::unknown(&GpsLatency) };
        let alone = of(&unknown, &[(0, 1)], &Known { sigma: &[], offset: &[] }, &information, -1.0).unwrap();
        assert!(
            (alone.setting.sigmas[0] - 0.01).abs() < 1e-5 && (alone.setting.values[0] - 5e-3).abs() < 1e-5
        );
        // Beside something else that imitates it in part: 1/√(10⁴ − 100²/(4 + 1)).
        let known = Known { sigma: &[1.0], offset: &[0.0] };
        let beside = of(&unknown, &[(0, 1)], &known, &information, -1.0).unwrap();
        assert!((beside.setting.sigmas[0] - 8000.0f64.sqrt().recip()).abs() < 1e-5, "{beside:?}");
    }
}
