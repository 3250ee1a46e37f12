//! What the autopilots' own parsers ask and read. ArduPilot at 856c2a19dd, PX4 at fbadd9d76d.

use super::*;
use crate::engine::navigation::LastFix;

const GRAVITY: f64 = 9.806_65;

fn state(t_s: f64) -> Navigation {
    let (roll, yaw): (f64, f64) = (0.3, 1.0);
    let q = nalgebra::UnitQuaternion::from_euler_angles(roll, 0.1, yaw);
    Navigation {
        t_s,
        running: true,
        since_used_fix_s: Some(0.1),
        quaternion: [q.w, q.i, q.j, q.k],
        roll_pitch_yaw_rad: [roll, 0.1, yaw],
        attitude_sigma_rad: [0.002, 0.003, 0.01],
        place_deg_deg_m: [47.3977, 8.5456, 488.25],
        position_sigma_m: [0.8, 0.7, 1.2],
        velocity_ned_m_per_s: [12.0, -3.0, 0.5],
        velocity_sigma_m_per_s: [0.05, 0.06, 0.04],
        acceleration_ned_m_per_s2: [0.1, 0.2, -0.3],
        rate_rad_per_s: [0.01, -0.02, 0.03],
        force_m_per_s2: [0.5, 0.25, -GRAVITY],
        measured_rate_rad_per_s: [0.011, -0.021, 0.031],
        measured_force_m_per_s2: [0.51, 0.26, -9.9],
        temperature_degc: Some(31.5),
        fix: Some(LastFix {
            age_s: 0.1,
            place_deg_deg_m: [47.3978, 8.5457, 489.0],
            velocity_ned_m_per_s: [12.1, -3.1, 0.6],
            position_sigma_m: [0.9, 0.9, 1.5],
            velocity_sigma_m_per_s: [0.1; 3],
        }),
    }
}

/// A device that has followed the filter for long enough.
fn settled() -> Device {
    let mut device = Device::default();
    for k in 0..=20 {
        assert!(device.feed(&state(f64::from(k))).0.is_empty(), "nothing was asked for");
    }
    device
}

fn ask(device: &mut Device, content: &str) -> String {
    answer(device, &String::from_utf8(framed(content)).unwrap())
}

fn answer(device: &mut Device, raw: &str) -> String {
    let sent: Vec<u8> = device
        .receive(raw.as_bytes())
        .into_iter()
        .flat_map(|a| match a {
            Action::Send(bytes) => bytes,
            Action::Baud(_) => Vec::new(),
        })
        .collect();
    String::from_utf8(sent).unwrap()
}

/// The commands of `AP_ExternalAHRS_VectorNav::initialize` (lines 418 to 464) for a model that is no VN-1xx or VN-3xx, at EAHRS_RATE 50,
/// each answered as `decode_latest_term` (line 386) wants it: the same first two terms, no error.
fn as_ardupilot(device: &mut Device) {
    for command in ["VNASY,0", "VNWRG,06,0,1", "VNWRG,06,0,2"] {
        assert_eq!(ask(device, command).as_bytes(), framed(command));
    }
    assert!(ask(device, "VNRRG,01").starts_with("$VNRRG,01,VN-200-GAWARE*"));
    for command in [
        "VNWRG,75,3,16,01,0721",
        "VNWRG,76,3,16,31,0001,0106,0613",
        "VNWRG,77,3,160,49,0003,26B8,0018",
        "VNASY,1",
    ] {
        assert_eq!(ask(device, command).as_bytes(), framed(command));
    }
}

/// Bytes read in order.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (first, rest) = self.0.split_first_chunk().unwrap();
        self.0 = rest;
        *first
    }

    fn floats<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| f64::from(f32::from_le_bytes(self.take())))
    }

    fn doubles(&mut self) -> [f64; 3] {
        std::array::from_fn(|_| f64::from_le_bytes(self.take()))
    }
}

fn close<const N: usize>(found: [f64; N], expected: [f64; N]) {
    assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-5), "{found:?} {expected:?}");
}

/// The content of the messages in a stream, each behind one of these headers and with a right checksum: `check_uart` (line 204).
fn messages<'a>(mut stream: &'a [u8], kinds: &[(&[u8], usize)]) -> Vec<(usize, Reader<'a>)> {
    let mut found = Vec::new();
    while !stream.is_empty() {
        assert_eq!(stream[0], 0xFA);
        let (k, (header, size)) =
            kinds.iter().enumerate().find(|(_, (header, _))| stream[1..].starts_with(header)).unwrap();
        let len = 1 + header.len() + size + 2;
        assert_eq!(ascii::crc16(&stream[1..len]), 0, "over header, content and checksum");
        found.push((k, Reader(&stream[1 + header.len()..len - 2])));
        stream = &stream[len..];
    }
    found
}

/// `VN_IMU_packet`, `VN_INS_ekf_packet`, `VN_INS_gnss_packet` (lines 62, 128, 143) with their sizes.
const ARDUPILOT: [(&[u8], usize); 3] = [
    (&[0x01, 0x21, 0x07], 8 + 4 * 3 * 5 + 4 + 4),
    (&[0x31, 0x01, 0x00, 0x06, 0x01, 0x13, 0x06], 8 + 12 + 16 + 12 + 2 + 24 + 12 + 4 + 4),
    (&[0x49, 0x03, 0x00, 0xB8, 0x26, 0x18, 0x00], 8 + 8 + 2 + 24 + 12 + 12 + 4 + 28 + 2),
];

#[test]
fn ardupilot_reads_what_it_has_asked_for() {
    let mut device = settled();
    as_ardupilot(&mut device);
    let (bytes, mode) = device.feed(&state(21.0));
    assert_eq!(mode, Ok(InsMode::Tracking));
    let mut found = messages(&bytes, &ARDUPILOT);
    assert_eq!(found.iter().map(|(k, _)| *k).collect::<Vec<_>>(), [0, 1, 2]);
    let s = state(21.0);
    let imu = &mut found[0].1;
    assert_eq!(u64::from_le_bytes(imu.take()), 21_000_000_000, "ns");
    close(imu.floats(), s.rate_rad_per_s);
    close(imu.floats(), s.force_m_per_s2);
    close(imu.floats(), s.measured_force_m_per_s2);
    close(imu.floats(), s.measured_rate_rad_per_s);
    close(imu.floats(), [0.0, 0.0, 0.0, 31.5, 0.0]);
    let ekf = &mut found[1].1;
    assert_eq!(u64::from_le_bytes(ekf.take()), 21_000_000_000);
    close(ekf.floats(), [57.295_78, 5.729_578, 17.188_734]);
    // quaternion[3] is its scalar part (line 664).
    let [x, y, z, w] = ekf.floats();
    close([w, x, y, z], s.quaternion);
    close(ekf.floats(), [0.572_958, 0.171_887, 0.114_592]);
    assert_eq!(u16::from_le_bytes(ekf.take()), 0b110, "tracking, with a fix");
    assert_eq!(ekf.doubles(), s.place_deg_deg_m);
    close(ekf.floats(), s.velocity_ned_m_per_s);
    close(ekf.floats(), [1.2, 0.06]);
    let gnss = &mut found[2].1;
    assert_eq!(u64::from_le_bytes(gnss.take()), 21_000_000_000);
    assert_eq!(u64::from_le_bytes(gnss.take()), 0, "no GNSS time");
    assert_eq!(gnss.take(), [0, 3], "satellites unknown, a fix with a height");
    assert_eq!(gnss.doubles(), [47.3978, 8.5457, 489.0]);
    close(gnss.floats(), [12.1, -3.1, 0.6]);
    close(gnss.floats(), [0.9, 0.9, 1.5, 0.1]);
    close(gnss.floats(), [99.99_f32.into(); 7]);
    assert_eq!(gnss.take(), [0, 0], "no second receiver");
}

#[test]
fn the_rates_are_those_asked_for_at_any_rate_of_samples() {
    for sample_hz in [50.0, 125.0, 200.0, 333.0] {
        let mut device = settled();
        as_ardupilot(&mut device);
        let mut counts = [0; 3];
        let samples = (10.0 * sample_hz) as u32;
        for k in 0..samples {
            let (bytes, _) = device.feed(&state(30.0 + f64::from(k) / sample_hz));
            messages(&bytes, &ARDUPILOT).iter().for_each(|(k, _)| counts[*k] += 1);
        }
        assert!(
            counts.iter().zip([500, 500, 50]).all(|(n, e): (&i32, i32)| (n - e).abs() <= 2),
            "{sample_hz}: {counts:?}"
        );
    }
}

/// `VectorNav::init` and `configure` (lines 429 and 520), in the words that `libvnc/src/vn/protocol/upack.c` writes: without leading
/// zeros, and with `XX` where no checksum is wanted.
#[test]
fn px4_reads_what_it_has_asked_for() {
    let mut device = settled();
    for (command, expected) in [
        ("VNRRG,01", "VNRRG,01,VN-200-GAWARE"),
        ("VNRRG,02", "VNRRG,02,1"),
        ("VNRRG,35", "VNRRG,35,1,1,1,1"),
        ("VNWRG,35,1,0,1,1", "VNWRG,35,1,0,1,1"),
        ("VNRRG,35", "VNRRG,35,1,0,1,1"),
    ] {
        assert_eq!(ask(&mut device, command).as_bytes(), framed(expected));
    }
    let both = device.receive(&framed("VNWRG,05,921600"));
    assert_eq!(both, [Action::Send(framed("VNWRG,05,921600")), Action::Baud(921_600)]);
    for command in ["$VNWRG,75,2,1,6,1,600*XX\r\n", "$VNWRG,76,2,8,36,1,130,84,613*XX\r\n"] {
        assert!(!answer(&mut device, command).contains("VNERR"), "{command}");
    }
    let crc = ascii::crc16(b"VNWRG,77,2,80,A,1,26B9");
    assert!(!answer(&mut device, &format!("$VNWRG,77,2,80,A,1,26B9*{crc:04X}\r\n")).contains("VNERR"));
    let kinds: [(&[u8], usize); 3] = [
        (&[0x06, 0x01, 0x00, 0x00, 0x06], 8 + 24),
        (
            &[0x36, 0x01, 0x00, 0x30, 0x01, 0x84, 0x00, 0x13, 0x06],
            8 + 4 + 4 + 12 + 16 + 12 + 2 + 24 + 12 + 4 + 4,
        ),
        (&[0x0A, 0x01, 0x00, 0xB9, 0x26], 8 + 8 + 2 + 24 + 12 + 12 + 4 + 28),
    ];
    let (bytes, _) = device.feed(&state(22.0));
    let mut found = messages(&bytes, &kinds);
    assert_eq!(found.len(), 3);
    let s = state(22.0);
    // Accel before AngularRate: bits 9 and 10.
    let imu = &mut found[0].1;
    let _: [u8; 8] = imu.take();
    close(imu.floats(), s.force_m_per_s2);
    close(imu.floats(), s.rate_rad_per_s);
    let ins = &mut found[1].1;
    let _: [u8; 8] = ins.take();
    close(ins.floats(), [31.5, 0.0]);
    close(ins.floats(), [0.0; 3]);
    let [x, y, z, w] = ins.floats();
    close([w, x, y, z], s.quaternion);
    close(ins.floats(), s.acceleration_ned_m_per_s2);
    assert_eq!(u16::from_le_bytes(ins.take()) & 0b11, 2, "mode_tracking");
}

#[test]
fn nothing_is_sent_while_the_estimate_is_unhealthy() {
    let fresh = |change: &dyn Fn(&mut Navigation)| {
        let mut device = settled();
        as_ardupilot(&mut device);
        let mut now = state(21.0);
        change(&mut now);
        let (bytes, mode) = device.feed(&now);
        (bytes.len(), mode)
    };
    assert_eq!(fresh(&|s| s.running = false), (0, Err(Unhealthy::NotRunning)));
    assert_eq!(fresh(&|s| s.attitude_sigma_rad[1] = 0.05), (0, Err(Unhealthy::Uncertain)));
    assert_eq!(fresh(&|s| s.attitude_sigma_rad[2] = 0.2), (0, Err(Unhealthy::Uncertain)));
    assert_eq!(fresh(&|s| s.since_used_fix_s = Some(16.0)), (0, Err(Unhealthy::NoFixes)));
    assert_eq!(fresh(&|s| s.since_used_fix_s = None), (0, Err(Unhealthy::NoFixes)));
    assert_eq!(fresh(&|s| s.velocity_ned_m_per_s[0] = f64::NAN), (0, Err(Unhealthy::NotFinite)));
    // The filter has started anew.
    let mut device = settled();
    as_ardupilot(&mut device);
    assert_eq!(device.feed(&state(3.0)), (Vec::new(), Err(Unhealthy::Settling)));
    assert!(!device.feed(&state(13.5)).0.is_empty());
}

#[test]
fn without_fixes_the_status_says_so_and_the_message_of_the_receiver_stays_away() {
    let mut device = settled();
    as_ardupilot(&mut device);
    let mut now = state(21.0);
    now.since_used_fix_s = Some(3.0);
    let (bytes, mode) = device.feed(&now);
    assert_eq!(mode, Ok(InsMode::FixesLost));
    let mut found = messages(&bytes, &ARDUPILOT);
    assert_eq!(found.iter().map(|(k, _)| *k).collect::<Vec<_>>(), [0, 1]);
    let _: [u8; 8 + 40] = found[1].1.take();
    assert_eq!(u16::from_le_bytes(found[1].1.take()), 0b011, "fixes lost, no fix");
}

#[test]
fn a_pause_is_kept_and_a_message_can_be_switched_off() {
    let mut device = settled();
    as_ardupilot(&mut device);
    ask(&mut device, "VNASY,0");
    assert!(device.feed(&state(21.0)).0.is_empty());
    ask(&mut device, "VNASY,1");
    for register in ["75", "76", "77"] {
        assert!(!ask(&mut device, &format!("VNWRG,{register},0,16,1,1")).contains("VNERR"));
    }
    assert!(device.feed(&state(22.0)).0.is_empty() && device.rates_hz().is_empty());
}

#[test]
fn what_cannot_be_is_refused_with_the_number_of_the_reason() {
    let mut device = settled();
    for (raw, code) in [
        ("$VNRRG,01*00\r\n", 3),
        ("$VNRRG,01\r\n", 3),
        ("$VNTAR*XX\r\n", 4),
        ("$VNWRG,75*XX\r\n", 5),
        ("$VNWRG,75,3*XX\r\n", 5),
        // DeltaTheta is not known here, and there is no eighth group.
        ("$VNWRG,75,3,16,01,0800*XX\r\n", 7),
        ("$VNWRG,75,3,16,80,0001*XX\r\n", 7),
        ("$VNWRG,75,3,16,41,0001*XX\r\n", 7),
        ("$VNWRG,05,1234*XX\r\n", 7),
        ("$VNRRG,99*XX\r\n", 8),
        ("$VNRRG,-1*XX\r\n", 8),
        ("$VNWRG,01,VN-300*XX\r\n", 9),
    ] {
        assert_eq!(answer(&mut device, raw).as_bytes(), framed(&format!("VNERR,{code:02}")), "{raw}");
    }
    assert!(device.rates_hz().is_empty());
}

proptest::proptest! {
    #[test]
    fn rubbish_neither_panics_nor_silences_the_next_command(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..400)) {
        let mut device = Device::default();
        device.receive(&bytes);
        device.receive(b"\r\n");
        proptest::prop_assert!(ask(&mut device, "VNRRG,01").contains("VN-200-GAWARE"));
    }
}
