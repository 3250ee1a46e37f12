//! The verified change of parameters: back up what is on board, set what differs, read back and compare; on any failure put the old
//! values back and verify that. It ends with a statement of what is on the vehicle, value by value where it is neither set.
//!
//! It refuses a vehicle that is armed or of which that is not known, and sends no setting while it is. It never arms and never reboots.
//! Answers of the protocol carry no number: before values are read back it waits until late answers to settings have arrived.

mod outcome;

pub use outcome::{ApplyOutcome, Doubtful};

use super::{Encoding, ParamMessage, ParamName, ParamRead, ParamTiming, ParamType, ParamValue, Parameters};
use crate::change::{Exchange, Phase, VehicleState, VerifiedChange};
use serde::{Deserialize, Serialize};

/// A parameter and the value that it is to have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Which.
    pub name: ParamName,
    /// New value.
    pub value: f64,
    /// Its type, where the file names one.
    pub kind: Option<ParamType>,
}

/// A parameter before and after: what a journal keeps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// Which.
    pub name: ParamName,
    /// Type on the vehicle.
    pub kind: ParamType,
    /// Value on board before.
    pub old: f64,
    /// New value.
    pub new: f64,
}

/// Times and patience.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ApplyTiming {
    /// Of single requests.
    pub request: ParamTiming,
    /// Longest time that an answer is under way, s.
    pub settle_s: f64,
    /// Attempts to put the old values back.
    pub restores: u32,
}

impl Default for ApplyTiming {
    fn default() -> Self {
        Self { request: ParamTiming::default(), settle_s: 0.7, restores: 3 }
    }
}

#[derive(Debug)]
enum Step {
    BackUp(ParamRead),
    /// Setting number `at` of the pairs.
    Set {
        at: usize,
        tries: u32,
        deadline: f64,
    },
    /// Late answers may still come until then.
    Settle {
        until: f64,
    },
    ReadBack(ParamRead),
    Finished(ApplyOutcome),
}

/// The machine. Feed it with values of the vehicle, times and its state; send what it returns.
#[derive(Debug)]
pub struct ParamApply {
    encoding: Encoding,
    timing: ApplyTiming,
    wanted: Vec<Wanted>,
    pairs: Vec<Pair>,
    armed: Option<bool>,
    /// Whether the old values are what is wanted now.
    restoring: bool,
    /// Whether anything was sent that can change a value.
    touched: bool,
    /// The last reading of all of them.
    seen: Parameters,
    restores_left: u32,
    /// It is not certain any more that this is the vehicle: nothing is ever sent again.
    abandoned: bool,
    why: Option<String>,
    step: Step,
}

impl ParamApply {
    /// Starts with the backup; send what is returned.
    pub fn start(
        encoding: Encoding,
        timing: ApplyTiming,
        wanted: Vec<Wanted>,
        armed: Option<bool>,
        now: f64,
    ) -> (Self, Vec<ParamMessage>) {
        let names: Vec<ParamName> = wanted.iter().map(|w| w.name).collect();
        let (read, messages) = ParamRead::start(encoding, timing.request, names, now);
        let mut apply = Self::new(encoding, timing, armed, Step::BackUp(read));
        apply.wanted = wanted;
        if apply.wanted.is_empty() {
            apply.finish(ApplyOutcome::Verified { changed: 0, values: 0 });
            return (apply, Vec::new());
        }
        match apply.objection() {
            Some(why) => {
                apply.finish(ApplyOutcome::Previous { why });
                (apply, Vec::new())
            }
            None => (apply, messages),
        }
    }

    /// Takes up a change that was interrupted: sees what is on board and puts the old values back.
    pub fn resume(
        encoding: Encoding,
        timing: ApplyTiming,
        pairs: Vec<Pair>,
        armed: Option<bool>,
        now: f64,
    ) -> (Self, Vec<ParamMessage>) {
        let mut apply = Self::new(encoding, timing, armed, Step::Settle { until: now + timing.settle_s });
        apply.pairs = pairs;
        (apply.touched, apply.restoring) = (true, true);
        apply.why = Some("the change was interrupted".to_owned());
        (apply, Vec::new())
    }

    fn new(encoding: Encoding, timing: ApplyTiming, armed: Option<bool>, step: Step) -> Self {
        Self {
            encoding,
            timing,
            wanted: Vec::new(),
            pairs: Vec::new(),
            armed,
            restoring: false,
            touched: false,
            seen: Parameters::default(),
            restores_left: timing.restores,
            abandoned: false,
            why: None,
            step,
        }
    }
}

impl Exchange for ParamApply {
    type Action = ParamMessage;
    type Message = ParamMessage;

    fn deadline(&self) -> Option<f64> {
        match &self.step {
            Step::BackUp(read) | Step::ReadBack(read) => read.deadline(),
            Step::Set { deadline, .. } => Some(*deadline),
            Step::Settle { until } => Some(*until),
            Step::Finished(_) => None,
        }
    }

    fn receive(&mut self, now: f64, message: &ParamMessage) -> Vec<ParamMessage> {
        let messages = match &mut self.step {
            Step::BackUp(read) | Step::ReadBack(read) => read.receive(now, message),
            Step::Set { .. } => return self.answered(now, message),
            Step::Settle { .. } | Step::Finished(_) => return Vec::new(),
        };
        self.advance(now, messages)
    }

    fn tick(&mut self, now: f64) -> Vec<ParamMessage> {
        let messages = match &mut self.step {
            Step::BackUp(read) | Step::ReadBack(read) => read.tick(now),
            Step::Set { deadline, .. } if now >= *deadline => return self.again(now),
            Step::Settle { until } if now >= *until => return self.read_back(now),
            _ => return Vec::new(),
        };
        self.advance(now, messages)
    }
}

impl VerifiedChange for ParamApply {
    type Outcome = ApplyOutcome;
    type Backup = [Pair];

    fn is_open(outcome: &ApplyOutcome) -> bool {
        matches!(outcome, ApplyOutcome::Mixed { .. })
    }

    fn untouched(why: String) -> ApplyOutcome {
        ApplyOutcome::Previous { why }
    }

    fn backup(&self) -> Option<&[Pair]> {
        (!matches!(self.step, Step::BackUp(_)) && !self.pairs.is_empty()).then_some(&self.pairs)
    }

    fn phase(&self) -> Phase {
        match &self.step {
            Step::BackUp(_) => Phase::BackingUp,
            Step::Set { .. } if self.restoring => Phase::Restoring,
            Step::Set { .. } => Phase::Sending,
            Step::Settle { .. } | Step::ReadBack(_) => Phase::ReadingBack,
            Step::Finished(_) => Phase::Finished,
        }
    }

    fn outcome(&self) -> Option<&ApplyOutcome> {
        match &self.step {
            Step::Finished(outcome) => Some(outcome),
            _ => None,
        }
    }

    fn vehicle_state(&mut self, _: f64, state: VehicleState) -> Vec<ParamMessage> {
        self.armed = Some(state.armed);
        Vec::new()
    }

    fn cancel(&mut self, now: f64, why: &str) -> Vec<ParamMessage> {
        self.why.get_or_insert_with(|| why.to_owned());
        match &self.step {
            Step::BackUp(_) => {
                self.finish(ApplyOutcome::Previous { why: why.to_owned() });
                Vec::new()
            }
            Step::Set { .. } | Step::Settle { .. } | Step::ReadBack(_) if !self.restoring => {
                // What is on board now is not known: all of it is put back.
                self.seen = Parameters::default();
                self.restore(now)
            }
            _ => Vec::new(),
        }
    }

    fn abandon(&mut self, why: &str) {
        self.abandoned = true;
        match (&self.step, self.touched) {
            (Step::Finished(outcome), _) if !matches!(outcome, ApplyOutcome::Mixed { .. }) => {}
            (_, false) => self.finish(ApplyOutcome::Previous { why: why.to_owned() }),
            (_, true) => {
                // What was read last may be another vehicle's.
                self.seen = Parameters::default();
                self.stranded(why);
            }
        }
    }

    fn link_restored(&mut self, now: f64) -> Vec<ParamMessage> {
        let open = matches!(self.step, Step::Finished(ApplyOutcome::Mixed { .. }));
        if !open || self.abandoned || self.armed != Some(false) {
            return Vec::new();
        }
        self.restores_left = self.timing.restores;
        self.restoring = true;
        self.settle(now)
    }
}

impl ParamApply {
    fn objection(&self) -> Option<String> {
        match self.armed {
            Some(false) => None,
            Some(true) => Some("the vehicle is armed".to_owned()),
            None => Some("it is not known whether the vehicle is armed (no heartbeat)".to_owned()),
        }
    }

    fn finish(&mut self, outcome: ApplyOutcome) {
        self.step = Step::Finished(outcome);
    }

    /// Goes on where a reading has ended.
    fn advance(&mut self, now: f64, messages: Vec<ParamMessage>) -> Vec<ParamMessage> {
        match &self.step {
            Step::BackUp(read) => match read.result().cloned() {
                Some(got) => self.backed_up(now, &got),
                None => messages,
            },
            Step::ReadBack(read) => match read.result().cloned() {
                Some(got) => self.judge(now, got),
                None => messages,
            },
            _ => messages,
        }
    }

    /// The old values are there: everything is checked before the first setting.
    fn backed_up(&mut self, now: f64, got: &Parameters) -> Vec<ParamMessage> {
        let pairs: Result<Vec<Pair>, String> = if got.is_silent() && self.wanted.len() > 1 {
            let why = "the vehicle does not answer requests for parameters: it has none of these names, or the link is too poor";
            Err(why.to_owned())
        } else {
            self.wanted.iter().map(|w| pair(w, got, self.encoding)).collect()
        };
        match pairs.and_then(|pairs| self.objection().map_or(Ok(pairs), Err)) {
            Ok(pairs) => {
                self.pairs = pairs;
                self.seen = got.clone();
                self.set_next(now, 0)
            }
            Err(why) => {
                self.finish(ApplyOutcome::Previous { why });
                Vec::new()
            }
        }
    }

    /// Whether two values of a parameter are one to the vehicle.
    fn same(&self, pair: &Pair, a: f64, b: f64) -> bool {
        self.encoding.same(pair.kind, a, b)
    }

    fn target(&self, pair: &Pair) -> f64 {
        if self.restoring { pair.old } else { pair.new }
    }

    /// Sets the next value that is not on board yet, from this number on.
    fn set_next(&mut self, now: f64, from: usize) -> Vec<ParamMessage> {
        let differs =
            |p: &Pair| self.seen.values.get(&p.name).is_none_or(|v| !self.same(p, v.value, self.target(p)));
        let next = self.pairs.iter().enumerate().skip(from).find(|(_, p)| differs(p)).map(|(k, p)| (k, *p));
        match next {
            Some((at, pair)) => {
                // Right before each setting.
                if let Some(why) = self.objection() {
                    return self.held_back(now, why);
                }
                self.touched = true;
                self.step = Step::Set { at, tries: 1, deadline: now + self.timing.request.reply_s };
                vec![self.setting(&pair)]
            }
            None => self.settle(now),
        }
    }

    /// The vehicle was armed on the way: nothing more is set, and what is on board is read.
    fn held_back(&mut self, now: f64, why: String) -> Vec<ParamMessage> {
        self.why.get_or_insert(why.clone());
        if self.touched {
            return self.settle(now);
        }
        self.finish(ApplyOutcome::Previous { why });
        Vec::new()
    }

    fn setting(&self, pair: &Pair) -> ParamMessage {
        let value = ParamValue { kind: pair.kind, value: self.target(pair) };
        ParamMessage::Set { name: pair.name, bits: self.encoding.encode(value), kind: pair.kind }
    }

    /// A value came while a setting waits for its answer.
    fn answered(&mut self, now: f64, message: &ParamMessage) -> Vec<ParamMessage> {
        let Step::Set { at, .. } = self.step else { return Vec::new() };
        let ParamMessage::Value { name, bits, kind: Some(kind), .. } = message else { return Vec::new() };
        let Some(pair) = self.pairs.get(at).filter(|p| p.name == *name) else { return Vec::new() };
        let value = self.encoding.decode(*bits, *kind).value;
        if self.same(pair, value, self.target(pair)) {
            return self.set_next(now, at + 1);
        }
        // Another value than was sent: a parameter that cannot be written, or a late answer. The next attempt shows which.
        Vec::new()
    }

    /// No right answer in time: once more, or on to what can be read.
    fn again(&mut self, now: f64) -> Vec<ParamMessage> {
        let Step::Set { at, tries, .. } = self.step else { return Vec::new() };
        let Some(pair) = self.pairs.get(at).copied() else { return self.settle(now) };
        if let Some(why) = self.objection() {
            return self.held_back(now, why);
        }
        if tries < self.timing.request.tries {
            self.step = Step::Set { at, tries: tries + 1, deadline: now + self.timing.request.reply_s };
            return vec![self.setting(&pair)];
        }
        if self.restoring {
            // The others are put back all the same; what came of this one shows in what is read back.
            return self.set_next(now, at + 1);
        }
        self.settle(now)
    }

    fn settle(&mut self, now: f64) -> Vec<ParamMessage> {
        self.step = Step::Settle { until: now + self.timing.settle_s };
        Vec::new()
    }

    fn read_back(&mut self, now: f64) -> Vec<ParamMessage> {
        let names: Vec<ParamName> = self.pairs.iter().map(|p| p.name).collect();
        let (read, messages) = ParamRead::start(self.encoding, self.timing.request, names, now);
        self.step = Step::ReadBack(read);
        self.advance(now, messages)
    }

    /// Compares what was read with both sets and decides.
    fn judge(&mut self, now: f64, got: Parameters) -> Vec<ParamMessage> {
        let is = |pair: &Pair, value: f64| {
            got.values.get(&pair.name).is_some_and(|v| self.same(pair, v.value, value))
        };
        let all_new = self.pairs.iter().all(|p| is(p, p.new));
        let all_old = self.pairs.iter().all(|p| is(p, p.old));
        let wrong =
            self.pairs.iter().find(|p| !is(p, self.target(p))).map(|p| mismatch(p, self.target(p), &got));
        let silent = got.is_silent();
        self.seen = got;
        if all_new && !self.restoring {
            let changed = self.pairs.iter().filter(|p| !self.same(p, p.old, p.new)).count();
            let values = self.pairs.len();
            self.finish(ApplyOutcome::Verified { changed, values });
            return Vec::new();
        }
        if let Some(wrong) = wrong
            && self.why.is_none()
        {
            self.why = Some(wrong);
        }
        if all_old {
            let why = self.why.clone().unwrap_or_default();
            self.finish(ApplyOutcome::Previous { why });
            return Vec::new();
        }
        // A link that is dead, or a vehicle that flies, is waited for.
        if self.restores_left == 0 || silent || self.objection().is_some() {
            let why = self.why.clone().unwrap_or_default();
            self.stranded(&why);
            return Vec::new();
        }
        self.restore(now)
    }

    fn restore(&mut self, now: f64) -> Vec<ParamMessage> {
        self.restores_left = self.restores_left.saturating_sub(1);
        self.restoring = true;
        if !self.touched {
            let why = self.why.clone().unwrap_or_default();
            self.finish(ApplyOutcome::Previous { why });
            return Vec::new();
        }
        self.set_next(now, 0)
    }

    fn stranded(&mut self, why: &str) {
        let seen = |p: &Pair| self.seen.values.get(&p.name).map(|v| v.value);
        let values =
            self.pairs.iter().map(|p| Doubtful { name: p.name, old: p.old, new: p.new, on_board: seen(p) });
        let outcome = ApplyOutcome::Mixed { values: values.collect(), why: why.to_owned() };
        self.finish(outcome);
    }
}

/// Old and new value of a parameter, or why it cannot be set.
fn pair(wanted: &Wanted, got: &Parameters, encoding: Encoding) -> Result<Pair, String> {
    let name = wanted.name;
    let Some(on_board) = got.values.get(&name) else {
        return Err(format!(
            "the vehicle does not answer for {name}: it has no such parameter, or the link is too poor"
        ));
    };
    if let Some(kind) = wanted.kind.filter(|k| *k != on_board.kind) {
        return Err(format!(
            "{name} is of type {} on the vehicle and of type {} in the file",
            on_board.kind, kind
        ));
    }
    let value = ParamValue { kind: on_board.kind, value: wanted.value };
    let survives = encoding.decode(encoding.encode(value), value.kind).value as f32 == wanted.value as f32;
    if !survives || !on_board.kind.holds(wanted.value) {
        return Err(format!("{} is no value of {name}, which is of type {}", wanted.value, on_board.kind));
    }
    Ok(Pair { name, kind: on_board.kind, old: on_board.value, new: wanted.value })
}

fn mismatch(pair: &Pair, target: f64, got: &Parameters) -> String {
    match got.values.get(&pair.name) {
        Some(v) => format!(
            "{} reads {} after it was set to {}: the vehicle does not accept that value",
            pair.name, v.value as f32, target as f32
        ),
        None => format!("{} could not be read back", pair.name),
    }
}

#[cfg(test)]
mod tests;
