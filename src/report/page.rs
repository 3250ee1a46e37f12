//! The frame of every report: one file, light and dark, printable.

const STYLE: &str = "
:root{color-scheme:light dark;--ink:#1d2329;--paper:#fff;--soft:#f2f4f6;--line:#d5dbe1;--accent:#2a82be}
@media(prefers-color-scheme:dark){:root{--ink:#e3e8ed;--paper:#14181c;--soft:#1e242a;--line:#37414b;--accent:#6db6ea}}
body{font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:900px;margin:2rem auto;padding:0 1rem}
h1{font-size:1.5rem;margin:0 0 .3rem;overflow-wrap:anywhere}h2{font-size:1.15rem;margin:2rem 0 .5rem;border-bottom:1px solid var(--line)}
.verdict{background:var(--soft);border-left:5px solid var(--accent);padding:.8rem 1rem;border-radius:4px}
table{border-collapse:collapse;width:100%;font-size:.92rem;margin:.9rem 0}.t{white-space:nowrap}td,th{padding:.3rem .6rem;border-bottom:1px solid var(--line);text-align:left}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}.plot{width:100%;height:auto;color:var(--ink)}
@media(max-width:600px){.plot{width:auto;max-width:none;height:190px}.wide{overflow-x:auto}}
pre{background:var(--soft);padding:.8rem;overflow:auto;font-size:.85rem}small{opacity:.75}
@media print{body{max-width:none;margin:0}h2{break-after:avoid}table,svg{break-inside:avoid}}
";

/// Text that cannot become markup.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A page with this title and body.
pub fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width\"><title>gaware: {title}</title><style>{STYLE}</style></head><body>{body}</body></html>\n"
    )
}
