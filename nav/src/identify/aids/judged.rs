//! What is measured as scalars along a settled trajectory, judged: its noise, its effects all together, and which of them the flight shows.

use super::choose::{self, Chosen, Confirm, Widths, is_held_out};
use super::series::{self, Figures, Known, Noise, Prior, Row};
use crate::identify::evidence::{SCALES, log_mean_exp};
use crate::identify::pass::Information;
use crate::identify::statistics::rms;

/// Passes: wind multiplies the scale and the coefficients, and the noise is fitted.
const PASSES: usize = 5;
/// Fewer rows than this say nothing.
pub(in crate::identify) const ENOUGH: usize = 100;
/// Length of the blocks that are taken for independent of each other, s.
pub(in crate::identify) const BLOCK_S: f64 = 20.0;

/// Something that is measured along a flight.
pub(in crate::identify) trait Judged {
    fn widths(&self) -> &Widths;
    fn noise_figures(&self) -> (&'static Figures, Known);
    /// Where the passes begin.
    fn start(&self) -> Vec<f64> {
        vec![0.0; self.widths().len()]
    }
    /// What every instant says about these values.
    fn rows(&self, values: &[f64], with_columns: bool) -> Vec<Row>;
    /// Linearises about what these values say of anything else.
    fn follow(&mut self, values: &[f64], noise: &Noise);
    /// What is left of each measurement with these values, with its time since the start, s, where anything else (the wind) is what `by` says: an error that wind follows
    /// would leave no more than its correction does.
    fn left(&self, values: &[f64], by: &[f64], noise: &Noise) -> Vec<(f64, f64)>;

    /// RMS of what is left on the held-out blocks with these values.
    fn held_out_rms(&self, values: &[f64], by: &[f64], noise: &Noise) -> f64 {
        let left = self.left(values, by, noise).into_iter();
        rms(left.filter(|l| is_held_out((l.0 / BLOCK_S) as usize)).map(|l| l.1))
    }

    /// Values of all effects together within their widest priors, the noise, and the information about them there.
    fn fitted(&mut self) -> Option<(Vec<f64>, Noise, Vec<Information>)> {
        let mut values = self.start();
        let mut noise = None;
        for pass in 0..PASSES {
            let rows = self.rows(&values, true);
            if rows.len() < ENOUGH {
                return None;
            }
            let every: Vec<usize> = (0..self.widths().catalogue.len()).collect();
            let own = self.noise(&rows, &every, &values, noise.as_ref()).1;
            let run = series::pass(&rows, &own, BLOCK_S);
            if pass + 1 == PASSES {
                return Some((values, own, run.blocks));
            }
            let step = choose::step(&run.blocks, &[], self.widths(), &values)?;
            values.iter_mut().zip(&step).for_each(|(v, s)| *v += s);
            self.follow(&values, &own);
            noise = Some(own);
        }
        None
    }

    /// The likeliest noise where these effects are there, and the logarithm of that likelihood.
    fn noise(&self, rows: &[Row], named: &[usize], values: &[f64], near: Option<&Noise>) -> (f64, Noise) {
        let (figures, known) = self.noise_figures();
        let sigma = self.widths().with(named, None);
        series::noise_of(rows, figures, Prior { sigma: &sigma, values }, known, near)
    }

    /// Chooses. An effect has to be worth the odds also against the noise that would do without it: a slow one against weather that changes
    /// faster, a port against a trajectory whose height is worse.
    fn chosen(&self, values: &[f64], noise: &Noise, blocks: &[Information]) -> Chosen {
        let rows = self.rows(values, true);
        let unfounded = |named: &[usize]| {
            if let Some(e) = named.iter().find(|e| self.widths().is_within_what_is_known(**e, values)) {
                return Some(*e);
            }
            let all = self.noise(&rows, named, values, Some(noise));
            let odds = |e: &usize| {
                let others: Vec<usize> = named.iter().copied().filter(|o| o != e).collect();
                let with = all.0 + self.of_its_size(&rows, named, *e, values, &all.1);
                (*e, with - self.noise(&rows, &others, values, None).0)
            };
            let worst = named.iter().map(odds).min_by(|a, b| a.1.total_cmp(&b.1));
            worst.filter(|w| w.1 < choose::THRESHOLD).map(|w| w.0)
        };
        let held_out_error = |values: &[f64], by: &[f64]| self.held_out_rms(values, by, noise);
        let confirm = Confirm { held_out_error: &held_out_error, unfounded: &unfounded };
        choose::choose(blocks, &[], self.widths(), values, &confirm)
    }

    /// By how much an effect is likelier with the width of its prior averaged over a few scales than with its widest.
    fn of_its_size(&self, rows: &[Row], named: &[usize], e: usize, values: &[f64], noise: &Noise) -> f64 {
        let at = |sigma: &[f64]| series::marginal(rows, noise, Prior { sigma, values });
        let scaled = SCALES.map(|scale| at(&self.widths().with(named, Some((e, scale)))));
        log_mean_exp(scaled) - at(&self.widths().with(named, None))
    }
}
