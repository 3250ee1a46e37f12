//! Words and figures as every sink writes them.

/// The same text in printable ASCII: ground stations and serial consoles show that for certain and little else.
pub fn ascii(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '°' => out.push_str(" deg"),
            '±' => out.push_str("+/-"),
            '–' | '—' | '−' => out.push('-'),
            '→' => out.push_str("->"),
            '≤' => out.push_str("<="),
            '≥' => out.push_str(">="),
            'σ' => out.push_str("sigma"),
            '²' => out.push('2'),
            '’' | '‘' => out.push('\''),
            '…' => out.push_str("..."),
            c if c.is_ascii_graphic() => out.push(c),
            c if c.is_whitespace() => out.push(' '),
            _ => out.push('?'),
        }
    }
    out
}

/// Cuts an ASCII text to `max` bytes, at a word where there is one.
pub fn fit(text: &str, max: usize) -> String {
    if text.len() <= max {
        return text.to_owned();
    }
    let head: String = text.chars().take(max.saturating_sub(3)).collect();
    let cut = head.rfind(' ').filter(|at| *at > max / 2).unwrap_or(head.len());
    format!("{}...", head.get(..cut).unwrap_or(&head))
}

/// Hours, minutes and seconds of a duration in seconds: `1:05`, `1:00:05`.
pub fn clock(seconds: f64) -> String {
    let s = seconds.max(0.0) as u64;
    let (h, m, s) = (s / 3600, s / 60 % 60, s % 60);
    if h > 0 { format!("{h}:{m:02}:{s:02}") } else { format!("{m}:{s:02}") }
}

/// Bytes in the unit that keeps them short.
pub fn bytes(n: u64) -> String {
    match n {
        0..1_000 => format!("{n} B"),
        1_000..1_000_000 => format!("{:.1} kB", n as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", n as f64 / 1e6),
        _ => format!("{:.1} GB", n as f64 / 1e9),
    }
}

/// Three figures or so: enough to read, few enough to read quickly.
pub fn brief(x: f64) -> String {
    match x.abs() {
        a if !a.is_finite() => "-".to_owned(),
        a if a >= 100.0 => format!("{x:.0}"),
        a if a >= 10.0 => format!("{x:.1}"),
        a if a >= 0.1 || a == 0.0 => format!("{x:.2}"),
        a if a >= 0.01 => format!("{x:.3}"),
        _ => format!("{x:.4}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_cut_at_a_word_and_say_so() {
        assert_eq!(fit("Steep turn right", 16), "Steep turn right");
        assert_eq!(fit("Steep turn right, one circle", 20), "Steep turn right,...");
        assert_eq!(ascii("55° ± 2σ – naïve"), "55 deg +/- 2sigma - na?ve");
    }

    #[test]
    fn figures_are_short() {
        assert_eq!(clock(65.9), "1:05");
        assert_eq!(clock(3605.0), "1:00:05");
        assert_eq!(clock(f64::NAN), "0:00");
        assert_eq!(bytes(1_234_567), "1.2 MB");
        // The sigma of a latency is no zero.
        assert_eq!([brief(0.0), brief(0.0712), brief(0.00069)], ["0.00", "0.071", "0.0007"]);
        assert_eq!([brief(123.4), brief(12.34), brief(1.234), brief(f64::NAN)], ["123", "12.3", "1.23", "-"]);
    }
}
