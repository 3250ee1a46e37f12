//! Changes against a vehicle of either dialect over a link that loses, delays and dies: whatever is said of the vehicle is so.

use super::*;
use proptest::prelude::*;
use std::collections::{BTreeMap, VecDeque};

/// What a heartbeat says.
fn motors(armed: bool) -> VehicleState {
    VehicleState { armed, mission_mode: false, flying_mission: false, in_flight: false }
}

/// Small, seeded, and the same on every machine (SplitMix64).
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn name(text: &str) -> ParamName {
    text.parse().expect("a name")
}

/// What the vehicle holds.
#[derive(Clone)]
struct Vehicle {
    encoding: Encoding,
    table: BTreeMap<ParamName, ParamValue>,
    read_only: Option<ParamName>,
    /// A parameter that the vehicle never lets go beyond this.
    capped: Option<(ParamName, f64)>,
}

impl Vehicle {
    fn new(encoding: Encoding) -> Self {
        let entries = [
            ("GPS1_DELAY_MS", ParamType::I16, 0.0),
            ("GPS1_POS_X", ParamType::Real32, 0.25),
            ("GPS1_POS_Y", ParamType::Real32, 0.0),
            ("INS_ACCSCAL_X", ParamType::Real32, 1.001),
            ("CAL_ACC0_ID", ParamType::I32, 123_456_789.0),
            ("STAT_FLTTIME", ParamType::I32, 77.0),
        ];
        let table =
            entries.into_iter().map(|(n, kind, value)| (name(n), ParamValue { kind, value })).collect();
        Self { encoding, table, read_only: Some(name("STAT_FLTTIME")), capped: None }
    }

    fn get(&self, name: ParamName) -> f64 {
        let v = self.table[&name];
        self.encoding.decode(self.encoding.encode(v), v.kind).value
    }

    fn answer(&mut self, message: &ParamMessage) -> Option<ParamMessage> {
        let asked = match message {
            ParamMessage::RequestRead { name } => *name,
            ParamMessage::Set { name, bits, kind } => {
                let value = self.table.get_mut(name)?;
                // PX4 does not answer where the type is another one.
                if self.encoding == Encoding::ByBytes && *kind != value.kind {
                    return None;
                }
                if self.read_only != Some(*name) {
                    value.value = self.encoding.decode(*bits, value.kind).value;
                }
                if let Some((_, most)) = self.capped.filter(|(n, _)| n == name) {
                    value.value = value.value.min(most);
                }
                *name
            }
            other => panic!("{other:?}"),
        };
        let value = *self.table.get(&asked)?;
        let bits = self.encoding.encode(value);
        Some(ParamMessage::Value { name: asked, bits, kind: Some(value.kind), count: 6, index: u16::MAX })
    }
}

/// A link in virtual time: messages keep their order.
struct Link {
    chance: Chance,
    loss: f64,
    /// It is dead from this message of ours on, and until that time.
    cut: Option<(u32, f64)>,
    sent: u32,
    up: VecDeque<(f64, ParamMessage)>,
    down: VecDeque<(f64, ParamMessage)>,
}

impl Link {
    fn new(seed: u64, loss: f64, cut: Option<(u32, f64)>) -> Self {
        Self { chance: Chance(seed), loss, cut, sent: 0, up: VecDeque::new(), down: VecDeque::new() }
    }

    fn lost(&mut self, now: f64) -> bool {
        let dead = self.cut.is_some_and(|(from, until)| self.sent > from && now < until);
        self.chance.next() < self.loss || dead
    }

    fn arrival(&mut self, now: f64, queue_end: Option<f64>) -> f64 {
        (now + 0.02 + 0.25 * self.chance.next()).max(queue_end.unwrap_or(0.0))
    }

    fn send(&mut self, now: f64, messages: Vec<ParamMessage>) {
        for message in messages {
            self.sent += 1;
            if !self.lost(now) {
                let at = self.arrival(now, self.up.back().map(|(t, _)| *t));
                self.up.push_back((at, message));
            }
        }
    }
}

/// Runs to the end, or until our message number `kill` was sent; heartbeats come every second while the link is alive.
fn run(
    apply: &mut ParamApply,
    first: Vec<ParamMessage>,
    vehicle: &mut Vehicle,
    link: &mut Link,
    kill: Option<u32>,
) -> f64 {
    let mut now = 0.0;
    link.send(now, first);
    let mut heartbeat = 1.0;
    while now < 2000.0 {
        let over = match apply.outcome() {
            Some(ApplyOutcome::Mixed { .. }) => {
                link.cut.is_none_or(|(_, until)| until == f64::INFINITY) || now > 1900.0
            }
            outcome => outcome.is_some(),
        };
        if over || kill.is_some_and(|k| link.sent > k) {
            return now;
        }
        let next = [
            link.up.front().map(|(t, _)| *t),
            link.down.front().map(|(t, _)| *t),
            apply.deadline(),
            Some(heartbeat),
        ];
        now = next.into_iter().flatten().fold(f64::INFINITY, f64::min).max(now);
        while let Some((_, message)) = link.up.pop_front_if(|(t, _)| *t <= now) {
            if let Some(answer) = vehicle.answer(&message)
                && !link.lost(now)
            {
                let at = link.arrival(now, link.down.back().map(|(t, _)| *t));
                link.down.push_back((at, answer));
            }
        }
        while let Some((_, message)) = link.down.pop_front_if(|(t, _)| *t <= now) {
            let out = apply.receive(now, &message);
            link.send(now, out);
        }
        if now >= heartbeat {
            heartbeat = now + 1.0;
            if !link.lost(now) {
                apply.vehicle_state(0.0, motors(false));
                let out = apply.link_restored(now);
                link.send(now, out);
            }
        }
        if apply.deadline().is_some_and(|t| now >= t) {
            let out = apply.tick(now);
            link.send(now, out);
        }
    }
    now
}

fn wanted(list: &[(&str, f64)]) -> Vec<Wanted> {
    list.iter().map(|(n, value)| Wanted { name: name(n), value: *value, kind: None }).collect()
}

const NEW: [(&str, f64); 4] =
    [("GPS1_DELAY_MS", 123.0), ("GPS1_POS_X", 1.18), ("GPS1_POS_Y", 0.39), ("INS_ACCSCAL_X", 1.0099)];

/// Fails where what was said of the vehicle is not so.
fn check(outcome: &ApplyOutcome, before: &Vehicle, after: &Vehicle, seed: u64) {
    for (n, new) in NEW {
        let (old, now) = (before.get(name(n)), after.get(name(n)));
        match outcome {
            ApplyOutcome::Verified { .. } => assert_eq!(now as f32, new as f32, "{seed}: {n}"),
            ApplyOutcome::Previous { .. } => assert_eq!(now, old, "{seed}: {n}: {outcome}"),
            ApplyOutcome::Mixed { values, .. } => {
                let said = values.iter().find(|v| v.name == name(n)).expect("every parameter is named");
                assert!(said.on_board.is_none_or(|v| v == now), "{seed}: {said}, in truth {now}");
                assert!(now == old || now as f32 == new as f32, "{seed}");
            }
        }
    }
    for n in ["CAL_ACC0_ID", "STAT_FLTTIME"] {
        assert_eq!(before.get(name(n)), after.get(name(n)), "what the file does not name stays");
    }
}

fn transfer(encoding: Encoding, seed: u64, loss: f64, cut: Option<(u32, f64)>) -> ApplyOutcome {
    let (before, mut link) = (Vehicle::new(encoding), Link::new(seed, loss, cut));
    let mut vehicle = before.clone();
    let (mut apply, first) =
        ParamApply::start(encoding, ApplyTiming::default(), wanted(&NEW), Some(false), 0.0);
    run(&mut apply, first, &mut vehicle, &mut link, None);
    let outcome = apply.outcome().unwrap_or_else(|| panic!("{seed}: it does not end")).clone();
    check(&outcome, &before, &vehicle, seed);
    outcome
}

#[test]
fn two_hundred_changes_over_a_link_with_a_fifth_lost_are_verified_or_truly_described() {
    let mut verified = 0;
    for seed in 0..200 {
        let encoding = if seed % 2 == 0 { Encoding::ByValue } else { Encoding::ByBytes };
        let outcome = transfer(encoding, seed, 0.2, None);
        verified += usize::from(matches!(outcome, ApplyOutcome::Verified { changed: 4, values: 4 }));
    }
    assert!(verified >= 195, "{verified} of 200");
}

/// Cut for good at any message: what is said is so. Cut for a while: in the end the old set or the new one is on board.
#[test]
fn a_link_cut_at_any_message_leaves_a_true_statement() {
    let (mut mixed, mut settled) = (0, 0);
    for seed in 0..100 {
        for (from, until) in [(seed as u32 % 25, f64::INFINITY), (seed as u32 % 25, 300.0)] {
            let encoding = if seed % 2 == 0 { Encoding::ByValue } else { Encoding::ByBytes };
            let outcome = transfer(encoding, seed, 0.2, Some((from, until)));
            let is_mixed = matches!(outcome, ApplyOutcome::Mixed { .. });
            mixed += usize::from(is_mixed);
            assert!(until == f64::INFINITY || !is_mixed, "{seed}, cut at {from}: {outcome}");
            settled += usize::from(!is_mixed);
        }
    }
    assert!(mixed > 20 && settled > 100, "{mixed} mixed, {settled} settled");
}

/// The program is killed after any message; the journal has both sets, and a second run puts the old one back.
#[test]
fn a_change_that_was_killed_at_any_message_is_put_back() {
    let mut half = 0;
    for seed in 0..100_u64 {
        let encoding = if seed.is_multiple_of(2) { Encoding::ByValue } else { Encoding::ByBytes };
        let (before, mut link) = (Vehicle::new(encoding), Link::new(seed, 0.2, None));
        let mut vehicle = before.clone();
        let (mut apply, first) =
            ParamApply::start(encoding, ApplyTiming::default(), wanted(&NEW), Some(false), 0.0);
        run(&mut apply, first, &mut vehicle, &mut link, Some(seed as u32 % 25));
        let Some(journal) = apply.backup().map(<[Pair]>::to_vec) else {
            assert!(
                NEW.iter().all(|(n, _)| vehicle.get(name(n)) == before.get(name(n))),
                "nothing is set before it is kept"
            );
            continue;
        };
        drop(apply);
        half += usize::from(NEW.iter().any(|(n, _)| vehicle.get(name(n)) != before.get(name(n))));
        let mut link = Link::new(seed + 1000, 0.2, None);
        let (mut again, first) =
            ParamApply::resume(encoding, ApplyTiming::default(), journal, Some(false), 0.0);
        run(&mut again, first, &mut vehicle, &mut link, None);
        let outcome = again.outcome().unwrap_or_else(|| panic!("{seed}: it does not end"));
        assert!(matches!(outcome, ApplyOutcome::Previous { .. }), "{seed}: {outcome}");
        check(outcome, &before, &vehicle, seed);
    }
    assert!(half > 30, "{half}");
}

/// The sentence with which a change is refused; nothing is sent that could change anything.
fn refused(
    encoding: Encoding,
    wanted: Vec<Wanted>,
    armed: Option<bool>,
    change: impl Fn(&mut Vehicle),
) -> String {
    let mut before = Vehicle::new(encoding);
    change(&mut before);
    let (mut vehicle, mut link) = (before.clone(), Link::new(1, 0.0, None));
    let (mut apply, first) = ParamApply::start(encoding, ApplyTiming::default(), wanted, armed, 0.0);
    run(&mut apply, first, &mut vehicle, &mut link, None);
    let Some(ApplyOutcome::Previous { why }) = apply.outcome() else { panic!("{:?}", apply.outcome()) };
    for n in before.table.keys() {
        assert_eq!(vehicle.get(*n), before.get(*n), "{n}");
    }
    why.clone()
}

#[test]
fn bad_input_is_refused_with_a_sentence_and_nothing_is_changed() {
    for encoding in [Encoding::ByValue, Encoding::ByBytes] {
        let no = |list: &[(&str, f64)]| refused(encoding, wanted(list), Some(false), |_| ());
        assert!(no(&[("GPS1_POS_X", 1.0), ("NO_SUCH", 1.0)]).contains("does not answer for NO_SUCH"));
        assert!(
            no(&[("GPS1_POS_X", 1.0), ("GPS1_DELAY_MS", 70_000.0)])
                .contains("70000 is no value of GPS1_DELAY_MS")
        );
        assert!(no(&[("GPS1_DELAY_MS", 1.5)]).contains("of type int16"));
        assert!(
            no(&[("GPS1_POS_X", 1.0), ("STAT_FLTTIME", 5.0)])
                .contains("STAT_FLTTIME reads 77 after it was set to 5")
        );
        let typed = vec![Wanted { kind: Some(ParamType::I32), ..wanted(&[("GPS1_POS_X", 1.0)])[0] }];
        assert!(
            refused(encoding, typed, Some(false), |_| ())
                .contains("of type float on the vehicle and of type int32")
        );
        let armed = refused(encoding, wanted(&NEW), Some(true), |_| ());
        assert_eq!(armed, "the vehicle is armed");
        assert!(refused(encoding, wanted(&NEW), None, |_| ()).contains("not known whether"));
        let capped =
            refused(encoding, wanted(&NEW), Some(false), |v| v.capped = Some((name("INS_ACCSCAL_X"), 1.005)));
        assert!(capped.contains("INS_ACCSCAL_X reads 1.005 after it was set to 1.0099"), "{capped}");
        let silent = refused(encoding, wanted(&NEW), Some(false), |v| v.table.clear());
        assert!(silent.contains("does not answer requests"), "{silent}");
        // A single name that the vehicle has not got is no dead link.
        let unknown = no(&[("NO_SUCH", 1.0)]);
        assert!(unknown.contains("NO_SUCH: it has no such parameter"), "{unknown}");
    }
}

#[test]
fn a_vehicle_that_is_armed_on_the_way_gets_no_further_setting() {
    let encoding = Encoding::ByValue;
    let mut vehicle = Vehicle::new(encoding);
    let (mut apply, mut out) =
        ParamApply::start(encoding, ApplyTiming::default(), wanted(&NEW), Some(false), 0.0);
    let (mut now, mut set) = (0.0, 0);
    for _ in 0..200 {
        for message in std::mem::take(&mut out) {
            if matches!(message, ParamMessage::Set { .. }) {
                set += 1;
                assert_eq!(set, 1, "a second setting although it is armed");
                apply.vehicle_state(0.0, motors(true));
            }
            if let Some(answer) = vehicle.answer(&message) {
                out.extend(apply.receive(now, &answer));
            }
        }
        if out.is_empty()
            && let Some(deadline) = apply.deadline()
        {
            now = deadline;
            out = apply.tick(now);
        }
    }
    let Some(ApplyOutcome::Mixed { values, why }) = apply.outcome().cloned() else {
        panic!("{:?}", apply.outcome())
    };
    assert_eq!(why, "the vehicle is armed");
    assert_eq!(values[0].to_string(), "GPS1_DELAY_MS 123, the new value");
    assert_eq!(values[1].to_string(), "GPS1_POS_X 0.25, the old value");
    // Disarmed: the old values are put back.
    apply.vehicle_state(0.0, motors(false));
    let first = apply.link_restored(now);
    run(&mut apply, first, &mut vehicle, &mut Link::new(3, 0.0, None), None);
    assert!(matches!(apply.outcome(), Some(ApplyOutcome::Previous { .. })), "{:?}", apply.outcome());
    assert_eq!(vehicle.get(name("GPS1_DELAY_MS")), 0.0);
}

#[test]
fn a_cancelled_change_is_put_back() {
    for after in 5..9 {
        let (before, mut link) = (Vehicle::new(Encoding::ByBytes), Link::new(9, 0.0, None));
        let mut vehicle = before.clone();
        let (mut apply, first) =
            ParamApply::start(Encoding::ByBytes, ApplyTiming::default(), wanted(&NEW), Some(false), 0.0);
        let now = run(&mut apply, first, &mut vehicle, &mut link, Some(after));
        let out = apply.cancel(now, "it was cancelled");
        link.send(now, out);
        run(&mut apply, Vec::new(), &mut vehicle, &mut link, None);
        assert!(matches!(apply.outcome(), Some(ApplyOutcome::Previous { .. })), "{:?}", apply.outcome());
        check(&apply.outcome().unwrap().clone(), &before, &vehicle, after.into());
    }
}

proptest! {
    #[test]
    fn whatever_the_link_does_the_statement_is_true(seed: u64, loss in 0.0..0.6_f64, from in 0_u32..60, length in 0.0..400.0_f64, value: bool) {
        let encoding = if value { Encoding::ByValue } else { Encoding::ByBytes };
        transfer(encoding, seed, loss, Some((from, length)));
    }
}
