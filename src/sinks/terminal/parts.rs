//! The panels of the terminal screen.

use super::draw::View;
use crate::engine::snapshot::{Condition, Phase, StateStatus, Status};
use crate::sinks::events::{Severity, phase_words};
use crate::sinks::status::{LinkState, MissionState, RecorderState};
use crate::sinks::words::{brief, bytes, clock, fit};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span, Text};
use ratatui::widgets::{Block, Padding, Paragraph, Wrap};

const BOLD: Style = Style::new().add_modifier(Modifier::BOLD);

/// One line: phase, time, link, recorder, NIS.
pub(super) fn title(frame: &mut Frame, view: &View, area: Rect) {
    let (s, link, recorder) = (view.snapshot, &view.sinks.link, &view.sinks.recorder);
    let link_style = match link.state {
        LinkState::Up => view.ink(Color::Green),
        LinkState::Connecting => view.ink(Color::Yellow),
        LinkState::Silent | LinkState::Down => view.ink(Color::Red).add_modifier(Modifier::BOLD),
    };
    let (recorder_text, recorder_style) = match recorder.state {
        RecorderState::Off => ("rec off".to_owned(), Style::new()),
        RecorderState::Recording => (format!("rec {}", bytes(recorder.bytes)), view.ink(Color::Green)),
        RecorderState::Failed => ("REC FAILED".to_owned(), view.ink(Color::Red).add_modifier(Modifier::BOLD)),
    };
    let link_text = match link.state {
        LinkState::Up => format!("link up {:.0}/s", link.rate_hz),
        other => format!("link {}", other.word()),
    };
    let gap = || Span::raw("  ");
    let line = Line::from(vec![
        Span::styled(" gaware ", BOLD.add_modifier(Modifier::REVERSED)),
        gap(),
        Span::styled(phase_words(s.phase), BOLD),
        gap(),
        Span::raw(clock(s.elapsed_s)),
        gap(),
        Span::styled(link_text, link_style),
        gap(),
        Span::styled(recorder_text, recorder_style),
        gap(),
        Span::styled(format!("NIS {}", nis(view)), nis_style(view)),
    ]);
    frame.render_widget(Paragraph::new(line), area);
}

fn nis(view: &View) -> String {
    if view.snapshot.phase == Phase::Running {
        brief(view.snapshot.consistency.nis_mean_per_dof)
    } else {
        "-".to_owned()
    }
}

fn nis_style(view: &View) -> Style {
    match view.snapshot.consistency.nis_mean_per_dof {
        _ if view.snapshot.phase != Phase::Running => Style::new(),
        n if !(0.4..=2.0).contains(&n) => view.ink(Color::Red).add_modifier(Modifier::BOLD),
        n if n > 1.5 => view.ink(Color::Yellow),
        _ => view.ink(Color::Green),
    }
}

/// Heading and words of what the pilot is to do.
fn guidance(view: &View) -> (&'static str, String) {
    let s = view.snapshot;
    if s.phase != Phase::Running {
        let words = if s.waiting_for.is_empty() { phase_words(s.phase) } else { &s.waiting_for };
        return ("WAIT", words.to_owned());
    }
    match () {
        () if s.guidance.done => ("DONE", "Everything this airframe can show is known".to_owned()),
        () if s.guidance.instruction.is_empty() => ("STAND BY", "No instruction yet".to_owned()),
        () => ("FLY NOW", s.guidance.instruction.clone()),
    }
}

/// The instruction in its box, with reason and progress.
pub(super) fn instruction(frame: &mut Frame, view: &View, area: Rect) {
    let (heading, words) = guidance(view);
    let block = view.block(heading).border_style(view.ink(Color::Yellow)).style(BOLD);
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let g = &view.snapshot.guidance;
    let flying = heading == "FLY NOW";
    let rest = u16::from(flying) + u16::from(inner.height > 3);
    let [top, reason, progress] = Layout::vertical([
        Constraint::Min(1),
        Constraint::Length(rest.saturating_sub(u16::from(flying))),
        Constraint::Length(u16::from(flying)),
    ])
    .areas(inner);
    large(frame, view, &words, top);
    let words = if flying { &g.reason } else { &g.last_result };
    let line = fit_chars(&view.text(words), inner.width);
    frame.render_widget(Paragraph::new(line).style(Style::new().remove_modifier(Modifier::BOLD)), reason);
    let width = usize::from(progress.width.saturating_sub(6));
    let bar = format!("{} {:3.0} %", view.bar(width, g.progress), g.progress.clamp(0.0, 1.0) * 100.0);
    frame.render_widget(Paragraph::new(bar).style(view.ink(Color::Green)), progress);
}

/// Words as large as a terminal can: a bright field of their own, the words in its middle.
fn large(frame: &mut Frame, view: &View, words: &str, area: Rect) {
    let look = view.ink(Color::Yellow).add_modifier(Modifier::BOLD | Modifier::REVERSED);
    let paragraph = Paragraph::new(view.text(words)).wrap(Wrap { trim: true }).style(look);
    // An estimate that errs on the side of more lines: words do not fill a line.
    let per_line = usize::from(area.width).saturating_sub(12).max(1);
    let lines = u16::try_from(words.chars().count().div_ceil(per_line)).unwrap_or(u16::MAX);
    let above = area.height.saturating_sub(lines) / 2;
    frame.render_widget(paragraph.block(Block::new().padding(Padding::new(2, 2, above, 0))), area);
}

/// The instruction alone, for very small screens.
pub(super) fn instruction_words(frame: &mut Frame, view: &View, area: Rect) {
    let (heading, words) = guidance(view);
    let text = Text::from(vec![Line::raw(heading), Line::styled(view.text(&words), BOLD)]);
    frame.render_widget(Paragraph::new(text).wrap(Wrap { trim: true }), area);
}

/// Conditions with their letter and what they are about.
fn rows<'a>(view: &View<'a>) -> [(&'static str, &'static str, &'a Condition); 3] {
    let c = &view.snapshot.observability.conditions;
    [("(a)", "attitude, biases", &c.a), ("(b)", "diagonal of G", &c.b), ("(c)", "all of G", &c.c)]
}

/// From this width on a condition says what it is about.
const ROOM_FOR_WORDS: u16 = 36;

fn condition_line(view: &View, (letter, about, c): (&str, &str, &Condition), width: u16) -> Line<'static> {
    let letter = if width >= ROOM_FOR_WORDS { format!("{letter} {about:16}") } else { letter.to_owned() };
    let (text, style) = if c.met {
        ("  met".to_owned(), view.of(Status::Observable))
    } else {
        // Never 100 % before it is met.
        (
            format!("{:3.0} %", (c.progress.clamp(0.0, 1.0) * 100.0).floor().min(99.0)),
            view.of(Status::Converging),
        )
    };
    let beside = letter.chars().count() + 7;
    let bar = view.bar(usize::from(width).saturating_sub(beside), if c.met { 1.0 } else { c.progress });
    Line::from(vec![Span::styled(format!("{letter} "), BOLD), Span::styled(format!("{bar} {text}"), style)])
}

/// Conditions in their box, with what is missing.
pub(super) fn conditions(frame: &mut Frame, view: &View, area: Rect) {
    let block = view.block("Conditions (enough, not needed)");
    let inner = block.inner(area);
    let each = usize::from(inner.height / 3).saturating_sub(1).max(1);
    let mut lines = Vec::new();
    for row in rows(view) {
        lines.push(condition_line(view, row, inner.width));
        let mut missing = wrapped(&view.text(&row.2.missing), inner.width.saturating_sub(4), each);
        missing.resize(each, String::new());
        lines.extend(missing.into_iter().map(|line| Line::raw(format!("    {line}"))));
    }
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

/// Conditions, a line each.
pub(super) fn conditions_short(frame: &mut Frame, view: &View, area: Rect) {
    let lines: Vec<Line> = rows(view).into_iter().map(|row| condition_line(view, row, area.width)).collect();
    frame.render_widget(Paragraph::new(lines), area);
}

/// G in its box.
pub(super) fn g(frame: &mut Frame, view: &View, area: Rect) {
    let block = view.block("G, deg/h/g, sigma against target");
    let inner = block.inner(area);
    frame.render_widget(block, area);
    g_rows(frame, view, inner, true);
}

/// G: values with sigmas, and bars below them.
pub(super) fn g_rows(frame: &mut Frame, view: &View, area: Rect, bars: bool) {
    let column = usize::from(area.width.saturating_sub(3) / 3);
    let mut lines = vec![Line::styled(format!("   {:<column$}{:<column$}{:<column$}", "x", "y", "z"), BOLD)];
    let estimate = &view.snapshot.estimate.g_sensitivity_deg_per_h_per_g;
    let plus_minus = if view.options.ascii { "+-" } else { "±" };
    for (r, (values, sigmas)) in estimate.value.iter().zip(&estimate.sigma).enumerate() {
        let axis = ["x", "y", "z"].get(r).copied().unwrap_or_default();
        let mut figures = vec![Span::styled(format!("{axis}  "), BOLD)];
        let mut under = vec![Span::raw("   ")];
        for (c, (value, sigma)) in values.iter().zip(sigmas).enumerate() {
            let state = state_of(view, &format!("g{}{}", r + 1, c + 1));
            let style = view.of(state.map_or(Status::Unobservable, |s| s.status));
            // No filter gives a sigma of zero: nothing is estimated yet.
            let text = match *sigma {
                0.0 => "-".to_owned(),
                // Rounded and without the sign of a negative zero.
                sigma => format!("{:+.1} {plus_minus}{}", (value * 10.0).round() / 10.0 + 0.0, brief(sigma)),
            };
            figures.push(Span::styled(format!("{text:<column$}"), style));
            let bar = view.bar(column.saturating_sub(2), state.map_or(0.0, way_to_target));
            under.push(Span::styled(format!("{bar}  "), style));
        }
        lines.push(Line::from(figures));
        if bars {
            lines.push(Line::from(under));
        }
    }
    frame.render_widget(Paragraph::new(lines), area);
}

fn state_of<'a>(view: &View<'a>, name: &str) -> Option<&'a StateStatus> {
    view.snapshot.observability.states.iter().find(|s| s.name == name)
}

/// How much of the way from the first sigma to the target is done, on a logarithmic scale, 0 to 1.
fn way_to_target(s: &StateStatus) -> f64 {
    let first = s.sigma / s.sigma_ratio;
    if s.sigma > 0.0 && s.target > 0.0 && first > s.target && first.is_finite() {
        ((first / s.sigma).ln() / (first / s.target).ln()).clamp(0.0, 1.0)
    } else {
        f64::from(u8::from(s.status == Status::Observable))
    }
}

/// Rates, fixes, filter.
pub(super) fn health(frame: &mut Frame, view: &View, area: Rect) {
    let (s, link) = (view.snapshot, &view.sinks.link);
    let name = if s.imu.message.is_empty() { "no inertial data" } else { &s.imu.message };
    let lost = if s.imu.dropped > 0 { format!(", {} lost", s.imu.dropped) } else { String::new() };
    let detail = if link.detail.is_empty() { link.state.word() } else { &link.detail };
    let lines: Vec<Line> = [
        format!("{name} {:.1} Hz{lost}", s.imu.rate_hz),
        format!("fixes {:.1} Hz, {} used, {} rejected", s.gnss.rate_hz, s.gnss.used, s.gnss.rejected),
        format!("NIS {} per dof (1 is right)", nis(view)),
        format!("{detail}: {} lost, {} damaged", link.lost, link.bad_crc),
        format!("recorder {} {}", view.sinks.recorder.state.word(), view.sinks.recorder.detail),
        format!("autopilot {}", if s.autopilot.is_empty() { "unknown" } else { &s.autopilot }),
    ]
    .into_iter()
    .map(|line| Line::raw(fit_chars(&view.text(&line), area.width.saturating_sub(2))))
    .collect();
    frame.render_widget(Paragraph::new(lines).block(view.block("Input and filter")), area);
}

/// What has become of the planned mission.
fn mission_line(view: &View, width: u16) -> Option<Line<'static>> {
    let mission = &view.sinks.mission;
    let (mark, style) = match mission.state {
        MissionState::None => return None,
        MissionState::Unknown => ("!", view.ink(Color::Red).add_modifier(Modifier::BOLD)),
        MissionState::NotOnVehicle => ("!", view.ink(Color::Yellow).add_modifier(Modifier::BOLD)),
        MissionState::OnVehicle => ("=", view.ink(Color::Green)),
        MissionState::Ready | MissionState::Uploading => (">", BOLD),
    };
    Some(Line::styled(fit_chars(&format!("{mark} mission: {}", view.text(&mission.text)), width), style))
}

/// The planned mission, warnings of now, then events, newest first.
pub(super) fn events(frame: &mut Frame, view: &View, area: Rect) {
    let width = area.width.saturating_sub(2);
    // On a small screen one line each: the newest few matter more than the end of each.
    let each = if area.height >= ROOM_FOR_SENTENCES { 3 } else { 1 };
    let lines = |mark: String, text: &str, style: Style| {
        let indent = mark.chars().count();
        let text = wrapped(&view.text(text), width.saturating_sub(indent as u16), each);
        text.into_iter().enumerate().map(move |(k, line)| {
            let before = if k == 0 { mark.clone() } else { " ".repeat(indent) };
            Line::styled(format!("{before}{line}"), style)
        })
    };
    let warnings = view
        .snapshot
        .warnings
        .iter()
        .rev()
        .flat_map(|w| lines("! ".to_owned(), w, view.ink(Color::Yellow).add_modifier(Modifier::BOLD)));
    let events = view.events.iter().rev().flat_map(|e| {
        let style = match e.severity {
            Severity::Warning => view.ink(Color::Yellow),
            Severity::Notice => BOLD,
            Severity::Info => Style::new(),
        };
        lines(format!("{} ", clock(e.elapsed_s)), &e.text, style)
    });
    let lines: Vec<Line> = mission_line(view, width)
        .into_iter()
        .chain(warnings)
        .chain(events)
        .take(usize::from(area.height))
        .collect();
    frame.render_widget(Paragraph::new(lines).block(view.block("Warnings, events")), area);
}

/// Every state with its bar.
pub(super) fn states(frame: &mut Frame, view: &View, area: Rect) {
    let lines: Vec<Line> = view
        .snapshot
        .observability
        .states
        .iter()
        .map(|s| {
            let bar = view.bar(10, way_to_target(s));
            let figures = format!("{:>6} /{:>5} {}", brief(s.sigma), brief(s.target), s.unit);
            Line::from(vec![
                Span::styled(format!("{:<6}", s.name), BOLD),
                Span::styled(bar, view.of(s.status)),
                Span::raw(format!(" {figures}")),
            ])
        })
        .collect();
    frame.render_widget(Paragraph::new(lines).block(view.block("States: sigma / target")), area);
}

/// What the flight has not made known.
pub(super) fn weak(frame: &mut Frame, view: &View, area: Rect) {
    let o = &view.snapshot.observability;
    let mut lines: Vec<Line> =
        o.unobservable_directions.iter().map(|d| Line::raw(format!("- {}", view.text(&d.text)))).collect();
    if !o.disagreement.is_empty() {
        lines.push(Line::styled(view.text(&o.disagreement), view.ink(Color::Yellow)));
    }
    let paragraph = Paragraph::new(lines).wrap(Wrap { trim: true }).block(view.block("Not known yet"));
    frame.render_widget(paragraph, area);
}

/// The last line.
pub(super) fn keys(frame: &mut Frame, view: &View, area: Rect) {
    let dropped = view.sinks.dropped();
    let mut spans = vec![Span::raw(" q quit  ? help")];
    if view.sinks.mission.can_upload() {
        spans.push(Span::raw("  u upload the mission"));
    }
    if dropped > 0 {
        let text = format!("   {dropped} messages skipped by slow sinks");
        spans.push(Span::styled(text, view.ink(Color::Yellow)));
    }
    frame.render_widget(Paragraph::new(Line::from(spans)), area);
}

/// From this height on events are told to their end.
const ROOM_FOR_SENTENCES: u16 = 14;

/// At most `most` lines of `width` columns, broken between words; what is left is cut.
fn wrapped(text: &str, width: u16, most: usize) -> Vec<String> {
    let mut lines = Vec::new();
    let mut rest = text.trim();
    while lines.len() + 1 < most && rest.chars().count() > usize::from(width) {
        let end = rest.char_indices().nth(usize::from(width) + 1).map_or(rest.len(), |(at, _)| at);
        let Some((head, _)) = rest.get(..end).and_then(|head| head.rsplit_once(' ')) else { break };
        lines.push(head.to_owned());
        rest = rest.get(head.len()..).unwrap_or_default().trim_start();
    }
    lines.push(fit_chars(rest, width));
    lines
}

/// Cuts to `width` columns, at a word where there is one.
fn fit_chars(text: &str, width: u16) -> String {
    let width = usize::from(width);
    if text.chars().count() <= width { text.to_owned() } else { fit(text, width) }
}
