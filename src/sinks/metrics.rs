//! `GET /metrics`: the snapshot and the sinks in Prometheus' text format, version 0.0.4.
//!
//! Everything to be scraped already lies in one [`Snapshot`] and one [`StatusView`], so the text is rendered from them
//! on request; a recorder with a global registry would only be a second copy that can disagree.

use super::status::{LinkState, RecorderState, StatusView};
use crate::engine::snapshot::{Phase, Snapshot, Status};
use std::fmt::Write;

/// Content type of [`render`].
pub const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// The whole page.
pub fn render(snapshot: &Snapshot, status: &StatusView) -> String {
    let mut page = Page::default();
    page.family("gaware_build_info", "gauge", "Version of gaware.");
    page.sample("gaware_build_info", &[("version", env!("CARGO_PKG_VERSION"))], 1.0);
    inputs(&mut page, snapshot);
    estimates(&mut page, snapshot);
    observability(&mut page, snapshot);
    surroundings(&mut page, status);
    page.text
}

fn inputs(page: &mut Page, s: &Snapshot) {
    page.single("gaware_snapshots_total", "counter", "Snapshots made by the engine.", s.sequence as f64);
    page.single("gaware_elapsed_seconds", "gauge", "Seconds since the first sample.", s.elapsed_s);
    page.single("gaware_imu_samples_total", "counter", "Inertial samples used.", s.imu.samples as f64);
    page.single(
        "gaware_imu_dropped_total",
        "counter",
        "Inertial samples lost or refused.",
        s.imu.dropped as f64,
    );
    page.single("gaware_imu_rate_hertz", "gauge", "Inertial samples per second.", s.imu.rate_hz);
    page.single("gaware_gnss_rate_hertz", "gauge", "Fixes per second.", s.gnss.rate_hz);
    page.family("gaware_gnss_fixes_total", "counter", "Fixes, by what the filter did with them.");
    page.sample("gaware_gnss_fixes_total", &[("result", "used")], s.gnss.used as f64);
    page.sample("gaware_gnss_fixes_total", &[("result", "rejected")], s.gnss.rejected as f64);
    page.family("gaware_phase", "gauge", "1 for the phase the estimator is in.");
    for (phase, name) in PHASES {
        page.sample("gaware_phase", &[("phase", name)], flag(phase == s.phase));
    }
    page.single("gaware_warnings", "gauge", "Warnings shown now.", s.warnings.len() as f64);
}

const PHASES: [(Phase, &str); 5] = [
    (Phase::WaitingForImu, "waiting_for_imu"),
    (Phase::WaitingForGnss, "waiting_for_gnss"),
    (Phase::Aligning, "aligning"),
    (Phase::SearchingHeading, "searching_heading"),
    (Phase::Running, "running"),
];

fn estimates(page: &mut Page, s: &Snapshot) {
    page.single(
        "gaware_nis_mean_per_dof",
        "gauge",
        "Mean normalised innovation squared per degree of freedom; 1 is right.",
        s.consistency.nis_mean_per_dof,
    );
    let g = &s.estimate.g_sensitivity_deg_per_h_per_g;
    let families = [
        (
            "gaware_g_sensitivity_deg_per_h_per_g",
            "G; row = gyro axis, column = axis of specific force.",
            &g.value,
        ),
        ("gaware_g_sensitivity_sigma_deg_per_h_per_g", "1-sigma of G.", &g.sigma),
    ];
    for (name, help, matrix) in families {
        page.family(name, "gauge", help);
        for (row, values) in AXES.iter().zip(matrix) {
            for (column, value) in AXES.iter().zip(values) {
                page.sample(name, &[("gyro", row), ("acceleration", column)], *value);
            }
        }
    }
}

const AXES: [&str; 3] = ["x", "y", "z"];

fn observability(page: &mut Page, s: &Snapshot) {
    let o = &s.observability;
    let conditions = [("a", &o.conditions.a), ("b", &o.conditions.b), ("c", &o.conditions.c)];
    page.family("gaware_condition_met", "gauge", "1 where the condition of observability is met.");
    for (name, c) in conditions {
        page.sample("gaware_condition_met", &[("condition", name)], flag(c.met));
    }
    page.family("gaware_condition_progress", "gauge", "How far the condition is met, 0 to 1.");
    for (name, c) in conditions {
        page.sample("gaware_condition_progress", &[("condition", name)], c.progress);
    }
    page.family("gaware_state_sigma", "gauge", "1-sigma of a state in its unit.");
    for x in &o.states {
        page.sample("gaware_state_sigma", &[("state", &x.name), ("unit", &x.unit)], x.sigma);
    }
    page.family("gaware_state_sigma_ratio", "gauge", "Sigma now over sigma at the start.");
    for x in &o.states {
        page.sample("gaware_state_sigma_ratio", &[("state", &x.name)], x.sigma_ratio);
    }
    page.family("gaware_state_observable", "gauge", "1 where a state is observable.");
    for x in &o.states {
        page.sample("gaware_state_observable", &[("state", &x.name)], flag(x.status == Status::Observable));
    }
}

fn surroundings(page: &mut Page, status: &StatusView) {
    let link = &status.link;
    page.family("gaware_link_state", "gauge", "1 for the state the link is in.");
    for state in LinkState::ALL {
        page.sample("gaware_link_state", &[("state", state.word())], flag(state == link.state));
    }
    page.single("gaware_link_frames_total", "counter", "Good frames.", link.frames as f64);
    page.single("gaware_link_bytes_total", "counter", "Bytes received.", link.bytes as f64);
    page.single("gaware_link_lost_total", "counter", "Frames lost by their sequence.", link.lost as f64);
    page.single("gaware_link_bad_crc_total", "counter", "Frames with a bad checksum.", link.bad_crc as f64);
    page.family("gaware_recorder_state", "gauge", "1 for the state the recorder is in.");
    for state in RecorderState::ALL {
        page.sample(
            "gaware_recorder_state",
            &[("state", state.word())],
            flag(state == status.recorder.state),
        );
    }
    page.single("gaware_recorder_bytes_total", "counter", "Bytes recorded.", status.recorder.bytes as f64);
    page.family("gaware_sink_delivered_total", "counter", "Messages a sink delivered.");
    for (name, sink) in &status.sinks {
        page.sample("gaware_sink_delivered_total", &[("sink", name)], sink.delivered as f64);
    }
    page.family("gaware_sink_dropped_total", "counter", "Messages a sink lost because it was slow.");
    for (name, sink) in &status.sinks {
        page.sample("gaware_sink_dropped_total", &[("sink", name)], sink.dropped as f64);
    }
}

fn flag(on: bool) -> f64 {
    f64::from(u8::from(on))
}

#[derive(Default)]
struct Page {
    text: String,
}

// Writing to a String cannot fail, so the results of `write!` carry nothing.
impl Page {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        let _ = writeln!(self.text, "# HELP {name} {help}\n# TYPE {name} {kind}");
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: f64) {
        self.text.push_str(name);
        for (i, (label, word)) in labels.iter().enumerate() {
            let open = if i == 0 { '{' } else { ',' };
            let word = word.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
            let _ = write!(self.text, "{open}{label}=\"{word}\"");
        }
        if !labels.is_empty() {
            self.text.push('}');
        }
        let _ = match value {
            v if v.is_nan() => writeln!(self.text, " NaN"),
            v if v.is_infinite() => writeln!(self.text, " {}", if v > 0.0 { "+Inf" } else { "-Inf" }),
            v => writeln!(self.text, " {v}"),
        };
    }

    fn single(&mut self, name: &str, kind: &str, help: &str, value: f64) {
        self.family(name, kind, help);
        self.sample(name, &[], value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::snapshot::StateStatus;
    use crate::sinks::status::SinkStatus;
    use std::collections::BTreeSet;

    fn page() -> String {
        let mut s = Snapshot { sequence: 41, phase: Phase::Running, ..Snapshot::default() };
        s.estimate.g_sensitivity_deg_per_h_per_g.value[1][2] = -7.5;
        s.observability.states =
            vec![StateStatus { name: "odd\"name\\\n".into(), sigma: f64::NAN, ..StateStatus::default() }];
        let status = SinkStatus::new();
        status.sink("web").dropped(3);
        render(&s, &status.view())
    }

    #[test]
    fn figures_arrive_under_their_names() {
        let page = page();
        for line in [
            "gaware_snapshots_total 41",
            "gaware_phase{phase=\"running\"} 1",
            "gaware_phase{phase=\"aligning\"} 0",
            "gaware_g_sensitivity_deg_per_h_per_g{gyro=\"y\",acceleration=\"z\"} -7.5",
            "gaware_sink_dropped_total{sink=\"web\"} 3",
            "gaware_link_state{state=\"connecting\"} 1",
            "gaware_state_sigma{state=\"odd\\\"name\\\\\\n\",unit=\"\"} NaN",
        ] {
            assert!(page.lines().any(|l| l == line), "missing {line} in\n{page}");
        }
    }

    #[test]
    fn every_sample_belongs_to_the_family_declared_just_before_it() {
        let mut family = String::new();
        let mut declared = BTreeSet::new();
        for line in page().lines() {
            if let Some(rest) = line.strip_prefix("# TYPE ") {
                family = rest.split(' ').next().unwrap().to_owned();
                assert!(declared.insert(family.clone()), "{family} declared twice");
            } else if !line.starts_with('#') {
                let name = line.split(['{', ' ']).next().unwrap();
                assert_eq!(name, family);
                let value = line.rsplit(' ').next().unwrap();
                assert!(value == "NaN" || value.parse::<f64>().is_ok(), "{line}");
            }
        }
        assert!(declared.len() > 20);
    }
}
