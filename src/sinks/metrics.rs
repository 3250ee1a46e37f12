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
    let version = [("version", env!("CARGO_PKG_VERSION"))];
    page.samples("gaware_build_info", "Version of gaware.", [(version, 1.0)]);
    inputs(&mut page, snapshot);
    estimates(&mut page, snapshot);
    observability(&mut page, snapshot);
    surroundings(&mut page, status);
    page.text
}

fn inputs(page: &mut Page, s: &Snapshot) {
    page.single("gaware_snapshots_total", "Snapshots made by the engine.", s.sequence as f64);
    page.single("gaware_elapsed_seconds", "Seconds since the first sample.", s.elapsed_s);
    page.single("gaware_imu_samples_total", "Inertial samples used.", s.imu.samples as f64);
    page.single("gaware_imu_dropped_total", "Inertial samples lost or refused.", s.imu.dropped as f64);
    page.single("gaware_imu_rate_hertz", "Inertial samples per second.", s.imu.rate_hz);
    page.single("gaware_gnss_rate_hertz", "Fixes per second.", s.gnss.rate_hz);
    let fixes = [("used", s.gnss.used), ("rejected", s.gnss.rejected)];
    let fixes = fixes.map(|(result, n)| ([("result", result)], n as f64));
    page.samples("gaware_gnss_fixes_total", "Fixes, by what the filter did with them.", fixes);
    let phases = PHASES.map(|(phase, name)| ([("phase", name)], flag(phase == s.phase)));
    page.samples("gaware_phase", "1 for the phase the estimator is in.", phases);
    page.single("gaware_warnings", "Warnings shown now.", s.warnings.len() as f64);
}

const PHASES: [(Phase, &str); 5] = [
    (Phase::WaitingForImu, "waiting_for_imu"),
    (Phase::WaitingForGnss, "waiting_for_gnss"),
    (Phase::Aligning, "aligning"),
    (Phase::SearchingHeading, "searching_heading"),
    (Phase::Running, "running"),
];

fn estimates(page: &mut Page, s: &Snapshot) {
    let help = "Mean normalised innovation squared per degree of freedom; 1 is right.";
    page.single("gaware_nis_mean_per_dof", help, s.consistency.nis_mean_per_dof);
    let g = &s.estimate.g_sensitivity_deg_per_h_per_g;
    let help = "G; row = gyro axis, column = axis of specific force.";
    page.samples("gaware_g_sensitivity_deg_per_h_per_g", help, elements(&g.value));
    page.samples("gaware_g_sensitivity_sigma_deg_per_h_per_g", "1-sigma of G.", elements(&g.sigma));
}

fn elements(matrix: &[[f64; 3]; 3]) -> impl Iterator<Item = Sample<'static, 2>> {
    const AXES: [&str; 3] = ["x", "y", "z"];
    AXES.into_iter().zip(matrix).flat_map(|(row, values)| {
        let labels = move |(column, value): (_, &f64)| ([("gyro", row), ("acceleration", column)], *value);
        AXES.into_iter().zip(values).map(labels)
    })
}

fn observability(page: &mut Page, s: &Snapshot) {
    let o = &s.observability;
    let conditions = [("a", &o.conditions.a), ("b", &o.conditions.b), ("c", &o.conditions.c)];
    let met = conditions.map(|(name, c)| ([("condition", name)], flag(c.met)));
    page.samples("gaware_condition_met", "1 where the condition of observability is met.", met);
    let progress = conditions.map(|(name, c)| ([("condition", name)], c.progress));
    page.samples("gaware_condition_progress", "How far the condition is met, 0 to 1.", progress);
    let sigmas = o.states.iter().map(|x| ([("state", &*x.name), ("unit", &*x.unit)], x.sigma));
    page.samples("gaware_state_sigma", "1-sigma of a state in its unit.", sigmas);
    let ratios = o.states.iter().map(|x| ([("state", &*x.name)], x.sigma_ratio));
    page.samples("gaware_state_sigma_ratio", "Sigma now over sigma at the start.", ratios);
    let seen = o.states.iter().map(|x| ([("state", &*x.name)], flag(x.status == Status::Observable)));
    page.samples("gaware_state_observable", "1 where a state is observable.", seen);
}

fn surroundings(page: &mut Page, status: &StatusView) {
    let (link, recorder) = (&status.link, &status.recorder);
    let states = LinkState::ALL.map(|state| ([("state", state.word())], flag(state == link.state)));
    page.samples("gaware_link_state", "1 for the state the link is in.", states);
    page.single("gaware_link_frames_total", "Good frames.", link.frames as f64);
    page.single("gaware_link_bytes_total", "Bytes received.", link.bytes as f64);
    page.single("gaware_link_lost_total", "Frames lost by their sequence.", link.lost as f64);
    page.single("gaware_link_bad_crc_total", "Frames with a bad checksum.", link.bad_crc as f64);
    let states = RecorderState::ALL.map(|state| ([("state", state.word())], flag(state == recorder.state)));
    page.samples("gaware_recorder_state", "1 for the state the recorder is in.", states);
    page.single("gaware_recorder_bytes_total", "Bytes recorded.", recorder.bytes as f64);
    let delivered = status.sinks.iter().map(|(name, sink)| ([("sink", &**name)], sink.delivered as f64));
    page.samples("gaware_sink_delivered_total", "Messages a sink delivered.", delivered);
    let dropped = status.sinks.iter().map(|(name, sink)| ([("sink", &**name)], sink.dropped as f64));
    page.samples("gaware_sink_dropped_total", "Messages a sink lost because it was slow.", dropped);
}

fn flag(on: bool) -> f64 {
    f64::from(u8::from(on))
}

/// Labels and value.
type Sample<'a, const N: usize> = ([(&'a str, &'a str); N], f64);

#[derive(Default)]
struct Page {
    text: String,
}

// Writing to a String cannot fail, so the results of `write!` carry nothing.
impl Page {
    /// A family: what only rises has a name that ends with `_total`.
    fn samples<'a, const N: usize>(
        &mut self,
        name: &str,
        help: &str,
        samples: impl IntoIterator<Item = Sample<'a, N>>,
    ) {
        let kind = if name.ends_with("_total") { "counter" } else { "gauge" };
        let _ = writeln!(self.text, "# HELP {name} {help}\n# TYPE {name} {kind}");
        for (labels, value) in samples {
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
    }

    fn single(&mut self, name: &str, help: &str, value: f64) {
        self.samples(name, help, [([], value)]);
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
