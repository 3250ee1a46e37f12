use super::*;
use crate::study::blind::{Family, Kind, fly};
use gaware_nav::effects;
use gaware_nav::model::EffectSetting;

fn explain(hidden: &[EffectSetting], seed: u64) -> Explained {
    let blind = fly(hidden, Kind::Rich, Family::Tuning, seed);
    samples(&[blind.samples], &[], &Model::default(), &Settings::default(), &|_| {})
}

#[test]
fn a_hidden_delay_is_named_and_the_gap_shrinks() {
    let hidden = EffectSetting::known(&effects::GpsLatency, &[0.17]).unwrap();
    let explained = explain(&[hidden], 3);
    let e = &explained.explanation;
    assert_eq!(e.verdict, contract::Verdict::Explained, "{}", e.summary);
    assert_eq!(e.effects.len(), 1);
    assert_eq!(e.effects[0].names, ["gps_latency"]);
    let found = explained.model.get("gps_latency").unwrap();
    assert!((found.values[0] - 0.17).abs() < 4.0 * found.sigmas[0] + 0.005, "{found:?}");
    let gap = e.gap.as_ref().unwrap();
    assert!(gap.held_out.before > 1.3 && (0.9..1.1).contains(&gap.held_out.after), "{gap:?}");
    let back = Model::from_toml(&explained.model.to_toml()).unwrap();
    assert!((back.get("gps_latency").unwrap().values[0] - found.values[0]).abs() < 1e-9);
    // The report holds what it says and needs nothing from elsewhere.
    let folder = std::env::temp_dir().join(format!("gaware-explain-{}", std::process::id()));
    write(&explained, &folder).unwrap();
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(page.contains("gps_latency") && page.contains("<svg"));
    assert!(!page.contains("<script") && !page.contains("href="));
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("report.json")).unwrap()).unwrap();
    assert_eq!(json["schema"], "gaware.explanation/1");
    assert!(json["effects"][0]["parameters"]["gps_latency"]["value_s"].is_number());
    assert!(json["where"].is_array() && json["gap"]["held_out"]["before"].is_number());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn too_little_to_say_names_nothing() {
    let whole = fly(&[], Kind::Rich, Family::Tuning, 4).samples;
    let without_fixes: Vec<Sample> = whole.iter().filter(|s| !matches!(s, Sample::Fix(_))).cloned().collect();
    let short: Vec<Sample> = whole.into_iter().take(1500).collect();
    for flight in [short, without_fixes, Vec::new()] {
        let e = samples(&[flight], &[], &Model::default(), &Settings::default(), &|_| {}).explanation;
        assert_eq!(e.verdict, contract::Verdict::Unexplained);
        assert!(e.effects.is_empty() && e.gap.is_none());
        assert!(e.summary.starts_with("Nothing can be said"), "{}", e.summary);
    }
}
