//! Serves the scripted flight on the web page, and with `--terminal` on the terminal, without vehicle or engine: to
//! look at both, and for the page's test in a real browser.
//!
//! `web_fixture [--bind ADDR:PORT] [--token TOKEN] [--from SECONDS] [--speed FACTOR] [--freeze] [--commands] [--parameters] [--terminal] [--stops SECONDS]`
//!
//! With `--stops S` the flight stands still every S seconds, first after half of that, until a line arrives on stdin: whoever watches
//! sees every phase, however slow it is.

mod long;
mod script;

use gaware::engine::snapshot::Snapshot;
use gaware::sinks::status::{
    Control, LinkState, LinkView, MissionState, MissionView, ParametersView, RecorderState, RecorderView,
    SinkStatus, VehicleView,
};
use gaware::sinks::terminal::{self, Sources};
use gaware::sinks::web::{self, WebState, access::Token};
use gaware::sinks::{Change, Request};
use std::error::Error;
use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

struct Options {
    bind: String,
    token: Option<String>,
    from_s: f64,
    speed: f64,
    freeze: bool,
    commands: bool,
    terminal: bool,
    long: bool,
    parameters: bool,
    /// Time between stops of the flight, s.
    stops_s: Option<f64>,
}

fn options() -> Result<Options, Box<dyn Error>> {
    let mut o = Options {
        bind: "127.0.0.1:8765".into(),
        token: None,
        from_s: 0.0,
        speed: 1.0,
        freeze: false,
        commands: false,
        terminal: false,
        long: false,
        parameters: false,
        stops_s: None,
    };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or(format!("{arg} needs a value"));
        match arg.as_str() {
            "--bind" => o.bind = value()?,
            "--token" => o.token = Some(value()?),
            "--from" => o.from_s = value()?.parse()?,
            "--speed" => o.speed = value()?.parse()?,
            "--freeze" => o.freeze = true,
            "--commands" => o.commands = true,
            "--long" => o.long = true,
            "--parameters" => o.parameters = true,
            "--terminal" => o.terminal = true,
            "--stops" => o.stops_s = Some(value()?.parse()?),
            other => return Err(format!("unknown option {other}").into()),
        }
    }
    Ok(o)
}

#[tokio::main]
async fn main() -> ExitCode {
    match run().await {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("web_fixture: {e}");
            ExitCode::FAILURE
        }
    }
}

async fn run() -> Result<(), Box<dyn Error>> {
    let options = options()?;
    let status = SinkStatus::new();
    let (tx, rx) = watch::channel(Arc::new(script_of(&options)(options.from_s)));
    let mut state = WebState::new(rx.clone(), Arc::clone(&status));
    if let Some(token) = &options.token {
        state = state.with_token(Token::new(token)?);
    }
    if options.parameters {
        status.set_parameters(ParametersView {
            state: MissionState::Ready,
            name: "autopilot.param".into(),
            values: vec!["GPS1_DELAY_MS 213".into(), "GPS1_POS_X 0.42".into()],
            text: "2 parameters of autopilot.param can be set while the vehicle is disarmed".into(),
        });
    }
    if options.commands {
        let (commands, handler) = mpsc::channel(1);
        tokio::spawn(carry_out(handler));
        state = state.with_commands(commands);
    }
    let listener = TcpListener::bind(&options.bind).await?;
    let shutdown = CancellationToken::new();
    let sources = Sources { snapshots: rx, status: Arc::clone(&status), requests: None };
    let screen = options.terminal.then(|| {
        terminal::spawn(
            sources,
            terminal::Options::from_env(|name| std::env::var(name).ok()),
            shutdown.clone(),
        )
    });
    let screen = screen.transpose()?;
    tokio::spawn(play(tx, status, options, listener.local_addr()?));
    let stop = shutdown.clone();
    tokio::spawn(async move {
        let _ = tokio::signal::ctrl_c().await;
        stop.cancel();
    });
    web::serve(listener, state, shutdown).await?;
    match screen {
        Some(ended) => Ok(ended.await??),
        None => Ok(()),
    }
}

async fn carry_out(mut commands: mpsc::Receiver<Request>) {
    while let Some(Request { change, reply }) = commands.recv().await {
        let _ = reply.send(match change {
            Change::Mission => Ok("12 items uploaded and read back: they agree.".into()),
            Change::Parameters => Err("no parameter on the vehicle was changed: the vehicle is armed".into()),
        });
    }
}

/// The flight of two minutes, or the long one.
fn script_of(o: &Options) -> fn(f64) -> Snapshot {
    if o.long { long::snapshot } else { script::snapshot }
}

async fn play(tx: watch::Sender<Arc<Snapshot>>, status: Arc<SinkStatus>, o: Options, address: SocketAddr) {
    let snapshot = script_of(&o);
    status.set_route(script::route());
    // The minutes before `--from`, so that charts and map begin full.
    let mut t_s = 0.0;
    while t_s < o.from_s {
        tx.send_replace(Arc::new(snapshot(t_s)));
        t_s += script::STEP_S;
        // Slow enough for the page's history to see every one.
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    surroundings(&status, t_s, o.long);
    if !o.terminal {
        println!("listening on http://{address}/");
    }
    let mut ticks =
        tokio::time::interval(Duration::from_secs_f64(script::STEP_S / o.speed.clamp(0.01, 100.0)));
    let mut lines = lines_of_stdin();
    let mut stop_s = o.stops_s.map(|s| ((t_s / s - 0.5).floor() + 1.5) * s);
    // Everything stands still but the clock: a page would call it old otherwise.
    let mut held_s = 0.0;
    loop {
        let held = o.freeze || stop_s.is_some_and(|stop_s| t_s >= stop_s);
        tokio::select! {
            _ = ticks.tick() => {}
            Some(()) = lines.recv(), if held && !o.freeze => {
                stop_s = stop_s.zip(o.stops_s).map(|(at_s, every_s)| at_s + every_s);
                held_s = 0.0;
                continue;
            }
        }
        surroundings(&status, t_s, o.long);
        // While the link is lost nothing new comes.
        if !(o.long && long::link_lost(t_s)) {
            let now = snapshot(t_s);
            tx.send_replace(Arc::new(Snapshot { elapsed_s: now.elapsed_s + held_s, ..now }));
        }
        if held {
            held_s += 1e-4;
        } else {
            t_s += script::STEP_S;
        }
    }
}

/// A message for each line of stdin, by a thread that does not keep the program from ending.
fn lines_of_stdin() -> mpsc::UnboundedReceiver<()> {
    let (sender, receiver) = mpsc::unbounded_channel();
    std::thread::spawn(move || {
        for _ in std::io::stdin().lines().map_while(Result::ok) {
            if sender.send(()).is_err() {
                break;
            }
        }
    });
    receiver
}

fn surroundings(status: &SinkStatus, t_s: f64, long: bool) {
    let lost = long && long::link_lost(t_s);
    status.set_link(LinkView {
        state: if lost { LinkState::Silent } else { LinkState::Up },
        detail: "udpin:0.0.0.0:14550".into(),
        frames: (t_s * 168.0) as u64,
        bytes: (t_s * 7100.0) as u64,
        lost: (t_s / 9.0) as u64,
        bad_crc: 0,
        rate_hz: if lost { 0.0 } else { 168.0 },
    });
    status.set_recorder(RecorderView {
        state: RecorderState::Recording,
        detail: format!("{} items", (t_s * 180.0) as u64),
        bytes: (t_s * 31_000.0) as u64,
        file: "recordings/flight-007.mcap".into(),
    });
    if long {
        status.set_vehicle(long::vehicle(t_s));
        status.set_mission(long::mission(t_s));
    } else {
        status.set_vehicle(VehicleView {
            control: Control::Pilot,
            mode: "FBWA".into(),
            ..VehicleView::default()
        });
        status.set_mission(MissionView { state: MissionState::None, ..MissionView::default() });
    }
}
