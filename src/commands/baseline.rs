//! Golden results: a document from an earlier `replay --json`, against which a new one is compared.
//!
//! Every value of the baseline must be found again. Numbers may differ by the tolerance of the longest matching prefix in
//! the baseline's own `tolerances` (absolute, by JSON pointer), otherwise by a millionth of their size:
//!
//! ```json
//! {"schema": "gaware.summary/1", "duration_s": 674.2,
//!  "tolerances": {"/estimate/g_sensitivity_deg_per_h_per_g/value": 5.0, "/consistency": 0.05}}
//! ```

use super::CommandError;
use serde_json::{Map, Value};
use std::path::Path;

const DEFAULT_RELATIVE: f64 = 1e-6;
const MAX_SHOWN: usize = 20;

/// What became of one log. A group is a value at the top of the baseline's document.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Name of the log.
    pub log: String,
    /// Groups, each with the places where it left its tolerance.
    pub differences: Vec<(String, Vec<String>)>,
}

/// Compares a result with the baseline in this file: for each value at its top the places that differ.
///
/// # Errors
/// When the file is no baseline.
pub fn differences(
    path: &Path,
    result: &Map<String, Value>,
) -> Result<Vec<(String, Vec<String>)>, CommandError> {
    let wrong = |reason: String| CommandError::Baseline { path: path.to_owned(), reason };
    let text =
        crate::inputs::text(path).map_err(|source| CommandError::Read { path: path.to_owned(), source })?;
    let mut baseline: Map<String, Value> = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    let tolerances = match baseline.remove("tolerances") {
        None => Map::new(),
        Some(Value::Object(map)) if map.values().all(Value::is_number) => map,
        Some(_) => return Err(wrong("\"tolerances\" must map JSON pointers to numbers".to_owned())),
    };
    if baseline.is_empty() {
        return Err(wrong("it holds no values".to_owned()));
    }
    let groups = baseline.iter().map(|(key, wanted)| {
        let mut found = Vec::new();
        compare(&format!("/{}", escaped(key)), wanted, result.get(key), &tolerances, &mut found);
        (key.clone(), found)
    });
    Ok(groups.collect())
}

/// Fails where a result left its tolerance.
///
/// # Errors
/// The places.
pub fn verdict(outcomes: &[Outcome]) -> Result<(), CommandError> {
    let several = outcomes.len() > 1;
    let mut all: Vec<String> = Vec::new();
    for outcome in outcomes {
        let of_log = if several { format!("{} ", outcome.log) } else { String::new() };
        all.extend(outcome.differences.iter().flat_map(|(_, places)| places).map(|p| format!("{of_log}{p}")));
    }
    if all.is_empty() {
        return Ok(());
    }
    let count = all.len();
    all.truncate(MAX_SHOWN);
    Err(CommandError::Differs { count, differences: all.join("\n") })
}

/// The outcomes as JUnit XML: a suite for each log, a test case for each value at the top of its baseline.
pub fn junit(outcomes: &[Outcome]) -> String {
    let failed = |o: &Outcome| o.differences.iter().filter(|(_, places)| !places.is_empty()).count();
    let (tests, failures) =
        outcomes.iter().fold((0, 0), |(t, f), o| (t + o.differences.len(), f + failed(o)));
    let mut out = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"gaware replay\" tests=\"{tests}\" failures=\"{failures}\">\n"
    );
    for outcome in outcomes {
        let log = xml(&outcome.log);
        out.push_str(&format!(
            "  <testsuite name=\"{log}\" tests=\"{}\" failures=\"{}\" errors=\"0\" skipped=\"0\">\n",
            outcome.differences.len(),
            failed(outcome)
        ));
        for (group, places) in &outcome.differences {
            let case = format!("    <testcase classname=\"{log}\" name=\"{}\"", xml(group));
            if places.is_empty() {
                out.push_str(&format!("{case}/>\n"));
            } else {
                let message = format!("{} place(s) left the tolerance of the baseline", places.len());
                let places = xml(&places.join("\n"));
                out.push_str(&format!(
                    "{case}><failure message=\"{message}\">{places}</failure></testcase>\n"
                ));
            }
        }
        out.push_str("  </testsuite>\n");
    }
    out + "</testsuites>\n"
}

/// Text that cannot become markup; control characters are not allowed in XML at all.
fn xml(text: &str) -> String {
    let allowed: String = text.chars().map(|c| if c.is_control() && c != '\n' { ' ' } else { c }).collect();
    allowed.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A key as part of a JSON pointer (RFC 6901).
fn escaped(key: &str) -> String {
    key.replace('~', "~0").replace('/', "~1")
}

fn compare(
    at: &str,
    wanted: &Value,
    found: Option<&Value>,
    tolerances: &Map<String, Value>,
    out: &mut Vec<String>,
) {
    match (wanted, found) {
        (_, None) => out.push(format!("{at}: missing, the baseline has {wanted}")),
        (Value::Object(w), Some(Value::Object(f))) => {
            for (key, value) in w {
                let key_at = format!("{at}/{}", escaped(key));
                compare(&key_at, value, f.get(key), tolerances, out);
            }
        }
        (Value::Array(w), Some(Value::Array(f))) => {
            for (k, value) in w.iter().enumerate() {
                compare(&format!("{at}/{k}"), value, f.get(k), tolerances, out);
            }
            if f.len() > w.len() {
                out.push(format!("{at}: {} entries, the baseline has {}", f.len(), w.len()));
            }
        }
        (Value::Number(w), Some(Value::Number(f))) => {
            let (w, f) = (w.as_f64().unwrap_or(f64::NAN), f.as_f64().unwrap_or(f64::NAN));
            let tolerance = tolerance(at, tolerances).unwrap_or(DEFAULT_RELATIVE * w.abs());
            let close = (w - f).abs() <= tolerance;
            if !close {
                out.push(format!("{at}: {f}, the baseline has {w} ± {tolerance}"));
            }
        }
        (w, Some(f)) if w == f => {}
        (w, Some(f)) => out.push(format!("{at}: {f}, the baseline has {w}")),
    }
}

/// The tolerance of the longest prefix, by whole path elements.
fn tolerance(at: &str, tolerances: &Map<String, Value>) -> Option<f64> {
    let matches =
        |prefix: &str| at.strip_prefix(prefix).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
    let best = tolerances.iter().filter(|(prefix, _)| matches(prefix)).max_by_key(|(prefix, _)| prefix.len());
    best.and_then(|(_, value)| value.as_f64())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn differences(baseline: Value, result: Value) -> Result<(), String> {
        let path = std::env::temp_dir().join(format!(
            "gaware-baseline-{}-{:?}.json",
            std::process::id(),
            std::thread::current().id()
        ));
        std::fs::write(&path, baseline.to_string()).unwrap();
        let outcome = super::differences(&path, result.as_object().unwrap())
            .and_then(|differences| verdict(&[Outcome { log: "a.tlog".to_owned(), differences }]))
            .map_err(|e| e.to_string());
        std::fs::remove_file(&path).unwrap();
        outcome
    }

    #[test]
    fn the_longest_prefix_gives_the_tolerance() {
        let baseline = json!({"a": {"b": [1.0, 2.0], "c": 5.0}, "tolerances": {"/a": 0.5, "/a/b/1": 0.01}});
        assert_eq!(differences(baseline.clone(), json!({"a": {"b": [1.4, 2.005], "c": 5.2}})), Ok(()));
        let told = differences(baseline, json!({"a": {"b": [1.4, 2.1], "c": 5.2}})).unwrap_err();
        assert!(told.contains("/a/b/1: 2.1"), "{told}");
    }

    #[test]
    fn without_a_tolerance_a_change_is_seen() {
        assert!(differences(json!({"n": 100.0}), json!({"n": 100.01})).is_err());
        assert_eq!(differences(json!({"n": 100.0}), json!({"n": 100.0, "new": 1})), Ok(()));
        assert!(differences(json!({"s": "observable"}), json!({"s": "weak"})).is_err());
        assert!(differences(json!({"gone": 1}), json!({"n": 1})).is_err());
    }

    #[test]
    fn junit_has_a_case_for_each_value_and_its_places_as_text() {
        let places = vec!["/b: \"<1>\" & more".to_owned()];
        let outcome = Outcome {
            log: "a&b.tlog".to_owned(),
            differences: vec![("a".to_owned(), vec![]), ("b".to_owned(), places)],
        };
        let text = junit(&[outcome]);
        assert!(text.contains("<testsuite name=\"a&amp;b.tlog\" tests=\"2\" failures=\"1\""), "{text}");
        assert!(
            text.contains("name=\"a\"/>") && text.contains("/b: &quot;&lt;1&gt;&quot; &amp; more</failure>"),
            "{text}"
        );
    }

    #[test]
    fn a_file_that_is_no_baseline_is_refused() {
        assert!(differences(json!({}), json!({})).unwrap_err().contains("no baseline"));
        assert!(differences(json!({"a": 1, "tolerances": 3}), json!({"a": 1})).is_err());
    }
}
