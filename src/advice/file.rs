//! The advice as a parameter file: proposals whose value is known as parameters, everything else as comments.

use super::on_board::OnBoard;
use super::rule::Change;
use super::{Advice, Proposal, rounded, rule_free};
use gaware_mission::item::Autopilot;
use gaware_mission::params::file::{self, FileEntry, FileLine};
use gaware_nav::math::{log10, powf};

/// Longest comment line, characters.
const WIDTH: usize = 110;

/// The text of `autopilot.param` or `autopilot.params`.
pub fn text(advice: &Advice, autopilot: Autopilot, on_board: &OnBoard, origin: &str) -> String {
    let mut lines = Vec::new();
    let version = advice.version.as_deref().unwrap_or("of unknown version");
    lines.push(file::origin_line(&format!("gaware explain of {origin}; {autopilot} {version}")));
    let uid = on_board.board.as_deref().and_then(|board| board.parse().ok());
    lines.push(file::vehicle_line(autopilot, on_board.fixed_wing, uid));
    comment(
        &mut lines,
        "read each line before it is applied; gaware params apply backs up, writes, reads back and compares",
    );
    if advice.proposals.iter().any(|p| p.proposed.is_some() && p.reboot) {
        comment(&mut lines, "a reboot of the autopilot is due afterwards");
    }
    if advice.proposals.is_empty() {
        comment(&mut lines, "nothing is proposed");
    }
    for proposal in &advice.proposals {
        comment(&mut lines, &words(proposal));
        if let (Some(value), Ok(name)) = (proposal.proposed, proposal.parameter.parse()) {
            lines.push(FileLine::Entry(FileEntry { name, value, kind: Some(proposal.kind) }));
        }
    }
    for not in &advice.not_proposed {
        let parameter = not.parameter.map_or_else(String::new, |p| format!(", {p}"));
        comment(&mut lines, &format!("not proposed: {}{parameter}: {}", not.effect, not.reason));
    }
    advice.notes.iter().for_each(|note| comment(&mut lines, &format!("note: {note}")));
    file::write(autopilot, on_board.system_id.unwrap_or(1), &lines)
}

/// What a proposal does: `GPS1_DELAY_MS = 333 ± 2 ms`.
pub fn short(p: &Proposal) -> String {
    let unit = if p.unit.is_empty() { String::new() } else { format!(" {}", p.unit) };
    let with = |v: f64| format!("{} ± {}{unit}", rule_free(rounded(v, 1e-6)), significant(p.sigma));
    match (p.proposed, p.change) {
        (Some(v), _) => format!("{} = {} ± {}{unit}", p.parameter, rule_free(v), significant(p.sigma)),
        (None, Change::Set(v)) => format!("{} = {}", p.parameter, with(v)),
        (None, Change::Add(v)) => format!("{}: add {}", p.parameter, with(v)),
        (None, Change::Multiply(v)) => format!("{}: multiply by {}", p.parameter, with(v)),
        (None, Change::UnitPlus(v)) => {
            format!("{} = position of the inertial unit plus {}", p.parameter, with(v))
        }
    }
}

/// Two significant figures.
fn significant(sigma: f64) -> String {
    let step = powf(10_f64, log10(sigma.abs().max(1e-9)).floor() - 1.0);
    rule_free((sigma / step).round() * step)
}

/// The same with all that belongs to it.
pub fn words(p: &Proposal) -> String {
    let old = p.on_board.map_or_else(|| "not in the log".to_owned(), |v| rule_free(v).to_string());
    let needs =
        if p.needs.is_empty() { String::new() } else { format!("; not in the log: {}", p.needs.join(", ")) };
    let note = p.note.as_deref().map_or_else(String::new, |n| format!("; {n}"));
    let reboot = if p.reboot { "; reboot" } else { "" };
    format!("{} (on board: {old}); {}{needs}{note}{reboot}", short(p), p.effect)
}

fn comment(lines: &mut Vec<FileLine>, text: &str) {
    let mut line = String::new();
    for word in text.split_whitespace() {
        if !line.is_empty() && line.chars().count() + word.chars().count() >= WIDTH {
            lines.push(FileLine::Comment(std::mem::take(&mut line)));
            line.push(' ');
        } else if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    lines.push(FileLine::Comment(line));
}
