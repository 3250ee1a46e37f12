//! The mark by which a file is recognised as this program's own and unchanged: a word and the SHA-256 of the whole file, in which the digest
//! itself counts as zeros. It stands where the format has room for a comment or a field that readers ignore:
//!
//! | format | where |
//! |---|---|
//! | HTML, XML, Markdown | a comment at the end |
//! | TOML, parameter files | a comment line at the end |
//! | JSON, `.plan` | the last field, `written_by` |
//! | manual pages | a comment line at the end |
//! | Parquet | the last key of the file's metadata |
//! | MCAP | the metadata record `gaware` |
//!
//! A mark in the file itself is copied with it and needs neither a second file nor attributes of the file system, and an edit is seen. CSV,
//! `.waypoints` and `.tlog` have no room: such a file is never overwritten without `--force`.

use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Stands before the digest.
pub const WORD: &str = "gaware-sha256:";
/// Hexadecimal digits of a digest.
const DIGITS: usize = 64;
/// How far from the end a mark can stand: behind the one of a table follows the list of the columns, behind that of an MCAP file its summary.
const TAIL: u64 = 1 << 20;

/// The mark with a digest that is still to be put in.
pub fn blank() -> String {
    format!("{WORD}{}", "0".repeat(DIGITS))
}

/// How a text holds a comment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// `# …`
    Hash,
    /// `<!-- … -->`
    Angle,
    /// `.\" …`
    Roff,
}

/// A text with a mark at its end.
pub fn text(mut text: String, style: Style) -> String {
    if !text.ends_with('\n') {
        text.push('\n');
    }
    let blank = blank();
    text.push_str(&match style {
        Style::Hash => format!("# {blank}\n"),
        Style::Angle => format!("<!-- {blank} -->\n"),
        Style::Roff => format!(".\\\" {blank}\n"),
    });
    text
}

/// A JSON object with a mark as its last field.
pub fn json(text: &str) -> String {
    let Some((fields, end)) = text.trim_end().rsplit_once('}') else { return text.to_owned() };
    let separator = if fields.trim_end().ends_with('{') { "" } else { "," };
    format!("{}{separator}\n  \"written_by\": \"{}\"\n}}{end}\n", fields.trim_end(), blank())
}

/// Puts the digest into the last mark, where there is one. `key`: what else the digest is of.
pub fn sealed(mut content: Vec<u8>, key: &[u8]) -> Vec<u8> {
    if let Some(at) = last_mark(&content) {
        let digest = hex(&Sha256::new().chain_update(key).chain_update(&content).finalize());
        if let Some(place) = content.get_mut(at..at + DIGITS).filter(|p| p.iter().all(|b| *b == b'0')) {
            place.copy_from_slice(digest.as_bytes());
        }
    }
    content
}

/// Whether a file has a mark, and is as it was written.
pub fn is_own(path: &Path) -> bool {
    File::open(path).and_then(|file| is_sealed(file, b"")).unwrap_or(false)
}

/// The same of a content.
///
/// # Errors
/// What the system says.
pub fn is_sealed(mut content: impl Read + Seek, key: &[u8]) -> io::Result<bool> {
    let length = content.seek(SeekFrom::End(0))?;
    let from = content.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
    let mut tail = Vec::new();
    content.by_ref().take(TAIL).read_to_end(&mut tail)?;
    let Some(at) = last_mark(&tail) else { return Ok(false) };
    let Some(written) = tail.get(at..at + DIGITS) else { return Ok(false) };
    content.seek(SeekFrom::Start(0))?;
    let mut content = BufReader::new(content);
    let mut hash = Sha256::new().chain_update(key);
    // Into the hash goes what stands before the digest, zeros, and what follows.
    copy(&mut content, from + at as u64, &mut hash)?;
    content.read_exact(&mut [0; DIGITS])?;
    hash.update([b'0'; DIGITS]);
    copy(&mut content, u64::MAX, &mut hash)?;
    Ok(hex(&hash.finalize()).as_bytes() == written)
}

fn copy(from: &mut impl Read, bytes: u64, to: &mut Sha256) -> io::Result<()> {
    let mut from = from.take(bytes);
    let mut block = vec![0; 1 << 16];
    loop {
        match from.read(&mut block)? {
            0 => return Ok(()),
            n => to.update(block.get(..n).unwrap_or_default()),
        }
    }
}

/// Where the digest of the last mark begins.
fn last_mark(content: &[u8]) -> Option<usize> {
    let windows = content.windows(WORD.len());
    let at = windows.rev().position(|w| w == WORD.as_bytes())?;
    let digest = content.len() - at;
    (digest + DIGITS <= content.len()).then_some(digest)
}

/// Bytes in hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}
