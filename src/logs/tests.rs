//! Opening logs: recorded flights where they are at hand, and files that are none.

use super::*;
use crate::timeline::TimeLine;
use gaware_nav::sample::{FixVelocity, Sample};

fn flight(name: &str) -> PathBuf {
    crate::testing::flights().join(name)
}

fn samples(path: &Path) -> (Vec<Sample>, Damage) {
    let mut reader = open(path).unwrap();
    let (mut time, mut samples) = (TimeLine::default(), Vec::new());
    for record in reader.by_ref().filter_map(Result::ok) {
        if let Item::Measurement(measurement) = record.item {
            time.push(&measurement, 0, &mut samples);
        }
    }
    assert_eq!(reader.progress().read_bytes, reader.progress().total_bytes);
    (samples, reader.damage())
}

struct Counts {
    imu_hz: f64,
    fixes: usize,
    attitudes: usize,
    restarts: usize,
    mean_down_g: f64,
}

fn counts(samples: &[Sample]) -> Counts {
    assert!(matches!(
        samples.iter().find(|s| matches!(s, Sample::Stream(_) | Sample::Imu(_))),
        Some(Sample::Stream(_))
    ));
    let imu: Vec<_> =
        samples.iter().filter_map(|s| if let Sample::Imu(i) = s { Some(i) } else { None }).collect();
    assert!(imu.windows(2).all(|w| w[1].t_s > w[0].t_s));
    let mut spacings: Vec<_> = imu.windows(2).map(|w| w[1].t_s - w[0].t_s).collect();
    spacings.sort_by(f64::total_cmp);
    let count = |f: fn(&Sample) -> bool| samples.iter().filter(|s| f(s)).count();
    Counts {
        imu_hz: 1.0 / spacings[spacings.len() / 2],
        fixes: count(|s| matches!(s, Sample::Fix(_))),
        attitudes: count(|s| matches!(s, Sample::Attitude(_))),
        restarts: count(|s| matches!(s, Sample::Restart(_))),
        mean_down_g: imu.iter().map(|s| s.accel.z).sum::<f64>() / imu.len() as f64 / 9.806_65,
    }
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_dataflash_log_gives_full_rate_samples_and_fixes_with_accuracies() {
    let path = flight("sitl_gsens_typical_dither_cut.BIN");
    let (samples, damage) = samples(&path);
    let c = counts(&samples);
    assert!(!damage.any(), "{damage:?}");
    assert!((c.imu_hz - 400.0).abs() < 2.0, "{}", c.imu_hz);
    assert_eq!((c.fixes, c.attitudes, c.restarts), (1050, 1050, 0));
    assert!((-1.5..-0.9).contains(&c.mean_down_g), "{}", c.mean_down_g);
    let full = samples.iter().filter(|s| {
        matches!(s, Sample::Fix(f) if matches!(f.velocity, FixVelocity::Full(_))
            && f.position_sigma_m == Some([0.3, 0.3, 0.3]))
    });
    assert_eq!(full.count(), 1050);
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_dataflash_log_of_an_older_copter_is_read() {
    let path = flight("real_copter_sample.BIN");
    let c = counts(&samples(&path).0);
    assert!(c.imu_hz > 20.0 && c.fixes > 300, "{} Hz, {} fixes", c.imu_hz, c.fixes);
    assert_eq!(c.restarts, 1, "logging paused for ten minutes");
    assert!((-1.1..-0.9).contains(&c.mean_down_g), "{}", c.mean_down_g);
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn px4_logs_give_samples() {
    // The first was flown without GNSS.
    for (name, fixes) in [("real_px4_sample.ulg", 0..1), ("real_px4_ekf_failure.ulg", 300..500)] {
        let path = flight(name);
        let c = counts(&samples(&path).0);
        assert!((90.0..260.0).contains(&c.imu_hz), "{name}: {} Hz", c.imu_hz);
        assert!(
            fixes.contains(&c.fixes) && c.attitudes > 100,
            "{name}: {} fixes, {} attitudes",
            c.fixes,
            c.attitudes
        );
        assert!((-1.3..-0.7).contains(&c.mean_down_g), "{name}: {}", c.mean_down_g);
    }
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn cut_logs_of_autopilots_give_what_they_have() {
    for name in ["real_px4_sample.ulg", "real_copter_sample.BIN"] {
        let path = flight(name);
        let bytes = std::fs::read(path).unwrap();
        let cut = std::env::temp_dir().join(format!("gaware-cut-{}-{name}", std::process::id()));
        std::fs::write(&cut, &bytes[..bytes.len() / 2 + 7]).unwrap();
        let records = open(&cut).unwrap().filter_map(Result::ok).count();
        std::fs::remove_file(&cut).unwrap();
        assert!(records > 1000, "{name}: {records}");
    }
}

#[test]
fn files_that_are_no_logs_are_refused_with_a_sentence() {
    let folder = std::env::temp_dir().join(format!("gaware-nologs-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let message = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        match open(&path) {
            Err(e) => e.to_string(),
            Ok(mut reader) => {
                let error = reader.find_map(Result::err);
                error.expect("an error").to_string()
            }
        }
    };
    assert!(message("a.tlog", b"").contains("is empty"));
    assert!(message("a.txt", b"hello, this is no log at all").contains("unsupported format"));
    assert!(message("b.tlog", b"hello, this is no log at all").contains("no tlog entry"));
    assert!(
        message("a.ulg", b"ULog\x01\x12\x35\x01 and then rubbish, rubbish, rubbish")
            .contains("no ULog entry")
    );
    assert!(
        message("a.bin", b"\xA3\x95\x01 and then rubbish, rubbish, rubbish").contains("no DataFlash entry")
    );
    assert!(message("a.mcap", b"\x89MCAP0\r\nand then rubbish, rubbish, rubbish").contains("no mcap entry"));
    assert!(open(folder.join("missing.tlog")).err().unwrap().to_string().contains("missing.tlog"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn tables_give_means_over_intervals_and_fixes_in_order_of_time() {
    let folder = std::env::temp_dir().join(format!("gaware-tables-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write(
        "imu.csv",
        "t_s,wx,wy,wz,fx,fy,fz\n0.01,0.1,0,0,0,0,-9.8\n0.02,0.2,0,0,0,0,-9.7\n0.03,0.3,0,0,0,0,-9.6\n",
    );
    let fix = "47.0,8.0,500,10,0,-1,1.5,1.5,2.5,0.1,0.1,0.2";
    write("gps.csv", &format!("t,lat,lon,h,vn,ve,vd,a,b,c,d,e,f\n0.02,{fix}\n"));
    write("other.csv", &format!("t,lat,lon,h,vn,ve,vd,a,b,c,d,e,f\n0.005,{fix}\n0.03,{fix}\n"));
    let (all, _) = samples(&folder);
    assert!(matches!(&all[0], Sample::Stream(s) if s.kind == gaware_nav::sample::SampleKind::IntervalMean));
    assert!(matches!(&all[3], Sample::Fix(f) if f.velocity == FixVelocity::Full([10.0, 0.0, -1.0])));
    assert!(matches!(&all[2], Sample::Imu(i) if i.gyro.x == 0.2));
    let (named, _) = samples(&folder.join("other.csv"));
    assert!(matches!(named.last(), Some(Sample::Fix(f)) if f.t_s == 0.03));
    assert_eq!(named.len(), 5, "the fix before the first sample has no time base");
    write("gps.csv", "t,lat\n0.02,47\n");
    let error = open(&folder).err().unwrap().to_string();
    assert!(error.contains("gps.csv, row 1") && error.contains("columns"), "{error}");
    write("gps.csv", "t,lat,lon,h,vn,ve,vd,a,b,c,d,e,f\n0.02,nan,8.0,500,10,0,-1,1.5,1.5,2.5,0.1,0.1,0.2\n");
    assert!(open(&folder).err().unwrap().to_string().contains("not finite"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn bursts_of_damage_in_real_logs_cost_what_they_touch_and_are_reported() {
    for name in ["real_px4_sample.ulg", "real_px4_ekf_failure.ulg", "real_copter_sample.BIN"] {
        let path = flight(name);
        let bytes = std::fs::read(path).unwrap();
        let count = |bytes: &[u8]| {
            let file = std::env::temp_dir().join(format!("gaware-burst-{}-{name}", std::process::id()));
            std::fs::write(&file, bytes).unwrap();
            let mut reader = open(&file).unwrap();
            let n = reader.by_ref().filter(Result::is_ok).count();
            std::fs::remove_file(&file).unwrap();
            (n, reader.damage())
        };
        let (whole, damage) = count(&bytes);
        assert!(!damage.any() || damage.truncated, "{name}: {damage:?}");
        // From a tenth on, behind the definitions: what they lose is lost for the whole log.
        for k in 0..6_usize {
            let at = bytes.len() / 10 * (k + 2) + 131 * k;
            let mut hit = bytes.clone();
            let mut state = 0x2545_f491_u32 + k as u32;
            for byte in &mut hit[at..at + 64] {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *byte = (state >> 24) as u8;
            }
            let (left, damage) = count(&hit);
            assert!(whole - left.min(whole) <= 12, "{name} at {at}: {left} of {whole}, {damage:?}");
            assert!(damage.any() || left == whole, "{name} at {at}: lost without a word");
        }
    }
}

/// Number of values and RMS of each channel, as pymavlink 2.4.50 (`.BIN`) and pyulog (`.ulg`) read them.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn innovations_of_autopilots_own_logs_are_those_of_other_readers() {
    use super::filter::Channel::*;
    let copter = [
        (VelocityNorth, 728, 0.106_741),
        (VelocityEast, 728, 0.158_742),
        (VelocityDown, 728, 0.140_067),
        (PositionNorth, 728, 0.103_635),
        (PositionEast, 728, 0.166_965),
        (PositionDown, 728, 0.319_419),
        (Heading, 728, 0.983_320),
        (VelocityRatio, 728, 0.049_186),
        (PositionRatio, 728, 0.024_501),
        (HeightRatio, 728, 0.018_423),
        (HeadingRatio, 728, 0.023_662),
    ];
    let px4 = [
        (VelocityNorth, 159, 0.487_355),
        (VelocityEast, 159, 0.606_130),
        (VelocityDown, 159, 1.524_930),
        (PositionNorth, 159, 1.241_127),
        (PositionEast, 159, 2.141_898),
        (PositionDown, 159, 0.771_401),
        (Heading, 159, 0.012_319_f64.to_degrees()),
        (HeadingRatio, 159, 0.044_352),
    ];
    for (name, expected) in [("real_copter_sample.BIN", &copter[..]), ("real_px4_ekf_failure.ulg", &px4[..])]
    {
        let values: Vec<(filter::Channel, f64)> = open(flight(name))
            .unwrap()
            .filter_map(|record| match record.unwrap().item {
                Item::Note(LogNote::Filter(values)) => Some(values),
                _ => None,
            })
            .flatten()
            .collect();
        for (channel, count, rms) in expected {
            let of: Vec<f64> = values.iter().filter(|(c, _)| c == channel).map(|(_, v)| *v).collect();
            let found = (of.iter().map(|v| v * v).sum::<f64>() / of.len() as f64).sqrt();
            assert_eq!(of.len(), *count, "{name} {channel:?}");
            assert!((found / rms - 1.0).abs() < 1e-4, "{name} {channel:?}: {found} {rms}");
        }
    }
}
