use super::*;
use std::collections::BTreeSet;

#[test]
fn draws_stay_within_what_an_effect_can_be() {
    for (k, effect) in REGISTRY.iter().enumerate() {
        let setting = draw(*effect, &mut Noise::numbered(k as u64, Purpose::HiddenTruth, 3));
        assert_eq!(setting.values.len(), effect.len());
        assert!(setting.values.iter().all(|v| v.is_finite()), "{}", effect.name());
        assert!(effect.is_empty() || setting.values.iter().any(|v| *v != 0.0), "{}", effect.name());
    }
}

#[test]
fn what_is_sealed_can_be_unsealed() {
    let hidden: Vec<_> = (0..200).map(draw_injected).collect();
    let named: BTreeSet<_> = hidden.iter().map(|h| h.as_ref().map_or("none", |s| s.effect.name())).collect();
    assert_eq!(named.len(), REGISTRY.len() + 1);
    for h in hidden.iter().flatten() {
        let back = Model::from_toml(&ground_truth(Some(h))).unwrap();
        let found = back.get(h.effect.name()).unwrap();
        assert!(found.values.iter().zip(&h.values).all(|(a, b)| (a - b).abs() <= 1e-9 * b.abs()));
    }
}

fn campaign(at_once: usize, flights: usize) -> Campaign {
    Campaign {
        effects: Vec::new(),
        at_once,
        flights,
        clean: 4,
        first_seed: 1,
        unknown: false,
        family: Family::Tuning,
        threads: 2,
    }
}

#[test]
fn the_beginning_of_a_campaign_covers_every_effect_and_kind() {
    let jobs = campaign(1, 2 * REGISTRY.len()).jobs();
    let covered: BTreeSet<_> =
        jobs.iter().filter_map(|j| Some((j.hidden[0]?, j.kind == Kind::Rich))).collect();
    assert_eq!(covered.len(), 2 * REGISTRY.len());
    assert_eq!(jobs.iter().filter(|j| j.hidden[0].is_none()).count(), 4);
    let seeds: BTreeSet<_> = campaign(2, 500).jobs().iter().map(seed_of).collect();
    assert_eq!(seeds.len(), 504);
}

#[test]
fn two_at_once_are_two_different_ones_in_all_pairs() {
    let all = REGISTRY.len();
    let jobs = campaign(2, all * (all - 1) * 2).jobs();
    let pairs: BTreeSet<_> = jobs.iter().filter_map(|j| Some((j.hidden[0]?, j.hidden[1]?))).collect();
    assert_eq!(pairs.len(), all * (all - 1));
    assert!(pairs.iter().all(|(a, b)| a != b));
}

#[test]
fn three_at_once_are_three_different_ones() {
    let all = REGISTRY.len();
    let jobs = campaign(3, all * (all - 1) * 4).jobs();
    let flown = jobs.iter().filter(|j| j.hidden[0].is_some());
    let triples: BTreeSet<BTreeSet<_>> =
        flown.map(|j| j.hidden.iter().flatten().copied().collect()).collect();
    assert!(triples.iter().all(|t| t.len() == 3) && triples.len() > all * (all - 1) / 2, "{}", triples.len());
    let seeds: BTreeSet<_> = jobs.iter().map(seed_of).collect();
    assert_eq!(seeds.len(), jobs.len());
}

fn outcome(hidden: &[&'static str], groups: &[&[&'static str]], oracle: &[bool]) -> Outcome {
    Outcome {
        hidden: hidden.to_vec(),
        kind: Kind::Rich,
        seed: 1,
        evidence: vec![9.0; groups.len()],
        groups: groups.iter().map(|g| g.to_vec()).collect(),
        removed: Vec::new(),
        held_out: groups.iter().map(|g| (g[0], 2.0)).collect(),
        sizes: Vec::new(),
        oracle: oracle.iter().map(|alone| Seen { alone: *alone, gain: 9.0, other: None }).collect(),
        errors_in_sigmas: vec![-2.5, 0.5],
        noise: Vec::new(),
        verdict: None,
        looks: Vec::new(),
    }
}

#[test]
fn the_summary_counts_what_was_promised() {
    let s = summarise(&[
        outcome(&["gps_latency"], &[&["gps_latency"]], &[true]),
        outcome(&["gps_latency"], &[&["gps_lever_arm", "gps_latency"]], &[false]),
        outcome(&["gps_latency"], &[&["gps_lever_arm"]], &[true]),
        outcome(&["gps_latency"], &[], &[false]),
        outcome(&[], &[&["gps_latency"]], &[]),
        outcome(&[], &[], &[]),
    ]);
    let counts = |s: Share| (s.count, s.of);
    assert_eq!(counts(s.oracle), (2, 4));
    assert_eq!(counts(s.alone_right_where_oracle), (1, 2));
    assert_eq!(counts(s.alone_right), (1, 4));
    assert_eq!(counts(s.in_group), (2, 3));
    assert_eq!(counts(s.nothing), (1, 4));
    assert_eq!(counts(s.wrong_alone), (1, 4));
    assert_eq!(counts(s.false_alarms), (1, 2));
    assert_eq!(counts(s.held_out_shrinks), (3, 3));
    assert_eq!(s.unnoticed.of, 0);
    assert_eq!(counts(s.within_2_sigma), (4, 8));
    assert_eq!(counts(s.within_3_sigma), (8, 8));
}

#[test]
fn two_effects_are_found_when_both_are_named() {
    let both = ["gps_latency", "gps_lever_arm"];
    let s = summarise(&[
        outcome(&both, &[&["gps_lever_arm"], &["gps_latency", "gyro_bias_step"]], &[true, true]),
        outcome(&both, &[&["gps_lever_arm"]], &[true, false]),
    ]);
    assert_eq!((s.both_found.count, s.both_found.of), (1, 2));
    assert_eq!((s.both_found_where_oracle.count, s.both_found_where_oracle.of), (1, 1));
    assert_eq!((s.oracle.count, s.oracle.of), (3, 4));
}

/// The whole way, once: inject, fly, explain, compare with the ground truth.
#[test]
fn a_lever_arm_is_hidden_and_found() {
    let campaign = Campaign { effects: vec!["gps_lever_arm".into()], clean: 1, ..campaign(1, 1) };
    let outcomes = run(&campaign, &Settings::default(), &gaware::parallel::Silent);
    let s = summarise(&outcomes);
    assert_eq!((s.oracle.count, s.alone_right.count, s.alone_right.of), (1, 1, 1), "{outcomes:?}");
    assert_eq!((s.false_alarms.count, s.false_alarms.of), (0, 1), "{outcomes:?}");
    assert_eq!(s.within_3_sigma.of, 3, "{outcomes:?}");
}

/// Something that the catalogue does not have is not passed over, and nothing else is named alone in its place.
#[test]
fn what_the_catalogue_lacks_is_noticed() {
    let campaign = Campaign {
        effects: vec!["gyro_temperature".into()],
        clean: 0,
        unknown: true,
        first_seed: 3,
        ..campaign(1, 1)
    };
    let outcomes = run(&campaign, &Settings::default(), &gaware::parallel::Silent);
    let s = summarise(&outcomes);
    assert_eq!((s.oracle.count, s.unnoticed.count, s.unnoticed.of), (1, 0, 1), "{outcomes:?}");
    assert!(!outcomes[0].groups.iter().any(|g| g.contains(&"gyro_temperature")), "{outcomes:?}");
}

fn flown(names: &[&'static str], kind: Kind, family: Family) -> Outcome {
    let place = |name: &&str| REGISTRY.iter().position(|e| e.name() == *name);
    let hidden = std::array::from_fn(|k| names.get(k).and_then(place));
    one(&Job { hidden, kind, seed: 1 }, family, &Settings::default()).unwrap()
}

/// A drift that stands for everything at first gives its place back when the rest is named, far ahead as it was.
#[test]
fn a_temperature_is_named_beside_two_more_effects() {
    let names = ["gyro_temperature", "accel_temperature", "gps_latency"];
    let outcome = flown(&names, Kind::Coordinated, Family::Aside);
    let mut found: Vec<_> = outcome.groups.iter().map(|g| g[0]).collect();
    found.sort_unstable();
    assert_eq!(found, ["accel_temperature", "gps_latency", "gyro_temperature"], "{outcome:?}");
}

/// Half a g of vibration makes no gyro delay of a clock that drifts.
#[test]
fn a_drifting_clock_is_named_alone_in_vibration() {
    let outcome = flown(&["vibration_rectification", "clock_drift"], Kind::Coordinated, Family::Tuning);
    assert!(outcome.groups.contains(&vec!["clock_drift"]), "{outcome:?}");
    assert!(!outcome.groups.iter().flatten().any(|n| *n == "gyro_accel_delay"), "{outcome:?}");
}

/// Accelerometer noise that a fit of a few rests has far too small makes a drift of what is chance: it is no less than the rests show.
#[test]
fn a_perfect_unit_turned_by_hand_without_a_receiver_has_no_name() {
    let clean = Job { hidden: [None; MOST_AT_ONCE], kind: Kind::Coordinated, seed: 5001 };
    let outcome = one(&clean, Family::Hand, &Settings::default()).unwrap();
    assert!(outcome.groups.is_empty(), "{outcome:?}");
}

#[test]
fn what_only_a_hand_shows_is_named_with_its_values() {
    for kind in [Kind::Rich, Kind::Coordinated] {
        let outcome = flown(&["gyro_g2_sensitivity", "accel_scale_factor"], kind, Family::Hand);
        let mut found: Vec<_> = outcome.groups.iter().flatten().copied().collect();
        found.sort_unstable();
        assert_eq!(found, ["accel_scale_factor", "gyro_g2_sensitivity"], "{outcome:?}");
        assert!(outcome.errors_in_sigmas.iter().all(|z| z.abs() < 3.0), "{outcome:?}");
    }
}
