//! Mutations of inputs: of any bytes, of texts, and of scripts of frames.

use crate::random::Random;
use crate::script::{self, Kind, Step};

/// How inputs of a target are built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Any bytes.
    Bytes,
    /// Text in lines, with numbers and words.
    Text,
    /// A script of frames (see [`script`]).
    Script,
}

/// Longest input, bytes.
pub const LONGEST: usize = 256 * 1024;
/// Mutations of one input at most.
const STACK: usize = 8;

/// Integers at which lengths, counters and conversions turn.
const INTEGERS: [u64; 16] = [
    0,
    1,
    0x7F,
    0x80,
    0xFF,
    0x100,
    0x7FFF,
    0x8000,
    0xFFFF,
    0x1_0000,
    0x7FFF_FFFF,
    0x8000_0000,
    0xFFFF_FFFF,
    0x7FFF_FFFF_FFFF_FFFF,
    0x8000_0000_0000_0000,
    u64::MAX,
];
/// Floating-point numbers at which arithmetic turns.
const FLOATS: [f64; 12] =
    [0.0, -0.0, 1.0, -1.0, 1e-9, 1e9, 1e38, -3.5e38, 1e308, f64::INFINITY, f64::NAN, f64::MIN_POSITIVE];
/// Numbers as texts have them.
const NUMBERS: [&str; 20] = [
    "0",
    "-0.0",
    "1",
    "-1",
    "0.5",
    "3",
    "255",
    "65536",
    "1e-9",
    "1e-300",
    "1e9",
    "1e38",
    "-1e38",
    "1e308",
    "-1e308",
    "180",
    "-90.0000001",
    "4294967296",
    "-9223372036854775808",
    "18446744073709551615",
];
/// Words and signs as texts have them.
const WORDS: [&str; 18] = [
    "nan",
    "inf",
    "-inf",
    "null",
    "true",
    "1e400",
    "\"\"",
    "[]",
    "{}",
    "[[",
    "\u{1b}[2J",
    "\0",
    ":",
    "0x10",
    "é",
    "\t",
    "--",
    "99999999999999999999999999",
];

/// A mutated copy of `base`; `other` is what pieces are taken from.
pub fn mutate(shape: Shape, base: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    // Many changes at once mostly make an input that is refused at its first line.
    let times = if random.once_in(2) { 1 } else { 1 + random.below(STACK) };
    let mut out = match shape {
        // A script is damaged as bytes only now and then: mostly its frames stay frames.
        Shape::Script if !random.once_in(10) => {
            let mut steps = script::read(base);
            let others = script::read(other);
            (0..times).for_each(|_| step(&mut steps, &others, random));
            script::write(&steps)
        }
        Shape::Text => {
            let mut out = base.to_vec();
            for _ in 0..times {
                if random.once_in(6) { bytes(&mut out, other, random) } else { text(&mut out, random) }
            }
            out
        }
        _ => {
            let mut out = base.to_vec();
            (0..times).for_each(|_| bytes(&mut out, other, random));
            out
        }
    };
    out.truncate(LONGEST);
    out
}

/// A piece of `list`: where it begins and ends.
fn piece(len: usize, longest: usize, random: &mut Random) -> (usize, usize) {
    let start = random.below(len);
    let end = start + random.below((len - start).min(longest)) + 1;
    (start, end.min(len))
}

/// An interesting value as bytes of either order.
fn value(random: &mut Random) -> Vec<u8> {
    let size = [1, 2, 4, 8][random.below(4)];
    let mut raw = match random.below(4) {
        0 => (FLOATS[random.below(FLOATS.len())] as f32).to_le_bytes().to_vec(),
        1 => FLOATS[random.below(FLOATS.len())].to_le_bytes().to_vec(),
        2 => INTEGERS[random.below(INTEGERS.len())].to_le_bytes()[..size].to_vec(),
        _ => random.bits().to_le_bytes()[..size].to_vec(),
    };
    if random.once_in(4) {
        raw.reverse();
    }
    raw
}

fn bytes(out: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    if out.is_empty() {
        out.extend((0..1 + random.below(64)).map(|_| random.byte()));
        return;
    }
    let at = random.below(out.len());
    match random.below(9) {
        0 => out[at] ^= 1 << random.below(8),
        1 => out[at] = random.byte(),
        2 | 3 => {
            for (place, v) in out[at..].iter_mut().zip(value(random)) {
                *place = v;
            }
        }
        4 => {
            let inserted = value(random);
            out.splice(at..at, inserted);
        }
        5 => {
            let (start, end) = piece(out.len(), 256, random);
            out.drain(start..end);
        }
        6 => {
            let (start, end) = piece(out.len(), 1024, random);
            let copy = out[start..end].to_vec();
            out.splice(at..at, copy);
        }
        7 if !other.is_empty() => {
            let (start, end) = piece(other.len(), 4096, random);
            let keep = if random.once_in(2) { at } else { (at + end - start).min(out.len()) };
            out.splice(at..keep, other[start..end].iter().copied());
        }
        _ => out.truncate(at),
    }
}

/// The first piece from `at` on that looks like a number, or like a word.
fn token(text: &[u8], at: usize, number: bool) -> Option<(usize, usize)> {
    let begins = |b: &u8| if number { b.is_ascii_digit() || *b == b'-' } else { b.is_ascii_alphanumeric() };
    let inside = |b: &u8| b.is_ascii_alphanumeric() || b"+-._".contains(b);
    let start = at + text.get(at..)?.iter().position(begins)?;
    let len = text.get(start..)?.iter().position(|b| !inside(b)).unwrap_or(text.len() - start);
    Some((start, start + len.max(1)))
}

fn text(out: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(out.len());
    let word = WORDS[random.below(WORDS.len())];
    match random.below(8) {
        0..=3 => {
            if let Some((start, end)) = token(out, at, true) {
                let old = String::from_utf8_lossy(&out[start..end]).into_owned();
                out.splice(start..end, number(&old, random).into_bytes());
            }
        }
        4 => {
            if let Some((start, end)) = token(out, at, false) {
                out.splice(start..end, word.bytes());
            }
        }
        5 => _ = out.splice(at..at, word.bytes()),
        _ => lines(out, random),
    }
}

/// Another number, often one near the old one.
fn number(old: &str, random: &mut Random) -> String {
    const FACTORS: [f64; 8] = [-1.0, 0.0, 1e-3, 0.5, 2.0, 10.0, 1e3, 1e6];
    match old.parse::<f64>() {
        Ok(old) if random.once_in(2) => {
            let new = old * FACTORS[random.below(FACTORS.len())];
            // An integer stays one.
            if new.fract() == 0.0 { format!("{new:.0}") } else { format!("{new}") }
        }
        _ => NUMBERS[random.below(NUMBERS.len())].to_owned(),
    }
}

/// Repeats, removes or exchanges lines.
fn lines(out: &mut Vec<u8>, random: &mut Random) {
    let mut all: Vec<Vec<u8>> = out.split_inclusive(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
    if all.is_empty() {
        return;
    }
    let (a, b) = (random.below(all.len()), random.below(all.len()));
    match random.below(3) {
        0 => all.insert(a, all[b].clone()),
        1 => _ = all.remove(a),
        _ => all.swap(a, b),
    }
    *out = all.concat();
}

fn step(steps: &mut Vec<Step>, others: &[Step], random: &mut Random) {
    const KINDS: [Kind; 7] =
        [Kind::Frame, Kind::Deliver, Kind::Lose, Kind::Repeat, Kind::Delay, Kind::Cancel, Kind::Again];
    const WAITS: [u16; 8] = [0, 1, 20, 250, 1500, 5000, 30_000, u16::MAX];
    if steps.is_empty() {
        steps.extend_from_slice(others);
        return;
    }
    let at = random.below(steps.len());
    match random.below(10) {
        0..=3 => {
            let payload = &mut steps[at].payload;
            let before = payload.len();
            bytes(payload, &[], random);
            // Mostly fields change and stay where they are.
            if !random.once_in(4) {
                payload.resize(before, 0);
            }
            payload.truncate(255);
        }
        4 => steps[at].wait_ms = WAITS[random.below(WAITS.len())],
        5 => steps[at].kind = KINDS[random.below(KINDS.len())].byte(),
        6 => {
            let step = &mut steps[at];
            match random.below(3) {
                0 => step.from.0 = random.byte(),
                1 => step.from.1 = random.byte(),
                _ => step.message_id = random.below(512) as u32,
            }
        }
        7 => {
            let (start, end) = piece(steps.len(), 32, random);
            steps.drain(start..end);
        }
        8 => {
            let (start, end) = piece(steps.len(), 32, random);
            let copy = steps[start..end].to_vec();
            steps.splice(at..at, copy);
        }
        _ if !others.is_empty() => {
            let (start, end) = piece(others.len(), 32, random);
            steps.splice(at..at, others[start..end].iter().cloned());
        }
        _ => {
            let other = random.below(steps.len());
            steps.swap(at, other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_input_and_inputs_stay_within_bounds() {
        let base = script::write(&[Step::of(Kind::Deliver, 5), Step::of(Kind::Frame, 6)]);
        for shape in [Shape::Bytes, Shape::Text, Shape::Script] {
            for number in 0..2000 {
                let make = || mutate(shape, &base, b"a = 1\nb = 2\n", &mut Random::of_input(1, "x", number));
                let input = make();
                assert_eq!(input, make());
                assert!(input.len() <= LONGEST);
            }
        }
    }
}
