//! What each kind of stamp does to the samples that follow.

use super::*;
use gaware_nav::earth::Geodetic;
use gaware_nav::sample::FixVelocity;
use nalgebra::Vector3;
use proptest::prelude::*;

#[derive(Default)]
struct Bench {
    time: TimeLine,
    out: Vec<Sample>,
}

fn sample() -> ImuSample {
    ImuSample {
        t_s: 0.0,
        gyro: Vector3::zeros(),
        accel: Vector3::new(0.0, 0.0, -9.8),
        temperature_degc: None,
    }
}

fn fix(height_m: f64) -> GnssFix {
    GnssFix {
        t_s: 0.0,
        position: Geodetic::from_degrees(47.0, 8.0, height_m),
        velocity: FixVelocity::None,
        position_sigma_m: None,
        velocity_sigma_m_per_s: None,
        yaw_rad: None,
    }
}

impl Bench {
    fn new() -> Self {
        let mut bench = Self::default();
        bench.push(Measurement::Stream(ImuStream { message: "A".to_owned(), ..ImuStream::default() }));
        bench
    }

    fn push(&mut self, measurement: Measurement) {
        self.time.push(&measurement, 0, &mut self.out);
    }

    fn imu(&mut self, stamp: Stamp) {
        self.push(Measurement::Imu(stamp, sample()));
    }

    /// Samples every 5 ms.
    fn fly(&mut self, from_us: u64, to_us: u64) {
        (from_us..to_us).step_by(5_000).for_each(|t| self.imu(Stamp::Usec(t)));
    }

    fn fix(&mut self, t_us: u64) {
        self.push(Measurement::Fix(Some(Stamp::Usec(t_us)), fix(500.0)));
    }

    fn times(&self) -> Vec<f64> {
        self.out.iter().filter_map(|s| if let Sample::Imu(i) = s { Some(i.t_s) } else { None }).collect()
    }

    fn restarts(&self) -> Vec<RestartReason> {
        self.out.iter().filter_map(|s| if let Sample::Restart(r) = s { Some(*r) } else { None }).collect()
    }

    fn assert_even(&self, samples: usize) {
        let times = self.times();
        assert_eq!((times.len(), self.restarts()), (samples, vec![]), "{:?}", self.time.counts());
        assert!(times.windows(2).all(|w| (w[1] - w[0] - 0.005).abs() < 1e-6));
        assert_eq!(self.time.imu_gaps(), Gaps::default());
    }
}

#[test]
fn counters_of_32_bits_wrap_without_a_word() {
    let mut bench = Bench::new();
    for k in 0..2000_u32 {
        bench.imu(Stamp::Usec(u64::from((u32::MAX - 5_000_000).wrapping_add(k * 5_000))));
    }
    bench.assert_even(2000);
    let mut bench = Bench::new();
    for k in 0..2000_u32 {
        bench.imu(Stamp::BootMs((u32::MAX - 5_000).wrapping_add(k * 5)));
    }
    bench.assert_even(2000);
}

#[test]
fn a_reboot_is_one_restart_that_loses_no_sample_and_announces_the_stream_again() {
    let mut bench = Bench::new();
    bench.fly(60_000_000, 61_000_000);
    bench.fly(2_000_000, 3_000_000);
    assert_eq!(bench.restarts(), vec![RestartReason::Reboot]);
    assert_eq!(bench.times().len(), 400);
    let stretches = stretches(&bench.out);
    assert_eq!(stretches.iter().map(|s| s.samples.len()).collect::<Vec<_>>(), vec![200, 200]);
    assert!(stretches.iter().all(|s| s.stream.message == "A"));
}

#[test]
fn a_clock_that_is_set_back_by_less_than_a_second_is_a_restart_and_late_samples_are_none() {
    for back_us in [200_000, 500_000, 900_000] {
        let mut bench = Bench::new();
        bench.fly(60_000_000, 61_000_000);
        bench.fly(61_000_000 - back_us, 62_000_000);
        assert_eq!(bench.restarts(), vec![RestartReason::ClockSetBack], "{back_us}");
        let lost = bench.time.counts().imu_backward;
        assert!(lost <= u64::from(BEHIND), "{back_us}: {lost}");
    }
    // Overtaken by up to half a second, in any order.
    let mut bench = Bench::new();
    bench.fly(60_000_000, 61_000_000);
    for k in 0..2000_u64 {
        let late = (k.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) % 100;
        bench.imu(Stamp::Usec(61_000_000 + 5_000 * (k + 100 - late)));
    }
    assert_eq!(bench.restarts(), vec![]);
}

/// Autopilots that reboot begin near zero; nothing else is called a reboot.
#[test]
fn a_clock_that_is_set_back_by_seconds_in_flight_is_no_reboot() {
    for back_us in [2_000_000, 8_000_000, 20_000_000] {
        let mut bench = Bench::new();
        bench.fly(200_000_000, 201_000_000);
        bench.fly(201_000_000 - back_us, 202_000_000);
        assert_eq!(bench.restarts(), vec![RestartReason::ClockSetBack], "{back_us}");
        assert!(bench.time.counts().imu_unconfirmed <= u64::from(BEHIND), "{:?}", bench.time.counts());
    }
}

#[test]
fn frames_that_a_link_delays_by_up_to_two_seconds_are_no_restart() {
    let mut bench = Bench::new();
    bench.fly(60_000_000, 61_000_000);
    let mut frames: Vec<(u64, u64)> = (0..4000_u64)
        .map(|k| {
            let late_us = (k.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 33) % 2_000_000;
            (61_000_000 + 20_000 * k + late_us, 61_000_000 + 20_000 * k)
        })
        .collect();
    frames.sort_unstable();
    frames.iter().for_each(|(_, stamp_us)| bench.imu(Stamp::Usec(*stamp_us)));
    let counts = bench.time.counts();
    assert_eq!(bench.restarts(), vec![]);
    assert_eq!(counts.imu_samples + counts.imu_backward + counts.imu_unconfirmed, 4200, "{counts:?}");
    assert!(bench.times().windows(2).all(|w| w[1] > w[0]));
}

/// Late samples that come in order by chance: among a hundred links two had eight of them in a row.
#[test]
fn late_samples_that_happen_to_come_in_order_are_no_clock_that_was_set_back() {
    for link in 0..100_u64 {
        let mut bench = Bench::new();
        bench.fly(60_000_000, 61_000_000);
        let mut frames: Vec<(u64, u64)> = (0..6000_u64)
            .map(|k| {
                let stamp_us = 61_000_000 + 20_000 * k;
                (stamp_us + scattered((link << 32) + k) % 2_000_000, stamp_us)
            })
            .collect();
        frames.sort_unstable();
        frames.iter().for_each(|(_, stamp_us)| bench.imu(Stamp::Usec(*stamp_us)));
        assert_eq!(bench.restarts(), vec![], "link {link}");
    }
}

/// SplitMix64 (Steele, Lea & Flood 2014): numbers without order.
fn scattered(k: u64) -> u64 {
    let z = k.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[test]
fn a_sensor_that_fails_ends_the_stretch_and_the_next_sample_begins_another() {
    let mut bench = Bench::new();
    bench.fly(60_000_000, 61_000_000);
    bench.time.interrupt(RestartReason::SensorFault, &mut bench.out);
    bench.time.interrupt(RestartReason::SensorFault, &mut bench.out);
    bench.fly(63_000_000, 64_000_000);
    assert_eq!(bench.restarts(), vec![RestartReason::SensorFault]);
    let stretches = stretches(&bench.out);
    assert_eq!(stretches.iter().map(|s| s.samples.len()).collect::<Vec<_>>(), vec![200, 200]);
}

#[test]
fn a_long_silence_is_a_restart_and_a_gap_that_loses_no_samples() {
    let mut bench = Bench::new();
    bench.fly(1_000_000, 2_000_000);
    bench.fly(602_000_000, 603_000_000);
    assert_eq!(bench.restarts(), vec![RestartReason::ClockJump]);
    let gaps = bench.time.imu_gaps();
    assert_eq!((gaps.count, bench.time.imu_lost()), (1, 0));
    assert!((gaps.longest_s - 600.005).abs() < 1e-6, "{gaps:?}");
}

#[test]
fn a_gap_is_counted_with_what_it_cost() {
    let mut bench = Bench::new();
    bench.fly(1_000_000, 2_000_000);
    bench.fly(3_600_000, 5_000_000);
    assert!(bench.restarts().is_empty());
    assert_eq!((bench.times().len(), bench.time.imu_gaps().count, bench.time.imu_lost()), (480, 1, 320));
}

#[test]
fn one_stamp_out_of_place_costs_its_own_sample_wherever_it_comes() {
    for at in [0_usize, 1, 100, 399] {
        for wrong in
            [0, 7_000_000, 1_600_000 + 8_000_000, 4_000_000_000, 1 << 40, u64::MAX, 1_700_000_000_000_000]
        {
            let mut bench = Bench::new();
            for k in 0..400 {
                let t_us = 20_000_000 + 5_000 * k as u64;
                bench.imu(Stamp::Usec(if k == at { wrong } else { t_us }));
            }
            let times = bench.times();
            assert!(
                times.len() >= 398 && bench.restarts().is_empty(),
                "{at} {wrong}: {:?}",
                bench.time.counts()
            );
            assert!(times.windows(2).all(|w| w[1] > w[0] && w[1] - w[0] < 0.011), "{at} {wrong}");
        }
    }
}

#[test]
fn repeated_late_and_impossible_samples_are_counted() {
    let mut bench = Bench::new();
    bench.fly(1_000_000, 2_000_000);
    bench.imu(Stamp::Usec(1_995_000));
    bench.imu(Stamp::Usec(1_990_000));
    for gyro in [f64::NAN, 1e9] {
        bench.push(Measurement::Imu(
            Stamp::Usec(2_000_000),
            ImuSample { gyro: Vector3::repeat(gyro), ..sample() },
        ));
    }
    let counts = *bench.time.counts();
    assert_eq!((counts.imu_duplicates, counts.imu_backward), (1, 1));
    assert_eq!((counts.imu_invalid, counts.imu_implausible), (1, 1));
    bench.fly(2_000_000, 2_100_000);
    bench.assert_even(220);
}

#[test]
fn a_fix_stamped_eight_seconds_ahead_costs_itself_alone() {
    let mut bench = Bench::new();
    for k in 0..50_u64 {
        let t_us = 10_000_000 + 200_000 * k;
        bench.fly(t_us, t_us + 200_000);
        bench.fix(if k == 5 { t_us + 8_000_000 } else { t_us + 100_000 });
    }
    let counts = bench.time.counts();
    assert_eq!((counts.fixes, counts.fix_misplaced), (49, 1));
}

#[test]
fn fixes_in_a_gap_wait_for_the_samples_and_come_in_order() {
    let mut bench = Bench::new();
    bench.fly(1_000_000, 2_000_000);
    (1..=20).for_each(|k| bench.fix(2_000_000 + 200_000 * k));
    bench.fly(6_000_000, 7_000_000);
    let fixes: Vec<f64> =
        bench.out.iter().filter_map(|s| if let Sample::Fix(f) = s { Some(f.t_s) } else { None }).collect();
    assert_eq!(fixes.len(), 20);
    assert!(fixes.windows(2).all(|w| w[1] > w[0]));
}

#[test]
fn a_fix_stamped_eight_seconds_behind_is_out_of_place_and_no_late_one() {
    let mut bench = Bench::new();
    bench.fly(60_000_000, 75_000_000);
    [74_000_000, 66_000_000, 74_200_000].into_iter().for_each(|t| bench.fix(t));
    let counts = bench.time.counts();
    assert_eq!((counts.fixes, counts.fix_backward, counts.fix_misplaced), (2, 0, 1));
}

#[test]
fn fixes_behind_repeated_or_without_a_base_are_counted() {
    let mut bench = Bench::new();
    bench.fix(1_000_000);
    bench.fly(30_000_000, 31_000_000);
    [30_900_000, 30_900_000, 30_700_000, 1_000_000].into_iter().for_each(|t| bench.fix(t));
    // A receiver without a clock.
    (0..3).for_each(|_| bench.push(Measurement::Fix(None, fix(501.0))));
    bench.push(Measurement::Fix(Some(Stamp::Usec(31_000_000)), fix(1e9)));
    let counts = bench.time.counts();
    assert_eq!((counts.fixes, counts.fix_before_imu, counts.fix_duplicates), (2, 1, 3));
    assert_eq!((counts.fix_backward, counts.fix_misplaced, counts.fix_implausible), (1, 1, 1));
}

#[test]
fn a_temperature_that_vanishes_stays_what_it_was_until_a_restart() {
    let mut bench = Bench::new();
    for (k, given) in [Some(30.0), None, Some(31.0), Some(f64::NAN), None].into_iter().enumerate() {
        let stamp = Stamp::Usec(90_000_000 + 5_000 * k as u64);
        bench.push(Measurement::Imu(stamp, ImuSample { temperature_degc: given, ..sample() }));
    }
    bench.fly(1_000_000, 1_010_000);
    let temperature = |s: &Sample| if let Sample::Imu(i) = s { Some(i.temperature_degc) } else { None };
    let found: Vec<Option<f64>> = bench.out.iter().filter_map(temperature).collect();
    assert_eq!(found, [Some(30.0), Some(30.0), Some(31.0), Some(31.0), Some(31.0), None, None]);
}

#[test]
fn another_source_is_a_stretch_of_its_own() {
    let mut bench = Bench::new();
    bench.fly(1_000_000, 2_000_000);
    bench.push(Measurement::Stream(ImuStream { message: "B".to_owned(), ..ImuStream::default() }));
    bench.fly(2_000_000, 3_000_000);
    assert_eq!(bench.restarts(), vec![RestartReason::SourceChange]);
    let names: Vec<String> = stretches(&bench.out).into_iter().map(|s| s.stream.message).collect();
    assert_eq!(names, ["A", "B"]);
}

proptest! {
    /// Whatever is stamped how: time goes forward within a stretch, fixes stay near the samples, and memory is bounded.
    #[test]
    fn any_stamps_give_stretches_in_order(
        stamps in proptest::collection::vec((0_u8..4, any::<u64>(), 0_u64..40_000_000), 1..400),
    ) {
        let mut bench = Bench::new();
        for (k, (kind, any, near)) in stamps.into_iter().enumerate() {
            let t = if k % 7 == 0 { any } else { near };
            match kind {
                0 => bench.fix(t),
                1 => bench.imu(Stamp::BootMs((t / 1000) as u32)),
                2 => bench.push(Measurement::Attitude(Stamp::Usec(t), [0.1, 0.2, f64::from(kind)])),
                _ => bench.fly(near, near + 100_000),
            }
        }
        let (mut now, mut last_fix) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        for sample in &bench.out {
            match sample {
                Sample::Restart(_) => (now, last_fix) = (f64::NEG_INFINITY, f64::NEG_INFINITY),
                Sample::Imu(s) => {
                    prop_assert!(s.t_s > now && (now == f64::NEG_INFINITY || s.t_s - now <= 10.0));
                    now = s.t_s;
                }
                Sample::Fix(f) => {
                    prop_assert!(f.t_s > last_fix);
                    last_fix = f.t_s;
                }
                _ => {}
            }
        }
        prop_assert!(bench.time.waiting.len() <= MAX_WAITING);
    }
}
