//! Reading parameters by name: a few requests in flight, repeated until they are answered or given up.
//!
//! Autopilots do not answer for a parameter that they do not have (ArduPilot does from 4.7 on), and a poor link loses requests and answers of one that they
//! have: a name is given up when so much silence is not to be expected of this link any more.

use super::{Encoding, ParamMessage, ParamName, ParamValue};
use crate::change::Exchange;
use gaware_nav::math::ln;
use std::collections::BTreeMap;

/// Waiting times and patience.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParamTiming {
    /// Wait for an answer, s.
    pub reply_s: f64,
    /// Requests of a parameter that gets no answer; fewer where a link that has lost little needs fewer to be certain.
    pub tries: u32,
    /// Requests in flight; autopilots queue a few of them and drop the rest.
    pub window: usize,
}

impl Default for ParamTiming {
    fn default() -> Self {
        Self { reply_s: 0.7, tries: 10, window: 5 }
    }
}

/// A parameter that is there is taken for missing less often than once in so many.
const CERTAIN: f64 = 1000.0;

/// What was read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parameters {
    /// Values by name.
    pub values: BTreeMap<ParamName, ParamValue>,
    /// Parameters without a value: the vehicle says that it does not have them, or does not answer for them, or not at all.
    pub unanswered: Vec<ParamName>,
}

impl Parameters {
    /// The value of a parameter.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.values.iter().find(|(n, _)| n.as_str() == name).map(|(_, v)| v.value)
    }

    /// Whether none of the parameters asked for was answered.
    pub fn is_silent(&self) -> bool {
        self.values.is_empty() && !self.unanswered.is_empty()
    }
}

#[derive(Debug, Clone, Copy)]
struct Asked {
    name: ParamName,
    tries: u32,
    deadline: f64,
}

/// One reading of some parameters by name.
#[derive(Debug, Clone)]
pub struct ParamRead {
    encoding: Encoding,
    timing: ParamTiming,
    waiting: Vec<ParamName>,
    asked: Vec<Asked>,
    /// Parameters that were answered, and the requests that it took.
    answered: u32,
    sent: u32,
    read: Parameters,
}

impl Exchange for ParamRead {
    type Action = ParamMessage;
    type Message = ParamMessage;

    fn deadline(&self) -> Option<f64> {
        self.asked.iter().map(|a| a.deadline).min_by(f64::total_cmp)
    }

    fn receive(&mut self, now: f64, message: &ParamMessage) -> Vec<ParamMessage> {
        let (name, value) = match message {
            ParamMessage::Value { name, bits, kind: Some(kind), .. } => {
                (*name, Some(self.encoding.decode(*bits, *kind)))
            }
            ParamMessage::Missing { name } => (*name, None),
            _ => return Vec::new(),
        };
        let Some(at) = self.asked.iter().position(|a| a.name == name) else {
            // Somebody else's, or late.
            return Vec::new();
        };
        self.sent += self.asked.remove(at).tries;
        self.answered += 1;
        match value {
            Some(value) => drop(self.read.values.insert(name, value)),
            None => self.read.unanswered.push(name),
        }
        self.ask_more(now)
    }

    fn tick(&mut self, now: f64) -> Vec<ParamMessage> {
        let (mut messages, tries) = (Vec::new(), self.tries());
        for asked in self.asked.iter_mut().filter(|a| now >= a.deadline && a.tries < tries) {
            asked.tries += 1;
            asked.deadline = now + self.timing.reply_s;
            messages.push(ParamMessage::RequestRead { name: asked.name });
        }
        let given_up = self.asked.iter().filter(|a| now >= a.deadline).map(|a| a.name);
        self.read.unanswered.extend(given_up);
        self.asked.retain(|a| now < a.deadline);
        messages.extend(self.ask_more(now));
        messages
    }
}

impl ParamRead {
    /// Starts; send what is returned.
    pub fn start(
        encoding: Encoding,
        timing: ParamTiming,
        names: impl IntoIterator<Item = ParamName>,
        now: f64,
    ) -> (Self, Vec<ParamMessage>) {
        let mut waiting: Vec<ParamName> = names.into_iter().collect();
        waiting.reverse();
        let (asked, read) = (Vec::new(), Parameters::default());
        let mut read = Self { encoding, timing, waiting, asked, answered: 0, sent: 0, read };
        let messages = read.ask_more(now);
        (read, messages)
    }

    /// What was read, once every parameter was answered or given up.
    pub fn result(&self) -> Option<&Parameters> {
        (self.asked.is_empty() && self.waiting.is_empty()).then_some(&self.read)
    }

    /// Requests after which silence means that there is no such parameter: the share of lost answers to the power of them, that share by the rule of
    /// succession (Laplace) of what was answered and one lost request of the one that is waited for.
    fn tries(&self) -> u32 {
        let lost = f64::from(self.sent - self.answered + 2) / f64::from(self.sent + 3);
        let enough = (-ln(CERTAIN) / ln(lost)).ceil();
        (1..self.timing.tries).find(|n| f64::from(*n) >= enough).unwrap_or(self.timing.tries)
    }

    fn ask_more(&mut self, now: f64) -> Vec<ParamMessage> {
        let mut messages = Vec::new();
        while self.asked.len() < self.timing.window.max(1)
            && let Some(name) = self.waiting.pop()
        {
            self.asked.push(Asked { name, tries: 1, deadline: now + self.timing.reply_s });
            messages.push(ParamMessage::RequestRead { name });
        }
        messages
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::ParamType;

    fn names(list: &[&str]) -> Vec<ParamName> {
        list.iter().map(|n| n.parse().expect("a name")).collect()
    }

    fn value(name: ParamName, v: f32) -> ParamMessage {
        ParamMessage::Value { name, bits: v.to_bits(), kind: Some(ParamType::Real32), count: 9, index: 65535 }
    }

    /// A vehicle that has every parameter but those named MISSING, and loses the first request of each.
    #[test]
    fn lost_requests_are_repeated_and_missing_parameters_given_up() {
        let wanted = names(&["A", "B", "C", "MISSING", "E", "F", "G", "H"]);
        let (mut read, first) =
            ParamRead::start(Encoding::ByValue, ParamTiming::default(), wanted.clone(), 0.0);
        assert_eq!(first.len(), 5, "no more in flight than the window");
        let (mut now, mut seen) = (0.0, BTreeMap::<ParamName, u32>::new());
        let mut messages = first;
        while read.result().is_none() {
            let mut next = Vec::new();
            for message in std::mem::take(&mut messages) {
                let ParamMessage::RequestRead { name } = message else { panic!("{message:?}") };
                let count = seen.entry(name).or_default();
                *count += 1;
                if *count > 1 && name.as_str() != "MISSING" {
                    next.extend(read.receive(now, &value(name, 2.5)));
                }
            }
            if next.is_empty() && read.result().is_none() {
                now = read.deadline().expect("something is in flight");
                next = read.tick(now);
            }
            messages = next;
        }
        let result = read.result().expect("over");
        assert_eq!(result.unanswered, names(&["MISSING"]));
        assert_eq!((result.values.len(), result.get("H"), result.get("MISSING")), (7, Some(2.5), None));
        assert!(seen.values().all(|tries| *tries <= 10), "{seen:?}");
    }

    /// What is left open of readings by a vehicle that has the names of one letter, over a link that loses this share of the messages each way; and the longest, s.
    fn left_open(wanted: &[&str], loss: f64, seeds: u64) -> (usize, f64) {
        let (mut open, mut longest) = (0, 0.0_f64);
        for seed in 0..seeds {
            let mut state = seed;
            let mut lost = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                ((state >> 33) as f64) < loss * f64::from(1_u32 << 31)
            };
            let (mut read, mut messages) =
                ParamRead::start(Encoding::ByValue, ParamTiming::default(), names(wanted), 0.0);
            let mut now = 0.0;
            while read.result().is_none() {
                let sent = std::mem::take(&mut messages);
                for message in sent {
                    let ParamMessage::RequestRead { name } = message else { panic!("{message:?}") };
                    if name.as_str().len() == 1 && !lost() && !lost() {
                        messages.extend(read.receive(now, &value(name, 2.5)));
                    }
                }
                if messages.is_empty() && read.result().is_none() {
                    now = read.deadline().expect("something is in flight");
                    messages = read.tick(now);
                }
            }
            open += read.result().map_or(0, |r| r.unanswered.len());
            longest = longest.max(now);
        }
        (open, longest)
    }

    /// A link that loses a fifth each way, and one that loses nothing.
    #[test]
    fn what_is_there_is_found_on_a_poor_link_and_what_is_not_is_soon_given_up_on_a_good_one() {
        assert!(left_open(&["A", "B"], 0.2, 2000).0 <= 4);
        assert!(left_open(&["A", "B", "C", "D", "E", "F", "G", "H"], 0.2, 500).0 <= 4);
        let seconds = |wanted: &[&str]| left_open(wanted, 0.0, 1).1;
        assert!((seconds(&["A", "B", "C", "D", "E", "F", "G", "H", "MISSING"]) - 3.5).abs() < 1e-9);
        assert!((seconds(&["MISSING"]) - 7.0).abs() < 1e-9);
    }

    #[test]
    fn a_vehicle_that_says_so_has_no_such_parameter() {
        let wanted = names(&["A", "MISSING"]);
        let (mut read, _) = ParamRead::start(Encoding::ByValue, ParamTiming::default(), wanted.clone(), 0.0);
        read.receive(0.1, &value(wanted[0], 1.0));
        read.receive(0.1, &ParamMessage::Missing { name: wanted[1] });
        assert!(read.result().is_some_and(|r| r.unanswered == [wanted[1]] && r.get("A") == Some(1.0)));
    }

    #[test]
    fn a_silent_vehicle_ends_the_reading() {
        let (mut read, _) = ParamRead::start(
            Encoding::ByBytes,
            ParamTiming::default(),
            names(&["A", "B", "C", "D", "E", "F"]),
            0.0,
        );
        // Values that were not asked for do not count.
        assert!(read.receive(0.1, &value(names(&["F"])[0], 1.0)).is_empty());
        while let Some(t) = read.deadline() {
            read.tick(t);
        }
        assert!(read.result().is_some_and(|r| r.is_silent() && r.unanswered.len() == 6));
    }
}
