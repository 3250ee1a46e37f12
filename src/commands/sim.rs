//! `gaware sim`: a simulated autopilot on UDP, TCP or a pseudo-terminal.

use super::OverwriteArgs;
use super::effects::EffectsArgs;
use crate::outputs::{OutputError, mark};
use clap::{Args, ValueEnum};
use gaware_nav::effects::DRAG;
use gaware_nav::model::Model;
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig, Flavour};
use gaware_sitl::blind;
use gaware_sitl::faults::{Fault, FaultError, link_faults};
use gaware_sitl::scenario::{self, Airframe, InjectError, Scenario};
use gaware_sitl::sensors::Temperature;
use gaware_sitl::shell::{Endpoint, Options, Served, Server, ShellError, Speed};
use std::path::PathBuf;
use tokio_util::sync::CancellationToken;

/// Which autopilot the simulation behaves as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AutopilotKind {
    /// Truncated RAW_IMU, send-time stamps, rate caps.
    Ardupilot,
    /// HIGHRES_IMU without the filter's bias estimate, no RAW_IMU.
    Px4,
}

/// Arguments of `gaware sim`.
#[derive(Debug, Clone, Args)]
pub struct SimArgs {
    /// Flight to fly; a wrong name lists all.
    #[arg(long, default_value = "fixed_wing")]
    pub scenario: String,
    /// Fly the scenario so many times in a row, with a landing after each (fixed_wing…: 340 s each, multirotor: 240 s).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub repeat: Option<u32>,
    /// Address of the simulated link: udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT or pty.
    #[arg(long, default_value = "udpout:127.0.0.1:14550")]
    pub listen: String,
    /// Autopilot to behave as.
    #[arg(long, value_enum, default_value = "ardupilot")]
    pub autopilot: AutopilotKind,
    /// Virtual seconds per second, or max (not over UDP).
    #[arg(long, default_value = "1")]
    pub speed: String,
    /// Seed of all noise and all faults.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// The sensors are what this model says: noise, fixes and effects, each of its given value (default: those of the scenario).
    #[arg(long, value_name = "FILE", conflicts_with = "hide_random")]
    pub model: Option<PathBuf>,
    /// Effects that a user defines, for --model and --hide.
    #[command(flatten)]
    pub effects: EffectsArgs,
    /// Inject an effect into the sensors, values as in a model file: gps_latency=0.3, gps_lever_arm=[0.3,0,-0.1].
    #[arg(long, value_name = "EFFECT=VALUE")]
    pub hide: Vec<String>,
    /// Inject a random sensor error (seeded), or none, into sensors without other errors; only the file of --sealed
    /// names it.
    #[arg(long, value_name = "SEED", requires = "sealed", conflicts_with = "hide")]
    pub hide_random: Option<u64>,
    /// File for the ground truth of --hide-random, a model file.
    #[arg(long, value_name = "FILE", requires = "hide_random")]
    pub sealed: Option<PathBuf>,
    /// Record every frame, sent and received, to this .tlog.
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Something that goes wrong: reboot@30, gnss-loss@20-40, clock-jump@50+10, gimbal, loss=0.1, …
    #[arg(long, value_name = "FAULT")]
    pub fault: Vec<String>,
    /// MAVLink system id.
    #[arg(long, default_value_t = 1)]
    pub system_id: u8,
    /// Hardware id (uid of AUTOPILOT_VERSION); 0: it gives none (default: all simulated vehicles have the same).
    #[arg(long, value_name = "NUMBER")]
    pub uid: Option<u64>,
    /// Main loop, Hz; ArduPilot grants a message 0.8 of it.
    #[arg(long, default_value_t = 400.0, value_name = "HZ")]
    pub loop_rate: f64,
    /// Corner of the two-pole filter over the inertial samples (real vehicles: 20); without, they are unfiltered.
    #[arg(long, value_name = "HZ")]
    pub filter: Option<f64>,
    /// Begin the flight at once instead of waiting for a station's first request.
    #[arg(long)]
    pub no_wait: bool,
    /// Mean wind blowing toward north and east, m/s, for vehicles that fly missions: 3,-2.
    #[arg(long, value_name = "N,E", value_delimiter = ',', num_args = 1, allow_hyphen_values = true)]
    pub wind: Vec<f64>,
    /// End when a vehicle that flies missions has landed.
    #[arg(long)]
    pub until_landed: bool,
    /// End after this much virtual time.
    #[arg(long, value_name = "S")]
    pub until: Option<f64>,
}

/// Why a simulation did not run.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// No such scenario.
    #[error("there is no scenario \"{name}\"; known are {known}")]
    Scenario {
        /// As written.
        name: String,
        /// All names.
        known: String,
    },
    /// A flight that cannot be flown twice.
    #[error("--repeat: scenario \"{0}\" does not end at rest after a flight, so it cannot be flown again")]
    Repeat(String),
    /// A number outside of sense.
    #[error("--{name} {value} is out of range: {wanted}")]
    Range {
        /// Argument.
        name: &'static str,
        /// As written.
        value: f64,
        /// What would do.
        wanted: &'static str,
    },
    /// Not two numbers.
    #[error("--wind takes two numbers, toward north and toward east in m/s: --wind 3,-2")]
    Wind,
    /// A vehicle whose drag is its own.
    #[error("only a multirotor that flies by itself can have another drag: --scenario multirotor")]
    Drag,
    /// A model that cannot be read.
    #[error(transparent)]
    Model(Box<super::CommandError>),
    /// An effect that cannot be injected.
    #[error(transparent)]
    Hide(#[from] InjectError),
    /// The ground truth cannot be written.
    #[error("the ground truth: {0}")]
    Sealed(OutputError),
    /// The recording may not be written there.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A fault that cannot be read.
    #[error(transparent)]
    Fault(#[from] FaultError),
    /// The link or the recording.
    #[error(transparent)]
    Shell(#[from] ShellError),
}

impl SimError {
    /// Whether the arguments were at fault rather than the work (exit status 2 rather than 1).
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Shell(e) => {
                matches!(e, ShellError::Address(_) | ShellError::Speed(_) | ShellError::UdpAtFullSpeed)
            }
            Self::Sealed(e) | Self::Output(e) => e.is_usage(),
            Self::Model(_) => false,
            _ => true,
        }
    }
}

/// A board that warms up in flight, so that effects of temperature have something to go with.
const WARMING: Temperature = Temperature { start_degc: 22.0, end_degc: 47.0, time_constant_s: 110.0 };

/// Takes all effects out of a scenario and puts in what this seed draws, if anything; returns the ground truth.
///
/// Truncation is never drawn: the message itself truncates, so where it comes up nothing is injected.
fn hide_random(scenario: &mut Scenario, seed: u64) -> String {
    let drawn = blind::draw_injected(seed).filter(|s| !s.effect.truncates_samples());
    scenario.model.effects = drawn.iter().cloned().collect();
    scenario.sensors.temperature = Some(WARMING);
    let what = drawn.as_ref().map_or("nothing", |s| s.effect.name());
    format!("# injected: {what}\n{}", blind::ground_truth(drawn.as_ref()))
}

/// The sensors become those of this model; where it says nothing of biases, those of the scenario stay.
fn believe(scenario: &mut Scenario, mut model: Model) {
    let own = &scenario.model.imu;
    if model.imu.gyro_bias == [0.0; 3] && model.imu.accel_bias == [0.0; 3] {
        (model.imu.gyro_bias, model.imu.accel_bias) = (own.gyro_bias, own.accel_bias);
    }
    scenario.model = model;
}

/// What is about to be run.
struct Prepared {
    autopilot: Autopilot,
    endpoint: Endpoint,
    options: Options,
    /// The injected effect, not shown before the flight has been explained.
    sealed: Option<String>,
}

/// Everything the arguments ask for, checked before anything is opened.
fn prepare(args: &SimArgs) -> Result<Prepared, SimError> {
    let mut scenario = scenario::scenario(&args.scenario).ok_or_else(|| SimError::Scenario {
        name: args.scenario.clone(),
        known: scenario::names().collect::<Vec<_>>().join(", "),
    })?;
    if let Some(times) = args.repeat {
        scenario = scenario.repeated(times).ok_or_else(|| SimError::Repeat(args.scenario.clone()))?;
    }
    args.effects.load().map_err(|e| SimError::Model(Box::new(e)))?;
    if let Some(path) = &args.model {
        believe(&mut scenario, super::load_model(path).map_err(|e| SimError::Model(Box::new(e)))?);
    }
    for effect in &args.hide {
        scenario::inject(&mut scenario.model, effect)?;
    }
    let has_drag = scenario.model.effects.iter().any(|s| DRAG.iter().any(|e| e.name() == s.effect.name()));
    if has_drag && (scenario.airframe == Airframe::FixedWing || scenario.vehicle.is_some()) {
        return Err(SimError::Drag);
    }
    let sealed = args.hide_random.map(|seed| hide_random(&mut scenario, seed));
    if let Some(vehicle) = &mut scenario.vehicle {
        vehicle.seed = args.seed;
        if let [north, east] = args.wind[..] {
            vehicle.wind_n_e_m_per_s =
                [within("wind", north, -30.0, 30.0, "30 m/s")?, within("wind", east, -30.0, 30.0, "30 m/s")?];
        }
    }
    if !matches!(args.wind.len(), 0 | 2) {
        return Err(SimError::Wind);
    }
    let faults = args.fault.iter().map(|f| f.parse()).collect::<Result<Vec<Fault>, _>>()?;
    let loop_rate_hz = within("loop-rate", args.loop_rate, 10.0, 2000.0, "10 to 2000 Hz")?;
    let filter_hz = args
        .filter
        .map(|hz| within("filter", hz, 0.1, 0.45 * loop_rate_hz, "0.1 Hz to 0.45 of the loop rate"))
        .transpose()?;
    let until_s = args.until.map_or(Ok(f64::INFINITY), |s| within("until", s, 0.0, 1e7, "0 to 1e7 s"))?;
    let options = Options {
        speed: args.speed.parse()?,
        link_faults: link_faults(&faults),
        seed: args.seed,
        record: args.record.clone(),
        until_s,
        until_landed: args.until_landed,
        ..Options::default()
    };
    let endpoint: Endpoint = args.listen.parse()?;
    if options.speed == Speed::Max && matches!(endpoint, Endpoint::UdpIn(_) | Endpoint::UdpOut(_)) {
        return Err(ShellError::UdpAtFullSpeed.into());
    }
    let config = AutopilotConfig {
        flavour: match args.autopilot {
            AutopilotKind::Ardupilot => Flavour::ArduPilot,
            AutopilotKind::Px4 => Flavour::Px4,
        },
        system_id: args.system_id,
        uid: args.uid.unwrap_or(AutopilotConfig::default().uid),
        loop_rate_hz,
        filter_hz,
        wait_for_station: !args.no_wait,
        // A blind flight is reported in the integers that every board sends, and the truth is not on the wire.
        has_highres_imu: sealed.is_none(),
        has_sim_state: sealed.is_none(),
        faults,
        seed: args.seed,
        ..AutopilotConfig::default()
    };
    Ok(Prepared { autopilot: Autopilot::playing(config, &scenario), endpoint, options, sealed })
}

/// The same while something else may ask for the end, which is `None`: a flight that is repeated for hours takes a second for each time.
async fn prepared(args: &SimArgs, shutdown: &CancellationToken) -> Option<Result<Prepared, SimError>> {
    let (done, prepared) = tokio::sync::oneshot::channel();
    let args = args.clone();
    std::thread::spawn(move || _ = done.send(prepare(&args)));
    tokio::select! {
        () = shutdown.cancelled() => None,
        prepared = prepared => prepared.ok(),
    }
}

fn within(
    name: &'static str,
    value: f64,
    low: f64,
    high: f64,
    wanted: &'static str,
) -> Result<f64, SimError> {
    if (low..=high).contains(&value) { Ok(value) } else { Err(SimError::Range { name, value, wanted }) }
}

/// Runs the simulation until its flight is over or `shutdown` is called. `announce` gets the address that a station
/// connects to, as soon as it is open.
///
/// # Errors
/// When an argument makes no sense, or the link or the recording cannot be opened.
pub async fn run(
    args: &SimArgs,
    announce: impl FnOnce(&str),
    shutdown: CancellationToken,
) -> Result<Served, SimError> {
    let outputs = args.overwrite.outputs(args.model.as_deref());
    args.record.iter().chain(&args.sealed).try_for_each(|path| outputs.check(path))?;
    let Some(prepared) = prepared(args, &shutdown).await else { return Ok(Served::default()) };
    let Prepared { autopilot, endpoint, options, sealed } = prepared?;
    if let (Some(text), Some(path)) = (&sealed, &args.sealed) {
        outputs.write(path, mark::text(text.clone(), mark::Style::Hash)).map_err(SimError::Sealed)?;
    }
    let server = Server::bind(&endpoint).await?;
    announce(server.address());
    Ok(server.run(autopilot, options, shutdown).await?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        sim: SimArgs,
    }

    fn args(line: &str) -> SimArgs {
        Cli::parse_from(std::iter::once("sim").chain(line.split_whitespace())).sim
    }

    #[test]
    fn wrong_arguments_are_explained_in_one_sentence() {
        for (line, said) in [
            ("--scenario moon", "there is no scenario \"moon\"; known are paper, "),
            ("--hide gremlins=1", "there is no effect \"gremlins\""),
            ("--scenario fixed_wing --hide drag_rotor=0.2", "--scenario multirotor"),
            ("--scenario mission_multirotor --hide drag_rotor=0.2", "--scenario multirotor"),
            ("--fault gremlins", "is no fault; known are"),
            ("--listen nowhere", "is an invalid address; write"),
            ("--speed fast", "is no speed"),
            ("--speed max", "UDP loses frames"),
            ("--filter 900", "out of range"),
            ("--scenario paper --repeat 2", "does not end at rest"),
            ("--wind 3", "--wind takes two numbers"),
        ] {
            let error = prepare(&args(line)).err().unwrap();
            assert!(error.to_string().contains(said), "{error}");
            assert!(error.is_usage());
        }
    }

    #[test]
    fn arguments_reach_the_simulation() {
        let line = "--hide gps_latency=0.3 --fault loss=0.2 --fault reboot@9 --speed 5 --until 30 --seed 7";
        let Prepared { autopilot, endpoint, options, .. } = prepare(&args(line)).unwrap();
        assert_eq!(autopilot.model().get("gps_latency").unwrap().values, vec![0.3]);
        assert_eq!(endpoint, Endpoint::UdpOut("127.0.0.1:14550".into()));
        assert_eq!((options.speed, options.until_s, options.seed), (Speed::Times(5.0), 30.0, 7));
        assert_eq!(options.link_faults.loss, 0.2);
    }

    #[test]
    fn what_is_hidden_by_chance_stands_in_the_sealed_text_and_in_the_sensors_alone() {
        let mut hidden = std::collections::BTreeSet::new();
        let scenario = scenario::scenario("bench").unwrap();
        for seed in 0..40 {
            let mut scenario = scenario.clone();
            let sealed = hide_random(&mut scenario, seed);
            let truth = gaware_nav::model::Model::from_toml(&sealed).unwrap();
            let inside = &scenario.model.effects;
            assert_eq!(truth.effects.len(), inside.len(), "{sealed}");
            for (told, real) in truth.effects.iter().zip(inside) {
                assert_eq!(told.effect.name(), real.effect.name());
                assert!(told.values.iter().zip(&real.values).all(|(a, b)| (a - b).abs() <= 1e-9 * b.abs()));
            }
            hidden.insert(inside.first().map(|s| s.effect.name()));
        }
        let prepared = prepare(&args("--scenario bench --hide-random 3 --sealed truth.toml")).unwrap();
        assert_eq!(prepared.autopilot.model().effects.len(), 1, "{:?}", prepared.sealed);
        assert_eq!(prepared.options.seed, 1, "the seed of the noise must not follow from what is hidden");
        assert!(hidden.len() > 8 && hidden.contains(&None), "{hidden:?}");
        assert!(Cli::try_parse_from(["sim", "--hide-random", "1"]).is_err(), "the truth must go somewhere");
        let both = ["sim", "--hide-random", "1", "--sealed", "x", "--hide", "gps_latency=0.1"];
        assert!(Cli::try_parse_from(both).is_err());
    }

    #[tokio::test]
    async fn a_truth_that_cannot_be_sealed_is_not_flown() {
        let args = args("--hide-random 1 --sealed no/such/folder/truth.toml --listen tcpin:127.0.0.1:0");
        let error = run(&args, |_| panic!("it opened a link"), CancellationToken::new()).await.unwrap_err();
        assert!(error.to_string().contains("ground truth") && !error.is_usage(), "{error}");
    }

    #[tokio::test]
    async fn a_repeated_flight_goes_on_after_the_first_landing() {
        let line =
            "--listen tcpin:127.0.0.1:0 --speed 1000 --no-wait --scenario multirotor --repeat 2 --until 250";
        let served = run(&args(line), |_| (), CancellationToken::new()).await.unwrap();
        assert!(served.virtual_s >= 250.0, "{served:?}");
    }

    #[test]
    fn wind_reaches_the_vehicle() {
        let autopilot = prepare(&args("--scenario mission_multirotor --wind -3,2")).unwrap().autopilot;
        assert_eq!(autopilot.vehicle().unwrap().config().wind_n_e_m_per_s, [-3.0, 2.0]);
    }

    #[tokio::test]
    async fn a_simulation_that_nobody_stops_ends_at_its_time() {
        let args = args("--listen tcpin:127.0.0.1:0 --speed 1000 --until 3 --no-wait --scenario bench");
        let mut address = String::new();
        let served = run(&args, |a| address = a.to_owned(), CancellationToken::new()).await.unwrap();
        assert!(address.starts_with("tcpout:127.0.0.1:"));
        assert!(served.virtual_s >= 3.0);
    }

    #[tokio::test]
    async fn who_asks_for_the_end_does_not_wait_for_a_day_of_flights() {
        let (stop, mut announced) = (CancellationToken::new(), false);
        stop.cancel();
        let args = args("--listen tcpin:127.0.0.1:0 --scenario fixed_wing --repeat 12");
        run(&args, |_| announced = true, stop).await.unwrap();
        assert!(!announced);
    }
}
