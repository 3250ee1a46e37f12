//! The faults of the campaign: what each is, when it happens, and which sentence must reach the pilot.

use super::spoiler::Spoil;
use gaware_sitl::faults::{Fault, LinkFaults};

/// Faults begin here, in mid-flight, s …
pub(super) const FROM_S: f64 = 150.0;
/// … and end here, s.
pub(super) const TO_S: f64 = 210.0;

/// Where a fault is put in.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cause {
    /// The link, both ways.
    Link(LinkFaults),
    /// The autopilot itself.
    Vehicle(Fault),
    /// Its messages.
    Messages(Spoil),
    /// A second autopilot with the same identity joins the link.
    SecondAutopilot,
}

/// One fault of the campaign.
#[derive(Debug, Clone)]
pub(super) struct Case {
    /// Name.
    pub(super) name: &'static str,
    /// What happens, in words.
    pub(super) happens: &'static str,
    pub(super) cause: Cause,
    /// From and to, s after power-on; equal for what happens at once.
    pub(super) span_s: (f64, f64),
    /// One of these must be part of a sentence that the pilot can read; nothing where the fault costs nothing.
    pub(super) reported: &'static [&'static str],
    /// Whether the autopilot sends `HIGHRES_IMU`: then only the wing flies, as PX4 takes its bias off in it.
    pub(super) highres: bool,
}

fn case(name: &'static str, happens: &'static str, cause: Cause, reported: &'static [&'static str]) -> Case {
    Case { name, happens, cause, span_s: (FROM_S, TO_S), reported, highres: false }
}

fn at_once(
    name: &'static str,
    happens: &'static str,
    fault: Fault,
    reported: &'static [&'static str],
) -> Case {
    Case { span_s: (FROM_S, FROM_S), ..case(name, happens, Cause::Vehicle(fault), reported) }
}

fn of_link() -> Vec<Case> {
    let link = LinkFaults::default;
    let none: &[&str] = &[];
    vec![
        case("none", "nothing", Cause::Link(link()), none),
        case("loss-1", "1 % of the frames lost", Cause::Link(LinkFaults { loss: 0.01, ..link() }), none),
        case("loss-5", "5 % of the frames lost", Cause::Link(LinkFaults { loss: 0.05, ..link() }), none),
        case("loss-20", "20 % of the frames lost", Cause::Link(LinkFaults { loss: 0.2, ..link() }), none),
        case(
            "loss-50",
            "50 % of the frames lost",
            Cause::Link(LinkFaults { loss: 0.5, ..link() }),
            &["instead of"],
        ),
        case(
            "duplicates",
            "every second frame twice",
            Cause::Link(LinkFaults { duplicate: 0.5, ..link() }),
            none,
        ),
        case(
            "reordered",
            "20 % of the frames overtaken",
            Cause::Link(LinkFaults { reorder: 0.2, ..link() }),
            none,
        ),
        case(
            "jitter-0.2s",
            "frames late by up to 0.2 s",
            Cause::Link(LinkFaults { jitter_s: 0.2, ..link() }),
            none,
        ),
        case(
            "jitter-2s",
            "frames late by up to 2 s",
            Cause::Link(LinkFaults { jitter_s: 2.0, ..link() }),
            &["out of place"],
        ),
        case(
            "bit-errors",
            "a bit flipped in 20 % of the frames",
            Cause::Link(LinkFaults { corrupt: 0.2, ..link() }),
            none,
        ),
        case(
            "silence-60s",
            "60 s of silence",
            Cause::Link(LinkFaults { loss: 1.0, ..link() }),
            &["link silent"],
        ),
    ]
}

fn of_clocks() -> Vec<Case> {
    let anew: &[&str] = &["starts anew", "aligned anew"];
    let stamps = |spoil| Cause::Messages(spoil);
    vec![
        at_once("reboot", "the autopilot reboots in flight", Fault::Reboot { at_s: FROM_S }, anew),
        at_once(
            "clock-ahead-5s",
            "the autopilot's clock jumps ahead by 5 s",
            Fault::ClockJump { at_s: FROM_S, by_s: 5.0 },
            anew,
        ),
        at_once(
            "clock-ahead-60s",
            "the autopilot's clock jumps ahead by 60 s",
            Fault::ClockJump { at_s: FROM_S, by_s: 60.0 },
            anew,
        ),
        case(
            "clock-and-back-0.5s",
            "the clock is ahead by 0.5 s, then right again",
            stamps(Spoil::Clock(0.5)),
            anew,
        ),
        case(
            "clock-and-back-20s",
            "the clock is ahead by 20 s, then right again",
            stamps(Spoil::Clock(20.0)),
            anew,
        ),
        case(
            "clock-behind-20s",
            "the clock is behind by 20 s, then right again",
            stamps(Spoil::Clock(-20.0)),
            anew,
        ),
        case(
            "fixes-ahead-8s",
            "every fifth fix stamped 8 s ahead",
            stamps(Spoil::FixStamps(8.0)),
            &["out of place"],
        ),
        case(
            "fixes-behind-8s",
            "every fifth fix stamped 8 s behind",
            stamps(Spoil::FixStamps(-8.0)),
            &["out of place"],
        ),
        case(
            "samples-ahead-8s",
            "every fifth inertial sample stamped 8 s ahead",
            stamps(Spoil::InertialStamps(8.0)),
            &["out of place"],
        ),
        case(
            "samples-behind-8s",
            "every fifth inertial sample stamped 8 s behind",
            stamps(Spoil::InertialStamps(-8.0)),
            &["out of place"],
        ),
        case(
            "wrap-32-bit-us",
            "a 32-bit counter of microseconds wraps",
            stamps(Spoil::Wrap { of_us: true, at_s: FROM_S }),
            &[],
        ),
        case(
            "wrap-32-bit-ms",
            "a 32-bit counter of milliseconds wraps",
            stamps(Spoil::Wrap { of_us: false, at_s: FROM_S }),
            &[],
        ),
    ]
}

fn of_sensors() -> Vec<Case> {
    let failed: &[&str] = &["innovation test", "do not change", "its range is exceeded"];
    let stamps = |spoil| Cause::Messages(spoil);
    vec![
        case(
            "gnss-lost",
            "no fix for 60 s",
            Cause::Vehicle(Fault::GnssLoss { from_s: FROM_S, to_s: TO_S }),
            &["no 3-D fix", "no GNSS fix for"],
        ),
        case(
            "gnss-jump-500m",
            "positions 500 m north of the truth",
            stamps(Spoil::Jump(500.0)),
            &["position jump", "innovation test"],
        ),
        case(
            "spoof-position-2m/s",
            "positions drift at 2 m/s, velocities do not",
            stamps(Spoil::Drift { speed: 2.0, with_velocity: false }),
            &["position jump", "innovation test"],
        ),
        case(
            "spoof-2m/s",
            "positions and velocities drift at 2 m/s",
            stamps(Spoil::Drift { speed: 2.0, with_velocity: true }),
            &["position jump", "innovation test"],
        ),
        case("frozen-sensor", "the inertial values freeze", stamps(Spoil::Frozen), failed),
        case("stuck-gyro", "gyro x freezes", stamps(Spoil::StuckGyro), failed),
        case("stuck-accel", "accelerometer y freezes", stamps(Spoil::StuckAccel), failed),
        case(
            "clipped",
            "the values end at 0.5 rad/s and 1.3 g",
            stamps(Spoil::Clipped { rate: 0.5, force: 12.75 }),
            failed,
        ),
        case("rate-halved", "half of the inertial samples", stamps(Spoil::Decimated(2)), &["instead of"]),
        case("rate-tenth", "a tenth of the inertial samples", stamps(Spoil::Decimated(10)), &["instead of"]),
        Case {
            highres: true,
            ..case(
                "source-change",
                "HIGHRES_IMU vanishes and comes back",
                stamps(Spoil::Absent(105)),
                &["inertial samples are taken from"],
            )
        },
        case(
            "second-autopilot",
            "another autopilot with the same id",
            Cause::SecondAutopilot,
            &["same system id"],
        ),
        case("flood-20x", "20 times as many frames, of other components", stamps(Spoil::Flood(20)), &[]),
    ]
}

/// All of them.
pub(super) fn registry() -> Vec<Case> {
    [of_link(), of_clocks(), of_sensors()].concat()
}
