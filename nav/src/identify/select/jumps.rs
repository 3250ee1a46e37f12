//! Jumps: events of one flight, looked for at every fix.

use super::super::evidence;
use super::super::linear::shocks::Shock;
use super::super::pass::Options;
use super::{Candidate, Point, Search, is_jump, prior_sigmas};
use crate::effects::{Event, REGISTRY};
use crate::identify::watched::Watched;
use crate::model::EffectSetting;

/// Jumps this close to the end of the flight are not looked for, s.
const MARGIN_S: f64 = 10.0;

impl Search<'_> {
    /// A jump as a candidate, its instant averaged over. Shocks are those of each flight; an event belongs to one of them.
    pub(in crate::identify) fn jump(
        &self,
        setting: &EffectSetting,
        shocks: &[Vec<Shock>],
    ) -> Option<Candidate> {
        let gyro = setting.effect.event() == Some(Event::GyroBias);
        let mut jumps = Vec::new();
        for (flight, shocks) in self.flights.iter().zip(shocks) {
            let start_s = flight.initial().t_s;
            let within = |s: &&Shock| {
                let elapsed_s = s.t_s - start_s;
                elapsed_s > self.settings.options.settle_s && elapsed_s < flight.duration_s() - MARGIN_S
            };
            jumps.extend(shocks.iter().filter(within).map(|s| {
                let (score, information) = if gyro { s.gyro } else { s.fix };
                (s.t_s, score, information)
            }));
        }
        let own = prior_sigmas(setting.effect);
        let best = evidence::jump(&jumps, own[1])?;
        let mut found = setting.clone();
        found.values = vec![best.t_s, best.size.x, best.size.y, best.size.z];
        found.sigmas[0] = best.sigma_s;
        let width = own[1] * best.scale;
        let prior =
            found.values.iter().zip(&own).map(|(v, s)| if *s > 0.0 { (0.0, width) } else { (*v, 0.0) });
        Some(Candidate {
            prior: prior.collect(),
            setting: found,
            evidence: best.evidence,
            cost: best.alone - best.evidence,
        })
    }

    /// A jump can be seen only where it happens: where all the data speak of one, its block must not be held out. This is
    /// all that the held-out data ever have to say to the choice. Returns whether other blocks are held out now.
    pub(super) fn turn_phase_to_jump(&mut self, point: &Point) -> bool {
        let options = self.settings.options;
        if options.held_out_every < 2 {
            return false;
        }
        let shocks: Vec<Vec<Shock>> = self
            .problems(point, &Watched::default())
            .iter()
            .map(|problem| problem.shocks(&point.noise, &options.all()))
            .collect();
        let best = REGISTRY
            .iter()
            .filter(|effect| is_jump(**effect))
            .filter_map(|effect| self.jump(&EffectSetting::unknown(*effect), &shocks))
            .max_by(|a, b| a.evidence.total_cmp(&b.evidence));
        let jump = best.filter(|b| b.evidence > self.settings.threshold);
        jump.is_some_and(|jump| self.turn_phase_to(&[jump.setting.values[0]]))
    }

    /// The same for every jump of a choice: those that came to light after the first.
    pub(super) fn turn_phase_to_jumps_of(&mut self, point: &Point) -> bool {
        let jumps = point.added.iter().map(|a| &a.setting).filter(|s| is_jump(s.effect));
        let events_s: Vec<f64> = jumps.map(|s| s.values[0]).collect();
        self.turn_phase_to(&events_s)
    }

    /// Holds out the blocks that hide the fewest of these instants; those of now where no others hide fewer.
    fn turn_phase_to(&mut self, events_s: &[f64]) -> bool {
        let options = self.settings.options;
        let since_start = |event_s: &f64| {
            let flight = self.flights.iter().rev().find(|f| f.initial().t_s <= *event_s)?;
            Some(event_s - flight.initial().t_s)
        };
        let at_s: Vec<f64> = events_s.iter().filter_map(since_start).collect();
        // Two seconds later it must still be in the fit part.
        let near = |at_s: &f64| [-1.0, 0.0, 1.0, 2.0].map(|by_s| at_s + by_s);
        let held = |phase: u32| {
            let o = Options { phase, ..options };
            at_s.iter().flat_map(near).filter(|t_s| o.part(*t_s) == Some(1)).count()
        };
        let phases = 0..options.held_out_every;
        let best = phases.min_by_key(|p| (held(*p), *p != options.phase)).unwrap_or(options.phase);
        self.settings.options.phase = best;
        best != options.phase
    }
}
