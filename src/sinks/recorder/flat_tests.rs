//! What other readers find in a recording: schemas by Foxglove's rules, positions that are positions, and a layout that fits.

use super::tests::{received, scratch, setup};
use super::*;
use crate::engine::snapshot::{ParameterEstimate, Phase, Snapshot};
use crate::logs::mcap::FRAME_TOPIC;
use crate::sensors::Severity;
use gaware_nav::earth::Geodetic;
use gaware_nav::sample::{AttitudeHint, FixVelocity, GnssFix, ImuSample, Sample};
use nalgebra::Vector3;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// A run that waits, then estimates, with one of each item.
fn recorded(name: &str) -> Vec<u8> {
    let path = scratch(name);
    let recorder = Recorder::start(&path, &setup()).unwrap();
    let mut snapshot = Snapshot::default();
    recorder.record(RecordItem::Snapshot(1_000_000, Box::new(snapshot.clone())));
    snapshot.phase = Phase::Running;
    (snapshot.motion.lat_deg, snapshot.motion.lon_deg) = (47.0, 8.0);
    let latency = ParameterEstimate {
        effect: "gps_latency".into(),
        name: "latency".into(),
        unit: "s".into(),
        ..Default::default()
    };
    snapshot.estimate.effects.push(latency);
    for k in 2..4 {
        recorder.record(RecordItem::Snapshot(k * 1_000_000, Box::new(snapshot.clone())));
    }
    let imu = ImuSample { t_s: 0.0, gyro: Vector3::zeros(), accel: Vector3::zeros(), temperature_degc: None };
    let position = Geodetic { lat_rad: 0.8, lon_rad: 0.1, height_m: 1.0 };
    let fix = GnssFix {
        t_s: 0.0,
        position,
        velocity: FixVelocity::Horizontal([1.0, 2.0]),
        position_sigma_m: None,
        velocity_sigma_m_per_s: None,
        yaw_rad: None,
    };
    let hint = AttitudeHint { t_s: 0.0, roll_pitch_yaw: [0.0; 3] };
    for sample in [Sample::Imu(imu), Sample::Fix(fix), Sample::Attitude(hint)] {
        recorder.record(RecordItem::Sample(4_000_000, sample));
    }
    recorder.record(RecordItem::Log(5_000_000, Severity::Info, "a line".to_owned()));
    recorder.record(RecordItem::Frame(received(0)));
    recorder.finish();
    std::fs::read(&*path).unwrap()
}

/// Messages by topic, each with the schema of its channel.
fn messages(bytes: &[u8]) -> BTreeMap<String, Vec<(Value, Option<Value>)>> {
    let mut out: BTreeMap<String, Vec<_>> = BTreeMap::new();
    for message in mcap::MessageStream::new(bytes).unwrap().map(|m| m.unwrap()) {
        let schema = message.channel.schema.as_ref().map(|s| serde_json::from_slice(&s.data).unwrap());
        let data = serde_json::from_slice(&message.data).unwrap_or_default();
        out.entry(message.channel.topic.clone()).or_default().push((data, schema));
    }
    out
}

/// What Foxglove's parser of JSON schemas does not take.
fn judge(schema: &Value, place: &str, inside_array: bool) {
    let Some(map) = schema.as_object() else { return };
    for key in ["$ref", "anyOf", "oneOf", "allOf", "definitions", "$defs"] {
        assert!(!map.contains_key(key), "{place} has {key}");
    }
    let kind = map.get("type").and_then(Value::as_str);
    let known = ["object", "array", "number", "integer", "string", "boolean"];
    assert!(kind.is_some_and(|k| known.contains(&k)), "{place} is {:?}", map.get("type"));
    assert!(!(inside_array && kind == Some("array")), "{place} is an array of arrays");
    if kind == Some("array") {
        judge(map.get("items").unwrap(), &format!("{place}[]"), true);
    }
    for (name, own) in map.get("properties").and_then(Value::as_object).into_iter().flatten() {
        judge(own, &format!("{place}.{name}"), false);
    }
}

/// Every key of an object is in its schema, with a type that fits.
fn fits(value: &Value, schema: &Value, place: &str) {
    match value {
        Value::Object(map) => {
            for (key, own) in map {
                let schema = schema.pointer(&format!("/properties/{key}"));
                fits(own, schema.unwrap_or_else(|| panic!("{place}.{key} is not in the schema")), key);
            }
        }
        Value::Array(all) => all.iter().for_each(|v| fits(v, &schema["items"], place)),
        Value::Null => panic!("{place} is null"),
        Value::Number(_) => {
            assert!(["number", "integer"].map(Value::from).contains(&schema["type"]), "{place}")
        }
        Value::String(_) => assert_eq!(schema["type"], "string", "{place}"),
        Value::Bool(_) => assert_eq!(schema["type"], "boolean", "{place}"),
    }
}

#[test]
fn every_schema_of_a_recording_follows_the_rules_of_foxglove() {
    let messages = messages(&recorded("schemas"));
    let topics: BTreeSet<&str> = messages.keys().map(String::as_str).collect();
    let with_schema = ["/attitude_autopilot", "/fix", "/imu", "/log", "/pose", "/position", "/states", "/tf"];
    assert!(with_schema.iter().all(|t| topics.contains(t)), "{topics:?}");
    for (topic, all) in &messages {
        for (message, schema) in all {
            let Some(schema) = schema else {
                assert!(topic == "/snapshot" || topic.starts_with(FRAME_TOPIC), "{topic} has no schema");
                continue;
            };
            judge(schema, topic, false);
            fits(message, schema, topic);
        }
    }
}

#[test]
fn without_an_estimate_there_is_no_position() {
    let messages = messages(&recorded("positions"));
    assert_eq!((messages["/snapshot"].len(), messages["/states"].len()), (3, 3));
    for topic in ["/position", "/pose", "/tf"] {
        assert_eq!(messages[topic].len(), 2, "{topic}");
    }
    assert!(messages["/position"].iter().all(|(m, _)| m["latitude"] == 47.0));
    assert!(messages["/states"][0].0.get("lat_deg").is_none());
    assert_eq!(messages["/states"][1].0["gps_latency_s"], 0.0);
    assert_eq!(messages["/tf"][0].0["child_frame_id"], messages["/position"][0].0["frame_id"]);
    assert_eq!(messages["/tf"][0].0["parent_frame_id"], messages["/pose"][0].0["frame_id"]);
}

#[test]
fn the_layout_shows_what_a_recording_has() {
    let layout: Value = serde_json::from_str(include_str!("../../../docs/foxglove-layout.json")).unwrap();
    let messages = messages(&recorded("layout"));
    let mut paths = 0;
    for panel in layout["configById"].as_object().unwrap().values() {
        for path in panel["paths"].as_array().into_iter().flatten() {
            let (topic, field) = path["value"].as_str().unwrap().split_once('.').unwrap();
            assert!(messages[topic].last().unwrap().0[field].is_number(), "{path}");
            paths += 1;
        }
        for topic in [&panel["followTopic"], &panel["topicToRender"]].into_iter().filter_map(Value::as_str) {
            assert!(messages.contains_key(topic), "{topic}");
        }
    }
    assert!(paths > 20);
}
