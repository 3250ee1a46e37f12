//! The JSON schemas in `docs/` are what the program really sends. `UPDATE_SCHEMA=1` renews them.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic, as tests do")]

use gaware::engine::snapshot::Snapshot;
use gaware::sinks::status::StatusView;
use std::path::PathBuf;

fn check(file: &str, schema: schemars::Schema) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("docs").join(file);
    let now = serde_json::to_string_pretty(&schema).unwrap() + "\n";
    if std::env::var_os("UPDATE_SCHEMA").is_some() {
        std::fs::write(&path, &now).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(kept == now, "docs/{file} is stale: run `UPDATE_SCHEMA=1 cargo test --test main schema`");
}

#[test]
fn the_schema_of_the_snapshot_is_up_to_date() {
    check("snapshot.schema.json", schemars::schema_for!(Snapshot));
}

#[test]
fn the_schema_of_the_sinks_is_up_to_date() {
    check("sinks.schema.json", schemars::schema_for!(StatusView));
}

#[test]
fn the_schemas_of_the_results_are_up_to_date() {
    check("summary.schema.json", schemars::schema_for!(gaware::pipeline::ReplayDocument));
    check("replay.schema.json", schemars::schema_for!(gaware::commands::replay::ReplayResults));
    check("explanation.schema.json", schemars::schema_for!(gaware::explain::contract::Explanation));
    check("fleet.schema.json", schemars::schema_for!(gaware::commands::fleet::FleetResult));
    check("fleet_family.schema.json", schemars::schema_for!(gaware::fleet::family::Family));
    check("plan.schema.json", schemars::schema_for!(gaware::commands::plan::PlanDocument));
    check("comparison.schema.json", schemars::schema_for!(gaware::compare::Comparison));
    check("loop.schema.json", schemars::schema_for!(gaware::demo::closed_loop::LoopResult));
    check("preflight.schema.json", schemars::schema_for!(gaware::commands::preflight::Table));
    check("mission.schema.json", schemars::schema_for!(gaware::commands::mission_result::MissionResult));
}
