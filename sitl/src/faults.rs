//! Faults: what a link does to frames, by seed, and what happens to the autopilot, by time. No I/O, no clock.

use crate::noise::{Noise, Purpose};
use std::str::FromStr;

/// What a link does to each frame, in one direction.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LinkFaults {
    /// Probability that a frame is lost.
    pub loss: f64,
    /// Probability that it arrives twice.
    pub duplicate: f64,
    /// Probability that later frames overtake it.
    pub reorder: f64,
    /// Probability that one bit is flipped.
    pub corrupt: f64,
    /// Delay of every frame, s.
    pub delay_s: f64,
    /// Each frame is late by up to this on top, s, evenly spread: frames overtake each other.
    pub jitter_s: f64,
    /// Times in which nothing gets through: from, to, s.
    pub dropouts: Vec<(f64, f64)>,
}

impl LinkFaults {
    /// Whether the link is perfect.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

/// How much later than its turn a reordered frame comes, s, beyond the delay.
const OVERTAKEN_BY_S: f64 = 0.05;

/// One direction of a faulty link: frames in, frames out when their time has come.
#[derive(Debug, Clone)]
pub struct FaultyLink {
    faults: LinkFaults,
    noise: Noise,
    /// Time of arrival, running number, frame.
    waiting: Vec<(f64, u64, Vec<u8>)>,
    count: u64,
}

impl FaultyLink {
    /// A link of this seed; `direction` distinguishes its two directions.
    pub fn new(faults: LinkFaults, seed: u64, direction: u32) -> Self {
        let noise = Noise::numbered(seed, Purpose::Link, direction);
        Self { faults, noise, waiting: Vec::new(), count: 0 }
    }

    /// From now on the link does this to frames; those under way arrive as they were to.
    pub fn set_faults(&mut self, faults: LinkFaults) {
        self.faults = faults;
    }

    /// A frame goes in.
    pub fn push(&mut self, now_s: f64, mut frame: Vec<u8>) {
        let [lost, twice, late, damaged, which] = std::array::from_fn(|_| self.noise.uniform());
        let out = self.faults.dropouts.iter().any(|(from, to)| (*from..*to).contains(&now_s));
        if out || lost < self.faults.loss {
            return;
        }
        let mut at = now_s + self.faults.delay_s;
        if self.faults.jitter_s > 0.0 {
            at += self.faults.jitter_s * self.noise.uniform();
        }
        if twice < self.faults.duplicate {
            self.enqueue(at + 0.5 * OVERTAKEN_BY_S, frame.clone());
        }
        if damaged < self.faults.corrupt && !frame.is_empty() {
            let bit = (which * (frame.len() * 8) as f64) as usize;
            frame[bit / 8] ^= 1 << (bit % 8);
        }
        if late < self.faults.reorder {
            at += OVERTAKEN_BY_S;
        }
        self.enqueue(at, frame);
    }

    fn enqueue(&mut self, at_s: f64, frame: Vec<u8>) {
        self.waiting.push((at_s, self.count, frame));
        self.count += 1;
    }

    /// Frames that have arrived by now, in order of arrival.
    pub fn pop(&mut self, now_s: f64) -> Vec<Vec<u8>> {
        let (mut here, later): (Vec<_>, Vec<_>) = self.waiting.drain(..).partition(|(at, _, _)| *at <= now_s);
        self.waiting = later;
        here.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        here.into_iter().map(|(_, _, frame)| frame).collect()
    }
}

/// Something that happens to the autopilot or its link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// Restarts at this time: boot time goes back to 0, rates are forgotten.
    Reboot {
        /// s.
        at_s: f64,
    },
    /// The autopilot goes on, but its MAVLink instance is stopped and started again (PX4's `mavlink stop`, `mavlink start`): nothing gets through in
    /// between, then its default rates hold, and it denies the rate of a message that it has not sent yet.
    InstanceRestart {
        /// s.
        from_s: f64,
        /// s.
        to_s: f64,
    },
    /// The receiver has no fix.
    GnssLoss {
        /// s.
        from_s: f64,
        /// s.
        to_s: f64,
    },
    /// The autopilot's clock jumps forward.
    ClockJump {
        /// s.
        at_s: f64,
        /// s.
        by_s: f64,
    },
    /// A gimbal shares the link and talks of its own inertial unit.
    Gimbal,
    /// Another ground station turns the inertial stream down.
    RateTheft {
        /// s.
        at_s: f64,
    },
    /// The aircraft has not the power to climb while it circles: a loiter to a higher altitude never ends.
    NoClimbInCircles,
    /// At this item of its mission the autopilot returns, as in a failsafe or by order of its pilot.
    Return {
        /// Number of the item.
        item: usize,
    },
    /// [`LinkFaults::loss`].
    Loss(f64),
    /// [`LinkFaults::duplicate`].
    Duplicate(f64),
    /// [`LinkFaults::reorder`].
    Reorder(f64),
    /// [`LinkFaults::corrupt`].
    Corrupt(f64),
    /// [`LinkFaults::delay_s`].
    Delay(f64),
    /// [`LinkFaults::jitter_s`].
    Jitter(f64),
    /// One of [`LinkFaults::dropouts`].
    Dropout {
        /// s.
        from_s: f64,
        /// s.
        to_s: f64,
    },
}

/// A fault that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "\"{0}\" is no fault; known are reboot@S, instance-restart@S-S, gnss-loss@S-S, clock-jump@S+S, gimbal, no-climb-in-circles, return@ITEM, rate-theft@S, loss=P, \
     duplicate=P, reorder=P, corrupt=P, delay=S, jitter=S, dropout@S-S"
)]
pub struct FaultError(String);

impl FromStr for Fault {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        parse(text).ok_or_else(|| FaultError(text.into()))
    }
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|v: &f64| v.is_finite() && *v >= 0.0)
}

fn parse(text: &str) -> Option<Fault> {
    let span = |at: &str| {
        let (from, to) = at.split_once('-')?;
        let (from_s, to_s) = (number(from)?, number(to)?);
        (from_s < to_s).then_some((from_s, to_s))
    };
    let share = |p: &str| number(p).filter(|p| *p <= 1.0);
    if text == "gimbal" {
        return Some(Fault::Gimbal);
    }
    if text == "no-climb-in-circles" {
        return Some(Fault::NoClimbInCircles);
    }
    if let Some((name, at)) = text.split_once('@') {
        return match name {
            "reboot" => Some(Fault::Reboot { at_s: number(at)? }),
            "return" => at.parse().ok().map(|item| Fault::Return { item }),
            "rate-theft" => Some(Fault::RateTheft { at_s: number(at)? }),
            "instance-restart" => span(at).map(|(from_s, to_s)| Fault::InstanceRestart { from_s, to_s }),
            "gnss-loss" => span(at).map(|(from_s, to_s)| Fault::GnssLoss { from_s, to_s }),
            "dropout" => span(at).map(|(from_s, to_s)| Fault::Dropout { from_s, to_s }),
            "clock-jump" => {
                let (at, by) = at.split_once('+')?;
                Some(Fault::ClockJump { at_s: number(at)?, by_s: number(by)? })
            }
            _ => None,
        };
    }
    let (name, value) = text.split_once('=')?;
    match name {
        "loss" => share(value).map(Fault::Loss),
        "duplicate" => share(value).map(Fault::Duplicate),
        "reorder" => share(value).map(Fault::Reorder),
        "corrupt" => share(value).map(Fault::Corrupt),
        "delay" => number(value).map(Fault::Delay),
        "jitter" => number(value).map(Fault::Jitter),
        _ => None,
    }
}

/// The part of a list of faults that the link does.
pub fn link_faults(faults: &[Fault]) -> LinkFaults {
    let mut link = LinkFaults::default();
    for fault in faults {
        match *fault {
            Fault::Loss(p) => link.loss = p,
            Fault::Duplicate(p) => link.duplicate = p,
            Fault::Reorder(p) => link.reorder = p,
            Fault::Corrupt(p) => link.corrupt = p,
            Fault::Delay(s) => link.delay_s = s,
            Fault::Jitter(s) => link.jitter_s = s,
            Fault::Dropout { from_s, to_s } => link.dropouts.push((from_s, to_s)),
            _ => {}
        }
    }
    link
}

#[cfg(test)]
mod tests {
    use super::*;

    fn send(faults: LinkFaults, frames: u32) -> Vec<Vec<u8>> {
        let mut link = FaultyLink::new(faults, 9, 0);
        let mut out = Vec::new();
        for k in 0..frames {
            let now = f64::from(k) * 0.01;
            link.push(now, k.to_le_bytes().to_vec());
            out.extend(link.pop(now));
        }
        out.extend(link.pop(f64::INFINITY));
        out
    }

    #[test]
    fn a_perfect_link_changes_nothing() {
        let sent: Vec<Vec<u8>> = (0..100u32).map(|k| k.to_le_bytes().to_vec()).collect();
        assert_eq!(send(LinkFaults::default(), 100), sent);
    }

    #[test]
    fn loss_duplication_and_damage_come_as_often_as_said() {
        let lost = send(LinkFaults { loss: 0.2, ..Default::default() }, 5000).len();
        assert!((3900..4100).contains(&lost), "{lost}");
        let twice = send(LinkFaults { duplicate: 0.05, ..Default::default() }, 5000).len();
        assert!((5200..5300).contains(&twice), "{twice}");
        let damaged = send(LinkFaults { corrupt: 0.1, ..Default::default() }, 5000);
        let wrong = damaged.iter().zip(0..5000u32).filter(|(f, k)| **f != k.to_le_bytes()).count();
        assert!((420..580).contains(&wrong), "{wrong}");
    }

    #[test]
    fn delayed_frames_wait_and_reordered_ones_are_overtaken() {
        let mut link = FaultyLink::new(LinkFaults { delay_s: 0.2, ..Default::default() }, 1, 0);
        link.push(0.0, vec![1]);
        assert!(link.pop(0.19).is_empty());
        assert_eq!(link.pop(0.2), vec![vec![1]]);
        let mixed = send(LinkFaults { reorder: 0.1, ..Default::default() }, 500);
        let numbers: Vec<u32> = mixed.iter().map(|f| u32::from_le_bytes([f[0], f[1], f[2], f[3]])).collect();
        assert_eq!(numbers.len(), 500);
        assert!(numbers.windows(2).any(|w| w[0] > w[1]));
    }

    #[test]
    fn jitter_lets_frames_overtake_each_other_and_loses_none() {
        let mixed = send(LinkFaults { jitter_s: 0.5, ..Default::default() }, 500);
        let numbers: Vec<u32> = mixed.iter().map(|f| u32::from_le_bytes([f[0], f[1], f[2], f[3]])).collect();
        assert_eq!(numbers.len(), 500);
        // 10 ms apart: one may be overtaken by those of the next half second and by no others.
        let behind = |(k, n): (usize, &u32)| *n as i64 - k as i64;
        assert!(numbers.iter().enumerate().map(behind).all(|d| d.abs() <= 50));
        assert!(numbers.windows(2).filter(|w| w[0] > w[1]).count() > 100);
    }

    #[test]
    fn nothing_passes_a_dropout() {
        let out = send(LinkFaults { dropouts: vec![(1.0, 2.0)], ..Default::default() }, 300);
        assert_eq!(out.len(), 200);
    }

    #[test]
    fn faults_are_read_from_the_command_line() {
        assert_eq!("reboot@30".parse(), Ok(Fault::Reboot { at_s: 30.0 }));
        assert_eq!("gnss-loss@20-40.5".parse(), Ok(Fault::GnssLoss { from_s: 20.0, to_s: 40.5 }));
        assert_eq!("instance-restart@9-12".parse(), Ok(Fault::InstanceRestart { from_s: 9.0, to_s: 12.0 }));
        assert_eq!("clock-jump@50+10".parse(), Ok(Fault::ClockJump { at_s: 50.0, by_s: 10.0 }));
        assert_eq!("return@7".parse(), Ok(Fault::Return { item: 7 }));
        assert_eq!("loss=0.2".parse(), Ok(Fault::Loss(0.2)));
        for wrong in ["", "loss=2", "loss=nan", "reboot", "dropout@5-3", "gremlin@3", "delay=-1"] {
            assert!(wrong.parse::<Fault>().is_err(), "{wrong}");
        }
    }
}
