//! One wire of each kind behind the same few verbs.

use super::Endpoint;
use std::io::{Error, ErrorKind, Result};
use std::net::SocketAddr;
use std::time::Duration;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::sync::mpsc;
use tokio_serial::{SerialPort, SerialStream};

/// A station that has read everything closes the connection; one that does not is not waited for longer. A flight of 340 s that was sent at full
/// speed is 4 MB in the buffers, which `gaware run` reads within 12 s beside two compilers on two cores.
const CLOSED_WITHIN: Duration = Duration::from_secs(30);

/// An open wire.
#[derive(Debug)]
pub(super) enum Link {
    Udp {
        socket: UdpSocket,
        peer: Option<SocketAddr>,
    },
    TcpListener {
        listener: TcpListener,
        stream: Option<TcpStream>,
    },
    TcpStream {
        stream: Option<TcpStream>,
    },
    Pty {
        master: SerialStream,
        /// Held open so that the terminal outlives a station that leaves.
        _slave: SerialStream,
        /// Whether anybody has spoken yet.
        heard: bool,
    },
    Channel {
        tx: mpsc::Sender<Vec<u8>>,
        rx: mpsc::Receiver<Vec<u8>>,
    },
}

/// The endpoint as a user writes it.
pub(super) fn spelled(endpoint: &Endpoint) -> String {
    match endpoint {
        Endpoint::UdpOut(a) => format!("udpout:{a}"),
        Endpoint::UdpIn(a) => format!("udpin:{a}"),
        Endpoint::TcpIn(a) => format!("tcpin:{a}"),
        Endpoint::TcpOut(a) => format!("tcpout:{a}"),
        Endpoint::Pty => "pty".into(),
    }
}

impl Link {
    /// Opens the wire; also gives what a station writes to reach it.
    pub(super) async fn open(endpoint: &Endpoint) -> Result<(Self, String)> {
        match endpoint {
            Endpoint::UdpOut(address) => {
                let peer = tokio::net::lookup_host(address)
                    .await?
                    .next()
                    .ok_or_else(|| Error::new(ErrorKind::NotFound, "no such host"))?;
                let any = if peer.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
                let socket = UdpSocket::bind(any).await?;
                Ok((Self::Udp { socket, peer: Some(peer) }, format!("udpin:{peer}")))
            }
            Endpoint::UdpIn(address) => {
                let socket = UdpSocket::bind(address).await?;
                let local = socket.local_addr()?;
                Ok((Self::Udp { socket, peer: None }, format!("udpout:{local}")))
            }
            Endpoint::TcpIn(address) => {
                let listener = TcpListener::bind(address).await?;
                let local = listener.local_addr()?;
                Ok((Self::TcpListener { listener, stream: None }, format!("tcpout:{local}")))
            }
            Endpoint::TcpOut(address) => {
                let stream = TcpStream::connect(address).await?;
                Ok((Self::TcpStream { stream: Some(stream) }, format!("tcpin:{address}")))
            }
            Endpoint::Pty => {
                let (master, slave) = pseudo_terminal()?;
                let name = slave.name().ok_or_else(|| Error::other("the pseudo-terminal has no name"))?;
                Ok((Self::Pty { master, _slave: slave, heard: false }, format!("serial:{name}:921600")))
            }
        }
    }

    pub(super) fn is_udp(&self) -> bool {
        matches!(self, Self::Udp { .. })
    }

    /// Whether someone is at the other end, as far as the wire shows.
    pub(super) fn is_connected(&self) -> bool {
        match self {
            Self::Udp { peer, .. } => peer.is_some(),
            Self::TcpListener { stream, .. } | Self::TcpStream { stream } => stream.is_some(),
            Self::Pty { heard, .. } => *heard,
            Self::Channel { tx, .. } => !tx.is_closed(),
        }
    }

    /// What has arrived, without waiting.
    pub(super) fn received(&mut self) -> Vec<Vec<u8>> {
        let mut chunks = Vec::new();
        let mut buffer = [0u8; 2048];
        match self {
            Self::Udp { socket, peer } => loop {
                match socket.try_recv_from(&mut buffer) {
                    Ok((n, from)) => {
                        *peer = Some(from);
                        chunks.push(buffer[..n].to_vec());
                    }
                    // An ICMP refusal of an earlier datagram is no reason to stop listening; Windows calls it a reset.
                    Err(e)
                        if matches!(e.kind(), ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset) => {}
                    Err(_) => break,
                }
            },
            Self::TcpListener { listener, stream } => {
                if stream.is_none() {
                    *stream = accept_now(listener);
                }
                read_tcp(stream, &mut buffer, &mut chunks);
            }
            Self::TcpStream { stream } => read_tcp(stream, &mut buffer, &mut chunks),
            Self::Pty { master, heard, .. } => {
                while let Ok(n @ 1..) = master.try_read(&mut buffer) {
                    *heard = true;
                    chunks.push(buffer[..n].to_vec());
                }
            }
            Self::Channel { rx, .. } => {
                while let Ok(bytes) = rx.try_recv() {
                    chunks.push(bytes);
                }
            }
        }
        chunks
    }

    /// Sends one frame, waiting while the other end is slow. Without anybody there the frame is lost, as on a real wire.
    pub(super) async fn send(&mut self, frame: &[u8]) {
        match self {
            Self::Udp { socket, peer } => {
                if let Some(peer) = peer {
                    // A refused or unreachable peer may come back: a datagram is lost, nothing more.
                    let _ = socket.send_to(frame, *peer).await;
                }
            }
            Self::TcpListener { stream, .. } | Self::TcpStream { stream } => {
                if let Some(s) = stream
                    && s.write_all(frame).await.is_err()
                {
                    *stream = None;
                }
            }
            Self::Pty { master, heard, .. } => {
                if *heard {
                    let _ = master.write_all(frame).await;
                } else {
                    // No one has spoken yet: like a UART without a listener, never wait.
                    let _ = master.try_write(frame);
                }
            }
            Self::Channel { tx, .. } => {
                let _ = tx.send(frame.to_vec()).await;
            }
        }
    }

    /// Lets the other end read what is still under way, then closes: a connection when the other end has closed it, or after a while.
    pub(super) async fn close(self, linger: Duration) {
        match self {
            Self::TcpListener { stream: Some(mut s), .. } | Self::TcpStream { stream: Some(mut s) } => {
                let _ = s.shutdown().await;
                // A socket that is dropped with something unread resets the connection, and what is under way is lost.
                let mut nowhere = tokio::io::sink();
                let _ = tokio::time::timeout(CLOSED_WITHIN, tokio::io::copy(&mut s, &mut nowhere)).await;
            }
            Self::Pty { .. } => tokio::time::sleep(linger).await,
            _ => {}
        }
    }
}

/// Both ends of a pseudo-terminal.
#[cfg(unix)]
fn pseudo_terminal() -> Result<(SerialStream, SerialStream)> {
    SerialStream::pair().map_err(Error::other)
}

#[cfg(not(unix))]
fn pseudo_terminal() -> Result<(SerialStream, SerialStream)> {
    let text = "this system has no pseudo-terminals that stand for a serial port; use udpout:, udpin:, tcpin: or tcpout:";
    Err(Error::new(ErrorKind::Unsupported, text))
}

/// A connection that is already waiting.
fn accept_now(listener: &TcpListener) -> Option<TcpStream> {
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    match listener.poll_accept(&mut context) {
        std::task::Poll::Ready(Ok((stream, _))) => {
            // Small frames, soon: the delay of Nagle's algorithm would look like a slow autopilot.
            let _ = stream.set_nodelay(true);
            Some(stream)
        }
        _ => None,
    }
}

fn read_tcp(stream: &mut Option<TcpStream>, buffer: &mut [u8], chunks: &mut Vec<Vec<u8>>) {
    while let Some(s) = stream {
        match s.try_read(buffer) {
            Ok(0) => *stream = None,
            Ok(n) => chunks.push(buffer[..n].to_vec()),
            Err(e) if e.kind() == ErrorKind::WouldBlock => return,
            Err(_) => *stream = None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::AsyncReadExt;

    /// A station that has yet to read most of what was sent to it, and whose own last words no one reads, gets everything all the same.
    #[tokio::test]
    async fn a_station_reads_everything_of_a_link_that_closes() {
        let (mut link, address) = Link::open(&Endpoint::TcpIn("127.0.0.1:0".into())).await.unwrap();
        let socket = tokio::net::TcpSocket::new_v4().unwrap();
        socket.set_recv_buffer_size(4096).unwrap();
        let address = address.strip_prefix("tcpout:").unwrap().parse().unwrap();
        let mut station = socket.connect(address).await.unwrap();
        while !link.is_connected() {
            link.received();
            tokio::task::yield_now().await;
        }
        let sent = vec![7; 65_536];
        link.send(&sent).await;
        station.write_all(&[1; 512]).await.unwrap();
        let read = async move {
            let mut all = Vec::new();
            station.read_to_end(&mut all).await.map(|_| all)
        };
        let ((), read) = tokio::join!(link.close(Duration::ZERO), read);
        assert_eq!(read.unwrap().len(), sent.len());
    }
}
