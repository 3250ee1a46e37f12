//! The arguments of `run`.

use crate::commands::ListenArgs;
use crate::commands::band::BandArgs;
use crate::commands::effects::EffectsArgs;
use crate::commands::foxglove::{DEFAULT_ADDRESS, listen_address};
use crate::commands::known::KnownArgs;
use crate::link::address::Address;
use crate::sinks::recorder::RecordLimit;
use crate::sinks::telemetry::TelemetryLevel;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// Arguments of `run`.
#[derive(Debug, Clone, clap::Args)]
pub struct RunArgs {
    /// Link to the vehicle: serial:/dev/ttyAMA0:921600, udpin:0.0.0.0:14550, udpout:HOST:PORT or tcpout:HOST:PORT; may
    /// be given several times.
    #[arg(long, value_name = "ADDR", required_unless_present = "config")]
    pub connect: Vec<Address>,
    /// Take options from this file, see `gaware config`; what the command line gives wins.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Model of the sensors (default: g-sensitivity and GNSS latency are estimated).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Effects that a user defines, for the model.
    #[command(flatten)]
    pub effects: EffectsArgs,
    /// Where to record: a folder, or a file that ends in .mcap.
    #[arg(long, value_name = "PATH", default_value = "recordings", conflicts_with = "no_record")]
    pub record: PathBuf,
    /// Space for recordings, as in 2GB: the recording becomes several files of an eighth of that, and the oldest are removed. In a
    /// folder recordings of earlier runs count too, other files never; with a file named, only the files of this run.
    #[arg(long, value_name = "SIZE", conflicts_with = "no_record")]
    pub record_limit: Option<RecordLimit>,
    /// Do not record.
    #[arg(long)]
    pub no_record: bool,
    /// Do not draw on the terminal.
    #[arg(long)]
    pub headless: bool,
    /// Rate of inertial messages to ask for, Hz. PX4 has 250 or 125 and nothing between: it gives the next higher one.
    #[arg(long, value_name = "HZ", default_value_t = 200, value_parser = rate)]
    pub rate: u16,
    /// What flies, for guidance: small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes it. Without it no
    /// maneuver is proposed.
    #[arg(long, value_name = "NAME|FILE")]
    pub airframe: Option<String>,
    /// Heights that proposed maneuvers keep to.
    #[command(flatten)]
    pub band: BandArgs,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// What is known before.
    #[command(flatten)]
    pub known: KnownArgs,
    /// Sign with this key (32 bytes or 64 hexadecimal digits) and accept only frames signed with it. The last time used
    /// is kept beside it.
    #[arg(long, value_name = "FILE")]
    pub signing_key: Option<PathBuf>,
    /// Messages to the ground station: nothing, texts and values at most 5 a second, or about 22 a second
    /// (docs/telemetry.md).
    #[arg(long, value_enum, value_name = "LEVEL", default_value = "low")]
    pub telemetry: TelemetryLevel,
    /// Serve the web page on this address, with a port alone on that port of this machine.
    #[arg(long, value_name = "ADDR", value_parser = listen_address)]
    pub web: Option<SocketAddr>,
    /// Live data for Foxglove, which connects to ws://ADDR: the topics of the recording. Without an address 127.0.0.1:8765, with a port
    /// alone that port of 127.0.0.1 (docs/foxglove.md).
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = DEFAULT_ADDRESS, value_parser = listen_address)]
    pub foxglove: Option<SocketAddr>,
    /// Token that the web page and --foxglove ask for; generated automatically when they listen on a non-loopback address.
    #[arg(long, value_name = "TOKEN", env = "GAWARE_WEB_TOKEN", hide_env_values = true)]
    pub web_token: Option<String>,
    /// A planned mission (.plan or .waypoints, see `gaware plan`) that may be uploaded from the page or the terminal; nothing is
    /// uploaded before the user asks for it there and confirms. The mission before is kept in a file beside it.
    #[arg(long, value_name = "FILE")]
    pub mission: Option<PathBuf>,
    /// A parameter file (`autopilot.param` of an explanation, for example) that may be applied from the page or the terminal; nothing is
    /// set before the user asks for it there and confirms. The values before are kept in a file beside it.
    #[arg(long, value_name = "FILE")]
    pub params: Option<PathBuf>,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
    /// Stop after this many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub duration: Option<Duration>,
}

/// A rate that can be asked for.
fn rate(text: &str) -> Result<u16, String> {
    let number = text.parse::<u16>().ok().filter(|hz| (1..=1000).contains(hz));
    number.ok_or_else(|| "write a whole number of Hz from 1 to 1000, as in --rate 200".to_owned())
}

/// Seconds that make sense as the length of a run.
pub(in crate::commands) fn seconds(text: &str) -> Result<Duration, String> {
    let number = text.parse::<f64>().ok().filter(|s| (0.0..=1e9).contains(s));
    number.map(Duration::from_secs_f64).ok_or_else(|| "write a number of seconds from 0 to 1e9".to_owned())
}
