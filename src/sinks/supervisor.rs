//! What the service manager is sent (`sd_notify(3)`): that the run is ready, that it is alive, that it ends.
//!
//! It speaks when the session has published its state, and only then: a session that hangs is silent, and the service manager starts the
//! program again. Without a service manager there is no socket and nothing is sent.

use std::io;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

/// Messages in the time after which the manager takes the program for dead.
const MESSAGES: u32 = 4;

/// The socket of the service manager, with the time after which it takes a silent program for dead.
#[derive(Debug)]
pub struct Supervisor {
    socket: UnixDatagram,
    address: SocketAddr,
    watchdog: Option<Duration>,
}

impl Supervisor {
    /// As `NOTIFY_SOCKET`, `WATCHDOG_USEC` and `WATCHDOG_PID` say; `None` where there is no socket or it cannot be used.
    pub fn from_env(env: &dyn Fn(&str) -> Option<String>) -> Option<Self> {
        let address = address(&env("NOTIFY_SOCKET")?).ok()?;
        let socket = UnixDatagram::unbound().ok()?;
        // A full queue of the manager holds no run up.
        socket.set_nonblocking(true).ok()?;
        let for_others = env("WATCHDOG_PID").is_some_and(|pid| pid != std::process::id().to_string());
        let period = env("WATCHDOG_USEC").and_then(|us| us.parse().ok()).filter(|us| *us > 0);
        let watchdog = period.filter(|_| !for_others).map(Duration::from_micros);
        Some(Self { socket, address, watchdog })
    }

    fn say(&self, message: &str) {
        // A message that is lost is followed by another, but for the first and the last; then the manager waits its time out.
        let _ = self.socket.send_to_addr(message.as_bytes(), &self.address);
    }

    /// Reports until the end. `live` changes whenever the session has published its state.
    pub async fn run<T>(self, mut live: watch::Receiver<T>, stop: CancellationToken) {
        let period = self.watchdog.map(|w| w / MESSAGES);
        let mut said: Option<Instant> = None;
        loop {
            tokio::select! {
                () = stop.cancelled() => break,
                changed = live.changed() => if changed.is_err() { break },
            }
            let now = Instant::now();
            match (said, period) {
                (None, _) => self.say("READY=1"),
                (Some(before), Some(period)) if now - before >= period => self.say("WATCHDOG=1"),
                _ => continue,
            }
            said = Some(now);
        }
        self.say("STOPPING=1");
    }
}

/// A path, or with `@` a name without a file.
fn address(text: &str) -> io::Result<SocketAddr> {
    match text.strip_prefix('@') {
        #[cfg(target_os = "linux")]
        Some(name) => {
            use std::os::linux::net::SocketAddrExt;
            SocketAddr::from_abstract_name(name.as_bytes())
        }
        #[cfg(not(target_os = "linux"))]
        Some(_) => Err(io::ErrorKind::Unsupported.into()),
        None => SocketAddr::from_pathname(text),
    }
}
