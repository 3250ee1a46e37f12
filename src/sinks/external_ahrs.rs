//! The serial port on which an autopilot reads the corrected attitude (`--external-ahrs`): an experiment for the ground.
//!
//! It opens the port, and again when it vanishes, hands bytes to [`Device`] and its answers back, and says when the autopilot has asked for
//! messages, when nothing is sent because the estimate is not good enough, and how late the messages were. Of several states that
//! wait only the newest is used.

use super::log;
use super::status::{SinkCounters, SinkStatus};
use crate::engine::navigation::Navigation;
use crate::external_ahrs::health::{InsMode, Unhealthy};
use crate::external_ahrs::{Action, Device};
use crate::link::address::SerialPort;
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::sync::mpsc;
use tokio_serial::{SerialPort as _, SerialPortBuilderExt, SerialStream};
use tokio_util::sync::CancellationToken;

/// States that may wait.
pub const AHEAD: usize = 16;
/// Pause before a port is opened again.
const AGAIN: Duration = Duration::from_secs(1);
/// A port that takes no bytes for so long has no one at its other end.
const PATIENCE: Duration = Duration::from_millis(100);

/// A state with the time at which the sample behind it arrived.
#[derive(Debug, Clone)]
pub struct Fresh {
    /// When the engine had taken the sample.
    pub arrived: Instant,
    /// The state.
    pub navigation: Navigation,
}

/// The port with the instrument behind it.
#[derive(Debug)]
pub struct ExternalAhrs {
    port: SerialPort,
    device: Device,
    counters: Arc<SinkCounters>,
    /// What was reported last: rates and health.
    reported: (Vec<f64>, Option<Result<InsMode, Unhealthy>>),
    late: Late,
}

/// How late messages were.
#[derive(Debug, Default)]
struct Late {
    writes: u32,
    sum: Duration,
    most: Duration,
}

impl ExternalAhrs {
    /// On this port; nothing is opened yet.
    pub fn new(port: SerialPort, status: Arc<SinkStatus>) -> Self {
        let counters = status.sink("external AHRS");
        Self {
            port,
            device: Device::default(),
            counters,
            reported: Default::default(),
            late: Late::default(),
        }
    }

    /// Serves the port until `stop`.
    pub async fn run(mut self, mut fresh: mpsc::Receiver<Fresh>, stop: CancellationToken) {
        log::line(
            "external AHRS: an experiment for the ground; take the propellers off (docs/external-ahrs.md)",
        );
        let mut problem = String::new();
        loop {
            let served = tokio::select! {
                () = stop.cancelled() => break,
                served = self.serve(&mut fresh) => served,
            };
            match served {
                // The run is over.
                Ok(()) => break,
                Err(error) => {
                    let now = format!("external AHRS: {}: {error}", self.port.path);
                    if std::mem::replace(&mut problem, now.clone()) != now {
                        log::line(&now);
                    }
                }
            }
            tokio::select! {
                () = stop.cancelled() => break,
                () = tokio::time::sleep(AGAIN) => {}
            }
            while fresh.try_recv().is_ok() {}
        }
        if self.late.writes > 0 {
            log::line(&self.late.words());
        }
    }

    /// Serves the port until it fails; without an error the run has ended.
    async fn serve(&mut self, fresh: &mut mpsc::Receiver<Fresh>) -> io::Result<()> {
        let mut port = tokio_serial::new(&self.port.path, self.port.baud).open_native_async()?;
        let mut bytes = [0; 256];
        loop {
            tokio::select! {
                read = port.read(&mut bytes) => match read? {
                    0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                    n => self.answer(bytes.get(..n).unwrap_or_default(), &mut port).await?,
                },
                state = fresh.recv() => match state {
                    Some(state) => self.feed(newest(state, fresh), &mut port).await?,
                    None => return Ok(()),
                },
            }
        }
    }

    async fn answer(&mut self, bytes: &[u8], port: &mut SerialStream) -> io::Result<()> {
        for action in self.device.receive(bytes) {
            match action {
                Action::Send(answer) => write(port, &answer).await?,
                Action::Baud(rate) => {
                    port.flush().await?;
                    port.set_baud_rate(rate)?;
                    self.port.baud = rate;
                }
            }
        }
        let rates = self.device.rates_hz();
        if rates != self.reported.0 {
            let words: Vec<String> = rates.iter().map(|hz| format!("{hz:.0}")).collect();
            log::line(&format!("external AHRS: the autopilot asks for messages at {} Hz", words.join(", ")));
            self.reported.0 = rates;
        }
        Ok(())
    }

    async fn feed(&mut self, state: Fresh, port: &mut SerialStream) -> io::Result<()> {
        let (message, health) = self.device.feed(&state.navigation);
        if self.reported.1 != Some(health) {
            log::line(&match health {
                Ok(InsMode::Tracking) => "external AHRS: the attitude is good".to_owned(),
                Ok(InsMode::FixesLost) => "external AHRS: no fixes, attitude only".to_owned(),
                Err(reason) => format!("external AHRS: SILENT: {reason}"),
            });
            self.reported.1 = Some(health);
        }
        if message.is_empty() {
            return Ok(());
        }
        match write(port, &message).await {
            Ok(()) => {
                self.counters.delivered(1);
                self.late.push(state.arrived.elapsed());
                Ok(())
            }
            Err(error) if error.kind() == io::ErrorKind::TimedOut => {
                self.counters.dropped(1);
                Ok(())
            }
            Err(error) => Err(error),
        }
    }
}

/// The last of those that wait: an old state is of no use to anybody.
fn newest(mut state: Fresh, fresh: &mut mpsc::Receiver<Fresh>) -> Fresh {
    while let Ok(newer) = fresh.try_recv() {
        state = newer;
    }
    state
}

async fn write(port: &mut SerialStream, bytes: &[u8]) -> io::Result<()> {
    tokio::time::timeout(PATIENCE, port.write_all(bytes))
        .await
        .map_err(|_| io::Error::from(io::ErrorKind::TimedOut))?
}

impl Late {
    fn push(&mut self, late: Duration) {
        self.writes += 1;
        self.sum += late;
        self.most = self.most.max(late);
    }

    fn words(&self) -> String {
        let ms = |d: Duration| d.as_secs_f64() * 1e3;
        format!(
            "external AHRS: sent {} times, {:.2} ms after the sample had arrived in the mean, {:.1} ms at most",
            self.writes,
            ms(self.sum / self.writes.max(1)),
            ms(self.most)
        )
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::external_ahrs::health::Unhealthy;
    use tokio::time::timeout;

    const LIMIT: Duration = Duration::from_secs(20);

    fn fresh(t_s: f64) -> Fresh {
        let navigation = Navigation {
            t_s,
            running: true,
            since_used_fix_s: Some(0.1),
            quaternion: [1.0, 0.0, 0.0, 0.0],
            ..Navigation::default()
        };
        Fresh { arrived: Instant::now(), navigation }
    }

    /// An autopilot asks over a pseudo-terminal, is answered, and reads its messages once the filter is healthy.
    #[tokio::test]
    async fn an_autopilot_asks_over_a_serial_port_and_reads_what_it_has_asked_for() {
        let (mut autopilot, ours) = SerialStream::pair().unwrap();
        let port = SerialPort { path: tokio_serial::SerialPort::name(&ours).unwrap(), baud: 115_200 };
        let status = SinkStatus::new();
        let stop = CancellationToken::new();
        let (states, receiver) = mpsc::channel(AHEAD);
        let sink = tokio::spawn(ExternalAhrs::new(port, status.clone()).run(receiver, stop.clone()));
        autopilot.write_all(b"$VNWRG,75,3,16,01,0101*XX\r\n").await.unwrap();
        let mut answer = [0; 27];
        timeout(LIMIT, autopilot.read_exact(&mut answer)).await.unwrap().unwrap();
        assert!(answer.starts_with(b"$VNWRG,75,3,16,01,0101*"), "{answer:?}");
        for second in 0..=11 {
            states.send(fresh(f64::from(second))).await.unwrap();
            // Each is used before the next one comes, or it would not be.
            timeout(LIMIT, async {
                while states.capacity() < AHEAD {
                    tokio::task::yield_now().await
                }
            })
            .await
            .unwrap();
        }
        let mut message = [0; 1 + 3 + 8 + 12 + 2];
        timeout(LIMIT, autopilot.read_exact(&mut message)).await.unwrap().unwrap();
        assert_eq!(message[..4], [0xFA, 0x01, 0x01, 0x01]);
        let at_ns = u64::from_le_bytes(*message[4..].first_chunk().unwrap());
        assert!(at_ns >= 10_000_000_000, "not before the filter has settled: {at_ns}");
        stop.cancel();
        timeout(LIMIT, sink).await.unwrap().unwrap();
        assert!(status.sink("external AHRS").view().delivered > 0);
    }

    #[test]
    fn delays_and_reasons_are_reported_in_words() {
        let mut late = Late::default();
        late.push(Duration::from_millis(1));
        late.push(Duration::from_millis(3));
        assert!(late.words().contains("2 times, 2.00 ms") && late.words().contains("3.0 ms at most"));
        assert_eq!(Unhealthy::NoFixes.to_string(), "no fix was used for 15 s");
    }
}
