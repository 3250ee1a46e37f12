//! What changed between two snapshots, in words: the one place that decides what is worth telling a pilot.
//!
//! Telemetry speaks these events, the terminal and the page list them. Pure: snapshot in, events out.

use crate::engine::situation::{Level, SituationKind};
use crate::engine::snapshot::{Condition, Phase, Snapshot, Status};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// How urgent an event is; the order of MAVLink's severities, without those no estimator needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// The pilot should look.
    Warning,
    /// The pilot should act: a new instruction.
    Notice,
    /// Good to know.
    Info,
}

/// What an event is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Topic {
    /// What to fly.
    Instruction,
    /// What the last maneuver brought.
    Result,
    /// The estimator's phase.
    Phase,
    /// What may be said now: a fault, who flies.
    Situation,
    /// One of the paper's conditions.
    Condition,
    /// States that became observable, or are so no longer.
    State,
    /// A warning of the engine.
    Warning,
    /// What has just happened: a mission was uploaded, a maneuver flown.
    News,
}

/// One change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Event {
    /// Time of the snapshot, seconds since the first sample.
    pub elapsed_s: f64,
    /// How urgent.
    pub severity: Severity,
    /// About what.
    pub topic: Topic,
    /// In words.
    pub text: String,
}

/// Something that was reported is not reported again before it was absent for so long, s, …
const QUIET_S: f64 = 60.0;
/// … or this long after its last report, s.
const REMINDER_S: f64 = 600.0;
/// Causes that are remembered; the one that was absent longest is forgotten.
const MAX_CAUSES: usize = 64;

/// Reports each cause once, and counts how often it returned in between.
#[derive(Debug, Clone, Default)]
pub struct Causes {
    known: BTreeMap<String, Cause>,
}

#[derive(Debug, Clone, Copy)]
struct Cause {
    last_s: f64,
    reported_s: f64,
    held_back: u64,
}

impl Causes {
    /// The text to report, with the number of times it was held back since the last report; nothing while it is not to be
    /// repeated. Texts that differ in their numbers only have one cause. `now_s` is of any clock that rises.
    pub fn admit(&mut self, now_s: f64, text: &str) -> Option<String> {
        let fresh = Cause { last_s: now_s, reported_s: now_s, held_back: 0 };
        let Some(cause) = self.known.get_mut(&cause_of(text)) else {
            if self.known.len() >= MAX_CAUSES
                && let Some(oldest) =
                    self.known.iter().min_by(|a, b| a.1.last_s.total_cmp(&b.1.last_s)).map(|(k, _)| k.clone())
            {
                self.known.remove(&oldest);
            }
            self.known.insert(cause_of(text), fresh);
            return Some(text.to_owned());
        };
        // A clock that went back is another clock.
        let quiet = (0.0..QUIET_S).contains(&(now_s - cause.last_s));
        if quiet && now_s - cause.reported_s < REMINDER_S {
            cause.last_s = now_s;
            cause.held_back += 1;
            return None;
        }
        let held_back = std::mem::replace(cause, fresh).held_back;
        Some(if held_back > 0 { format!("{text} ({held_back} more times before)") } else { text.to_owned() })
    }

    /// Notes that something reported goes on.
    fn goes_on(&mut self, now_s: f64, text: &str) {
        if let Some(cause) = self.known.get_mut(&cause_of(text)) {
            cause.last_s = now_s;
        }
    }
}

/// The text without its numbers.
pub fn cause_of(text: &str) -> String {
    let word = |w: &str| {
        let number = w.trim_start_matches(['(', '-', '+', '"']).starts_with(|c: char| c.is_ascii_digit());
        if number { "#".to_owned() } else { w.to_owned() }
    };
    text.split_whitespace().map(word).collect::<Vec<_>>().join(" ")
}

/// Remembers the last snapshot's words and says what is new.
#[derive(Debug, Clone, Default)]
pub struct EventDetector {
    seen_any: bool,
    instruction: String,
    result: String,
    done: bool,
    /// What the ground session asked for last, without its seconds.
    by_hand: String,
    phase: Phase,
    situation: SituationKind,
    met: [bool; 3],
    observable: BTreeSet<String>,
    warnings: BTreeSet<String>,
    causes: Causes,
    news: Vec<String>,
}

impl EventDetector {
    /// Everything that is new since the snapshot before, most urgent first.
    pub fn feed(&mut self, s: &Snapshot) -> Vec<Event> {
        let mut out = Vec::new();
        let mut say = |severity, topic, text: String| {
            out.push(Event { elapsed_s: s.elapsed_s, severity, topic, text });
        };
        self.phase_event(s, &mut say);
        self.situation_event(s, &mut say);
        self.warning_events(s, &mut say);
        self.condition_events(s, &mut say);
        self.state_events(s, &mut say);
        self.guidance_events(s, &mut say);
        self.ground_event(s, &mut say);
        self.seen_any = true;
        out.sort_by_key(|e| e.severity);
        out
    }

    fn phase_event(&mut self, s: &Snapshot, say: &mut impl FnMut(Severity, Topic, String)) {
        if self.seen_any && s.phase == self.phase {
            return;
        }
        let was_running = self.seen_any && self.phase == Phase::Running;
        self.phase = s.phase;
        let severity = if was_running { Severity::Warning } else { Severity::Info };
        let text = match s.waiting_for.as_str() {
            "" => phase_words(s.phase).to_owned(),
            reason => format!("{}: {reason}", phase_words(s.phase)),
        };
        say(severity, Topic::Phase, text);
    }

    fn situation_event(&mut self, s: &Snapshot, say: &mut impl FnMut(Severity, Topic, String)) {
        let now = &s.situation;
        if std::mem::replace(&mut self.situation, now.kind) == now.kind {
            return;
        }
        let severity = match now.level {
            Level::Lost => Severity::Warning,
            Level::Auto | Level::Idle if now.kind != SituationKind::Monitoring => Severity::Info,
            // Events of their own say these.
            _ => return,
        };
        if let Some(text) = self.causes.admit(s.elapsed_s, &format!("{}: {}", now.headline, now.text)) {
            say(severity, Topic::Situation, text);
        }
    }

    fn warning_events(&mut self, s: &Snapshot, say: &mut impl FnMut(Severity, Topic, String)) {
        let now: BTreeSet<String> = s.warnings.iter().cloned().collect();
        for text in &s.warnings {
            if self.warnings.contains(text) {
                self.causes.goes_on(s.elapsed_s, text);
            } else if let Some(text) = self.causes.admit(s.elapsed_s, text) {
                say(Severity::Warning, Topic::Warning, text);
            }
        }
        self.warnings = now;
        for text in s.news.iter().filter(|n| !self.news.contains(n)) {
            say(Severity::Info, Topic::News, text.clone());
        }
        self.news.clone_from(&s.news);
    }

    fn condition_events(&mut self, s: &Snapshot, say: &mut impl FnMut(Severity, Topic, String)) {
        let c = &s.observability.conditions;
        let rows: [(&Condition, &str, &str); 3] =
            [(&c.a, "a", "attitude, biases"), (&c.b, "b", "diagonal of G"), (&c.c, "c", "full G")];
        for (met, (condition, letter, what)) in self.met.iter_mut().zip(rows) {
            if condition.met && !*met {
                say(Severity::Info, Topic::Condition, format!("Condition ({letter}) met: {what}"));
            }
            *met = condition.met;
        }
    }

    fn state_events(&mut self, s: &Snapshot, say: &mut impl FnMut(Severity, Topic, String)) {
        let status: BTreeMap<&str, Status> =
            s.observability.states.iter().map(|x| (x.name.as_str(), x.status)).collect();
        let now: BTreeSet<String> = status
            .iter()
            .filter(|(_, status)| **status == Status::Observable)
            .map(|(name, _)| (*name).to_owned())
            .collect();
        let gained: Vec<&str> = now.difference(&self.observable).map(String::as_str).collect();
        let lost: Vec<&str> = self.observable.difference(&now).map(String::as_str).collect();
        if !gained.is_empty() {
            say(Severity::Info, Topic::State, format!("Observable now: {}", gained.join(" ")));
        }
        if !lost.is_empty() {
            say(Severity::Warning, Topic::State, format!("No longer observable: {}", lost.join(" ")));
        }
        self.observable = now;
    }

    /// The ground session's next instruction; seconds that pass are none.
    fn ground_event(&mut self, s: &Snapshot, say: &mut impl FnMut(Severity, Topic, String)) {
        if !s.ground.active {
            return;
        }
        let cause = cause_of(&s.ground.instruction);
        if cause != self.by_hand && !s.ground.instruction.is_empty() {
            say(Severity::Notice, Topic::Instruction, s.ground.instruction.clone());
        }
        self.by_hand = cause;
    }

    fn guidance_events(&mut self, s: &Snapshot, say: &mut impl FnMut(Severity, Topic, String)) {
        let g = &s.guidance;
        // No sink gives an order that the situation does not hold.
        let instruction =
            if s.situation.kind == SituationKind::Maneuver { g.instruction.as_str() } else { "" };
        if g.last_result != self.result && !g.last_result.is_empty() {
            say(Severity::Info, Topic::Result, g.last_result.clone());
        }
        if g.done && !self.done {
            say(Severity::Notice, Topic::Instruction, "All known that this airframe can show".to_owned());
        } else if instruction != self.instruction && !instruction.is_empty() {
            say(Severity::Notice, Topic::Instruction, format!("Fly: {instruction}"));
        }
        self.result.clone_from(&g.last_result);
        instruction.clone_into(&mut self.instruction);
        self.done = g.done;
    }
}

/// The phase as screens and telemetry name it.
pub fn phase_words(phase: Phase) -> &'static str {
    match phase {
        Phase::WaitingForImu => "Waiting for inertial data",
        Phase::WaitingForGnss => "Waiting for GNSS",
        Phase::Aligning => "Aligning",
        Phase::SearchingHeading => "Searching heading",
        Phase::Running => "Running",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::snapshot::StateStatus;

    fn state(name: &str, status: Status) -> StateStatus {
        StateStatus { name: name.into(), status, ..StateStatus::default() }
    }

    fn texts(events: &[Event]) -> Vec<&str> {
        events.iter().map(|e| e.text.as_str()).collect()
    }

    #[test]
    fn the_same_snapshot_twice_says_nothing_the_second_time() {
        let mut s = Snapshot { phase: Phase::Running, ..Snapshot::default() };
        (s.situation.kind, s.guidance.instruction) = (SituationKind::Maneuver, "Climb".into());
        s.warnings = vec!["rate low".into()];
        let mut d = EventDetector::default();
        assert_eq!(texts(&d.feed(&s)), ["rate low", "Fly: Climb", "Running"]);
        assert!(d.feed(&s).is_empty());
    }

    #[test]
    fn news_is_told_once_and_as_no_warning() {
        let mut s = Snapshot { news: vec!["flown: Steep turn".into()], ..Snapshot::default() };
        let mut d = EventDetector::default();
        let told: Vec<Event> = d.feed(&s).into_iter().filter(|e| e.topic == Topic::News).collect();
        assert_eq!((texts(&told), told[0].severity), (vec!["flown: Steep turn"], Severity::Info));
        assert!(d.feed(&s).iter().all(|e| e.topic != Topic::News));
        s.news.clear();
        d.feed(&s);
        s.news.push("flown: Steep turn".into());
        assert_eq!(texts(&d.feed(&s)), ["flown: Steep turn"], "a second time is news again");
    }

    #[test]
    fn a_warning_that_comes_and_goes_is_one_event_with_a_count() {
        let mut d = EventDetector::default();
        let mut told = Vec::new();
        // An outage of 70 s in which a fix appears every four seconds, and another much later.
        for second in 0..1000_u32 {
            let mut s = Snapshot { elapsed_s: f64::from(second), ..Snapshot::default() };
            if (second < 70 && second % 4 < 3) || second == 900 {
                s.warnings = vec![format!("the GNSS receiver has no 3-D fix, {second} satellites")];
            }
            told.extend(d.feed(&s).into_iter().filter(|e| e.topic == Topic::Warning).map(|e| e.text));
        }
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(told[0].ends_with("0 satellites"));
        assert!(told[1].ends_with("more times before)"), "{told:?}");
    }

    #[test]
    fn no_order_goes_out_that_the_situation_does_not_hold_and_a_fault_is_a_warning() {
        let mut s = Snapshot { phase: Phase::Running, ..Snapshot::default() };
        let mut d = EventDetector::default();
        d.feed(&s);
        s.guidance.instruction = "Climb".into();
        s.situation.kind = SituationKind::Landing;
        (s.situation.level, s.situation.headline) = (Level::Auto, "Landing".into());
        s.situation.text = "The vehicle lands".into();
        assert_eq!(texts(&d.feed(&s)), ["Landing: The vehicle lands"]);
        s.situation.kind = SituationKind::NoGnss;
        (s.situation.level, s.situation.headline) = (Level::Lost, "No GNSS".into());
        let events = d.feed(&s);
        assert_eq!(
            (events.len(), events[0].severity, events[0].topic),
            (1, Severity::Warning, Topic::Situation)
        );
        s.situation.kind = SituationKind::Maneuver;
        s.situation.level = Level::Fly;
        assert_eq!(texts(&d.feed(&s)), ["Fly: Climb"]);
    }

    #[test]
    fn instructions_of_the_ground_session_are_said_once_and_their_seconds_are_no_news() {
        let mut s = Snapshot { phase: Phase::Running, ..Snapshot::default() };
        let mut d = EventDetector::default();
        d.feed(&s);
        let mut say = |active: bool, text: &str| {
            (s.ground.active, s.ground.instruction) = (active, text.into());
            d.feed(&s).into_iter().map(|e| (e.severity, e.text)).collect::<Vec<_>>()
        };
        assert!(say(false, "Turn the vehicle nose up").is_empty());
        let told = |text: &str| vec![(Severity::Notice, text.to_owned())];
        assert_eq!(say(true, "Turn the vehicle nose up"), told("Turn the vehicle nose up"));
        assert_eq!(say(true, "Hold still nose up: 24 s"), told("Hold still nose up: 24 s"));
        assert!(say(true, "Hold still nose up: 23 s").is_empty());
        assert_eq!(say(true, "Turn the vehicle nose down"), told("Turn the vehicle nose down"));
    }

    #[test]
    fn gained_and_lost_states_are_one_line_each() {
        let mut s = Snapshot::default();
        s.observability.states = vec![state("g11", Status::Observable), state("g13", Status::Observable)];
        let mut d = EventDetector::default();
        assert!(texts(&d.feed(&s)).contains(&"Observable now: g11 g13"));
        s.observability.states = vec![state("g11", Status::Converging), state("g13", Status::Observable)];
        let events = d.feed(&s);
        assert_eq!(texts(&events), ["No longer observable: g11"]);
        assert_eq!(events[0].severity, Severity::Warning);
    }

    #[test]
    fn leaving_the_running_phase_is_a_warning_with_its_reason() {
        let mut s = Snapshot { phase: Phase::Running, ..Snapshot::default() };
        let mut d = EventDetector::default();
        d.feed(&s);
        s.phase = Phase::WaitingForGnss;
        s.waiting_for = "no fix for 12 s".into();
        let events = d.feed(&s);
        assert_eq!(texts(&events), ["Waiting for GNSS: no fix for 12 s"]);
        assert_eq!(events[0].severity, Severity::Warning);
    }

    #[test]
    fn a_condition_is_announced_when_it_turns_true_and_again_after_it_was_lost() {
        let mut s = Snapshot::default();
        let mut d = EventDetector::default();
        d.feed(&s);
        s.observability.conditions.c.met = true;
        assert_eq!(texts(&d.feed(&s)), ["Condition (c) met: full G"]);
        s.observability.conditions.c.met = false;
        assert!(d.feed(&s).is_empty());
        s.observability.conditions.c.met = true;
        assert_eq!(d.feed(&s).len(), 1);
    }
}
