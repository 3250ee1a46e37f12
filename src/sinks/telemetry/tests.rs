use super::*;
use crate::engine::snapshot::Phase;
use proptest::prelude::*;
use std::collections::BTreeMap;

fn running(instruction: &str) -> Snapshot {
    let mut s = Snapshot { phase: Phase::Running, t_s: 12.5, ..Snapshot::default() };
    s.guidance.instruction = instruction.to_owned();
    s.situation.kind = SituationKind::Maneuver;
    s.estimate.g_sensitivity_deg_per_h_per_g.value[2][0] = 31.0;
    s.estimate.g_sensitivity_deg_per_h_per_g.sigma[2][0] = 4.0;
    s.consistency.nis_mean_per_dof = 1.1;
    s
}

fn texts(messages: &[MavMessage]) -> Vec<(MavSeverity, String, u16)> {
    let mut out: Vec<(MavSeverity, String, u16)> = Vec::new();
    for m in messages {
        if let MavMessage::STATUSTEXT(t) = m {
            let part = t.text.to_str().unwrap().to_owned();
            match out.last_mut() {
                Some(last) if t.id != 0 && last.2 == t.id => last.1.push_str(&part),
                _ => out.push((t.severity, part, t.id)),
            }
        }
    }
    out
}

fn named(messages: &[MavMessage]) -> Vec<(String, f32)> {
    let name = |d: &NAMED_VALUE_FLOAT_DATA| d.name.to_str().unwrap().to_owned();
    messages
        .iter()
        .filter_map(|m| match m {
            MavMessage::NAMED_VALUE_FLOAT(d) => Some((name(d), d.value)),
            _ => None,
        })
        .collect()
}

#[test]
fn full_telemetry_carries_every_value_once_a_second_and_never_in_a_burst() {
    let mut telemetry = Telemetry::new(TelemetryLevel::Full.config().unwrap());
    let s = running("");
    let mut count = BTreeMap::new();
    // 0.1 s steps from 0.0 to 9.9: ten periods.
    for step in 0..100 {
        let sent = named(&telemetry.feed(f64::from(step) * 0.1, &s));
        assert!(sent.len() <= 4, "{} values at once", sent.len());
        for (name, value) in sent {
            assert!(name.len() <= 10);
            *count.entry(name).or_insert((0, 0.0)) =
                (count.get(&name).map_or(0, |c: &(i32, f32)| c.0) + 1, value);
        }
    }
    assert_eq!(count.len(), 22);
    assert!(count.values().all(|(n, _)| (9..=10).contains(n)), "{count:?}");
    assert_eq!(count["G31"].1, 31.0);
    assert_eq!(count["G31_sigma"].1, 4.0);
    assert_eq!(count["NIS"].1, 1.1);
}

#[test]
fn by_default_no_second_carries_more_than_five_messages() {
    let mut telemetry = Telemetry::new(TelemetryLevel::default().config().unwrap());
    let (mut sent, mut names) = (Vec::new(), std::collections::BTreeSet::new());
    for step in 0..600 {
        let t = f64::from(step) * 0.1;
        // A long instruction that changes all the time.
        let words = format!("{} {step}", "Straight and level, throttle full to idle and back, ".repeat(3));
        let now = telemetry.feed(t, &running(&words));
        names.extend(named(&now).into_iter().map(|(name, _)| name));
        sent.extend(now.iter().map(|_| t));
    }
    for k in 0..600 {
        let t = f64::from(k) * 0.1;
        let within = sent.iter().filter(|s| (0.0..0.95).contains(&(**s - t))).count();
        assert!(within <= 5, "{within} messages in the second from {t}");
    }
    assert_eq!(names.len(), 22, "all values arrive");
    assert_eq!(TelemetryLevel::Off.config(), None);
}

#[test]
fn a_pause_is_not_caught_up() {
    let mut telemetry = Telemetry::new(TelemetryConfig::default());
    telemetry.feed(0.0, &running(""));
    assert!(named(&telemetry.feed(3600.0, &running(""))).len() <= 2);
    // Nor does a clock that went back silence it.
    assert!(!named(&telemetry.feed(10.0, &running(""))).is_empty());
}

#[test]
fn an_instruction_is_a_notice_and_longer_than_one_text_it_comes_in_chunks() {
    let mut telemetry = Telemetry::new(TelemetryConfig::default());
    let long = "Straight and level, throttle full to idle and back, twice, 20 s";
    let sent = texts(&telemetry.feed(0.0, &running(long)));
    let (severity, text, id) = &sent[0];
    assert_eq!(*severity, MavSeverity::MAV_SEVERITY_NOTICE);
    assert_eq!(*text, format!("Fly: {long}"));
    assert_ne!(*id, 0);
}

#[test]
fn a_text_that_fills_its_last_chunk_ends_with_an_empty_one() {
    let mut telemetry = Telemetry::new(TelemetryConfig::default());
    let sent = telemetry.feed(0.0, &running(&"x".repeat(95)));
    let chunks: Vec<(u8, usize)> = sent
        .iter()
        .filter_map(|m| match m {
            MavMessage::STATUSTEXT(t) if t.id != 0 => Some((t.chunk_seq, t.text.to_str().unwrap().len())),
            _ => None,
        })
        .collect();
    assert_eq!(chunks, [(0, 50), (1, 50), (2, 0)]);
}

#[test]
fn chunks_of_a_text_are_not_parted_by_the_limit_of_a_second() {
    // MAVProxy and QGroundControl show what they have of a text when nothing more comes for a second.
    let mut telemetry = Telemetry::new(TelemetryConfig::default());
    let mut s = running(&"y".repeat(120));
    s.warnings = vec!["x".repeat(120)];
    let mut whole = 0;
    for step in 0..40 {
        let sent = telemetry.feed(f64::from(step) * 0.1, &s);
        let chunks: Vec<u8> = sent
            .iter()
            .filter_map(|m| match m {
                MavMessage::STATUSTEXT(t) if t.id != 0 => Some(t.chunk_seq),
                _ => None,
            })
            .collect();
        assert!(chunks.is_empty() || chunks == [0, 1, 2], "{chunks:?} at step {step}");
        whole += chunks.len() / 3;
    }
    assert_eq!(whole, 2);
}

#[test]
fn degrees_are_spelled_out() {
    let mut telemetry = Telemetry::new(TelemetryConfig::default());
    let sent = texts(&telemetry.feed(0.0, &running("Steep turn right, 55° bank")));
    assert_eq!(sent[0].1, "Fly: Steep turn right, 55 deg bank");
    assert_eq!(sent[0].2, 0);
}

#[test]
fn a_flood_is_rationed_and_the_newest_instruction_survives_it() {
    let mut telemetry = Telemetry::new(TelemetryConfig::default());
    let mut sent = Vec::new();
    for step in 0..100 {
        sent.extend(texts(&telemetry.feed(f64::from(step) * 0.1, &running(&format!("maneuver {step}")))));
    }
    assert!(sent.len() <= 4, "{sent:?}");
    assert!(telemetry.dropped_texts() > 90);
    let later = texts(&telemetry.feed(10.5, &running("maneuver 99")));
    assert_eq!(later[0].1, "Fly: maneuver 99");
}

#[test]
fn warnings_go_first_and_with_their_severity() {
    let mut telemetry = Telemetry::new(TelemetryConfig { texts_per_window: 1, ..TelemetryConfig::default() });
    let mut s = running("Climb");
    s.warnings = vec!["RAW_IMU at 4 Hz: another station took the rate".into()];
    let sent = texts(&telemetry.feed(0.0, &s));
    assert_eq!(sent.len(), 1);
    assert_eq!(sent[0].0, MavSeverity::MAV_SEVERITY_WARNING);
    // The rest waits for its turn.
    assert_eq!(texts(&telemetry.feed(10.0, &s))[0].1, "Fly: Climb");
}

proptest! {
    #[test]
    fn any_words_make_readable_texts_within_the_ration(words in prop::collection::vec(".{0,400}", 1..40)) {
        let mut telemetry = Telemetry::new(TelemetryConfig::default());
        for (i, word) in words.iter().enumerate() {
            let mut s = running(word);
            s.warnings = vec![word.clone()];
            let sent = telemetry.feed(i as f64, &s);
            for m in &sent {
                if let MavMessage::STATUSTEXT(t) = m {
                    prop_assert!(t.text.to_str().unwrap().chars().all(|c| c == ' ' || c.is_ascii_graphic()));
                }
            }
            prop_assert!(texts(&sent).len() <= 4);
        }
    }
}
