//! The frame of every report: one file that needs nothing else, light and dark, for screens of any width and for paper.

/// uPlot 1.6.32 (MIT), as the live page has it; its licence goes along.
const UPLOT: &str = include_str!("../sinks/web/assets/uplot.js");
const UPLOT_CSS: &str = include_str!("../sinks/web/assets/uplot.css");
const UPLOT_LICENCE: &str = include_str!("../sinks/web/assets/uplot-LICENSE.txt");
const SCRIPT: &str = include_str!("assets/report.js");
const STYLE: &str = include_str!("assets/report.css");

/// Text that cannot become markup.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A sentence begins with a capital letter.
pub fn capitalised(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

/// A page with this title and body. The scripts are there only where there is a plot.
pub fn page(title: &str, body: &str) -> String {
    let plots = body.contains("<figure class=\"chart\"");
    frame(title, "", body, plots.then_some(SCRIPT))
}

/// A page whose plots have a script and a style of their own.
pub fn page_with(title: &str, style: &str, body: &str, script: &str) -> String {
    frame(title, style, body, Some(script))
}

fn frame(title: &str, own_style: &str, body: &str, script: Option<&str>) -> String {
    let style = if script.is_some() { UPLOT_CSS } else { "" };
    let scripts = script.map_or_else(String::new, |script| {
        format!(
            "<script>/*\n{}*/\n{UPLOT}</script><script>{script}</script>",
            UPLOT_LICENCE.replace("*/", "* /")
        )
    });
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width,initial-scale=1\"><title>gaware: {title}</title><style>{style}{STYLE}{own_style}</style></head>\
         <body>{body}{scripts}</body></html>\n"
    )
}

/// A table that scrolls by itself where it is wider than the screen.
pub fn wide(table: &str) -> String {
    format!("<div class=\"wide\" tabindex=\"0\">{table}</div>")
}

/// A table in [`wide`]: titles (one that begins with `#` is over numbers) and rows of markup. Nothing without rows.
pub fn table<const N: usize>(titles: [&str; N], rows: impl IntoIterator<Item = [String; N]>) -> String {
    let class = titles.map(|t| if t.starts_with('#') { " class=\"n\"" } else { "" });
    let row = |tag: &str, cells: [String; N]| {
        let cells = class.iter().zip(cells).map(|(class, cell)| format!("<{tag}{class}>{cell}</{tag}>"));
        format!("<tr>{}</tr>", cells.collect::<String>())
    };
    let rows: String = rows.into_iter().map(|cells| row("td", cells)).collect();
    if rows.is_empty() {
        return rows;
    }
    let head = row("th", titles.map(|t| t.trim_start_matches('#').to_owned()));
    wide(&format!("<table>{head}{rows}</table>"))
}

/// A value and its sigma stay on one line.
fn together(text: &str) -> String {
    text.replace(" ± ", "\u{a0}±\u{a0}")
}

/// The answers of a report: question, answer (markup), one line each.
pub fn answers(rows: &[(&str, String)]) -> String {
    let rows = rows.iter().filter(|(_, answer)| !answer.is_empty());
    let rows: String =
        rows.map(|(question, answer)| format!("<dt>{question}</dt><dd>{}</dd>", together(answer))).collect();
    format!("<dl class=\"answers\">{rows}</dl>")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_without_plots_has_no_script_and_one_with_plots_needs_no_other_file() {
        assert!(!page("t", "<p>words</p>").contains("<script"));
        let page = page("t", "<figure class=\"chart\"></figure>");
        assert!(page.contains("uPlot") && page.contains("Permission is hereby granted"));
        assert!(!page.contains("src=") && !page.contains("<link"));
    }
}
