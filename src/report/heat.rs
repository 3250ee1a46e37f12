//! A map of the disagreement: a row per channel, a column per stretch of time, coloured by the mean squared normalised residual.

use gaware_nav::identify::residual::{CHANNELS, Point};
use gaware_nav::math::ln;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Columns of a map.
const COLUMNS: f64 = 80.0;
/// Size of the drawing: row height, width of the names, width of the map.
const ROW: f64 = 19.0;
const NAMES: f64 = 140.0;
const MAP: f64 = 710.0;

/// Opacity of the colour for a mean square: nothing up to twice what noise does, full at forty times.
fn opacity(mean_square: f64) -> f64 {
    (ln(mean_square.max(2.0) / 2.0) / ln(20.0f64)).clamp(0.0, 1.0)
}

/// The map as inline SVG; empty where there is nothing to draw. `colour` is that of the disagreement.
pub fn map(title: &str, points: &[Point], colour: &str) -> String {
    let Some(end_s) = points.last().map(|p| p.motion.elapsed_s).filter(|t| *t > 0.0) else {
        return String::new();
    };
    let step_s = end_s / COLUMNS;
    let rows: Vec<usize> =
        (0..CHANNELS.len()).filter(|c| points.iter().any(|p| p.normalised(*c).is_some())).collect();
    let height = 40.0 + ROW * rows.len() as f64;
    let mut svg = format!(
        "<div class=\"drawing\"><svg class=\"plot\" role=\"img\" viewBox=\"0 0 860 {height:.0}\" font-family=\"sans-serif\" font-size=\"15\" \
         fill=\"currentColor\"><title>{title}</title><text x=\"{NAMES:.0}\" y=\"13\">{title}</text>"
    );
    for (k, channel) in rows.iter().enumerate() {
        let y = 18.0 + ROW * k as f64;
        let mut cells: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
        for p in points {
            if let Some(z) = p.normalised(*channel) {
                let cell = cells
                    .entry(((p.motion.elapsed_s / step_s) as usize).min(COLUMNS as usize - 1))
                    .or_default();
                *cell = (cell.0 + z * z, cell.1 + 1.0);
            }
        }
        let name = CHANNELS[*channel].replace('_', " ");
        let _ = write!(
            svg,
            "<text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{name}</text>\
             <rect x=\"{NAMES:.0}\" y=\"{y:.1}\" width=\"{MAP:.0}\" height=\"{:.1}\" fill=\"none\" stroke=\"currentColor\" stroke-opacity=\".15\"/>",
            NAMES - 6.0,
            y + ROW - 4.5,
            ROW - 2.0
        );
        for (column, (sum, n)) in cells {
            let strength = opacity(sum / n);
            if strength > 0.0 {
                let _ = write!(
                    svg,
                    "<rect x=\"{:.1}\" y=\"{y:.1}\" width=\"{:.2}\" height=\"{:.1}\" fill=\"{colour}\" fill-opacity=\"{strength:.2}\"/>",
                    NAMES + MAP * column as f64 / COLUMNS,
                    MAP / COLUMNS + 0.3,
                    ROW - 2.0
                );
            }
        }
    }
    let every = [5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0];
    let every = every.into_iter().find(|e| end_s / e <= 13.0).unwrap_or(1200.0);
    let mut t = 0.0;
    while t <= end_s {
        let x = NAMES + MAP * t / end_s;
        let _ =
            write!(svg, "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{t:.0}</text>", height - 8.0);
        t += every;
    }
    let _ = write!(
        svg,
        "<text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">s</text></svg></div>",
        NAMES - 6.0,
        height - 8.0
    );
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_stays_blank_and_a_gap_is_full() {
        assert_eq!(opacity(1.0), 0.0);
        assert_eq!(opacity(2.0), 0.0);
        assert!((opacity(40.0) - 1.0).abs() < 1e-12 && opacity(9.0) > 0.3);
        assert_eq!(map("nothing", &[], "red"), "");
    }
}
