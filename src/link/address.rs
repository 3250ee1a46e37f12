//! Addresses of links as users write them: `serial:/dev/ttyAMA0:921600`, `udpin:0.0.0.0:14550`, `udpout:HOST:PORT`,
//! `tcpout:HOST:PORT`; and as other tools write them: `udp:` and `udp://` wait (MAVProxy, MAVSDK), `tcp:` and `tcp://` connect,
//! `serial:///dev/ttyUSB0:57600` (MAVSDK), `/dev/ttyUSB0,57600` (MAVProxy), `COM3` (Mission Planner).

use serde::Serialize;
use std::fmt;
use std::net::SocketAddr;
use std::str::FromStr;

/// Baud rate of a serial address without one: the usual setting of a companion port is faster, but this one is
/// the firmware's default.
const DEFAULT_BAUD: u32 = 57_600;

/// Where a link leads.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(into = "String")]
pub enum Address {
    /// A serial port or a pseudo-terminal.
    Serial {
        /// Device.
        path: String,
        /// Bits per second.
        baud: u32,
    },
    /// Waits for datagrams; answers whoever sent some lately.
    UdpIn(SocketAddr),
    /// Sends datagrams to a host.
    UdpOut(String),
    /// Connects to a host.
    TcpOut(String),
}

/// Why an address is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// No kind before the first colon.
    #[error(
        "\"{0}\" is not a valid address; write serial:/dev/ttyAMA0:921600, udpin:0.0.0.0:14550, udpout:HOST:PORT or tcpout:HOST:PORT"
    )]
    Kind(String),
    /// A host without a port or the other way round.
    #[error("\"{0}\" needs a host and a port from 1 to 65535, as in {1}:192.168.1.10:14550")]
    HostPort(String, &'static str),
    /// `udpin` binds a local address, not a name.
    #[error("udpin waits on a local IP address and port, as in udpin:0.0.0.0:14550; \"{0}\" is none")]
    Local(String),
    /// Waiting for TCP connections.
    #[error(
        "\"{0}\" would wait for a TCP connection; let the other side wait and write tcpout:HOST:PORT, or use udpin"
    )]
    TcpIn(String),
    /// No device.
    #[error("serial needs a device and a baud rate, as in serial:/dev/ttyAMA0:921600; found \"{0}\"")]
    Device(String),
    /// Not a rate.
    #[error("\"{0}\" is no baud rate; usual ones are 57600, 115200 and 921600")]
    Baud(String),
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(s: &str) -> Result<Self, Self::Err> {
        if s.starts_with("/dev/") || is_com_port(s) {
            return serial(s);
        }
        let (kind, rest) = s.split_once(':').ok_or_else(|| AddressError::Kind(s.to_owned()))?;
        // As a URL.
        let rest = rest.strip_prefix("//").unwrap_or(rest);
        match kind {
            "serial" => serial(rest),
            "udpin" | "udp" => local(rest).map(Self::UdpIn),
            "udpout" => host_port(rest, "udpout").map(Self::UdpOut),
            "tcpout" | "tcp" => host_port(rest, "tcpout").map(Self::TcpOut),
            "tcpin" => Err(AddressError::TcpIn(s.to_owned())),
            _ => Err(AddressError::Kind(s.to_owned())),
        }
    }
}

/// Whether this begins as the name of a serial port of Windows: `COM3`, `COM3:57600`, `COM12,115200`.
fn is_com_port(s: &str) -> bool {
    let name = s.split([':', ',']).next().unwrap_or_default();
    let number = name.get(3..).filter(|_| name.get(..3).is_some_and(|kind| kind.eq_ignore_ascii_case("COM")));
    number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}

/// A local address to wait on; without a host any of this machine's.
fn local(rest: &str) -> Result<SocketAddr, AddressError> {
    let whole = if rest.starts_with(':') { format!("0.0.0.0{rest}") } else { rest.to_owned() };
    whole.parse().map_err(|_| AddressError::Local(rest.to_owned()))
}

/// A device and its baud rate behind the last colon or comma.
fn serial(rest: &str) -> Result<Address, AddressError> {
    let (path, baud) = match rest.rsplit_once([':', ',']) {
        None => (rest, DEFAULT_BAUD),
        Some((path, baud)) => match baud.parse() {
            Ok(baud) if baud > 0 => (path, baud),
            _ => return Err(AddressError::Baud(baud.to_owned())),
        },
    };
    if path.is_empty() {
        return Err(AddressError::Device(rest.to_owned()));
    }
    // Several slashes at the start mean what one means, except in a URL.
    let path = match path.trim_start_matches('/') {
        below if below.len() < path.len() => format!("/{below}"),
        below => below.to_owned(),
    };
    Ok(Address::Serial { path, baud })
}

fn host_port(rest: &str, kind: &'static str) -> Result<String, AddressError> {
    match rest.rsplit_once(':') {
        Some((host, port))
            if !host.is_empty() && !host.contains('/') && port.parse::<u16>().is_ok_and(|p| p != 0) =>
        {
            Ok(rest.to_owned())
        }
        _ => Err(AddressError::HostPort(rest.to_owned(), kind)),
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial { path, baud } => write!(f, "serial:{path}:{baud}"),
            Self::UdpIn(address) => write!(f, "udpin:{address}"),
            Self::UdpOut(host) => write!(f, "udpout:{host}"),
            Self::TcpOut(host) => write!(f, "tcpout:{host}"),
        }
    }
}

impl From<Address> for String {
    fn from(address: Address) -> Self {
        address.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_read_back_as_written() {
        for text in [
            "serial:/dev/ttyAMA0:921600",
            "udpin:0.0.0.0:14550",
            "udpin:[::1]:14550",
            "serial:/dev/serial/by-id/usb-a,b:0:57600",
            "udpout:gcs.local:14550",
            "tcpout:127.0.0.1:5760",
        ] {
            assert_eq!(text.parse::<Address>().map(|a| a.to_string()).as_deref(), Ok(text));
        }
        assert_eq!("serial:/dev/pts/3".parse::<Address>().unwrap().to_string(), "serial:/dev/pts/3:57600");
    }

    #[test]
    fn the_forms_of_other_tools_are_understood() {
        for (text, meant) in [
            ("udp:0.0.0.0:14550", "udpin:0.0.0.0:14550"),
            ("udp://:14540", "udpin:0.0.0.0:14540"),
            ("udpin://0.0.0.0:14550", "udpin:0.0.0.0:14550"),
            ("udpout://gcs.local:14550", "udpout:gcs.local:14550"),
            ("tcp:127.0.0.1:5760", "tcpout:127.0.0.1:5760"),
            ("tcp://192.168.1.5:5760", "tcpout:192.168.1.5:5760"),
            ("serial:///dev/ttyUSB0:115200", "serial:/dev/ttyUSB0:115200"),
            ("serial:///dev/ttyUSB0", "serial:/dev/ttyUSB0:57600"),
            ("/dev/ttyUSB0,57600", "serial:/dev/ttyUSB0:57600"),
            ("/dev/ttyACM0:921600", "serial:/dev/ttyACM0:921600"),
            ("/dev/ttyACM0", "serial:/dev/ttyACM0:57600"),
            ("serial:////dev/ttyUSB0,9600", "serial:/dev/ttyUSB0:9600"),
            ("COM3", "serial:COM3:57600"),
            ("com12,115200", "serial:com12:115200"),
            (r"serial:\\.\COM12:921600", r"serial:\\.\COM12:921600"),
        ] {
            assert_eq!(text.parse::<Address>().map(|a| a.to_string()).as_deref(), Ok(meant), "{text}");
        }
    }

    #[test]
    fn a_wrong_address_says_what_is_wrong() {
        for (text, word) in [
            ("ttyAMA0", "serial:/dev"),
            ("tcpin:0.0.0.0:5760", "tcpout:HOST:PORT"),
            ("usb:/dev/x", "udpin"),
            ("serial:/dev/ttyAMA0:fast", "baud"),
            ("serial::57600", "device"),
            ("udpin:localhost:14550", "local IP"),
            ("udpout:14550", "host and a port"),
            ("tcpout:host:0", "host and a port"),
            ("tcp:////host:1", "host and a port"),
            ("tcpout:host:70000", "host and a port"),
        ] {
            let message = text.parse::<Address>().unwrap_err().to_string();
            assert!(message.contains(word), "{text}: {message}");
        }
    }
}
