//! Draws the terminal screen of the scripted flight as SVG on standard output, for the documentation:
//! `cargo run --example terminal_picture > docs/terminal.svg`.

#[path = "web_fixture/script.rs"]
#[expect(dead_code, reason = "the map is the page's alone")]
mod script;

use gaware::sinks::events::EventDetector;
use gaware::sinks::status::{LinkState, LinkView, RecorderState, RecorderView, SinkStatus};
use gaware::sinks::terminal::Options;
use gaware::sinks::terminal::draw::{Over, View, draw};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::{Buffer, Cell};
use ratatui::style::{Color, Modifier};
use std::convert::Infallible;

/// Width and height of a cell, pixels.
const CELL: (f64, f64) = (8.4, 18.0);
/// Seconds into the script.
const MOMENT_S: f64 = 58.0;

fn main() -> Result<(), Infallible> {
    let status = SinkStatus::new();
    status.set_link(LinkView {
        state: LinkState::Up,
        detail: "udpin:0.0.0.0:14550".into(),
        rate_hz: 168.0,
        ..LinkView::default()
    });
    status.set_recorder(RecorderView {
        state: RecorderState::Recording,
        detail: "flight-007.mcap".into(),
        bytes: 1_800_000,
        ..RecorderView::default()
    });
    let mut detector = EventDetector::default();
    let steps = (MOMENT_S / script::STEP_S) as u32;
    let events: Vec<_> =
        (0..=steps).flat_map(|i| detector.feed(&script::snapshot(f64::from(i) * script::STEP_S))).collect();
    let (snapshot, sinks) = (script::snapshot(MOMENT_S), status.view());
    let view = View {
        snapshot: &snapshot,
        sinks: &sinks,
        events: &events,
        options: Options::default(),
        over: Over::Nothing,
        scroll: 0,
    };
    let mut terminal = Terminal::new(TestBackend::new(120, 30))?;
    terminal.draw(|frame| draw(frame, &view))?;
    print!("{}", svg(terminal.backend().buffer()));
    Ok(())
}

fn svg(buffer: &Buffer) -> String {
    let (columns, rows) = (f64::from(buffer.area.width), f64::from(buffer.area.height));
    let (width, height) = (columns * CELL.0 + 24.0, rows * CELL.1 + 24.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans Mono, Menlo, \
         Consolas, monospace\" font-size=\"14\">\n<rect width=\"{width}\" height=\"{height}\" rx=\"10\" fill=\"#0b1418\"/>\n"
    );
    for (row, cells) in buffer.content().chunks(usize::from(buffer.area.width)).enumerate() {
        let mut column = 0;
        while let Some(first) = cells.get(column) {
            let same = cells.iter().skip(column).take_while(|c| look(c) == look(first)).count().max(1);
            let text: String = cells.iter().skip(column).take(same).map(Cell::symbol).collect();
            out += &run(&text, column, row, first);
            column += same;
        }
    }
    out + "</svg>\n"
}

fn look(cell: &Cell) -> (Color, Modifier) {
    (cell.fg, cell.modifier)
}

fn run(text: &str, column: usize, row: usize, cell: &Cell) -> String {
    if text.trim().is_empty() && !cell.modifier.contains(Modifier::REVERSED) {
        return String::new();
    }
    let (x, y) = (12.0 + column as f64 * CELL.0, 12.0 + row as f64 * CELL.1);
    let width = text.chars().count() as f64 * CELL.0;
    let mut fill = match cell.fg {
        Color::Green => "#4cd6a5",
        Color::Cyan => "#82b1ff",
        Color::Yellow => "#ffc05c",
        Color::Red => "#ff8b85",
        Color::DarkGray => "#6b7f87",
        _ => "#e8f0f2",
    };
    let mut back = String::new();
    if cell.modifier.contains(Modifier::REVERSED) {
        back = format!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{}\" fill=\"{fill}\"/>\n",
            CELL.1
        );
        fill = "#0b1418";
    }
    let weight = if cell.modifier.contains(Modifier::BOLD) { " font-weight=\"700\"" } else { "" };
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace(' ', "\u{a0}");
    let base = y + 13.5;
    format!(
        "{back}<text x=\"{x:.1}\" y=\"{base:.1}\" textLength=\"{width:.1}\" fill=\"{fill}\"{weight}>{text}</text>\n"
    )
}
