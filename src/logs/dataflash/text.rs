//! The same log as text (`.log`, as ground stations and older firmware wrote it): every line becomes the message that it was made of.
//!
//! Lines are `NAME, value, …`; their formats are `FMT` lines. Hundredths and degrees are written as such, a mode by its name. A line that does not fit its
//! format becomes a message that no reader can use, so that it is counted.

use super::health::mode_name;
use super::notes::class_of_firmware;
use super::{FMT, FMT_LEN, Format, HEADER, MAGIC};
use crate::logs::VehicleClass;
use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader, Read};

/// The first line that describes a format is among so many first bytes: a name of the firmware and some of the board come before.
pub const HEAD: usize = 4096;
/// The line that describes the descriptions themselves, without spaces.
const FIRST: &str = "FMT,128,89,FMT,";
/// Longer lines are none.
const LONGEST_LINE: u64 = 1024;
/// Flight modes have numbers below this.
const MODES: u32 = 64;

/// Whether a file begins like this.
pub fn is_one(head: &[u8]) -> bool {
    let compact: Vec<u8> = head.iter().copied().filter(|b| *b != b' ').collect();
    compact.split(|b| *b == b'\n').any(|line| line.starts_with(FIRST.as_bytes()))
}

/// Reads the binary log that a text was made of.
#[derive(Debug)]
pub struct Transcoder<R> {
    lines: BufReader<R>,
    formats: BTreeMap<String, (u8, Format)>,
    out: Vec<u8>,
    /// How much of `out` has been read.
    given: usize,
    /// What flies by the name of the firmware.
    class: Option<VehicleClass>,
    /// What stands before the first format.
    banner: Option<String>,
}

impl<R: Read> Transcoder<R> {
    /// Around a text.
    pub fn new(source: R) -> Self {
        Self {
            lines: BufReader::new(source),
            formats: BTreeMap::new(),
            out: Vec::new(),
            given: 0,
            class: None,
            banner: None,
        }
    }

    /// Takes the next line; false at the end.
    fn step(&mut self) -> io::Result<bool> {
        let mut line = Vec::new();
        if self.lines.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut line)? == 0 {
            return Ok(false);
        }
        let line = String::from_utf8_lossy(&line).trim().to_owned();
        if self.formats.is_empty() && !line.starts_with("FMT") {
            self.banner = self.banner.take().or(Some(line).filter(|l| l.contains('V')));
            return Ok(true);
        }
        if !line.is_empty() && self.message(&line).is_none() {
            // A description that describes nothing.
            self.out.extend(MAGIC);
            self.out.push(FMT);
            self.out.extend([0; FMT_LEN - HEADER]);
        }
        Ok(true)
    }

    fn message(&mut self, line: &str) -> Option<()> {
        let (name, rest) = line.split_once(',').unwrap_or((line, ""));
        if name == "FMT" {
            return self.describe(rest);
        }
        if name == "MSG" {
            self.class = class_of_firmware(rest.trim()).or(self.class);
        }
        let (kind, format) = self.formats.get(name)?;
        let mut values = rest.splitn(format.fields.len().max(1), ',').map(str::trim);
        let mut bytes = vec![MAGIC[0], MAGIC[1], *kind];
        for (_, kind, _) in &format.fields {
            self.field(*kind, values.next()?, &mut bytes)?;
        }
        self.out.extend(bytes);
        Some(())
    }

    /// Takes a description: type, length, name, types, labels.
    fn describe(&mut self, rest: &str) -> Option<()> {
        let mut parts = rest.splitn(5, ',').map(str::trim);
        let [kind, len] = [parts.next()?, parts.next()?].map(|v| v.parse::<u8>());
        let (name, types, labels) = (parts.next()?, parts.next()?, parts.next()?);
        let (kind, len) = (kind.ok()?, len.ok()?);
        if kind == FMT {
            // Known, and written with a label too few.
            return Some(());
        }
        let mut body = vec![kind, len];
        for (text, size) in [(name, 4), (types, 16), (labels, 64)] {
            padded(text, size, &mut body);
        }
        let (described, format) = Format::parse(&body)?;
        self.formats.insert(format.name.clone(), (described, format));
        self.out.extend(MAGIC);
        self.out.push(FMT);
        self.out.extend(body);
        if name == "MSG"
            && let Some(banner) = self.banner.take()
        {
            self.message(&format!("MSG, {banner}"))?;
        }
        Some(())
    }

    /// One value as the format has it.
    fn field(&self, kind: u8, value: &str, out: &mut Vec<u8>) -> Option<()> {
        let number = || value.parse::<f64>().ok();
        match kind {
            b'n' => padded(value, 4, out),
            b'N' => padded(value, 16, out),
            b'Z' => padded(value, 64, out),
            b'a' => out.extend([0; 64]),
            b'f' => out.extend((number()? as f32).to_le_bytes()),
            b'd' => out.extend(number()?.to_le_bytes()),
            b'Q' => out.extend(value.parse().unwrap_or(number()? as u64).to_le_bytes()),
            b'q' => out.extend(value.parse().unwrap_or(number()? as i64).to_le_bytes()),
            b'b' => out.push((number()? as i8) as u8),
            b'B' => out.push(number()? as u8),
            b'M' => out.push(number().map(|n| n as u8).or_else(|| self.mode(value))?),
            b'h' => out.extend((number()? as i16).to_le_bytes()),
            b'H' => out.extend((number()? as u16).to_le_bytes()),
            b'c' => out.extend(((100.0 * number()?).round() as i16).to_le_bytes()),
            b'C' => out.extend(((100.0 * number()?).round() as u16).to_le_bytes()),
            b'i' => out.extend((number()? as i32).to_le_bytes()),
            b'I' => out.extend((number()? as u32).to_le_bytes()),
            b'e' => out.extend(((100.0 * number()?).round() as i32).to_le_bytes()),
            b'E' => out.extend(((100.0 * number()?).round() as u32).to_le_bytes()),
            b'L' => {
                // Degrees, but where somebody wrote the integer.
                let scale = if value.contains('.') { 1e7 } else { 1.0 };
                out.extend(((scale * number()?).round() as i32).to_le_bytes());
            }
            _ => return None,
        }
        Some(())
    }

    /// The number of a mode: its name is written with or without spaces.
    fn mode(&self, name: &str) -> Option<u8> {
        let plain = |name: &str| name.to_ascii_uppercase().replace([' ', '_'], "");
        let class = self.class.or(Some(VehicleClass::Multirotor));
        let is = |k: &u32| plain(&mode_name(class, *k)) == plain(name);
        (0..MODES).find(is).and_then(|k| u8::try_from(k).ok())
    }
}

/// A text in so many bytes.
fn padded(text: &str, size: usize, out: &mut Vec<u8>) {
    out.extend(text.bytes().chain(std::iter::repeat(0)).take(size));
}

impl<R: Read> Read for Transcoder<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.given == self.out.len() {
            self.out.clear();
            self.given = 0;
            if !self.step()? {
                return Ok(0);
            }
        }
        let left = self.out.get(self.given..).unwrap_or_default();
        let n = left.len().min(buffer.len());
        if let (Some(to), Some(from)) = (buffer.get_mut(..n), left.get(..n)) {
            to.copy_from_slice(from);
        }
        self.given += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::logs::dataflash::DataflashReader;
    use crate::logs::{HealthNote, Item, LogNote, LogReader};
    use crate::timeline::Measurement;

    const LOG: &str = "\n\nArduCopter V3.1\n\nFMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format\n\
        FMT, 129, 23, PARM, Nf, Name,Value\nFMT, 132, 67, MSG, Z, Message\n\
        FMT, 130, 45, GPS, BIHBcLLeeEefI, Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T\n\
        FMT, 131, 31, IMU, Iffffff, TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\n\
        FMT, 1, 19, ATT, IccccCC, TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw\nFMT, 3, 6, MODE, Mh, Mode,ThrCrs\n\
        PARM, BATT_LOW_VOLT, 10.5\nMSG, hello, pilot\nMODE, Alt Hold, 424\n\
        ATT, 95891, 0.00, -0.25, 0.00, 0.26, 189.54, 189.54\n\
        IMU, 95892, 0.00033, 3.118068E-05, 0.00018, 0.04847138, 0.4273195, -9.78664\n\
        IMU, 95910, not a number, 0, 0, 0, 0, 0\n\
        GPS, 3, 56674000, 1777, 12, 1.32, 14.1105766, -100.6191906, -0.06, -2.50, 2.48, 287.33, -1.2, 95901\n\
        IMU, 95930, -0.00016, -6.0E-05, -0.0009, 0.046, 0.4273452, -9.776276\n";

    #[test]
    fn a_text_is_read_as_the_log_that_it_was_made_of() {
        assert!(is_one(LOG.as_bytes()) && !is_one(b"FMT is a format\n"));
        let mut reader = DataflashReader::new(Transcoder::new(LOG.as_bytes()), LOG.len() as u64);
        let items: Vec<Item> = reader.by_ref().map(|record| record.unwrap().item).collect();
        assert_eq!((reader.damage().bad_records, reader.damage().skipped_bytes), (1, 0));
        let samples: Vec<_> = items
            .iter()
            .filter_map(|item| match item {
                Item::Measurement(Measurement::Imu(stamp, sample)) => Some((stamp.raw_us(), sample.accel.z)),
                _ => None,
            })
            .collect();
        assert_eq!(samples.iter().map(|s| s.0).collect::<Vec<_>>(), [95_892_000, 95_930_000]);
        assert!((samples[0].1 + 9.78664).abs() < 1e-6);
        let fix = items.iter().find_map(|item| match item {
            Item::Measurement(Measurement::Fix(_, fix)) => Some(*fix),
            _ => None,
        });
        let position = fix.unwrap().position;
        assert!((position.lat_rad.to_degrees() - 14.110_576_6).abs() < 1e-9);
        assert!((position.lon_rad.to_degrees() + 100.619_190_6).abs() < 1e-9);
        assert!((position.height_m + 2.5).abs() < 1e-9, "{position:?}");
        let notes = |wanted: &LogNote| items.iter().any(|item| matches!(item, Item::Note(n) if n == wanted));
        assert!(notes(&LogNote::Parameter { name: "BATT_LOW_VOLT".to_owned(), value: 10.5 }));
        assert!(notes(&LogNote::Health(HealthNote::Mode("ALT_HOLD".to_owned()))), "{items:?}");
        assert!(notes(&LogNote::Version(3, 1)), "{items:?}");
        let text = |text: &str| {
            items
                .iter()
                .any(|item| matches!(item, Item::Note(LogNote::Health(HealthNote::Text(_, t))) if t == text))
        };
        assert!(text("hello, pilot") && text("ArduCopter V3.1"), "{items:?}");
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_to_its_end(lines in proptest::collection::vec("(FMT|IMU|GPS|MODE|MSG), [ -~]{0,60}", 0..20)) {
            let text = format!("FMT, 3, 6, MODE, Mh, Mode,ThrCrs\n{}", lines.join("\n"));
            let mut all = Vec::new();
            Transcoder::new(text.as_bytes()).read_to_end(&mut all).unwrap();
            proptest::prop_assert!(all.len() >= FMT_LEN);
        }
    }
}
