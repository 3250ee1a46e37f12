//! `gaware airframe fit LOG`: what an airframe really does, from a recorded flight, as an airframe file for planning.

mod measure;

use super::{CommandError, ListenArgs, OverwriteArgs, demo, load_model, output, progress_bar};
use crate::engine::{Engine, EngineOptions};
use crate::logs::{self, Item};
use crate::outputs::mark;
use crate::pipeline::{Consumer, Pipeline};
use gaware_mission::airframe::{Airframe, AirframeError};
use gaware_mission::item::Autopilot;
use gaware_nav::model::Model;
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::{ImuSample, Sample};
use mavlink::dialects::ardupilotmega::MavMessage;
use measure::{Instant, Measured};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Id of `VFR_HUD`, the only common message with an airspeed.
const VFR_HUD: u32 = 74;
/// Spacing of what is kept of a flight, s.
const SPACING_S: f64 = 0.1;
/// Records between two looks at the progress.
const PROGRESS_EVERY: u64 = 4096;

/// Arguments of `airframe`.
#[derive(Debug, Clone, clap::Args)]
pub struct AirframeArgs {
    /// What to do.
    #[command(subcommand)]
    pub action: AirframeAction,
}

/// What can be done.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum AirframeAction {
    /// Fit an airframe to a recorded flight: side force, speeds, bank, roll rate, climb, load peaks.
    Fit(FitArgs),
}

/// Arguments of `airframe fit`.
#[derive(Debug, Clone, clap::Args)]
pub struct FitArgs {
    /// Recorded flight: .tlog, DataFlash .bin, .ulg or a recording of gaware (.mcap).
    pub log: PathBuf,
    /// Airframe whose values stay where the flight measures none (default: quadrotor for a multirotor's flight, small_fixed_wing for any
    /// other). Who flies it is as the log says.
    #[arg(long, value_name = "NAME|FILE")]
    pub airframe: Option<String>,
    /// Write the airframe file here.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Model of the sensors (default: as `replay`).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Why there is no airframe.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// Too little flight.
    #[error("{path}: {seconds:.0} s of flight with a converged attitude, at least {least:.0} s are needed")]
    TooShort {
        /// Log.
        path: PathBuf,
        /// Seconds found.
        seconds: f64,
        /// Seconds needed.
        least: f64,
    },
    /// The file says wings and the flight rotors, or the other way round.
    #[error("{path} is the flight of a {flown}, and {airframe} describes a {described}")]
    Kind {
        /// Log.
        path: PathBuf,
        /// Kind that flew.
        flown: &'static str,
        /// Name of the airframe.
        airframe: String,
        /// Its kind.
        described: &'static str,
    },
    /// What was measured is inconsistent with what was given.
    #[error("the fitted airframe is not valid: {0}; start from a nearer one with --airframe")]
    Airframe(#[from] AirframeError),
}

/// Fits, writes and prints.
///
/// # Errors
/// A log, model or airframe that cannot be read, too little flight, a file that cannot be written.
pub fn run(args: &AirframeArgs) -> Result<(), CommandError> {
    let AirframeAction::Fit(args) = &args.action;
    let inputs = [Some(args.log.as_path()), args.airframe.as_deref().map(Path::new), args.model.as_deref()];
    let outputs = args.overwrite.outputs(inputs.into_iter().flatten());
    args.out.iter().try_for_each(|path| outputs.check(path))?;
    let model = args.model.as_deref().map_or_else(|| Ok(Model::standard()), load_model)?;
    let Flight { steps: flight, kind, autopilot } = read(args, model)?;
    let base = base(args, kind, autopilot)?;
    let seconds = SPACING_S * flight.len() as f64;
    if seconds < measure::LEAST_FLIGHT_S {
        let (path, least) = (args.log.clone(), measure::LEAST_FLIGHT_S);
        return Err(FitError::TooShort { path, seconds, least }.into());
    }
    let measured = measure::all(&flight, base.is_fixed_wing());
    let fitted = measure::apply(&base, &measured).map_err(FitError::from)?;
    if let Some(path) = &args.out {
        let text = file(&fitted, &args.log, seconds)?;
        outputs.write(path, mark::text(text, mark::Style::Hash))?;
    }
    if args.json {
        output::json(&document(&base, &fitted, &measured, seconds))
    } else {
        output::words(|out| print(out, &base, &fitted, &measured, seconds))
    }
}

/// Where the fit begins: an airframe of the kind that flew, flown by the autopilot that flew it.
fn base(
    args: &FitArgs,
    kind: Option<VehicleKind>,
    autopilot: Option<Autopilot>,
) -> Result<Airframe, CommandError> {
    let rotors = kind == Some(VehicleKind::Multirotor);
    let usual = if rotors { "quadrotor" } else { "small_fixed_wing" };
    let base = demo::load_airframe(args.airframe.as_deref().unwrap_or(usual))?;
    if kind.is_some() && base.is_fixed_wing() == rotors {
        let name = |rotors| if rotors { "multirotor" } else { "fixed wing" };
        let (path, airframe) = (args.log.clone(), base.name);
        return Err(FitError::Kind { path, flown: name(rotors), airframe, described: name(!rotors) }.into());
    }
    // What a file says of its own autopilot stays.
    Ok(match autopilot.filter(|a| *a != base.autopilot) {
        Some(autopilot) => base.flown_by(autopilot),
        None => base,
    })
}

fn file(fitted: &Airframe, log: &Path, seconds: f64) -> Result<String, CommandError> {
    // Names of files may hold anything; a comment ends with its line.
    let name: String = log.file_name().unwrap_or_default().to_string_lossy().escape_default().collect();
    let text = fitted.to_toml().map_err(FitError::from)?;
    Ok(format!("# Fitted to {seconds:.0} s of flight in {name} by `gaware airframe fit`.\n{text}"))
}

/// A recorded flight.
struct Flight {
    /// In steps, with the sensors as calibrated at its end.
    steps: Vec<Instant>,
    /// What flew, where the log says so.
    kind: Option<VehicleKind>,
    /// Who flew it.
    autopilot: Option<Autopilot>,
}

fn read(args: &FitArgs, model: Model) -> Result<Flight, CommandError> {
    let mut reader = logs::open(&args.log)?;
    let recorded = logs::mcap::recorded_setup(&args.log).map(|s| s.converter).unwrap_or_default();
    let options = crate::sensors::ConverterOptions {
        source: args.listen.source.or(recorded.source),
        vehicle: args.listen.vehicle.or(recorded.vehicle),
    };
    let log = Log { engine: Engine::new(model, EngineOptions::default()), kept: Vec::new(), sum: None };
    let mut pipeline = Pipeline::new(options, log, f64::INFINITY);
    pipeline.set_autopilot(reader.autopilot());
    let bar = progress_bar(reader.progress().total_bytes, "bytes");
    let mut airspeeds: Vec<(f64, f64)> = Vec::new();
    let mut records = 0_u64;
    while let Some(record) = reader.next() {
        let record = record?;
        pipeline.record(&record);
        if let Item::Frame(frame) = &record.item
            && frame.message_id == VFR_HUD
            && pipeline.converter().vehicle() == Some(frame.system_id)
            && let (Some(t_s), Ok(MavMessage::VFR_HUD(m))) =
                (pipeline.converter().time().now_s(), frame.decode())
        {
            airspeeds.push((t_s, f64::from(m.airspeed)));
        }
        records += 1;
        if records.is_multiple_of(PROGRESS_EVERY) {
            bar.set_position(reader.progress().read_bytes);
        }
    }
    bar.finish_and_clear();
    let known = [Autopilot::ArduPilot, Autopilot::Px4];
    let autopilot = known.into_iter().find(|a| a.key() == pipeline.autopilot());
    let steps = pipeline.engine().instants(&airspeeds);
    let kind = pipeline.vehicle_kind().or(reader.vehicle_kind()).filter(|k| *k != VehicleKind::Unknown);
    Ok(Flight { steps, kind, autopilot })
}

/// The mean of some inertial samples, with attitude and velocity at their end.
#[derive(Debug, Clone)]
struct Kept {
    imu: ImuSample,
    roll_pitch_yaw: [f64; 3],
    velocity_ned: [f64; 3],
}

/// An engine whose flight is kept in steps.
#[derive(Debug)]
struct Log {
    engine: Engine,
    kept: Vec<Kept>,
    /// Sum of the samples since the last step, their number, and when the step began.
    sum: Option<(ImuSample, f64, f64)>,
}

impl Log {
    fn push(&mut self, imu: &ImuSample) {
        let (sum, n, began) = match self.sum.take() {
            Some((sum, n, began)) if imu.t_s >= began && imu.t_s - began < 10.0 * SPACING_S => {
                let (gyro, accel) = (sum.gyro + imu.gyro, sum.accel + imu.accel);
                (ImuSample { gyro, accel, ..*imu }, n + 1.0, began)
            }
            _ => (*imu, 1.0, imu.t_s),
        };
        if imu.t_s - began < SPACING_S {
            self.sum = Some((sum, n, began));
            return;
        }
        if let (Some((_, roll_pitch_yaw)), Some(filter)) = (self.engine.attitude(), self.engine.filter()) {
            let imu = ImuSample { gyro: sum.gyro / n, accel: sum.accel / n, ..sum };
            self.kept.push(Kept { imu, roll_pitch_yaw, velocity_ned: filter.nav().v_n().into() });
        }
    }

    fn instants(&self, airspeeds: &[(f64, f64)]) -> Vec<Instant> {
        let Some(filter) = self.engine.filter() else { return Vec::new() };
        let instant = |kept: &Kept| {
            let motion = filter.calibration().motion(filter.model(), &kept.imu);
            let t_s = kept.imu.t_s;
            let after = airspeeds.partition_point(|(t, _)| *t <= t_s);
            let airspeed = after.checked_sub(1).and_then(|k| airspeeds.get(k)).filter(|(t, _)| t_s - t < 2.0);
            Instant {
                t_s,
                roll: kept.roll_pitch_yaw[0],
                pitch: kept.roll_pitch_yaw[1],
                velocity_ned: kept.velocity_ned.into(),
                rate: motion.rate,
                force: motion.force,
                airspeed: airspeed.map(|(_, v)| *v),
            }
        };
        measure::in_flight(self.kept.iter().map(instant).collect())
    }
}

impl Consumer for Log {
    fn feed(&mut self, sample: &Sample) {
        self.engine.feed(sample);
        match sample {
            Sample::Imu(imu) if imu.t_s.is_finite() => self.push(imu),
            Sample::Restart(_) => self.sum = None,
            _ => {}
        }
    }

    fn attitude(&mut self) -> Option<(f64, [f64; 3])> {
        self.engine.attitude()
    }
}

fn document(base: &Airframe, fitted: &Airframe, measured: &[Measured], seconds: f64) -> Value {
    let rows = measured.iter().map(|m| {
        json!({"key": m.key, "value": m.value, "sigma": m.sigma, "base": m.of(base), "used": m.of(fitted),
            "evidence": m.evidence})
    });
    json!({"schema": "gaware.airframe_fit/1", "flight_s": seconds, "measured": rows.collect::<Vec<_>>(),
        "airframe": fitted})
}

fn print(
    out: &mut String,
    base: &Airframe,
    fitted: &Airframe,
    measured: &[Measured],
    seconds: f64,
) -> std::fmt::Result {
    writeln!(out, "{seconds:.0} s of flight, fitted to {}", base.name)?;
    writeln!(out, "{:>24}{:>11}{:>9}{:>9}{:>9}  evidence", "", "measured", "sigma", "before", "now")?;
    let number = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
    for m in measured {
        writeln!(
            out,
            "{:>24}{:11.3}{:>9}{:>9}{:>9}  {}",
            m.key,
            m.value,
            number(m.sigma),
            number(m.of(base)),
            number(m.of(fitted)),
            m.evidence
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(log: PathBuf) -> FitArgs {
        FitArgs {
            log,
            airframe: None,
            out: None,
            overwrite: OverwriteArgs::default(),
            model: None,
            listen: ListenArgs::default(),
            json: true,
        }
    }

    /// A quadrotor of PX4 fitted to the file of a small wing on ArduPilot was planned for as such.
    #[test]
    fn the_fit_begins_with_what_flew_and_who_flew_it() {
        let args = fit("a.mcap".into());
        let quadrotor = base(&args, Some(VehicleKind::Multirotor), Some(Autopilot::Px4)).expect("shipped");
        assert_eq!((quadrotor.is_fixed_wing(), quadrotor.autopilot), (false, Autopilot::Px4));
        assert_eq!(quadrotor.radius_step_above_255_m, 0.0);
        for (kind, autopilot) in [(None, None), (Some(VehicleKind::FixedWing), Some(Autopilot::ArduPilot))] {
            let wing = base(&args, kind, autopilot).expect("shipped");
            assert_eq!(Some(wing), Airframe::example("small_fixed_wing"));
        }
        let args = FitArgs { airframe: Some("small_fixed_wing".to_owned()), ..args };
        let why = base(&args, Some(VehicleKind::Multirotor), None).expect_err("wings").to_string();
        assert_eq!(why, "a.mcap is the flight of a multirotor, and small fixed wing describes a fixed wing");
    }

    /// ArduPilot's simulated plane slips by about 0.2 g in its turns: 0.178 g at 45° of bank by its own truth.
    #[test]
    fn a_recorded_flight_shows_the_side_force_of_its_turns() {
        let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/small_clean_dither.tlog");
        let flight = read(&fit(log), Model::standard()).expect("a readable flight").steps;
        let measured = measure::all(&flight, true);
        let of = |key: &str| measured.iter().find(|m| m.key == key).map_or(f64::NAN, |m| m.value);
        assert!((of("side_force_g") - 0.178).abs() < 0.03, "{measured:?}");
        assert!(of("load_overshoot") > 1.1, "{measured:?}");
        assert!(of("bank_max_deg") > 45.0 && of("bank_max_deg") < 75.0, "{measured:?}");
        let base = Airframe::example("small_fixed_wing").expect("shipped").with_side_force(0.0, 0.0);
        let fitted = measure::apply(&base, &measured).expect("an airframe that flew");
        let text = file(&fitted, Path::new("a\nb = 1.tlog"), 100.0).expect("plain data");
        assert_eq!(Airframe::from_toml(&text), Ok(fitted));
    }
}
