//! The panels of the terminal screen.

use super::draw::View;
use crate::engine::situation::{LOSS, Level, SILENT_S, SituationKind, no_data};
use crate::engine::snapshot::{Condition, Phase, StateStatus, Status};
use crate::sinks::events::{Severity, phase_words};
use crate::sinks::status::{LinkState, MissionState, RecorderState};
use crate::sinks::words::{brief, bytes, clock, fit};
use gaware_nav::math::ln;
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
        LinkState::Up if s.imu.loss >= LOSS => view.ink(Color::Red).add_modifier(Modifier::BOLD),
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
        LinkState::Up if s.imu.loss >= LOSS => format!("link loses {:.0} %", s.imu.loss * 100.0),
        LinkState::Up => format!("link up {:.0}/s", link.rate_hz),
        other => format!("link {}", other.word()),
    };
    let gap = || Span::raw("  ");
    let line = Line::from(vec![
        Span::styled(" gaware ", BOLD.add_modifier(Modifier::REVERSED)),
        gap(),
        state(view),
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

/// The phase of the estimator, or what is wrong.
fn state(view: &View) -> Span<'static> {
    let (s, alarm) = (view.snapshot, view.ink(Color::Red).add_modifier(Modifier::BOLD));
    match s.situation.level {
        Level::Lost => Span::styled(s.situation.headline.clone(), alarm),
        _ => Span::styled(phase_words(s.phase), BOLD),
    }
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

/// What stands in the largest box.
struct Now {
    heading: String,
    alarm: bool,
    words: String,
    below: String,
    /// Share done and its words.
    progress: Option<(f64, String)>,
}

/// What the pilot has to know now: the situation as the engine decides it; a dead link is known here first.
fn now(view: &View) -> Now {
    let (s, vehicle) = (view.snapshot, &view.sinks.vehicle);
    let dead = matches!(view.sinks.link.state, LinkState::Silent | LinkState::Down)
        && (s.imu.samples > 0 || s.phase == Phase::Running);
    let old = no_data(SILENT_S);
    let situation = if dead { &old } else { &s.situation };
    let now = Now {
        heading: situation.headline.to_uppercase(),
        alarm: situation.level == Level::Lost,
        words: situation.text.clone(),
        below: if dead { "Everything below is old.".to_owned() } else { situation.detail.clone() },
        progress: None,
    };
    match situation.kind {
        SituationKind::Maneuver => Now { progress: Some(percent(s.guidance.progress)), ..now },
        SituationKind::Monitoring if !s.guidance.last_result.is_empty() => {
            Now { below: s.guidance.last_result.clone(), ..now }
        }
        _ if situation.level == Level::Auto && !vehicle.now.is_empty() => {
            let number = match vehicle.maneuvers {
                0 => String::new(),
                n => format!("{} of {n}: ", vehicle.maneuver),
            };
            let next =
                if vehicle.next.is_empty() { String::new() } else { format!("next: {}", vehicle.next) };
            let below = [vehicle.counts(), next].into_iter().filter(|t| !t.is_empty()).collect::<Vec<_>>();
            let progress = vehicle.progress().map(percent);
            Now { words: format!("{number}{}", vehicle.now), below: below.join("; "), progress, ..now }
        }
        _ => now,
    }
}

fn percent(share: f64) -> (f64, String) {
    (share, format!("{:3.0} %", share.clamp(0.0, 1.0) * 100.0))
}

/// What is said now in its box, with what belongs to it and progress.
pub(super) fn instruction(frame: &mut Frame, view: &View, area: Rect) {
    let now = now(view);
    let alarm = if now.alarm { Color::Red } else { Color::Yellow };
    let block = view.block(&now.heading).border_style(view.ink(alarm)).style(BOLD);
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let bar = u16::from(now.progress.is_some());
    // Words that are long have more right to the space than what explains them.
    let needed = wrapped(&view.text(&now.words), inner.width.saturating_sub(4), usize::MAX).len();
    let room = usize::from(inner.height.saturating_sub(bar)).saturating_sub(needed).min(2);
    let below = wrapped(&view.text(&now.below), inner.width, room.max(1));
    let below = if inner.height > 3 && room > 0 { below } else { Vec::new() };
    let lines = u16::try_from(below.len()).unwrap_or(0);
    let [top, reason, progress] =
        Layout::vertical([Constraint::Min(1), Constraint::Length(lines), Constraint::Length(bar)])
            .areas(inner);
    large(frame, view, &now.words, top);
    let below: Vec<Line> = below.into_iter().map(Line::raw).collect();
    frame.render_widget(Paragraph::new(below).style(Style::new().remove_modifier(Modifier::BOLD)), reason);
    if let Some((share, words)) = now.progress {
        let width = usize::from(progress.width.saturating_sub(6));
        let bar = format!("{} {words}", view.bar(width, share));
        frame.render_widget(Paragraph::new(bar).style(view.ink(Color::Green)), progress);
    }
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
    let now = now(view);
    let text = Text::from(vec![Line::raw(now.heading.clone()), Line::styled(view.text(&now.words), BOLD)]);
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

/// Conditions in their box; what is missing stands among the messages.
pub(super) fn conditions(frame: &mut Frame, view: &View, area: Rect) {
    let block = view.block("Observability conditions");
    let inner = block.inner(area);
    frame.render_widget(block, area);
    conditions_short(frame, view, inner);
}

/// Conditions, a line each.
pub(super) fn conditions_short(frame: &mut Frame, view: &View, area: Rect) {
    let lines: Vec<Line> = rows(view).into_iter().map(|row| condition_line(view, row, area.width)).collect();
    frame.render_widget(Paragraph::new(lines), area);
}

/// G in its box.
pub(super) fn g(frame: &mut Frame, view: &View, area: Rect, bars: bool) {
    let block = view.block("G, deg/h/g, sigma against target");
    let inner = block.inner(area);
    frame.render_widget(block, area);
    g_rows(frame, view, inner, bars);
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
            // Before the filter runs there is only the prior.
            let text = if view.snapshot.phase != Phase::Running || *sigma == 0.0 {
                "-".to_owned()
            } else {
                // Rounded and without the sign of a negative zero.
                format!("{:+.1} {plus_minus}{}", (value * 10.0).round() / 10.0 + 0.0, brief(*sigma))
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
    let turn = &view.snapshot.turn.text;
    if view.snapshot.phase == Phase::Running && !turn.is_empty() && lines.len() < usize::from(area.height) {
        lines.push(Line::raw(turn.as_str()));
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
        (ln(first / s.sigma) / ln(first / s.target)).clamp(0.0, 1.0)
    } else {
        f64::from(u8::from(s.status == Status::Observable))
    }
}

/// Rates, fixes and the link in one line.
pub(super) fn health(frame: &mut Frame, view: &View, area: Rect) {
    let (s, link) = (view.snapshot, &view.sinks.link);
    let name = if s.imu.message.is_empty() { "no inertial data" } else { &s.imu.message };
    let lost = if s.imu.dropped > 0 { format!(", {} lost", s.imu.dropped) } else { String::new() };
    let asked = match s.imu.asked_hz {
        hz if hz > 0.0 => format!(" of {hz:.0}"),
        _ => String::new(),
    };
    let text = format!(
        " {name} {:.1}{asked} Hz{lost}; fixes {:.1} Hz, {} used, {} rejected; link: {} lost",
        s.imu.rate_hz, s.gnss.rate_hz, s.gnss.used, s.gnss.rejected, link.lost
    );
    frame.render_widget(Paragraph::new(view.text(&text)), area);
}

/// What has become of the planned mission, or of the parameters.
fn change_message(
    view: &View,
    what: &str,
    state: MissionState,
    text: &str,
) -> Option<(String, String, Style)> {
    let (mark, style) = match state {
        MissionState::None => return None,
        MissionState::Unknown => ("!", view.ink(Color::Red).add_modifier(Modifier::BOLD)),
        MissionState::NotOnVehicle => ("!", view.ink(Color::Yellow).add_modifier(Modifier::BOLD)),
        MissionState::OnVehicle => ("=", view.ink(Color::Green)),
        MissionState::Ready | MissionState::Uploading => (">", BOLD),
    };
    Some((format!("{mark} "), format!("{what}: {text}"), style))
}

/// Everything that is to be said, the most urgent first: the mission, warnings of now, what the observability conditions and
/// the states lack, the link, then events, newest first. Whole sentences; what does not fit scrolls.
pub(super) fn messages(frame: &mut Frame, view: &View, area: Rect) {
    let s = view.snapshot;
    let plain = |text: String| ("- ".to_owned(), text, Style::new());
    let (mission, parameters) = (&view.sinks.mission, &view.sinks.parameters);
    let mission = change_message(view, "mission", mission.state, &mission.text);
    let parameters = change_message(view, "parameters", parameters.state, &parameters.text);
    let mut all: Vec<(String, String, Style)> = mission.into_iter().chain(parameters).collect();
    let warning = view.ink(Color::Yellow).add_modifier(Modifier::BOLD);
    all.extend(s.warnings.iter().rev().map(|w| ("! ".to_owned(), w.clone(), warning)));
    if s.phase == Phase::Running {
        all.extend(s.observability.unobservable_directions.iter().map(|d| plain(d.text.clone())));
        let open = rows(view).into_iter().filter(|(_, _, c)| !c.met && !c.missing.is_empty());
        all.extend(open.map(|(letter, about, c)| plain(format!("{letter} {about}: {}", c.missing))));
    }
    if !view.sinks.link.detail.is_empty() {
        all.push(plain(format!("link {}: {}", view.sinks.link.state.word(), view.sinks.link.detail)));
    }
    all.extend(view.events.iter().rev().map(|e| {
        let style = match e.severity {
            Severity::Warning => view.ink(Color::Yellow),
            Severity::Notice => BOLD,
            Severity::Info => Style::new(),
        };
        (format!("{} ", clock(e.elapsed_s)), e.text.clone(), style)
    }));
    let width = area.width.saturating_sub(2);
    let lines: Vec<Line> = all
        .iter()
        .flat_map(|(mark, text, style)| {
            let indent = mark.chars().count();
            let room = width.saturating_sub(u16::try_from(indent).unwrap_or(0)).max(1);
            let text = wrapped(&view.text(text), room, usize::MAX);
            text.into_iter().enumerate().map(move |(k, line)| {
                let before = if k == 0 { mark.clone() } else { " ".repeat(indent) };
                Line::styled(format!("{before}{line}"), *style)
            })
        })
        .collect();
    let shown = usize::from(area.height.saturating_sub(2));
    let hidden = lines.len().saturating_sub(shown);
    let first = usize::from(view.scroll).min(hidden);
    let title = match (first, hidden - first) {
        (0, 0) => "Messages".to_owned(),
        (before, after) => format!("Messages ({before} lines above, {after} below: Up, Down)"),
    };
    let lines: Vec<Line> = lines.into_iter().skip(first).take(shown).collect();
    frame.render_widget(Paragraph::new(lines).block(view.block(&title)), area);
}

/// Every state with its bar.
pub(super) fn states(frame: &mut Frame, view: &View, area: Rect) {
    let lines: Vec<Line> = view
        .snapshot
        .observability
        .states
        .iter()
        .map(|s| {
            let bar = view.bar(8, way_to_target(s));
            let figures = format!("{:>6} /{:>5} {}", brief(s.sigma), brief(s.target), s.unit);
            Line::from(vec![
                Span::styled(format!("{:<8}", s.name), BOLD),
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
    let paragraph =
        Paragraph::new(lines).wrap(Wrap { trim: true }).block(view.block(if view.snapshot.guidance.done {
            "Not observable in this flight"
        } else {
            "Not observable yet"
        }));
    frame.render_widget(paragraph, area);
}

/// The last line.
pub(super) fn keys(frame: &mut Frame, view: &View, area: Rect) {
    let dropped = view.sinks.dropped();
    let mut spans = vec![Span::raw(" q quit  ? help  Up, Down scroll")];
    if view.sinks.mission.state.can_be_asked_for() {
        spans.push(Span::raw("  u upload the mission"));
    }
    if view.sinks.parameters.state.can_be_asked_for() {
        spans.push(Span::raw("  p set parameters"));
    }
    if dropped > 0 {
        let text = format!("   {dropped} messages skipped by slow sinks");
        spans.push(Span::styled(text, view.ink(Color::Yellow)));
    }
    frame.render_widget(Paragraph::new(Line::from(spans)), area);
}

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
