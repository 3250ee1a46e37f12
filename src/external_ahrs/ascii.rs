//! Commands and answers in text: `$VNWRG,75,3,16,01,0721*D4`, with an exclusive or over what stands between `$` and `*`, or a CRC of four
//! digits, or `XX` for neither.

/// Longest command; what is longer is none.
const LONGEST: usize = 255;

/// Why a command is not carried out; the numbers are the protocol's own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// The checksum is not that of the content.
    Checksum = 3,
    /// No such command.
    Command = 4,
    /// Something is missing.
    TooFew = 5,
    /// A value that cannot be.
    Parameter = 7,
    /// No such register.
    Register = 8,
    /// A register that cannot be written.
    ReadOnly = 9,
}

/// The content between `$` and `*` with its frame.
pub fn framed(content: &str) -> Vec<u8> {
    format!("${content}*{:02X}\r\n", checksum(content.as_bytes())).into_bytes()
}

/// The answer to what is refused.
pub fn refused(why: Refusal) -> Vec<u8> {
    framed(&format!("VNERR,{:02}", why as u8))
}

fn checksum(content: &[u8]) -> u8 {
    content.iter().fold(0, |sum, byte| sum ^ byte)
}

/// CRC-16-CCITT from 0, as text and binary messages have it.
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0_u16, |crc, byte| {
        let mut crc = crc ^ (u16::from(*byte) << 8);
        for _ in 0..8 {
            crc = if crc & 0x8000 == 0 { crc << 1 } else { (crc << 1) ^ 0x1021 };
        }
        crc
    })
}

/// Finds commands in a stream of bytes.
#[derive(Debug, Default)]
pub struct Lines {
    line: Option<Vec<u8>>,
}

impl Lines {
    /// Takes a byte; a whole command, checked, or why it is none.
    pub fn push(&mut self, byte: u8) -> Option<Result<String, Refusal>> {
        match (byte, &mut self.line) {
            (b'$', _) => self.line = Some(Vec::new()),
            (b'\r' | b'\n', Some(_)) => return self.line.take().map(|line| check(&line)),
            (_, Some(line)) if line.len() < LONGEST && byte.is_ascii() => line.push(byte),
            // Noise, or what no command can be.
            _ => self.line = None,
        }
        None
    }
}

fn check(line: &[u8]) -> Result<String, Refusal> {
    let text = std::str::from_utf8(line).map_err(|_| Refusal::Checksum)?;
    let (content, sum) = text.split_once('*').ok_or(Refusal::Checksum)?;
    let right = match sum.len() {
        2 if sum == "XX" => true,
        2 => u8::from_str_radix(sum, 16) == Ok(checksum(content.as_bytes())),
        4 => u16::from_str_radix(sum, 16) == Ok(crc16(content.as_bytes())),
        _ => false,
    };
    if right { Ok(content.to_owned()) } else { Err(Refusal::Checksum) }
}
