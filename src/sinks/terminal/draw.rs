//! One frame of the terminal screen, from 20×5 upwards. Pure.

use super::Options;
use super::parts;
use crate::engine::snapshot::{Snapshot, Status};
use crate::figures::counted;
use crate::sinks::Change;
use crate::sinks::events::Event;
use crate::sinks::status::StatusView;
use crate::sinks::words;
use ratatui::Frame;
use ratatui::layout::{Alignment, Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::border;
use ratatui::text::Line;
use ratatui::widgets::{Block, Clear, Paragraph, Wrap};

/// Everything a frame shows.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// The engine's last word.
    pub snapshot: &'a Snapshot,
    /// Link, recorder and counters.
    pub sinks: &'a StatusView,
    /// Events so far, newest last.
    pub events: &'a [Event],
    /// How it looks.
    pub options: Options,
    /// What lies over it.
    pub over: Over,
    /// First line of the messages that is shown.
    pub scroll: u16,
}

/// What lies over the screen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Over {
    /// Nothing.
    #[default]
    Nothing,
    /// The help.
    Help,
    /// Whether this is really to be changed on the vehicle.
    Question(Change),
}

/// Borders for consoles without UTF-8.
const ASCII_BORDER: border::Set = border::Set {
    top_left: "+",
    top_right: "+",
    bottom_left: "+",
    bottom_right: "+",
    vertical_left: "|",
    vertical_right: "|",
    horizontal_top: "-",
    horizontal_bottom: "-",
};

impl View<'_> {
    /// A colour where colours are allowed.
    pub(super) fn ink(&self, color: Color) -> Style {
        if self.options.color { Style::new().fg(color) } else { Style::new() }
    }

    /// The look of a status.
    pub(super) fn of(&self, status: Status) -> Style {
        match status {
            Status::Observable => self.ink(Color::Green),
            Status::Converging => self.ink(Color::Cyan),
            Status::Weak => self.ink(Color::Yellow),
            Status::Unobservable => self.ink(Color::DarkGray),
        }
    }

    /// A text this console can show.
    pub(super) fn text(&self, text: &str) -> String {
        if self.options.ascii { words::ascii(text) } else { text.to_owned() }
    }

    /// A bar of `width` cells, `fraction` of them full.
    pub(super) fn bar(&self, width: usize, fraction: f64) -> String {
        let (full, empty) = if self.options.ascii { ("#", ".") } else { ("█", "░") };
        let cells = (fraction.clamp(0.0, 1.0) * width as f64).floor() as usize;
        full.repeat(cells.min(width)) + &empty.repeat(width - cells.min(width))
    }

    /// A titled box.
    pub(super) fn block(&self, title: &str) -> Block<'static> {
        let set = if self.options.ascii { ASCII_BORDER } else { border::ROUNDED };
        let title =
            Line::styled(format!(" {} ", self.text(title)), Style::new().add_modifier(Modifier::BOLD));
        Block::bordered().border_set(set).border_style(self.ink(Color::DarkGray)).title(title)
    }
}

/// Draws the frame.
pub fn draw(frame: &mut Frame, view: &View) {
    let area = frame.area();
    match (area.width, area.height) {
        (w, h) if w < 44 || h < 12 => tiny(frame, view, area),
        (w, h) if w < 78 || h < 22 => small(frame, view, area),
        (w, h) if w >= 116 && h >= 30 => large(frame, view, area),
        _ => normal(frame, view, area),
    }
    match view.over {
        Over::Nothing => {}
        Over::Help => help(frame, view, area),
        Over::Question(change) => question(frame, view, area, change),
    }
}

/// The instruction and one line of state.
fn tiny(frame: &mut Frame, view: &View, area: Rect) {
    let [bar, fly] = Layout::vertical([Constraint::Length(1), Constraint::Min(0)]).areas(area);
    parts::title(frame, view, bar);
    parts::instruction_words(frame, view, fly);
}

/// Instruction, conditions and G without boxes around.
fn small(frame: &mut Frame, view: &View, area: Rect) {
    let [bar, fly, conditions, g] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Min(5),
        Constraint::Length(3),
        Constraint::Length(if area.height >= 16 { 4 } else { 0 }),
    ])
    .areas(area);
    parts::title(frame, view, bar);
    parts::instruction(frame, view, fly);
    parts::conditions_short(frame, view, conditions);
    parts::g_rows(frame, view, g, false);
}

/// From this height on G has bars.
const TALL: u16 = 34;

/// 80×24: instruction, conditions, G, then messages in whole sentences over the full width, which scroll.
fn normal(frame: &mut Frame, view: &View, area: Rect) {
    let tall = area.height >= TALL;
    let [bar, fly, middle, messages, health, keys] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(7),
        Constraint::Length(if tall { 9 } else { 6 }),
        Constraint::Min(4),
        Constraint::Length(1),
        Constraint::Length(1),
    ])
    .areas(area);
    parts::title(frame, view, bar);
    parts::instruction(frame, view, fly);
    let [conditions, g] = Layout::horizontal([Constraint::Fill(4), Constraint::Fill(5)]).areas(middle);
    parts::conditions(frame, view, conditions);
    parts::g(frame, view, g, tall);
    parts::messages(frame, view, messages);
    parts::health(frame, view, health);
    parts::keys(frame, view, keys);
}

/// From this width on the column beside has space for sentences.
const WIDE: u16 = 160;

/// With the states and the weak directions beside it.
fn large(frame: &mut Frame, view: &View, area: Rect) {
    let beside = if area.width >= WIDE { 66 } else { 40 };
    let [left, right] = Layout::horizontal([Constraint::Min(80), Constraint::Length(beside)]).areas(area);
    normal(frame, view, left);
    let rows = u16::try_from(view.snapshot.observability.states.len()).unwrap_or(u16::MAX).saturating_add(2);
    let [states, weak] = Layout::vertical([Constraint::Max(rows.max(3)), Constraint::Min(6)]).areas(right);
    parts::states(frame, view, states);
    parts::weak(frame, view, weak);
}

fn help(frame: &mut Frame, view: &View, area: Rect) {
    let lines = [
        "q, Ctrl-C   end gaware",
        "?, h        this help",
        "u, p        upload the planned mission, set parameters",
        "Up, Down    scroll the messages",
        "",
        "Bars run from the first sigma to the target,",
        "on a logarithmic scale.",
        "Conditions are sufficient, not necessary:",
        "(a) attitude and biases  (b) diagonal of G",
        "(c) all of G. G in deg/h/g: row = gyro axis,",
        "column = axis of specific force.",
        "NIS: 1 is right; above 2 the filter is",
        "too sure of itself.",
    ];
    let text: Vec<Line> = lines.into_iter().map(|l| Line::raw(format!(" {l}"))).collect();
    let text = Paragraph::new(text).alignment(Alignment::Left).block(view.block("Help"));
    lay_over(frame, text, area, [50, 15]);
}

/// The answer is a key of its own: whoever types ahead changes nothing.
fn question(frame: &mut Frame, view: &View, area: Rect, change: Change) {
    if change == Change::Parameters {
        return parameters_question(frame, view, area);
    }
    let mission = &view.sinks.mission;
    let text = vec![
        Line::raw(view.text(&format!("{}, {}, replaces", mission.name, counted(mission.items, "item")))),
        Line::raw("the mission in the vehicle. Not while a"),
        Line::raw("mission is being flown."),
        Line::raw(""),
        Line::styled(
            "y  upload      n, Esc  keep the present one",
            Style::new().add_modifier(Modifier::BOLD),
        ),
    ];
    let block = view.block("Upload the planned mission?").border_style(view.ink(Color::Yellow));
    let text = Paragraph::new(text).wrap(Wrap { trim: true }).block(block);
    lay_over(frame, text, area, [50, 8]);
}

/// New values that are named in the question; more are counted.
const NAMED_VALUES: usize = 6;

fn parameters_question(frame: &mut Frame, view: &View, area: Rect) {
    let parameters = &view.sinks.parameters;
    let more = parameters.values.len().saturating_sub(NAMED_VALUES);
    let mut text = vec![Line::raw(view.text(&format!("{} sets", parameters.name)))];
    text.extend(parameters.values.iter().take(NAMED_VALUES).map(|v| Line::raw(view.text(&format!("  {v}")))));
    if more > 0 {
        text.push(Line::raw(format!("  and {more} more")));
    }
    text.push(Line::raw("Old values are kept in a file."));
    text.push(Line::raw(""));
    let keys = "y  set      n, Esc  keep the present ones";
    text.push(Line::styled(keys, Style::new().add_modifier(Modifier::BOLD)));
    let rows = u16::try_from(text.len()).unwrap_or(u16::MAX).saturating_add(3);
    let block = view.block("Set the vehicle's parameters?").border_style(view.ink(Color::Yellow));
    let text = Paragraph::new(text).wrap(Wrap { trim: false }).block(block);
    lay_over(frame, text, area, [50, rows]);
}

fn lay_over(frame: &mut Frame, text: Paragraph, area: Rect, [width, height]: [u16; 2]) {
    let (width, height) = (width.min(area.width), height.min(area.height));
    let over =
        Rect { x: area.x + (area.width - width) / 2, y: area.y + (area.height - height) / 2, width, height };
    frame.render_widget(Clear, over);
    frame.render_widget(text, over);
}
