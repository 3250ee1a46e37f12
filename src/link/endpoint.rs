//! Endpoints: one supervised task per address, which reconnects for ever, and nothing that decides what a frame means.
//!
//! Frames go to the reader of [`Links`] over a bounded channel that is waited for, so that nothing on the way to the
//! engine is dropped by us. Frames to the vehicle are dropped and counted when a link is too slow for them.

mod outgoing;

use super::address::Address;
use super::frame::Frame;
use super::framer::{Framer, FramerStats};
pub use super::status::LinkStatus;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpStream, UdpSocket};
use tokio::sync::{mpsc, watch};
use tokio_serial::SerialPortBuilderExt;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(3);
const CONNECT_PATIENCE: Duration = Duration::from_secs(5);
/// A UDP peer that was silent for longer gets no more answers.
const PEER_LIFETIME: Duration = Duration::from_secs(10);
const MAX_PEERS: usize = 16;
/// No system has this id: every peer that sends MAVLink is answered.
const ANYBODY: u8 = 0;
const FRAMES_AHEAD: usize = 4096;
const REPLIES_AHEAD: usize = 256;

/// Unix time that never goes back: read once, then carried on by the monotonic clock.
#[derive(Debug, Clone, Copy)]
pub struct ReceiveClock {
    unix_us: u64,
    since: Instant,
}

impl ReceiveClock {
    /// Starts now.
    pub fn start() -> Self {
        let unix = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        Self { unix_us: unix.as_micros() as u64, since: Instant::now() }
    }

    /// Unix time, µs.
    pub fn now_us(&self) -> u64 {
        self.unix_us + self.since.elapsed().as_micros() as u64
    }

    /// Time since the start, ns: for protocols that want a monotonic clock.
    pub fn monotonic_ns(&self) -> i64 {
        self.since.elapsed().as_nanos() as i64
    }
}

/// Where a frame came from, and where an answer to it has to go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Origin {
    /// Index of the link in the order of the addresses.
    pub link: u16,
    /// The sender, where several can share the link (UDP).
    pub peer: Option<SocketAddr>,
}

/// "127.0.0.1:40312 on link 1".
impl std::fmt::Display for Origin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(peer) = self.peer {
            write!(f, "{peer} on ")?;
        }
        write!(f, "link {}", self.link + 1)
    }
}

/// A frame with the circumstances of its arrival.
#[derive(Debug, Clone, PartialEq)]
pub struct Received {
    /// Index of the link in the order of the addresses.
    pub link: u16,
    /// The sender, where several can share the link (UDP).
    pub peer: Option<SocketAddr>,
    /// When, Unix µs.
    pub t_us: u64,
    /// What.
    pub frame: Frame,
}

impl Received {
    /// Where it came from.
    pub fn origin(&self) -> Origin {
        Origin { link: self.link, peer: self.peer }
    }
}

/// A frame for the vehicle, and for one peer alone where one is named.
type Reply = (Frame, Option<SocketAddr>);

/// The sending side of a link.
#[derive(Debug, Clone)]
pub struct LinkHandle {
    replies: mpsc::Sender<Reply>,
    dropped: Arc<AtomicU64>,
    status: watch::Receiver<LinkStatus>,
}

impl LinkHandle {
    /// Hands a frame over without waiting; drops and counts it when the link cannot take it.
    pub fn send(&self, frame: Frame) {
        self.send_to(frame, None);
    }

    /// As [`Self::send`], to one of the peers that share the link.
    pub fn send_to(&self, frame: Frame, peer: Option<SocketAddr>) {
        if self.replies.try_send((frame, peer)).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Frames to the vehicle that were dropped.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// How the link is doing.
    pub fn status(&self) -> LinkStatus {
        LinkStatus { unsent: self.dropped(), ..self.status.borrow().clone() }
    }

    /// For waiting on changes.
    pub fn watch(&self) -> watch::Receiver<LinkStatus> {
        self.status.clone()
    }
}

/// All links of a run.
#[derive(Debug)]
pub struct Links {
    followed: Arc<AtomicU8>,
    frames: mpsc::Receiver<Received>,
    handles: Vec<LinkHandle>,
    tasks: TaskTracker,
    stop: CancellationToken,
}

impl Links {
    /// Starts a task per address. Must be called inside a tokio runtime.
    pub fn start(addresses: &[Address], clock: ReceiveClock, stop: &CancellationToken) -> Self {
        let (to_reader, frames) = mpsc::channel(FRAMES_AHEAD);
        let tasks = TaskTracker::new();
        let stop = stop.child_token();
        let followed = Arc::new(AtomicU8::new(ANYBODY));
        let mut handles = Vec::new();
        for (index, address) in addresses.iter().enumerate() {
            let (replies, from_us) = mpsc::channel(REPLIES_AHEAD);
            let (status, watched) = watch::channel(LinkStatus {
                address: address.clone(),
                up: false,
                problem: "not opened yet".to_owned(),
                openings: 0,
                received_bytes: 0,
                framer: FramerStats::default(),
                unsent: 0,
            });
            let dropped = Arc::new(AtomicU64::new(0));
            let link = Link {
                index: index as u16,
                address: address.clone(),
                frames: to_reader.clone(),
                replies: from_us,
                dropped: dropped.clone(),
                status,
                clock,
                followed: followed.clone(),
                past: FramerStats::default(),
                told_down: false,
            };
            let stop = stop.clone();
            tasks.spawn(async move {
                let _ = stop.run_until_cancelled_owned(link.supervise()).await;
            });
            handles.push(LinkHandle { replies, dropped, status: watched });
        }
        tasks.close();
        Self { followed, frames, handles, tasks, stop }
    }

    /// From now on only peers that speak for this system are answered over UDP.
    pub fn follow(&self, system_id: u8) {
        self.followed.store(system_id, Ordering::Relaxed);
    }

    /// The next frame of any link, in the order of arrival.
    pub async fn next(&mut self) -> Option<Received> {
        self.frames.recv().await
    }

    /// The sending sides, in the order of the addresses.
    pub fn handles(&self) -> &[LinkHandle] {
        &self.handles
    }

    /// Sends to the vehicle over every link.
    pub fn broadcast(&self, frame: &Frame) {
        for handle in &self.handles {
            handle.send(frame.clone());
        }
    }

    /// Stops all tasks and waits for their end.
    pub async fn stop(mut self) {
        self.stop.cancel();
        self.frames.close();
        self.tasks.wait().await;
    }
}

struct Link {
    index: u16,
    address: Address,
    frames: mpsc::Sender<Received>,
    replies: mpsc::Receiver<Reply>,
    dropped: Arc<AtomicU64>,
    status: watch::Sender<LinkStatus>,
    clock: ReceiveClock,
    /// The vehicle that is followed.
    followed: Arc<AtomicU8>,
    /// What the framers of earlier connections and peers counted.
    past: FramerStats,
    /// Whether it reported that the link is down, and nothing has come over it since.
    told_down: bool,
}

/// How a connection ends that the other side ends.
const CLOSED: &str = "the other side closed the connection";

impl Link {
    /// Opens the link again and again, waiting longer after each failure in a row.
    async fn supervise(mut self) {
        let mut pause = FIRST_PAUSE;
        loop {
            let before = self.status.borrow().received_bytes;
            let problem = match self.serve().await {
                Ok(()) => CLOSED.to_owned(),
                // What was not read when the other side closed makes a reset of it.
                Err(e) if e.kind() == io::ErrorKind::ConnectionReset => CLOSED.to_owned(),
                Err(e) => e.to_string(),
            };
            if self.frames.is_closed() {
                // No one reads any more: the end of the links, not of the link.
                return;
            }
            // Once: whoever waits for a vehicle to be switched on has read it.
            if !std::mem::replace(&mut self.told_down, true) {
                tracing::warn!(address = %self.address, %problem, "link is down; it is tried again every few seconds until it opens");
            }
            self.status.send_modify(|s| {
                s.up = false;
                s.problem = problem;
            });
            if self.status.borrow().received_bytes > before {
                pause = FIRST_PAUSE;
            }
            tokio::time::sleep(pause).await;
            pause = (2 * pause).min(LONGEST_PAUSE);
        }
    }

    async fn serve(&mut self) -> io::Result<()> {
        match self.address.clone() {
            Address::Serial { path, baud } => {
                let port = tokio_serial::new(&path, baud)
                    .open_native_async()
                    .map_err(|e| io::Error::other(serial_problem(&path, &e)))?;
                self.stream(port).await
            }
            Address::TcpOut(host) => {
                let connected = tokio::time::timeout(CONNECT_PATIENCE, TcpStream::connect(&host)).await;
                let stream = connected.map_err(|_| io::Error::from(io::ErrorKind::TimedOut)).flatten();
                let stream =
                    stream.map_err(|e| io::Error::new(e.kind(), format!("cannot connect to {host}: {e}")))?;
                stream.set_nodelay(true)?;
                self.stream(stream).await
            }
            Address::UdpIn(local) => {
                let socket = UdpSocket::bind(local).await;
                let socket =
                    socket.map_err(|e| io::Error::new(e.kind(), format!("cannot wait on {local}: {e}")))?;
                self.datagrams(socket, None).await
            }
            Address::UdpOut(host) => {
                let found = tokio::net::lookup_host(&host).await;
                let peer = found
                    .map_err(|e| io::Error::new(e.kind(), format!("cannot resolve {host}: {e}")))?
                    .next();
                let peer = peer.ok_or_else(|| io::Error::other(format!("{host} has no address")))?;
                self.datagrams(outgoing::socket_to(peer).await?, Some(peer)).await
            }
        }
    }

    fn opened(&mut self) {
        // Frames that waited while the link was down are stale.
        while self.replies.try_recv().is_ok() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        tracing::info!(address = %self.address, "link is open");
        self.status.send_modify(|s| {
            s.up = true;
            s.openings += 1;
            s.problem.clear();
        });
    }

    async fn stream<S: AsyncRead + AsyncWrite + Unpin>(&mut self, stream: S) -> io::Result<()> {
        self.opened();
        let (mut reader, mut writer) = tokio::io::split(stream);
        let mut framer = Framer::new();
        let mut bytes = vec![0; 16 * 1024];
        let result = loop {
            tokio::select! {
                read = reader.read(&mut bytes) => match read {
                    Ok(0) => break Ok(()),
                    Ok(n) => {
                        self.take(&mut framer, bytes.get(..n).unwrap_or_default(), None).await?;
                        let stats = add(self.past, framer.stats());
                        self.status.send_modify(|s| s.framer = stats);
                    }
                    Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                    Err(e) => break Err(e),
                },
                Some((frame, _)) = self.replies.recv() => {
                    let written = tokio::time::timeout(CONNECT_PATIENCE, writer.write_all(frame.raw())).await;
                    if let Err(e) = written.map_err(|_| io::Error::from(io::ErrorKind::TimedOut)).flatten() {
                        break Err(e);
                    }
                }
            }
        };
        self.past = add(self.past, framer.stats());
        result
    }

    /// Reads datagrams of any peer and answers the fixed one, or those received from lately.
    async fn datagrams(&mut self, socket: UdpSocket, fixed: Option<SocketAddr>) -> io::Result<()> {
        self.opened();
        let mut peers: BTreeMap<SocketAddr, Peer> = BTreeMap::new();
        let mut bytes = vec![0; 64 * 1024];
        loop {
            tokio::select! {
                read = socket.recv_from(&mut bytes) => match read {
                    Ok((n, from)) => {
                        if !peers.contains_key(&from) {
                            make_room(&mut peers);
                        }
                        let mut peer = peers.remove(&from).unwrap_or_else(Peer::new);
                        peer.heard = Instant::now();
                        let earlier = peer.framer.stats();
                        let systems = self.take(&mut peer.framer, bytes.get(..n).unwrap_or_default(), Some(from)).await?;
                        peer.systems.extend(systems);
                        // Several framers share one status: the sum is kept in `past`.
                        self.past = add(self.past, since(peer.framer.stats(), earlier));
                        self.status.send_modify(|s| s.framer = self.past);
                        if peers.len() < MAX_PEERS {
                            peers.insert(from, peer);
                        }
                    }
                    // No one listens there (yet); Windows calls that a reset (`recvfrom`, WSAECONNRESET of a datagram socket).
                    Err(e) if matches!(e.kind(), io::ErrorKind::ConnectionRefused | io::ErrorKind::ConnectionReset | io::ErrorKind::Interrupted) => {}
                    Err(e) => return Err(e),
                },
                Some((frame, only)) = self.replies.recv() => {
                    let vehicle = self.followed.load(Ordering::Relaxed);
                    let lately = peers.iter().filter(|(_, p)| p.heard.elapsed() < PEER_LIFETIME && p.speaks_for(vehicle));
                    let to: Vec<_> = match only.or(fixed) {
                        Some(address) => vec![address],
                        None => lately.map(|(a, _)| *a).collect(),
                    };
                    for address in to {
                        // A peer that has gone away does not concern the others.
                        let _ = socket.send_to(frame.raw(), address).await;
                    }
                }
            }
        }
    }

    /// Passes the frames of these bytes on; gives the systems that they are of.
    async fn take(
        &mut self,
        framer: &mut Framer,
        bytes: &[u8],
        peer: Option<SocketAddr>,
    ) -> io::Result<BTreeSet<u8>> {
        let t_us = self.clock.now_us();
        let mut systems = BTreeSet::new();
        framer.push(bytes);
        while let Some(frame) = framer.next_frame() {
            systems.insert(frame.system_id);
            let received = Received { link: self.index, peer, t_us, frame };
            if self.frames.send(received).await.is_err() {
                return Err(io::Error::from(io::ErrorKind::BrokenPipe));
            }
        }
        if std::mem::take(&mut self.told_down) {
            tracing::warn!(address = %self.address, "link is up again");
        }
        self.status.send_modify(|s| s.received_bytes += bytes.len() as u64);
        Ok(systems)
    }
}

/// Someone who sends datagrams.
struct Peer {
    framer: Framer,
    heard: Instant,
    /// The systems whose frames it sent: at most 255 of them.
    systems: BTreeSet<u8>,
}

impl Peer {
    fn new() -> Self {
        Self { framer: Framer::new(), heard: Instant::now(), systems: BTreeSet::new() }
    }

    /// Whether it sent a whole frame of this vehicle, or of anybody while none is followed.
    fn speaks_for(&self, vehicle: u8) -> bool {
        if vehicle == ANYBODY { !self.systems.is_empty() } else { self.systems.contains(&vehicle) }
    }
}

/// Vehicles that change their port leave their old address behind. Of those who are still there strangers go first: a
/// flood of them must not cost the vehicle its place.
fn make_room(peers: &mut BTreeMap<SocketAddr, Peer>) {
    peers.retain(|_, p| p.heard.elapsed() < PEER_LIFETIME);
    if peers.len() >= MAX_PEERS
        && let Some(least) =
            peers.iter().min_by_key(|(_, p)| (!p.systems.is_empty(), p.heard)).map(|(a, _)| *a)
    {
        peers.remove(&least);
    }
}

/// Why a serial port does not open, and what helps.
fn serial_problem(path: &str, error: &tokio_serial::Error) -> String {
    let remedy = match error.kind() {
        tokio_serial::ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
            "; add your user to the group of the port, usually dialout (sudo usermod -aG dialout $USER), and log in again"
        }
        _ => "",
    };
    format!("cannot open {path}: {error}{remedy}")
}

fn add(a: FramerStats, b: FramerStats) -> FramerStats {
    FramerStats {
        frames: a.frames + b.frames,
        unknown: a.unknown + b.unknown,
        bad_checksum: a.bad_checksum + b.bad_checksum,
        skipped_bytes: a.skipped_bytes + b.skipped_bytes,
        lost: a.lost + b.lost,
    }
}

fn since(now: FramerStats, earlier: FramerStats) -> FramerStats {
    FramerStats {
        frames: now.frames - earlier.frames,
        unknown: now.unknown - earlier.unknown,
        bad_checksum: now.bad_checksum - earlier.bad_checksum,
        skipped_bytes: now.skipped_bytes - earlier.skipped_bytes,
        lost: now.lost - earlier.lost,
    }
}

#[cfg(test)]
mod tests;
