use super::table::{Cell, Put, Row};
use super::*;

struct Pair(f64, Option<f64>);

impl Row for Pair {
    fn visit(&self, put: &mut Put<'_>) {
        put("a_m", "first", Cell::Number(self.0));
        if let Some(b) = self.1 {
            put("b_s", "second", Cell::Number(b));
        }
        put("word", "third", Cell::Text("a \"quoted\", word"));
    }
}

fn table() -> Table {
    let mut table = Table::new("states", "A row.");
    table.push(&[&Pair(1.5, None)]);
    table.push(&[&Pair(f64::NAN, Some(0.1))]);
    table.push(&[&Pair(-2.0, None)]);
    table
}

#[test]
fn a_column_that_comes_later_is_empty_before_and_where_it_is_not_given() {
    let text = String::from_utf8(csv::bytes(&table()).unwrap()).unwrap();
    let word = "\"a \"\"quoted\"\", word\"";
    assert_eq!(text, format!("a_m,word,b_s\n1.5,{word},\n,{word},0.1\n-2,{word},\n"));
}

#[test]
fn a_target_is_a_file_of_a_known_ending_or_a_folder() {
    let of = |name: &str| Target::new(Path::new(name)).map_err(|e| e.to_string());
    assert!(
        of("/nowhere/tables").is_ok()
            && of("a.CSV").is_ok()
            && of("a.parquet").is_ok()
            && of("a.mcap").is_ok()
    );
    assert!(of("a.xlsx").unwrap_err().contains(".csv, .parquet or .mcap"));
}

#[test]
fn what_cannot_be_written_leaves_no_part_behind() {
    let folder = std::env::temp_dir().join(format!("gaware-export-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("taken.csv/x")).unwrap();
    // A folder has that name: the finished file cannot take its place.
    let target = Target { path: folder.join("taken.csv"), format: Some(Format::Csv) };
    let error = target.write(&gather::example(), &Outputs::default()).unwrap_err();
    assert!(error.to_string().contains("taken.csv"), "{error}");
    let left: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["taken.csv"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn every_message_of_an_mcap_file_is_a_flat_object_at_its_time() {
    let mut timed = Table::new("states", "A row.");
    for t_s in [2.0, 1.0] {
        timed.push(&[&rows::Origin { log: "x.tlog", elapsed_s: 0.0, t_s }]);
    }
    let bytes = mcap::bytes(&[timed]).unwrap();
    let messages: Vec<_> = ::mcap::MessageStream::new(&bytes).unwrap().map(|m| m.unwrap()).collect();
    let times: Vec<u64> = messages.iter().map(|m| m.log_time).collect();
    assert_eq!(times, [1_000_000_000, 2_000_000_000]);
    let first: serde_json::Value = serde_json::from_slice(&messages[0].data).unwrap();
    assert_eq!(first, serde_json::json!({"log": "x.tlog", "elapsed_s": 0.0, "t_s": 1.0}));
    let schema: serde_json::Value =
        serde_json::from_slice(&messages[0].channel.schema.as_ref().unwrap().data).unwrap();
    assert_eq!(schema["properties"]["t_s"]["type"], "number");
}

#[test]
fn the_list_of_columns_has_every_table_with_units() {
    let text = columns_in_words();
    for name in [
        "## states",
        "## imu",
        "## fixes",
        "## autopilot_attitude",
        "## events",
        "`g31_sigma_deg_per_h_per_g`",
        "`gps_latency_s`",
    ] {
        assert!(text.contains(name), "{name} in {text}");
    }
}
