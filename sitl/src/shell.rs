//! The thin shell around the [simulated autopilot](crate::autopilot): UDP, TCP, a pseudo-terminal, or channels inside
//! the process; wall clock and link faults live only here.

mod link;

use crate::autopilot::Autopilot;
use crate::faults::{FaultyLink, LinkFaults};
use gaware_wire::framer::Framer;
use link::Link;
use std::io::Write;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Where the autopilot listens or talks to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Endpoint {
    /// Sends datagrams to this address and receives what comes back.
    UdpOut(String),
    /// Waits for datagrams at this address and answers the last sender.
    UdpIn(String),
    /// Waits for a TCP connection at this address, one at a time.
    TcpIn(String),
    /// Connects to this address.
    TcpOut(String),
    /// Opens a pseudo-terminal.
    Pty,
}

impl FromStr for Endpoint {
    type Err = ShellError;

    fn from_str(text: &str) -> Result<Self, ShellError> {
        let wrong = || ShellError::Address(text.into());
        if text == "pty" {
            return Ok(Self::Pty);
        }
        let (kind, address) = text.split_once(':').ok_or_else(wrong)?;
        let port = address.rsplit_once(':').ok_or_else(wrong)?.1;
        port.parse::<u16>().map_err(|_| wrong())?;
        match kind {
            "udpout" => Ok(Self::UdpOut(address.into())),
            "udpin" => Ok(Self::UdpIn(address.into())),
            "tcpin" => Ok(Self::TcpIn(address.into())),
            "tcpout" => Ok(Self::TcpOut(address.into())),
            _ => Err(wrong()),
        }
    }
}

/// How fast virtual time runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Speed {
    /// This many virtual seconds per second.
    Times(f64),
    /// As fast as the station takes the frames; needs a wire that can hold the sender back.
    Max,
}

impl FromStr for Speed {
    type Err = ShellError;

    fn from_str(text: &str) -> Result<Self, ShellError> {
        if text == "max" {
            return Ok(Self::Max);
        }
        match text.parse::<f64>() {
            Ok(factor) if factor.is_finite() && factor > 0.0 => Ok(Self::Times(factor)),
            _ => Err(ShellError::Speed(text.into())),
        }
    }
}

/// Why the shell gave up.
#[derive(Debug, thiserror::Error)]
pub enum ShellError {
    /// Not an address.
    #[error(
        "\"{0}\" is an invalid address; write udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT or pty"
    )]
    Address(String),
    /// Not a speed.
    #[error("\"{0}\" is no speed; write a positive number or max")]
    Speed(String),
    /// UDP cannot hold the sender back.
    #[error("UDP loses frames at --speed max; use tcpin:, tcpout: or pty, or give a number")]
    UdpAtFullSpeed,
    /// The address cannot be used.
    #[error("cannot open {address}: {source}")]
    Open {
        /// As written.
        address: String,
        /// Why.
        source: std::io::Error,
    },
    /// The recording cannot be written.
    #[error("cannot write the recording {path}: {source}")]
    Record {
        /// Where.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// How to serve.
#[derive(Debug, Clone)]
pub struct Options {
    /// Speed of virtual time.
    pub speed: Speed,
    /// What the link does to frames, both ways.
    pub link_faults: LinkFaults,
    /// Seed of the link's faults.
    pub seed: u64,
    /// Writes every frame sent and received to this `.tlog`.
    pub record: Option<PathBuf>,
    /// Virtual seconds per second at full speed while the station has to act (ask for messages, upload, arm): it
    /// counts its timeouts by the wall clock.
    pub idle_factor: f64,
    /// Ends after this much virtual time, s, also for a vehicle that could go on.
    pub until_s: f64,
    /// Ends when a vehicle that flies missions has landed.
    pub until_landed: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            speed: Speed::Times(1.0),
            link_faults: LinkFaults::default(),
            seed: 1,
            record: None,
            idle_factor: 1.0,
            until_s: f64::INFINITY,
            until_landed: false,
        }
    }
}

impl Options {
    fn is_over(&self, autopilot: &Autopilot) -> bool {
        autopilot.is_over()
            || autopilot.now_s() >= self.until_s
            || (self.until_landed && autopilot.has_landed())
    }
}

/// What happened while serving.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Served {
    /// Virtual time at the end, s.
    pub virtual_s: f64,
    /// Frames handed to the wire.
    pub frames: u64,
    /// Bytes received.
    pub received_bytes: u64,
}

/// The station's end of a link inside the process: whole frames one way, bytes the other.
#[derive(Debug)]
pub struct EmbeddedEnd {
    /// Frames of the autopilot.
    pub frames: mpsc::Receiver<Vec<u8>>,
    /// Bytes for the autopilot.
    pub to_vehicle: mpsc::Sender<Vec<u8>>,
}

/// Frames that wait between the two ends of an embedded link before the sender is held back.
const EMBEDDED_FRAMES: usize = 256;
/// Wall time between two looks at the clock.
const TICK: Duration = Duration::from_millis(5);
/// Virtual time per turn at full speed, s: short enough that requests are answered soon.
const TURN_S: f64 = 0.02;
/// A virtual clock that fell behind by more than this, s, does not hurry after.
const PATIENCE_S: f64 = 0.5;
/// Time for the station to read what is still in the buffers when the flight is over.
const LINGER: Duration = Duration::from_millis(500);
/// Unix time at which virtual time starts in recordings, µs: fixed, so that recordings are reproducible.
const RECORD_EPOCH_US: u64 = 1_750_000_000_000_000;

/// An open endpoint with an address that stations can use.
#[derive(Debug)]
pub struct Server {
    link: Link,
    address: String,
}

impl Server {
    /// Opens the endpoint.
    ///
    /// # Errors
    /// When the address cannot be used.
    pub async fn bind(endpoint: &Endpoint) -> Result<Self, ShellError> {
        let (link, address) = Link::open(endpoint)
            .await
            .map_err(|source| ShellError::Open { address: link::spelled(endpoint), source })?;
        Ok(Self { link, address })
    }

    /// A link inside the process.
    pub fn embedded() -> (Self, EmbeddedEnd) {
        let (frames_in, frames) = mpsc::channel(EMBEDDED_FRAMES);
        let (to_vehicle, bytes) = mpsc::channel(EMBEDDED_FRAMES);
        let link = Link::Channel { tx: frames_in, rx: bytes };
        (Self { link, address: "embedded".into() }, EmbeddedEnd { frames, to_vehicle })
    }

    /// What a station connects to: `serial:/dev/pts/3:921600`, `tcpout:127.0.0.1:5760`, …
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Runs the autopilot until its flight is over or `shutdown` is called.
    ///
    /// # Errors
    /// When the recording cannot be written, or UDP is asked for full speed. A station that goes away is no error.
    pub async fn run(
        mut self,
        mut autopilot: Autopilot,
        options: Options,
        shutdown: CancellationToken,
    ) -> Result<Served, ShellError> {
        if options.speed == Speed::Max && self.link.is_udp() {
            return Err(ShellError::UdpAtFullSpeed);
        }
        let mut recorder = Recorder::create(options.record.clone())?;
        let mut down = FaultyLink::new(options.link_faults.clone(), options.seed, 0);
        let mut up = FaultyLink::new(options.link_faults.clone(), options.seed, 1);
        let mut served = Served::default();
        let mut clock = VirtualClock::new();
        while !options.is_over(&autopilot) && !shutdown.is_cancelled() {
            for bytes in self.link.received() {
                served.received_bytes += bytes.len() as u64;
                up.push(autopilot.now_s(), bytes);
            }
            for bytes in up.pop(autopilot.now_s()) {
                recorder.write_received((autopilot.now_s() * 1e6) as u64, &bytes)?;
                autopilot.receive(&bytes);
            }
            let racing = options.speed == Speed::Max && self.link.is_connected() && !autopilot.is_idle();
            let target = match options.speed {
                Speed::Max if racing => autopilot.now_s() + TURN_S,
                Speed::Max => clock.advance(options.idle_factor, autopilot.now_s()),
                Speed::Times(factor) => clock.advance(factor, autopilot.now_s()),
            };
            autopilot.step(target);
            for frame in autopilot.take_output() {
                recorder.write(frame.t_us, &frame.bytes)?;
                down.push(frame.t_us as f64 * 1e-6, frame.bytes);
            }
            let sending = async {
                for frame in down.pop(autopilot.now_s()) {
                    self.link.send(&frame).await;
                    served.frames += 1;
                }
            };
            tokio::select! {
                () = sending => {}
                () = shutdown.cancelled() => break,
            }
            if racing {
                tokio::task::yield_now().await;
            } else {
                tokio::select! {
                    () = tokio::time::sleep(TICK) => {}
                    () = shutdown.cancelled() => {}
                }
            }
        }
        recorder.finish()?;
        tokio::select! {
            () = self.link.close(LINGER) => {}
            () = shutdown.cancelled() => {}
        }
        served.virtual_s = autopilot.now_s();
        Ok(served)
    }
}

/// Virtual time that follows the wall clock.
struct VirtualClock {
    last: tokio::time::Instant,
    target_s: f64,
}

impl VirtualClock {
    fn new() -> Self {
        Self { last: tokio::time::Instant::now(), target_s: 0.0 }
    }

    /// The virtual time to go to.
    fn advance(&mut self, factor: f64, now_s: f64) -> f64 {
        let wall_s = self.last.elapsed().as_secs_f64();
        self.last = tokio::time::Instant::now();
        self.advance_by(wall_s, factor, now_s)
    }

    /// The loop steps whole periods; what it leaves over counts for the next time.
    fn advance_by(&mut self, wall_s: f64, factor: f64, now_s: f64) -> f64 {
        self.target_s = self.target_s.max(now_s) + (wall_s * factor).min(PATIENCE_S * factor.max(1.0));
        self.target_s
    }
}

/// The `.tlog` being written, and the bytes from the station that are no whole frame yet.
struct Recorder {
    file: Option<(PathBuf, std::io::BufWriter<std::fs::File>)>,
    heard: Framer,
}

impl Recorder {
    fn create(path: Option<PathBuf>) -> Result<Self, ShellError> {
        let open = |path: PathBuf| match std::fs::File::create(&path) {
            Ok(file) => Ok((path, std::io::BufWriter::new(file))),
            Err(source) => Err(ShellError::Record { path, source }),
        };
        Ok(Self { file: path.map(open).transpose()?, heard: Framer::new() })
    }

    /// What one read from a stream gives is any part of any number of frames; each frame is a record of its own.
    fn write_received(&mut self, t_us: u64, bytes: &[u8]) -> Result<(), ShellError> {
        self.heard.push(bytes);
        while let Some(frame) = self.heard.next_frame() {
            self.write(t_us, frame.raw())?;
        }
        Ok(())
    }

    fn write(&mut self, t_us: u64, frame: &[u8]) -> Result<(), ShellError> {
        let Some((path, file)) = &mut self.file else { return Ok(()) };
        let stamp = (RECORD_EPOCH_US + t_us).to_be_bytes();
        file.write_all(&stamp)
            .and_then(|()| file.write_all(frame))
            .map_err(|source| ShellError::Record { path: path.clone(), source })
    }

    fn finish(&mut self) -> Result<(), ShellError> {
        let Some((path, file)) = &mut self.file else { return Ok(()) };
        file.flush().map_err(|source| ShellError::Record { path: path.clone(), source })
    }
}

#[cfg(test)]
mod tests;
