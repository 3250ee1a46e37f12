//! What stands out in a fleet: which units, drifts and shifts are significant, each with its size in words.

use super::{FirmwareShift, ParameterFamily, UnitFamily};
use crate::figures::with_sigma;

/// Kinds of findings, in the order in which a report has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A unit whose constant part is far from those of the others.
    OutOfFamily,
    /// A shift that came with a firmware.
    Firmware,
    /// A drift over time.
    Drift,
    /// A unit that scatters more from flight to flight.
    Scatter,
}

/// One finding.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What it is.
    pub kind: Kind,
    /// Index of the parameter in the family.
    pub parameter: usize,
    /// The unit; of a shift with a firmware there is none.
    pub unit: Option<String>,
    /// Its size in words.
    pub size: String,
    /// Its size in sigmas, to order findings of a kind.
    pub strength: f64,
    /// The whole in one sentence.
    pub sentence: String,
}

/// Every finding, by parameter.
pub fn of(parameters: &[ParameterFamily]) -> Vec<Finding> {
    let mut out = Vec::new();
    for (parameter, p) in parameters.iter().enumerate() {
        p.units.iter().for_each(|u| out.extend(of_unit(parameter, p, u)));
        out.extend(p.firmware_shifts.iter().filter(|s| s.significant).map(|s| of_shift(parameter, p, s)));
    }
    out
}

fn of_unit(parameter: usize, p: &ParameterFamily, u: &UnitFamily) -> Vec<Finding> {
    let what = format!("{} {}", p.effect, p.name);
    let finding = |kind, strength, size: String, sentence| Finding {
        kind,
        parameter,
        unit: Some(u.unit.clone()),
        size,
        strength,
        sentence,
    };
    let mut out = Vec::new();
    if u.out_of_family {
        let t = u.family_t.unwrap_or_default().abs();
        let size = format!(
            "{} {}, {t:.1} standard deviations from the other units",
            with_sigma(u.constant.value, u.constant.sigma),
            p.unit
        );
        let sentence = format!("Unit {} is out of family in {what}: {size}", u.unit);
        out.push(finding(Kind::OutOfFamily, t, size, sentence));
    }
    if let Some(d) = u.drift_per_year.filter(|_| u.drifts) {
        let size = format!("{} {} per year", with_sigma(d.value, d.sigma), p.unit);
        let sentence = format!("Unit {} drifts in {what}: {size}", u.unit);
        out.push(finding(Kind::Drift, (d.value / d.sigma).abs(), size, sentence));
    }
    if u.scatters_more {
        let sentence =
            format!("Unit {} scatters more than the others from flight to flight in {what}", u.unit);
        out.push(finding(Kind::Scatter, 0.0, String::new(), sentence));
    }
    out
}

fn of_shift(parameter: usize, p: &ParameterFamily, s: &FirmwareShift) -> Finding {
    let by = format!("{} {}", with_sigma(s.shift.value, s.shift.sigma), p.unit);
    Finding {
        kind: Kind::Firmware,
        parameter,
        unit: None,
        size: format!("{by} with firmware {} (after {})", s.to, s.from),
        strength: (s.shift.value / s.shift.sigma).abs(),
        sentence: format!(
            "{} {} shifted by {by} with firmware {} (after {})",
            p.effect, p.name, s.to, s.from
        ),
    }
}
