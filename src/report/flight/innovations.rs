//! What the fixes said against what was expected of them: figures per channel, and over time.

use super::{AXES, series};
use crate::engine::snapshot::{Phase, Snapshot};
use crate::report::page::table;
use crate::report::plot::Plot;

const CHANNELS: [&str; 6] =
    ["position north", "position east", "position down", "velocity north", "velocity east", "velocity down"];
/// Beyond this an innovation is an outlier, sigma: one of 370 where nothing is missing.
const OUTLIER: f64 = 3.0;
/// Plots show no more, sigma; the table has the largest.
const SHOWN: f64 = 8.0;

/// One channel over the whole flight, in sigma.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name.
    pub name: &'static str,
    /// Root mean square; 1 where nothing is missing.
    pub rms: f64,
    /// Share beyond three sigma.
    pub outliers: f64,
    /// Largest, with its time, s.
    pub largest: (f64, f64),
}

/// All channels that the log has.
pub fn of(shots: &[Snapshot]) -> Vec<Channel> {
    let channel = |(k, name): (usize, &'static str)| {
        let running = shots.iter().filter(|s| s.phase == Phase::Running);
        let values: Vec<(f64, f64)> = running
            .filter_map(|s| Some((s.elapsed_s, *s.consistency.last_normalised_innovation.get(k)?)))
            .filter(|(_, v)| v.is_finite() && *v != 0.0)
            .collect();
        let n = values.len() as f64;
        let largest = values.iter().copied().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
        Some(Channel {
            name,
            rms: (values.iter().map(|(_, v)| v * v).sum::<f64>() / n).sqrt(),
            outliers: values.iter().filter(|(_, v)| v.abs() > OUTLIER).count() as f64 / n,
            largest,
        })
    };
    CHANNELS.into_iter().enumerate().filter_map(channel).collect()
}

/// The section of the page.
pub fn section(shots: &[Snapshot], channels: &[Channel], body: &mut String) -> Result<(), String> {
    if channels.is_empty() {
        return Ok(());
    }
    body.push_str(
        "<h2>Innovations</h2><p>What a fix says less what was expected of it, over its expected sigma.</p>",
    );
    let rows = channels.iter().map(|c| {
        [
            c.name.to_owned(),
            format!("{:.2}", c.rms),
            format!("{:.1} %", 100.0 * c.outliers),
            format!("{:.1}", c.largest.1),
            format!("{:.0}", c.largest.0),
        ]
    });
    let titles = ["Channel", "#RMS, sigma", "#beyond 3 sigma", "#largest, sigma", "#at, s"];
    body.push_str(&table(titles, rows));
    let largest = channels.iter().map(|c| c.largest.1.abs()).fold(4.0, f64::max);
    for (title, from) in [("position innovations", 0), ("velocity innovations", 3)] {
        let mut plot = Plot::new(title, "sigma").within(largest.min(SHOWN)).expected(2.0);
        for (k, (name, (_, color))) in ["north", "east", "down"].into_iter().zip(AXES).enumerate() {
            let points = series(shots, |s| s.consistency.last_normalised_innovation[from + k]);
            if points.iter().any(|(_, v)| *v != 0.0) {
                plot = plot.line(name, color, points);
            }
        }
        body.push_str(&plot.svg()?);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_outlier_is_named_with_its_time() {
        let shots: Vec<Snapshot> = (0..100)
            .map(|k| {
                let mut s =
                    Snapshot { elapsed_s: f64::from(k), phase: Phase::Running, ..Snapshot::default() };
                s.consistency.last_normalised_innovation[1] = if k == 40 { -50.0 } else { 1.0 };
                s
            })
            .collect();
        let found = of(&shots);
        assert_eq!(found.len(), 1, "channels without values are left out");
        assert_eq!(
            (found[0].name, found[0].largest, found[0].outliers),
            ("position east", (40.0, -50.0), 0.01)
        );
    }
}
