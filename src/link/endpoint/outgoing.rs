//! The local end of a `udpout` link.

use std::io;
use std::net::SocketAddr;
use tokio::net::UdpSocket;

/// Local ports begin here, below those that systems give away (32768 on Linux) …
const FIRST_PORT: u16 = 20_000;
/// … and there are so many of them.
const PORTS: u16 = 10_000;

/// The port from which a peer at this port is spoken to: the same in every run. PX4 answers for good the place that it heard first
/// (`mavlink_receiver.cpp`, `set_client_source_initialized`), so that a second run from another port would receive nothing.
pub(super) fn local_port(peer_port: u16) -> u16 {
    FIRST_PORT + peer_port % PORTS
}

/// A socket for a peer; where its port is in use already, any port.
pub(super) async fn socket_to(peer: SocketAddr) -> io::Result<UdpSocket> {
    let any = |port: u16| -> SocketAddr {
        if peer.is_ipv4() { ([0, 0, 0, 0], port).into() } else { ([0_u16; 8], port).into() }
    };
    match UdpSocket::bind(any(local_port(peer.port()))).await {
        Ok(socket) => Ok(socket),
        Err(_) => UdpSocket::bind(any(0)).await,
    }
}
