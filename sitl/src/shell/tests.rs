use super::*;
use crate::autopilot::AutopilotConfig;
use crate::scenario::scenario;
use gaware_wire::frame::encode;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::*;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpStream, UdpSocket};

/// Generous: a loaded machine must not fail a test.
const SOON: Duration = Duration::from_secs(60);

fn autopilot() -> Autopilot {
    Autopilot::playing(AutopilotConfig::default(), &scenario("paper").unwrap())
}

fn request() -> Vec<u8> {
    let header = MavHeader { system_id: 1, component_id: 191, sequence: 0 };
    let command = COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        param1: 105.0,
        param2: 5000.0,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    };
    encode(header, &MavMessage::COMMAND_LONG(command))
}

fn max() -> Options {
    Options { speed: Speed::Max, ..Options::default() }
}

/// `HIGHRES_IMU` samples among these bytes.
fn samples(framer: &mut Framer, bytes: &[u8]) -> usize {
    framer.push(bytes);
    std::iter::from_fn(|| framer.next_message())
        .filter(|(_, m)| matches!(m, MavMessage::HIGHRES_IMU(_)))
        .count()
}

/// Reads until the end, or until the whole flight has come.
async fn read_flight(mut stream: impl tokio::io::AsyncRead + Unpin) -> usize {
    let mut framer = Framer::new();
    let (mut seen, mut buffer) = (0, [0u8; 4096]);
    while seen < 14_000 {
        match tokio::time::timeout(SOON, stream.read(&mut buffer)).await.unwrap() {
            Ok(0) | Err(_) => break,
            Ok(n) => seen += samples(&mut framer, &buffer[..n]),
        }
    }
    assert_eq!(framer.stats().bad_checksum, 0);
    seen
}

#[tokio::test]
async fn a_flight_over_tcp_at_full_speed_loses_nothing() {
    let server = Server::bind(&"tcpin:127.0.0.1:0".parse().unwrap()).await.unwrap();
    let address = server.address().strip_prefix("tcpout:").unwrap().to_owned();
    let serving = tokio::spawn(server.run(autopilot(), max(), CancellationToken::new()));
    let mut station = TcpStream::connect(address).await.unwrap();
    station.write_all(&request()).await.unwrap();
    // 70 s at 200 Hz.
    assert!(read_flight(station).await >= 14_000);
    let served = serving.await.unwrap().unwrap();
    assert!(served.virtual_s >= 70.0);
}

#[tokio::test]
async fn a_flight_over_a_pseudo_terminal_loses_nothing() {
    let server = Server::bind(&Endpoint::Pty).await.unwrap();
    let path = server.address().strip_prefix("serial:").unwrap().strip_suffix(":921600").unwrap().to_owned();
    let serving = tokio::spawn(server.run(autopilot(), max(), CancellationToken::new()));
    let mut station = SerialStream::open(&tokio_serial::new(path, 921_600)).unwrap();
    AsyncWriteExt::write_all(&mut station, &request()).await.unwrap();
    assert!(read_flight(station).await >= 13_990);
    serving.await.unwrap().unwrap();
}

#[tokio::test]
async fn a_flight_inside_the_process_loses_nothing() {
    let (server, mut end) = Server::embedded();
    let serving = tokio::spawn(server.run(autopilot(), max(), CancellationToken::new()));
    end.to_vehicle.send(request()).await.unwrap();
    let (mut framer, mut seen) = (Framer::new(), 0);
    while let Some(frame) = tokio::time::timeout(SOON, end.frames.recv()).await.unwrap() {
        seen += samples(&mut framer, &frame);
    }
    assert!(seen >= 14_000, "{seen}");
    serving.await.unwrap().unwrap();
}

#[tokio::test]
async fn datagrams_go_out_and_requests_come_back() {
    let station = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let to = format!("udpout:{}", station.local_addr().unwrap());
    let server = Server::bind(&to.parse().unwrap()).await.unwrap();
    let shutdown = CancellationToken::new();
    let options = Options { speed: Speed::Times(10.0), ..Options::default() };
    let serving = tokio::spawn(server.run(autopilot(), options, shutdown.clone()));
    let (mut framer, mut asked, mut seen, mut buffer) = (Framer::new(), false, 0, [0u8; 2048]);
    while seen < 100 {
        let (n, from) = tokio::time::timeout(SOON, station.recv_from(&mut buffer)).await.unwrap().unwrap();
        seen += samples(&mut framer, &buffer[..n]);
        if !asked {
            asked = true;
            station.send_to(&request(), from).await.unwrap();
        }
    }
    shutdown.cancel();
    serving.await.unwrap().unwrap();
}

#[test]
fn virtual_time_keeps_its_pace() {
    let mut clock = VirtualClock::new();
    let mut autopilot = autopilot();
    for _ in 0..2000 {
        let target = clock.advance_by(0.005, 3.0, autopilot.now_s());
        autopilot.step(target);
    }
    assert!((autopilot.now_s() - 30.0).abs() < 0.01, "{}", autopilot.now_s());
}

#[tokio::test]
async fn udp_at_full_speed_is_refused() {
    let server = Server::bind(&"udpin:127.0.0.1:0".parse().unwrap()).await.unwrap();
    let result = server.run(autopilot(), max(), CancellationToken::new()).await;
    assert!(matches!(result, Err(ShellError::UdpAtFullSpeed)));
}

#[tokio::test]
async fn a_recording_holds_what_was_sent() {
    let path = std::env::temp_dir().join(format!("gaware-shell-{}.tlog", std::process::id()));
    let (server, mut end) = Server::embedded();
    let options = Options { record: Some(path.clone()), ..max() };
    let serving = tokio::spawn(server.run(autopilot(), options, CancellationToken::new()));
    // A stream gives any part of any number of frames: two and a half, then the rest of the third.
    let together = [request(), request(), request()].concat();
    let (first, rest) = together.split_at(5 * request().len() / 2);
    end.to_vehicle.send(first.to_vec()).await.unwrap();
    end.to_vehicle.send(rest.to_vec()).await.unwrap();
    let mut sent = Vec::new();
    while let Some(frame) = end.frames.recv().await {
        sent.push(frame);
    }
    serving.await.unwrap().unwrap();
    let recorded = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    let expected: usize = sent.iter().chain(&vec![request(); 3]).map(|f| f.len() + 8).sum();
    assert_eq!(recorded.len(), expected);
    // The requests were the first thing on the wire; each is a record of its own.
    let record = request().len() + 8;
    for heard in recorded.chunks(record).take(3) {
        assert_eq!(&heard[8..], &request()[..]);
    }
    assert!(recorded.ends_with(sent.last().unwrap()));
}

#[test]
fn addresses_and_speeds_are_read_or_refused_in_words() {
    assert_eq!(
        "udpout:localhost:14550".parse::<Endpoint>().unwrap(),
        Endpoint::UdpOut("localhost:14550".into())
    );
    for wrong in ["", "pt", "tcpin", "tcpin:1", "ftp:host:1", "udpin:host:99999"] {
        let error = wrong.parse::<Endpoint>().unwrap_err().to_string();
        assert!(error.contains("is an invalid address; write"), "{error}");
    }
    assert_eq!("max".parse::<Speed>().unwrap(), Speed::Max);
    assert!("-2".parse::<Speed>().is_err() && "nan".parse::<Speed>().is_err());
}

use tokio_serial::SerialStream;
