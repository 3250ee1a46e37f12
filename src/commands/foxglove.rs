//! Starting the server of live data for Foxglove, for `run` and `demo`.

use super::{CommandError, start};
use crate::sinks::foxglove::{self, Feed};
use crate::sinks::log;
use crate::sinks::status::SinkStatus;
use crate::sinks::web::access::Token;
use crate::sinks::web::{WebError, door};
use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs};
use std::time::{SystemTime, UNIX_EPOCH};
use tokio_util::sync::CancellationToken;

/// Where the server listens unless an address is given: the port that Foxglove proposes, for this machine only.
pub(super) const DEFAULT_ADDRESS: &str = "127.0.0.1:8765";

/// An address to listen on (a name such as localhost stands for its IPv4 address where it has one), or a port of this machine alone.
pub(super) fn listen_address(text: &str) -> Result<SocketAddr, String> {
    if let Ok(port) = text.parse::<u16>() {
        return Ok((Ipv4Addr::LOCALHOST, port).into());
    }
    let known: Vec<SocketAddr> = text.to_socket_addrs().map(Iterator::collect).unwrap_or_default();
    let chosen = known.iter().find(|a| a.is_ipv4()).or(known.first());
    chosen.copied().ok_or_else(|| "write an address and a port, as in 127.0.0.1:8765, or a port".to_owned())
}

/// Unix time, µs.
pub(super) fn now_us() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_micros()).unwrap_or(u64::MAX)
}

/// Serves until `stop`; on any address but this machine's own viewers need a token, and one is made up where none was given.
pub(super) fn serve(
    address: SocketAddr,
    token: Option<&str>,
    status: &SinkStatus,
    stop: &CancellationToken,
) -> Result<Feed, CommandError> {
    let fail = |source: std::io::Error| CommandError::Foxglove { address, reason: source.to_string() };
    let refuse = |e: WebError| CommandError::Foxglove { address, reason: e.to_string() };
    let listener = door::bind(address).map_err(fail)?;
    let bound = listener.local_addr().map_err(fail)?;
    let shown = start::address_to_open(bound);
    let token = match token {
        Some(text) => {
            log::line(&format!("Foxglove: ws://{shown}/?token=… (with the token given)"));
            Some(Token::new(text).map_err(refuse)?)
        }
        None if !bound.ip().is_loopback() => {
            let token = Token::random().map_err(refuse)?;
            log::line(&format!("Foxglove: ws://{shown}/?token={}", token.reveal()));
            Some(token)
        }
        None => {
            log::line(&format!("Foxglove: ws://{shown}"));
            None
        }
    };
    Ok(foxglove::serve(listener, token, now_us().to_string(), status, stop.clone()))
}

#[cfg(test)]
mod tests {
    use super::super::cli::{Cli, Command};
    use super::*;
    use clap::Parser;

    fn address_of(more: &[&str]) -> Result<Option<SocketAddr>, String> {
        let line = ["gaware", "run", "--connect", "udpin:127.0.0.1:14550"].iter().chain(more);
        match Cli::try_parse_from(line).map_err(|e| e.to_string())?.command {
            Command::Run(args) => Ok(args.foxglove),
            other => Err(format!("{other:?}")),
        }
    }

    #[test]
    fn others_can_connect_only_where_an_address_says_so() {
        let listens = |text: &str| Ok(Some(text.parse::<SocketAddr>().unwrap()));
        assert_eq!(address_of(&[]), Ok(None));
        assert_eq!(address_of(&["--foxglove"]), listens("127.0.0.1:8765"));
        assert_eq!(address_of(&["--foxglove", "--headless"]), listens("127.0.0.1:8765"));
        assert_eq!(address_of(&["--foxglove", "9000"]), listens("127.0.0.1:9000"));
        assert_eq!(address_of(&["--foxglove", "localhost:9000"]), listens("127.0.0.1:9000"));
        assert_eq!(address_of(&["--foxglove", "0.0.0.0:8765"]), listens("0.0.0.0:8765"));
        assert!(address_of(&["--foxglove", "everywhere"]).unwrap_err().contains("127.0.0.1:8765, or a port"));
    }

    #[test]
    fn a_port_that_is_taken_is_named() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
            let address = taken.local_addr().unwrap();
            let error = serve(address, None, &SinkStatus::new(), &CancellationToken::new()).unwrap_err();
            assert!(
                error.to_string().starts_with(&format!("cannot serve Foxglove on {address}: ")),
                "{error}"
            );
        });
    }
}
