//! Endpoints over real sockets and a pseudo-terminal.

use super::*;
use crate::link::heartbeat::{HeartbeatSource, heartbeat};
use std::net::Ipv4Addr;
use tokio::net::TcpListener;
use tokio::time::timeout;

const PATIENCE: Duration = Duration::from_secs(20);

fn start(address: &str) -> Links {
    Links::start(&[address.parse().unwrap()], ReceiveClock::start(), &CancellationToken::new())
}

fn beats(n: usize) -> Vec<Frame> {
    let mut voice = HeartbeatSource::new();
    (0..n).map(|_| voice.say(&heartbeat(true))).collect()
}

async fn next(links: &mut Links) -> Frame {
    timeout(PATIENCE, links.next()).await.expect("a frame in time").expect("links run").frame
}

async fn is_up(links: &Links, openings: u64) {
    let mut watch = links.handles()[0].watch();
    timeout(PATIENCE, watch.wait_for(|s| s.up && s.openings >= openings)).await.expect("up in time").unwrap();
}

#[tokio::test]
async fn tcp_reconnects_after_the_other_side_closes() {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let mut links = start(&format!("tcpout:{}", listener.local_addr().unwrap()));
    let frames = beats(2);
    for (k, frame) in frames.iter().enumerate() {
        let (mut socket, _) = timeout(PATIENCE, listener.accept()).await.unwrap().unwrap();
        socket.write_all(frame.raw()).await.unwrap();
        assert_eq!(next(&mut links).await, *frame);
        is_up(&links, k as u64 + 1).await;
        // And the way back.
        links.broadcast(frame);
        let mut back = vec![0; frame.raw().len()];
        timeout(PATIENCE, socket.read_exact(&mut back)).await.unwrap().unwrap();
        assert_eq!(&back[..], &frame.raw()[..]);
    }
    assert_eq!(links.handles()[0].status().framer.frames, 2);
    links.stop().await;
}

#[tokio::test]
async fn a_udp_peer_may_change_its_port() {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let address = free.local_addr().unwrap();
    drop(free);
    let mut links = start(&format!("udpin:{address}"));
    is_up(&links, 1).await;
    for frame in beats(2) {
        let vehicle = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
        vehicle.send_to(frame.raw(), address).await.unwrap();
        assert_eq!(next(&mut links).await, frame);
        links.broadcast(&frame);
        let mut bytes = [0; 300];
        let n = timeout(PATIENCE, vehicle.recv(&mut bytes)).await.unwrap().unwrap();
        assert_eq!(&bytes[..n], &frame.raw()[..]);
    }
    links.stop().await;
}

#[tokio::test]
async fn udp_out_speaks_first_and_hears_the_answer() {
    let station = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let mut links = start(&format!("udpout:{}", station.local_addr().unwrap()));
    is_up(&links, 1).await;
    let frame = beats(1).remove(0);
    links.broadcast(&frame);
    let mut bytes = [0; 300];
    let (n, from) = timeout(PATIENCE, station.recv_from(&mut bytes)).await.unwrap().unwrap();
    station.send_to(&bytes[..n], from).await.unwrap();
    assert_eq!(next(&mut links).await, frame);
    links.stop().await;
}

/// PX4's ground port answers the place that it heard first, for good: a second run has to come from there.
#[tokio::test]
async fn udp_out_comes_from_the_same_port_in_every_run_and_from_another_beside_one() {
    let station = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let address = format!("udpout:{}", station.local_addr().unwrap());
    let from = async || {
        let links = start(&address);
        is_up(&links, 1).await;
        links.broadcast(&beats(1).remove(0));
        let (_, from) = timeout(PATIENCE, station.recv_from(&mut [0; 300])).await.unwrap().unwrap();
        (links, from)
    };
    let (first, port) = from().await;
    let (beside, other) = from().await;
    assert_ne!(port, other);
    first.stop().await;
    beside.stop().await;
    let (again, same) = from().await;
    assert_eq!(port, same);
    again.stop().await;
}

#[tokio::test]
async fn a_serial_port_that_does_not_exist_says_so_and_is_tried_again() {
    let links = start("serial:/dev/gaware-no-such-port:57600");
    let mut watch = links.handles()[0].watch();
    let status = timeout(PATIENCE, watch.wait_for(|s| s.problem.contains("no-such-port")))
        .await
        .unwrap()
        .unwrap()
        .clone();
    assert!(!status.up);
    links.stop().await;
}

#[tokio::test]
async fn a_full_reply_queue_drops_and_counts() {
    let links = start("serial:/dev/gaware-no-such-port:57600");
    let frame = beats(1).remove(0);
    for _ in 0..REPLIES_AHEAD + 10 {
        links.broadcast(&frame);
    }
    assert_eq!(links.handles()[0].dropped(), 10);
    links.stop().await;
}

#[tokio::test]
async fn a_pseudo_terminal_is_a_serial_port() {
    let (mut vehicle, ours) = tokio_serial::SerialStream::pair().unwrap();
    let path = tokio_serial::SerialPort::name(&ours).unwrap();
    let mut links = start(&format!("serial:{path}:57600"));
    is_up(&links, 1).await;
    for frame in beats(3) {
        vehicle.write_all(frame.raw()).await.unwrap();
        assert_eq!(next(&mut links).await, frame);
    }
    links.stop().await;
}

#[tokio::test]
async fn strangers_get_nothing_and_take_nothing_from_the_vehicle() {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let address = free.local_addr().unwrap();
    drop(free);
    let mut links = start(&format!("udpin:{address}"));
    is_up(&links, 1).await;
    let frame = beats(1).remove(0);
    links.follow(frame.system_id);
    let vehicle = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    vehicle.send_to(frame.raw(), address).await.unwrap();
    assert_eq!(next(&mut links).await, frame);
    // One byte each from more strangers than there is space for, and a whole frame of another system.
    let mut strangers = Vec::new();
    for _ in 0..40 {
        let stranger = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
        stranger.send_to(&[0xFD], address).await.unwrap();
        strangers.push(stranger);
    }
    let mut other = HeartbeatSource::new();
    other.belongs_to(frame.system_id + 1);
    let foreign = other.say(&heartbeat(true));
    strangers[0].send_to(foreign.raw(), address).await.unwrap();
    assert_eq!(next(&mut links).await, foreign);
    for _ in 0..5 {
        links.broadcast(&frame);
        let mut bytes = [0; 300];
        let n = timeout(PATIENCE, vehicle.recv(&mut bytes)).await.unwrap().unwrap();
        assert_eq!(&bytes[..n], &frame.raw()[..]);
    }
    // What was sent to the vehicle was sent to no one else.
    for stranger in &strangers {
        assert!(stranger.try_recv(&mut [0; 300]).is_err(), "a stranger was answered");
    }
    links.stop().await;
}

#[test]
fn a_port_that_may_not_be_opened_names_the_group() {
    let denied = io::Error::from(io::ErrorKind::PermissionDenied);
    let text = serial_problem("/dev/ttyUSB0", &denied.into());
    assert!(text.contains("/dev/ttyUSB0") && text.contains("dialout"), "{text}");
}

#[tokio::test]
async fn the_end_of_the_links_is_no_trouble_of_a_link() {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let mut links = start(&format!("tcpout:{}", listener.local_addr().unwrap()));
    let (mut socket, _) = timeout(PATIENCE, listener.accept()).await.unwrap().unwrap();
    is_up(&links, 1).await;
    let status = links.handles()[0].clone();
    // No one reads any more, and a frame comes before the task is stopped.
    links.frames.close();
    socket.write_all(beats(1)[0].raw()).await.unwrap();
    timeout(PATIENCE, links.tasks.wait()).await.expect("the task ends by itself");
    assert_eq!(status.status().problem, "");
}
