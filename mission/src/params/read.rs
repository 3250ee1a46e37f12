//! Reading parameters by name: a few requests in flight, repeated until they are answered or given up.

use super::{Encoding, ParamMessage, ParamName, ParamValue};
use crate::change::Exchange;
use std::collections::BTreeMap;

/// Waiting times and patience.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParamTiming {
    /// Wait for an answer, s.
    pub reply_s: f64,
    /// Requests of a parameter that gets no answer. Autopilots do not answer for parameters that they do not have.
    pub tries: u32,
    /// Requests in flight; autopilots queue a few of them and drop the rest.
    pub window: usize,
}

impl Default for ParamTiming {
    fn default() -> Self {
        Self { reply_s: 0.7, tries: 3, window: 5 }
    }
}

/// What was read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parameters {
    /// Values by name.
    pub values: BTreeMap<ParamName, ParamValue>,
    /// Parameters that the vehicle did not answer for: it does not have them, or does not answer at all.
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
    read: Parameters,
}

impl Exchange for ParamRead {
    type Action = ParamMessage;
    type Message = ParamMessage;

    fn deadline(&self) -> Option<f64> {
        self.asked.iter().map(|a| a.deadline).min_by(f64::total_cmp)
    }

    fn receive(&mut self, now: f64, message: &ParamMessage) -> Vec<ParamMessage> {
        let ParamMessage::Value { name, bits, kind: Some(kind), .. } = message else { return Vec::new() };
        let before = self.asked.len();
        self.asked.retain(|a| a.name != *name);
        if self.asked.len() == before {
            // Somebody else's, or late.
            return Vec::new();
        }
        self.read.values.insert(*name, self.encoding.decode(*bits, *kind));
        self.ask_more(now)
    }

    fn tick(&mut self, now: f64) -> Vec<ParamMessage> {
        let mut messages = Vec::new();
        for asked in self.asked.iter_mut().filter(|a| now >= a.deadline && a.tries < self.timing.tries) {
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
        let mut read = Self { encoding, timing, waiting, asked: Vec::new(), read: Parameters::default() };
        let messages = read.ask_more(now);
        (read, messages)
    }

    /// What was read, once every parameter was answered or given up.
    pub fn result(&self) -> Option<&Parameters> {
        (self.asked.is_empty() && self.waiting.is_empty()).then_some(&self.read)
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
        assert!(seen.values().all(|tries| *tries <= 3), "{seen:?}");
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
