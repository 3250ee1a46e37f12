//! Reading all parameters: the list, then by number what was lost of it (MAVLink "Parameter Protocol", "Read All Parameters").
//!
//! PX4 sends the hash of its parameters along, as a parameter named `_HASH_CHECK` without a number
//! (`modules/mavlink/mavlink_parameters.cpp`): two lists with the same hash hold the same lasting values. Where it was lost it is asked
//! for by name; a vehicle that does not answer that has none.

use super::{Encoding, ParamMessage, ParamName, ParamTiming, ParamValue};
use crate::change::Exchange;
use std::collections::BTreeMap;

/// The parameter that is the hash.
pub const HASH: &str = "_HASH_CHECK";
/// Number of a parameter that has none.
const NO_INDEX: u16 = u16::MAX;
/// Silence after which what is missing is asked for, s: links slow down during a list.
const SILENCE_S: f64 = 1.5;
/// More parameters than any autopilot has: a vehicle that announces more is not followed.
const MOST: u16 = 10_000;

/// All parameters of a vehicle.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AllParameters {
    /// Values by name.
    pub values: BTreeMap<ParamName, ParamValue>,
    /// PX4's hash of them.
    pub hash: Option<u32>,
}

/// Why there is no list.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ListError {
    /// It was not to go on.
    #[error("{0}")]
    Stopped(String),
    /// No answer at all.
    #[error("the vehicle does not answer the request for its parameters")]
    Silent,
    /// Some never came.
    #[error("{missing} of {count} parameters did not arrive, although each was asked for several times")]
    Incomplete {
        /// How many.
        missing: usize,
        /// Of so many.
        count: u16,
    },
    /// Not a vehicle's count.
    #[error("the vehicle announces {0} parameters, more than any autopilot has")]
    TooMany(u16),
}

/// One reading of all parameters.
#[derive(Debug, Clone)]
pub struct ParamList {
    encoding: Encoding,
    timing: ParamTiming,
    count: Option<u16>,
    by_index: BTreeMap<u16, (ParamName, ParamValue)>,
    hash: Option<u32>,
    /// Requests of the hash by name.
    hash_asked: u32,
    lists_left: u32,
    /// Numbers asked for, with attempts.
    asked: BTreeMap<u16, u32>,
    deadline: f64,
    result: Option<Result<AllParameters, ListError>>,
}

impl Exchange for ParamList {
    type Action = ParamMessage;
    type Message = ParamMessage;

    fn deadline(&self) -> Option<f64> {
        self.result.is_none().then_some(self.deadline)
    }

    fn receive(&mut self, now: f64, message: &ParamMessage) -> Vec<ParamMessage> {
        let ParamMessage::Value { name, bits, kind: Some(kind), count, index } = message else {
            return Vec::new();
        };
        if self.result.is_some() {
            return Vec::new();
        }
        if name.as_str() == HASH {
            self.hash = Some(*bits);
            if self.hash_asked > 0 {
                self.finish();
            }
            return Vec::new();
        }
        if *index == NO_INDEX || *index >= *count {
            // The answer to somebody's setting.
            return Vec::new();
        }
        if *count > MOST {
            self.result = Some(Err(ListError::TooMany(*count)));
            return Vec::new();
        }
        if self.count.replace(*count).is_some_and(|before| before != *count) {
            // A parameter appeared or vanished: the numbers have moved.
            self.by_index.clear();
            self.asked.clear();
            self.hash_asked = 0;
        }
        self.by_index.insert(*index, (*name, self.encoding.decode(*bits, *kind)));
        self.deadline = now + if self.asked.is_empty() { SILENCE_S } else { self.timing.reply_s };
        let was_asked = self.asked.remove(index).is_some();
        if self.missing().next().is_none() {
            // Once the hash is asked for, only the clock asks again.
            return if self.hash_asked > 0 { Vec::new() } else { self.complete(now) };
        }
        if was_asked { self.ask() } else { Vec::new() }
    }

    fn tick(&mut self, now: f64) -> Vec<ParamMessage> {
        if self.result.is_some() || now < self.deadline {
            return Vec::new();
        }
        let Some(count) = self.count else {
            if self.lists_left == 0 {
                self.result = Some(Err(ListError::Silent));
                return Vec::new();
            }
            self.lists_left -= 1;
            self.deadline = now + SILENCE_S;
            return vec![ParamMessage::RequestList];
        };
        if self.missing().next().is_none() {
            return self.complete(now);
        }
        self.deadline = now + self.timing.reply_s;
        if self.asked.values().any(|tries| *tries >= self.timing.tries) {
            self.result = Some(Err(ListError::Incomplete { missing: self.missing().count(), count }));
            return Vec::new();
        }
        let again: Vec<u16> = self.asked.keys().copied().collect();
        let mut messages: Vec<ParamMessage> = again.iter().map(|index| self.request(*index)).collect();
        messages.extend(self.ask());
        messages
    }
}

impl ParamList {
    /// Starts; send what is returned.
    pub fn start(encoding: Encoding, timing: ParamTiming, now: f64) -> (Self, Vec<ParamMessage>) {
        let list = Self {
            encoding,
            timing,
            count: None,
            by_index: BTreeMap::new(),
            hash: None,
            hash_asked: 0,
            lists_left: timing.tries.saturating_sub(1),
            asked: BTreeMap::new(),
            deadline: now + SILENCE_S,
            result: None,
        };
        (list, vec![ParamMessage::RequestList])
    }

    /// The parameters, once all are there or given up.
    pub fn result(&self) -> Option<&Result<AllParameters, ListError>> {
        self.result.as_ref()
    }

    /// Parameters received, of all.
    pub fn progress(&self) -> (usize, usize) {
        (self.by_index.len(), usize::from(self.count.unwrap_or(0)))
    }

    /// All parameters are there; the hash, where the vehicle has one, may have been lost.
    fn complete(&mut self, now: f64) -> Vec<ParamMessage> {
        if self.encoding == Encoding::ByBytes
            && self.hash.is_none()
            && self.hash_asked < self.timing.tries
            && let Ok(name) = HASH.parse()
        {
            self.hash_asked += 1;
            self.deadline = now + self.timing.reply_s;
            return vec![ParamMessage::RequestRead { name }];
        }
        self.finish();
        Vec::new()
    }

    fn finish(&mut self) {
        let values = std::mem::take(&mut self.by_index).into_values().collect();
        self.result = Some(Ok(AllParameters { values, hash: self.hash }));
    }

    fn missing(&self) -> impl Iterator<Item = u16> + '_ {
        (0..self.count.unwrap_or(0)).filter(|index| !self.by_index.contains_key(index))
    }

    fn request(&mut self, index: u16) -> ParamMessage {
        *self.asked.entry(index).or_default() += 1;
        ParamMessage::RequestIndex { index }
    }

    /// Fills the window.
    fn ask(&mut self) -> Vec<ParamMessage> {
        let free = self.timing.window.max(1).saturating_sub(self.asked.len());
        let next: Vec<u16> =
            self.missing().filter(|index| !self.asked.contains_key(index)).take(free).collect();
        next.into_iter().map(|index| self.request(index)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::ParamType;

    fn value(index: u16, count: u16) -> ParamMessage {
        let name = format!("P{index}").parse().expect("a name");
        let bits = f32::from(index).to_bits();
        ParamMessage::Value { name, bits, kind: Some(ParamType::Real32), count, index }
    }

    fn hash(count: u16) -> ParamMessage {
        let name = HASH.parse().expect("a name");
        ParamMessage::Value { name, bits: 77, kind: Some(ParamType::U32), count, index: NO_INDEX }
    }

    /// A vehicle of `count` parameters behind a link that loses what `lost` says of the running number of a message.
    fn run(encoding: Encoding, count: u16, lost: impl Fn(u32) -> bool) -> Result<AllParameters, ListError> {
        let (mut list, mut out) =
            ParamList::start(encoding, ParamTiming { tries: 40, ..ParamTiming::default() }, 0.0);
        let (mut now, mut number) = (0.0, 0);
        while list.result().is_none() {
            let mut next = Vec::new();
            for message in std::mem::take(&mut out) {
                number += 1;
                let answers = match message {
                    _ if lost(number) => Vec::new(),
                    ParamMessage::RequestList => {
                        let first = (encoding == Encoding::ByBytes).then(|| hash(count));
                        first.into_iter().chain((0..count).map(|k| value(k, count))).collect()
                    }
                    ParamMessage::RequestRead { name } if name.as_str() == HASH => vec![hash(count)],
                    ParamMessage::RequestIndex { index } => vec![value(index, count)],
                    other => panic!("{other:?}"),
                };
                for answer in answers {
                    number += 1;
                    if !lost(number) {
                        next.extend(list.receive(now, &answer));
                    }
                }
            }
            if next.is_empty()
                && let Some(deadline) = list.deadline()
            {
                now = deadline;
                next = list.tick(now);
            }
            out = next;
        }
        list.result().cloned().expect("over")
    }

    #[test]
    fn what_is_lost_of_the_list_is_asked_for_by_number() {
        for (count, modulus) in [(1, 3), (40, 5), (900, 5), (900, 3)] {
            let lost = |n: u32| (n.wrapping_mul(2_654_435_761) >> 16).is_multiple_of(modulus);
            for (encoding, hash) in [(Encoding::ByValue, None), (Encoding::ByBytes, Some(77))] {
                let all = run(encoding, count, lost).expect("a list");
                assert_eq!((all.values.len(), all.hash), (usize::from(count), hash));
            }
        }
    }

    #[test]
    fn a_silent_vehicle_and_a_dead_parameter_end_the_reading() {
        assert_eq!(run(Encoding::ByValue, 10, |_| true), Err(ListError::Silent));
        let (mut list, _) = ParamList::start(Encoding::ByValue, ParamTiming::default(), 0.0);
        list.receive(0.1, &value(0, 3));
        list.receive(0.1, &value(2, 3));
        while let Some(t) = list.deadline() {
            list.tick(t);
        }
        assert_eq!(list.result(), Some(&Err(ListError::Incomplete { missing: 1, count: 3 })));
    }

    /// The hash comes first, so that its loss is the loss of one message.
    #[test]
    fn a_lost_hash_is_asked_for_and_a_vehicle_without_one_has_none() {
        let all = run(Encoding::ByBytes, 30, |n| n == 2).expect("a list");
        assert_eq!((all.values.len(), all.hash), (30, Some(77)));
        let (mut list, _) = ParamList::start(Encoding::ByBytes, ParamTiming::default(), 0.0);
        list.receive(0.1, &value(0, 1));
        let mut requests = 1;
        while let Some(t) = list.deadline() {
            requests += list.tick(t).len();
        }
        let all = list.result().cloned().expect("over").expect("a list");
        assert_eq!((all.values.len(), all.hash, requests), (1, None, 10));
    }

    #[test]
    fn the_hash_is_no_parameter() {
        let (mut list, _) = ParamList::start(Encoding::ByBytes, ParamTiming::default(), 0.0);
        list.receive(0.0, &hash(1));
        list.receive(0.0, &value(0, 1));
        let all = list.result().cloned().expect("over").expect("a list");
        assert_eq!((all.hash, all.values.len()), (Some(77), 1));
    }
}
