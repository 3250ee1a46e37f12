//! How the links of a run are doing, for the screens: rate of frames and silence over all links together. No clock.

use super::status::{LinkState, LinkView};
use crate::link::framer::FramerStats;
use crate::link::status::LinkStatus;

/// A link without a frame for this long is called silent, s.
const SILENT_S: f64 = 3.0;
/// Time between two measurements of the rate, s.
const PERIOD_S: f64 = 1.0;

/// Rate and silence of all links together.
#[derive(Debug, Clone, Copy, Default)]
pub struct LinkMeter {
    frames: u64,
    since_s: f64,
    received_s: f64,
    rate_hz: f64,
}

impl LinkMeter {
    /// The links as they are now; `now_s` counts from the start of the run.
    pub fn view(&mut self, now_s: f64, links: &[LinkStatus]) -> LinkView {
        let sum = |f: fn(&FramerStats) -> u64| links.iter().map(|l| f(&l.framer)).sum::<u64>();
        let frames = sum(|l| l.frames);
        let elapsed_s = now_s - self.since_s;
        if elapsed_s >= PERIOD_S {
            self.rate_hz = frames.saturating_sub(self.frames) as f64 / elapsed_s;
            if frames > self.frames {
                self.received_s = now_s;
            }
            (self.frames, self.since_s) = (frames, now_s);
        }
        let up = links.iter().any(|l| l.up);
        let state = match (up, frames) {
            (_, 0) => LinkState::Connecting,
            (false, _) => LinkState::Down,
            (true, _) if now_s - self.received_s > SILENT_S => LinkState::Silent,
            (true, _) => LinkState::Up,
        };
        let words = links.iter().map(|l| match l.problem.as_str() {
            "" => l.address.to_string(),
            problem => format!("{}: {problem}", l.address),
        });
        LinkView {
            state,
            detail: words.collect::<Vec<_>>().join("; "),
            frames,
            bytes: links.iter().map(|l| l.received_bytes).sum(),
            lost: sum(|l| l.lost),
            bad_crc: sum(|l| l.bad_checksum),
            rate_hz: self.rate_hz,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_that_falls_silent_is_called_so_and_up_again_when_frames_come() {
        let mut link = LinkStatus {
            address: "udpin:127.0.0.1:14550".parse().unwrap(),
            up: true,
            problem: String::new(),
            openings: 1,
            received_bytes: 0,
            framer: FramerStats::default(),
            unsent: 0,
        };
        let mut meter = LinkMeter::default();
        let mut states = Vec::new();
        for second in 0..20_u32 {
            link.framer.frames += if (5..12).contains(&second) { 0 } else { 100 };
            states.push(meter.view(f64::from(second), std::slice::from_ref(&link)).state);
        }
        assert_eq!(states[4], LinkState::Up);
        assert!(states[8..12].iter().all(|s| *s == LinkState::Silent), "{states:?}");
        assert!(states[12..].iter().all(|s| *s == LinkState::Up), "{states:?}");
        link.up = false;
        assert_eq!(meter.view(21.0, std::slice::from_ref(&link)).state, LinkState::Down);
        let nothing = LinkStatus { framer: FramerStats::default(), ..link };
        assert_eq!(LinkMeter::default().view(1.0, &[nothing]).state, LinkState::Connecting);
    }
}
