//! Connections of the web server, bounded in number and in time: whoever reaches the port can cost it little.
//!
//! A connection that does not finish its request, or does not read its answer, is closed; one address can hold only a part of
//! all connections.

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::time::{Instant, Sleep};

/// For a whole request header from the first byte on, or the next request of a connection.
const HEADER_PATIENCE: Duration = Duration::from_secs(10);
/// For a request's body and its answer; an upload takes up to two minutes.
const ANSWER_PATIENCE: Duration = Duration::from_secs(150);
/// A reader that takes nothing for so long is gone.
const WRITE_PATIENCE: Duration = Duration::from_secs(10);
/// After a failure to accept, as when there are no more file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);
/// Connections in all, and of one address.
const CONNECTIONS: (usize, usize) = (256, 64);
/// Bytes under way to one reader: little, so that one who stops reading is noticed.
const SEND_BUFFER: u32 = 64 * 1024;
const BACKLOG: u32 = 128;

/// Listens where a page is to be served.
///
/// # Errors
/// When the address cannot be bound.
pub fn bind(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    socket.set_reuseaddr(true)?;
    // Accepted connections inherit it.
    socket.set_send_buffer_size(SEND_BUFFER)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// So many places, of which one address may take a part.
#[derive(Debug)]
pub(in crate::sinks) struct Places {
    all: usize,
    of_one: usize,
    taken: Mutex<BTreeMap<IpAddr, usize>>,
}

impl Places {
    pub(in crate::sinks) fn new(all: usize, of_one: usize) -> Arc<Self> {
        Arc::new(Self { all, of_one, taken: Mutex::default() })
    }

    /// A place, if there is one for this address.
    pub(in crate::sinks) fn take(self: &Arc<Self>, address: IpAddr) -> Option<Place> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let of_one = taken.get(&address).copied().unwrap_or(0);
        if of_one >= self.of_one || taken.values().sum::<usize>() >= self.all {
            return None;
        }
        taken.insert(address, of_one + 1);
        Some(Place { places: Arc::clone(self), address })
    }
}

/// A place that is taken until it is dropped.
#[derive(Debug)]
pub(in crate::sinks) struct Place {
    places: Arc<Places>,
    address: IpAddr,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(n) = taken.get_mut(&self.address) {
            *n = n.saturating_sub(1);
            if *n == 0 {
                taken.remove(&self.address);
            }
        }
    }
}

/// The listener.
#[derive(Debug)]
pub(in crate::sinks) struct Door {
    listener: TcpListener,
    places: Arc<Places>,
}

impl Door {
    pub(in crate::sinks) fn new(listener: TcpListener) -> Self {
        Self { listener, places: Places::new(CONNECTIONS.0, CONNECTIONS.1) }
    }
}

impl Listener for Door {
    type Io = Visit;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Visit, SocketAddr) {
        loop {
            match self.listener.accept().await {
                Ok((stream, from)) => {
                    // Without a place the connection is closed at once.
                    if let Some(place) = self.places.take(from.ip()) {
                        return (Visit::new(stream, place), from);
                    }
                }
                Err(_) => tokio::time::sleep(ACCEPT_PAUSE).await,
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// The address of whoever asks.
#[derive(Debug, Clone, Copy)]
pub(in crate::sinks) struct Visitor(pub(in crate::sinks) IpAddr);

impl Connected<IncomingStream<'_, Door>> for Visitor {
    fn connect_info(stream: IncomingStream<'_, Door>) -> Self {
        Self(stream.remote_addr().ip())
    }
}

/// How far the header of a request has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Header {
    /// Not begun: empty lines before a request are none of it (RFC 9112, 2.2).
    Awaited,
    /// Begun, with so much of the empty line at its end.
    Begun(usize),
    /// Whole; what comes now is a body, or a further request that waits for its answer.
    Whole,
}

impl Header {
    fn after(self, byte: u8) -> Self {
        const END: &[u8] = b"\r\n\r\n";
        match self {
            Self::Awaited if matches!(byte, b'\r' | b'\n') => self,
            Self::Awaited => Self::Begun(0),
            Self::Begun(n) => match END.get(n) {
                Some(expected) if *expected == byte && n + 1 == END.len() => Self::Whole,
                Some(expected) if *expected == byte => Self::Begun(n + 1),
                _ => Self::Begun(usize::from(byte == b'\r')),
            },
            Self::Whole => self,
        }
    }
}

/// A connection with its deadlines.
#[derive(Debug)]
pub(in crate::sinks) struct Visit {
    stream: TcpStream,
    reading: Pin<Box<Sleep>>,
    writing: Option<Pin<Box<Sleep>>>,
    header: Header,
    _place: Place,
}

impl Visit {
    fn new(stream: TcpStream, place: Place) -> Self {
        let reading = Box::pin(tokio::time::sleep(HEADER_PATIENCE));
        Self { stream, reading, writing: None, header: Header::Awaited, _place: place }
    }

    /// Looks for the end of the header; from there on the answer has its time.
    fn received(&mut self, bytes: &[u8]) {
        let before = self.header;
        self.header = bytes.iter().fold(before, |header, byte| header.after(*byte));
        if before != Header::Whole && self.header == Header::Whole {
            self.reading.as_mut().reset(Instant::now() + ANSWER_PATIENCE);
        }
    }

    fn written<T>(&mut self, context: &mut Context<'_>, result: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if result.is_ready() {
            self.writing = None;
            self.header = Header::Awaited;
            // An answer is on its way: the next request has its time from here.
            self.reading.as_mut().reset(Instant::now() + HEADER_PATIENCE);
            return result;
        }
        let deadline = self.writing.get_or_insert_with(|| Box::pin(tokio::time::sleep(WRITE_PATIENCE)));
        match deadline.as_mut().poll(context) {
            Poll::Ready(()) => Poll::Ready(Err(io::ErrorKind::TimedOut.into())),
            Poll::Pending => Poll::Pending,
        }
    }
}

impl AsyncRead for Visit {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let before = buffer.filled().len();
        match Pin::new(&mut this.stream).poll_read(context, buffer) {
            Poll::Ready(result) => {
                this.received(buffer.filled().get(before..).unwrap_or_default());
                Poll::Ready(result)
            }
            Poll::Pending => match this.reading.as_mut().poll(context) {
                Poll::Ready(()) => Poll::Ready(Err(io::ErrorKind::TimedOut.into())),
                Poll::Pending => Poll::Pending,
            },
        }
    }
}

impl AsyncWrite for Visit {
    fn poll_write(self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let result = Pin::new(&mut this.stream).poll_write(context, bytes);
        this.written(context, result)
    }

    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_flush(context)
    }

    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_ends_with_its_own_empty_line() {
        let read = |text: &str| text.bytes().fold(Header::Awaited, Header::after);
        assert_eq!(read("GET / HTTP/1.1\r\nHost: a\r\n\r\n"), Header::Whole);
        assert_eq!(read("\r\n\r\n\r\n\r\n"), Header::Awaited);
        assert_eq!(read("\r\n\r\nGET / HTTP/1.1\r\n"), Header::Begun(2));
        assert_eq!(read("GET / HTTP/1.1\r\n\r\rbody"), Header::Begun(0));
    }
}
