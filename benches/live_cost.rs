//! What a live run costs: `cargo bench --bench live_cost`.
//!
//! A simulated autopilot flies at the speed of the wall clock with 200 inertial samples and 10 fixes a second. First
//! `gaware run` listens as a process of its own with every sink on (recorder, web page with one reader of its events,
//! log lines, telemetry): processor time and peak memory by `/proc`. Then the same run inside this process: the time
//! from sending a datagram until engine and recorder have taken it and a snapshot would show it.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    missing_docs,
    reason = "a bench may panic, as tests do"
)]

use gaware::commands::run::{self, Hooks, RunArgs};
use gaware::engine::{Engine, EngineOptions};
use gaware::link::endpoint::Received;
use gaware::link::frame::Frame;
use gaware::sinks::live::Live;
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig};
use gaware_sitl::scenario::scenario;
use gaware_sitl::shell::{Endpoint, Options, Server};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::UdpSocket;
use tokio::sync::{broadcast, mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Long enough for an average, and for the start to be a small part.
const FLIGHT_S: f64 = 40.0;
/// Measured from here on: the first seconds ask for rates and align.
const SETTLE: Duration = Duration::from_secs(8);
/// Ticks of `/proc/PID/stat` per second (`getconf CLK_TCK`; 100 on every Linux).
const TICKS_PER_S: f64 = 100.0;

fn autopilot() -> Autopilot {
    let mut scenario = scenario("fixed_wing").expect("it is registered");
    scenario.sensors.fix_rate_hz = 10.0;
    Autopilot::playing(AutopilotConfig::default(), &scenario)
}

async fn fly() -> (String, tokio::task::JoinHandle<u64>) {
    let server = Server::bind(&Endpoint::UdpIn("127.0.0.1:0".into())).await.unwrap();
    let address = server.address().to_owned();
    let options = Options { until_s: FLIGHT_S, ..Options::default() };
    let flight = tokio::spawn(async move {
        server.run(autopilot(), options, CancellationToken::new()).await.unwrap().frames
    });
    (address, flight)
}

/// User and system time of a process, s.
fn processor_s(pid: u32) -> (f64, f64) {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    // The name in parentheses may hold blanks; behind it user and system time are the 12th and 13th field.
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    let ticks = |k: usize| fields[k].parse::<f64>().unwrap() / TICKS_PER_S;
    (ticks(11), ticks(12))
}

fn peak_mib(pid: u32) -> f64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap() / 1024.0
}

/// The process, and the address of its page as told on stderr.
fn start(address: &str, folder: &Path) -> (Child, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_gaware"))
        .args(["run", "--connect", address, "--headless", "--json", "--web", "127.0.0.1:0", "--record"])
        .arg(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let page = lines
        .by_ref()
        .map_while(Result::ok)
        .find_map(|l| l.strip_prefix("web page: http://").map(|a| a.trim_end_matches('/').to_owned()));
    std::thread::spawn(move || lines.for_each(drop));
    (child, page.expect("the page's address is told"))
}

/// Reads the page's events, as a browser does, until they end; gives their number.
fn read_events(page: &str) -> std::thread::JoinHandle<usize> {
    let mut stream = TcpStream::connect(page).unwrap();
    write!(stream, "GET /api/v1/events HTTP/1.1\r\nHost: {page}\r\nAccept: text/event-stream\r\n\r\n")
        .unwrap();
    std::thread::spawn(move || {
        let (mut events, mut bytes) = (0, [0; 65536]);
        while let Ok(n @ 1..) = stream.read(&mut bytes) {
            events += bytes[..n].windows(5).filter(|w| w == b"data:").count();
        }
        events
    })
}

async fn process() {
    let folder = std::env::temp_dir().join(format!("gaware-cost-{}", std::process::id()));
    let (address, flight) = fly().await;
    let (mut child, page) = start(&address, &folder);
    let events = read_events(&page);
    tokio::time::sleep(SETTLE).await;
    let (begin, at) = (processor_s(child.id()), Instant::now());
    let frames = flight.await.unwrap();
    let (end, wall_s) = (processor_s(child.id()), at.elapsed().as_secs_f64());
    let peak = peak_mib(child.id());
    child.kill().unwrap();
    child.wait().unwrap();
    let recorded: u64 = fs::read_dir(&folder).unwrap().map(|f| f.unwrap().metadata().unwrap().len()).sum();
    fs::remove_dir_all(&folder).unwrap();
    println!(
        "all sinks on, {wall_s:.0} s: {:.2} % of a core in user code, {:.2} % in the kernel; {peak:.1} MiB at most",
        100.0 * (end.0 - begin.0) / wall_s,
        100.0 * (end.1 - begin.1) / wall_s
    );
    println!("  {frames} frames sent, {} events read, {recorded} bytes recorded", events.join().unwrap());
}

/// Passes datagrams of the vehicle on to the station and back, and notes when each left.
async fn relay(vehicle: String, left: mpsc::UnboundedSender<(Frame, Instant)>) -> String {
    let station_side = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let vehicle_side = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    vehicle_side.connect(vehicle.trim_start_matches("udpout:")).await.unwrap();
    let address = format!("udpout:{}", station_side.local_addr().unwrap());
    tokio::spawn(async move {
        let (mut down, mut up, mut station) = ([0; 2048], [0; 2048], None);
        loop {
            tokio::select! {
                Ok(n) = vehicle_side.recv(&mut down) => if let Some(station) = station {
                    if let Ok(frame) = Frame::parse(bytes::Bytes::copy_from_slice(&down[..n])) {
                        let _ = left.send((frame, Instant::now()));
                    }
                    let _ = station_side.send_to(&down[..n], station).await;
                },
                Ok((n, from)) = station_side.recv_from(&mut up) => {
                    station = Some(from);
                    let _ = vehicle_side.send(&up[..n]).await;
                }
            }
        }
    });
    address
}

#[derive(Debug, clap::Parser)]
struct Cli {
    #[command(flatten)]
    run: RunArgs,
}

async fn latency() {
    let folder = std::env::temp_dir().join(format!("gaware-latency-{}", std::process::id()));
    let (vehicle, flight) = fly().await;
    let (left, mut sent) = mpsc::unbounded_channel();
    let address = relay(vehicle, left).await;
    let line = ["run", "--connect", &address, "--record", folder.to_str().unwrap()];
    let args = <Cli as clap::Parser>::parse_from(line).run;
    let (frames, mut taken) = broadcast::channel::<Received>(1 << 16);
    let (live, _shown) = watch::channel(Arc::new(Live::default()));
    let (_outbox, outbox) = mpsc::channel(16);
    let stop = CancellationToken::new();
    let arrivals = tokio::spawn(async move {
        let mut delays_us = Vec::new();
        while let Ok(received) = taken.recv().await {
            let now = Instant::now();
            // Datagrams keep their order on the loopback; one that was lost is skipped.
            while let Ok((frame, at)) = sent.try_recv() {
                if frame.raw() == received.frame.raw() {
                    delays_us.push(now.duration_since(at).as_secs_f64() * 1e6);
                    break;
                }
            }
        }
        delays_us
    });
    let hooks = Hooks { live, outbox, raw_outbox: mpsc::channel(1).1, mission: None, frames, foxglove: None };
    let ending = stop.clone();
    tokio::spawn(async move {
        let _ = flight.await;
        ending.cancel();
    });
    let make = |model| Engine::new(model, EngineOptions::default());
    let run::Served { pipeline, .. } = run::serve(&args, hooks, stop, make).await.unwrap();
    let begin = Instant::now();
    let shown = (0..100).map(|_| pipeline.snapshot().imu.samples).sum::<u64>();
    let snapshot_us = begin.elapsed().as_secs_f64() * 1e6 / 100.0;
    let mut delays_us = arrivals.await.unwrap();
    delays_us.sort_by(f64::total_cmp);
    let at = |share: f64| delays_us[((delays_us.len() - 1) as f64 * share) as usize];
    println!(
        "datagram to engine and recorder, {} frames: p50 {:.0} µs, p99 {:.0} µs, p99.9 {:.0} µs; a snapshot takes {snapshot_us:.0} µs more ({} samples)",
        delays_us.len(),
        at(0.5),
        at(0.99),
        at(0.999),
        shown / 100
    );
    let _ = fs::remove_dir_all(&folder);
}

fn main() {
    // `cargo test --benches` only wants to know that it builds.
    if std::env::args().any(|a| a == "--test") {
        return;
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(process());
    runtime.block_on(latency());
    runtime.shutdown_background();
}
