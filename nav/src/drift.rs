//! How fast the biases drift: filters side by side that differ in nothing but the random walks which they assume.
//!
//! A unit that warms up changes its gyro biases by hundreds of deg/h in minutes, and a filter that assumes constants puts that into tilt, scale
//! factors and G, with sigmas that know nothing of it. Accelerometers that clip, rectify vibration or alias it are off by metres per second
//! squared for seconds, which goes into tilt and gyros. No single walk is right for all units: one that covers a cold start costs a
//! calm unit most of what a flight shows. So the same measurements go to one filter per walk, and the likelihood of their innovations
//! decides which of them is reported (multiple models: Bar-Shalom, Li & Kirubarajan 2001, section 11.6). The evidence is a sum that is
//! bounded from below (Page 1954, "Continuous inspection schemes"), so that a drift that begins after hours is found as soon as one at
//! the start. A filter that falls behind one with a greater walk has put a drift into its other states: it begins anew from the reported
//! one. One that falls behind a smaller walk is only vaguer, and goes on for as long as it takes to follow a drift; then it begins anew as
//! well, so that a shock (a hard landing) costs nothing of what the flight has shown before.

use crate::effects::{BiasWalk, unit};
use crate::filter::{Filter, FixOutcome, Fusion, PassedOver};
use crate::mechanization::NavState;
use crate::model::Model;
use crate::sample::{GnssFix, ImuSample};
use std::collections::VecDeque;

/// Random walks that are tried beside the model's own: gyros, deg/h/√h, and accelerometers, m/s²/√s. Gyros: a good consumer unit, one that
/// warms up, one that is heated, and a step. Factors of four to seven: a walk that is wrong by two costs less than a nat in ten minutes. With
/// three (60, 250, 1000) a step of 1000 deg/h left G 5.5 sigma off and slow drifts a NEES of 1.63 per degree of freedom; with these 3.2 and
/// 1.26 (`gaware study drift`). Accelerometers: one that warms up. At 1 to 2 mg/°C and 20 °C in five minutes roll and pitch of twelve flights made by
/// other means were within 2 sigma in 86 and 74 % of the time without it, in 95 and 98 % with it; where nothing drifts nothing changed, nor did 111 of
/// 112 logs of strangers with a truth (2026-11-30). Then strong vibration, and one that clips: those go with the largest walk of the gyros, which shake
/// as well; with a small one a step of the gyros goes into the accelerometers for seconds (NEES 4.5 after it instead of .9). On 267 gaps of
/// 10 s in the fixes of 108 logs of strangers the velocities within 2 sigma are 92.1 % without these two and 96.8 % with them, the RMS of all
/// in sigmas 1.80 and .92 (`gaware study withheld`, 2026-11-25).
pub const WALKS: [[f64; 2]; 7] =
    [[30.0, 0.0], [120.0, 0.0], [120.0, 0.006], [600.0, 0.0], [4000.0, 0.0], [4000.0, 0.05], [4000.0, 1.0]];
/// Another walk is reported once it is ahead by so many nats. With 4.7 two of four vehicles without any drift were given one, and sigmas of G
/// a third wider; with 7 none of twelve, with 9 slow drifts are found later (NEES 1.51 instead of 1.26; `gaware study drift`).
const AHEAD: f64 = 7.0;
/// Evidence against a walk counts down to this, nats: what a drift that begins must first make up for.
const BEHIND: f64 = -10.0;
/// A filter with a greater walk that is far behind goes on until that walk has made up so much, deg/h: as much as a bias is unknown when
/// power comes on. With the largest walk that takes 10 s. Without an end a hard landing left the elements of G at ±300 deg/h/g after a flight
/// that had shown them to ±25.
const FOLLOWED_DEG_PER_H: f64 = 200.0;
/// Outcomes of a filter that wait for those of the others.
const MOST_WAITING: usize = 64;

/// What a filter made of one fix, as far as it is compared.
#[derive(Debug, Clone, Copy)]
struct Evidence {
    stamp_s: f64,
    /// Rows of position and velocity: filters that took other rows are not compared.
    dof: [usize; 2],
    log_likelihood: f64,
}

impl Evidence {
    fn of(outcome: &FixOutcome) -> Self {
        let groups = [outcome.position, outcome.velocity];
        Self {
            stamp_s: outcome.stamp_s,
            dof: groups.map(|g| g.dof),
            log_likelihood: groups.iter().map(|g| g.log_likelihood).sum(),
        }
    }
}

/// One filter and how far it is ahead of the reported one, nats.
#[derive(Debug, Clone)]
struct Member {
    fusion: Fusion,
    walk: BiasWalk,
    lead: f64,
    waiting: VecDeque<Evidence>,
    /// When it began from the reported one, s.
    since_s: f64,
}

impl Member {
    /// Whether its walk has had the time to follow a drift.
    fn has_followed(&self) -> bool {
        let elapsed_s = self.fusion.filter().t_s() - self.since_s;
        self.walk.gyro * elapsed_s.max(0.0).sqrt() > FOLLOWED_DEG_PER_H * unit::DEG_PER_H.si
    }
}

/// Filters that differ in the walks of their biases.
#[derive(Debug, Clone)]
pub struct DriftBank {
    members: Vec<Member>,
    reported: usize,
    /// Whether accelerometers may be taken for ones that shake.
    shaking: bool,
}

impl DriftBank {
    /// Around a filter. A model without tolerances says what it means: nothing is tried beside it, nor beside one that names a walk of the
    /// gyro biases.
    pub fn new(fusion: Fusion) -> Self {
        let tried = if tries_walks(fusion.filter().model()) { &WALKS[..] } else { &[] };
        let walks = tried
            .iter()
            .map(|[gyro, accel]| BiasWalk { gyro: gyro * unit::DEG_PER_H_PER_RTH.si, accel: *accel });
        let since_s = fusion.filter().t_s();
        let member = |walk: BiasWalk| {
            let mut fusion = fusion.clone();
            fusion.set_walk(walk);
            Member { fusion, walk, lead: 0.0, waiting: VecDeque::new(), since_s }
        };
        let members: Vec<_> = std::iter::once(BiasWalk::default()).chain(walks).map(member).collect();
        // Constants that go on from an earlier stream keep the walk that they were found with.
        let reported = members.iter().position(|m| m.walk == fusion.filter().walk()).unwrap_or(0);
        Self { members, reported, shaking: true }
    }

    /// The reported filter with what it has not reached yet.
    pub fn fusion(&self) -> &Fusion {
        &self.members[self.reported].fusion
    }

    /// The same, to be asked for its prediction.
    pub fn fusion_mut(&mut self) -> &mut Fusion {
        &mut self.members[self.reported].fusion
    }

    /// The random walk of the biases that is reported, beyond the model's own.
    pub fn walk(&self) -> BiasWalk {
        self.members[self.reported].walk
    }

    /// Whether accelerometers may be taken for ones that shake. Not where the only aid is that the vehicle stays at its place: that is an
    /// assumption, which a vehicle that flies must be able to refute.
    pub fn allow_shaking(&mut self, allowed: bool) {
        self.shaking = allowed;
    }

    /// Does the same to every filter.
    pub fn for_each(&mut self, job: impl FnMut(&mut Fusion)) {
        self.members.iter_mut().map(|m| &mut m.fusion).for_each(job);
    }

    /// Takes a sample.
    pub fn push_imu(&mut self, sample: ImuSample) {
        self.for_each(|f| f.push_imu(sample));
    }

    /// Takes a fix.
    pub fn push_fix(&mut self, fix: GnssFix) {
        self.for_each(|f| f.push_fix(fix));
    }

    /// Applies the fixes whose time has come; the outcomes of the reported filter.
    pub fn poll(&mut self) -> Vec<FixOutcome> {
        let mut reported = Vec::new();
        for (k, member) in self.members.iter_mut().enumerate() {
            while let Some(outcome) = member.fusion.poll() {
                if member.waiting.len() == MOST_WAITING {
                    member.waiting.pop_front();
                }
                member.waiting.push_back(Evidence::of(&outcome));
                if k == self.reported {
                    reported.push(outcome);
                }
            }
            member.lead += member.fusion.filter_mut().take_rest_evidence();
        }
        self.compare();
        self.decide();
        reported
    }

    /// The fixes that all filters have taken, in order.
    fn compare(&mut self) {
        while self.members.iter().all(|m| !m.waiting.is_empty()) {
            let fronts = || self.members.iter().filter_map(|m| m.waiting.front());
            let latest = fronts().map(|e| e.stamp_s).fold(f64::NEG_INFINITY, f64::max);
            let alike = |e: &Evidence| e.stamp_s >= latest;
            if fronts().all(alike) {
                let dof = fronts().next().map(|e| e.dof);
                let same = fronts().all(|e| Some(e.dof) == dof);
                for member in &mut self.members {
                    let evidence = member.waiting.pop_front();
                    member.lead += evidence.filter(|_| same).map_or(0.0, |e| e.log_likelihood);
                }
            } else {
                self.members.iter_mut().for_each(|m| {
                    m.waiting.pop_front_if(|e| e.stamp_s < latest);
                });
            }
        }
        let zero = self.members[self.reported].lead;
        self.members.iter_mut().for_each(|m| m.lead -= zero);
    }

    /// Reports another walk where the evidence asks for it, and lets those begin anew that are far behind.
    fn decide(&mut self) {
        let allowed = |m: &Member| self.shaking || m.walk.accel == 0.0;
        let sound = |m: &Member| !m.fusion.filter().has_failed() && !m.fusion.filter().is_lost();
        let best = self
            .members
            .iter()
            .enumerate()
            .filter(|(_, m)| sound(m) && allowed(m))
            .max_by(|a, b| a.1.lead.total_cmp(&b.1.lead));
        let enough = if allowed(&self.members[self.reported]) { AHEAD } else { f64::NEG_INFINITY };
        if let Some((k, ahead)) = best.map(|(k, m)| (k, m.lead)).filter(|(_, lead)| *lead > enough) {
            self.reported = k;
            self.members.iter_mut().for_each(|m| m.lead -= ahead);
        }
        for k in 0..self.members.len() {
            let (far, walk) = (self.members[k].lead < BEHIND, self.members[k].walk);
            let poisoned = walk.gyro < self.walk().gyro || walk.accel < self.walk().accel;
            let again = poisoned || self.members[k].has_followed();
            if k != self.reported && (far && again || !sound(&self.members[k])) {
                let mut fusion = self.fusion().clone();
                let member = &mut self.members[k];
                fusion.set_walk(member.walk);
                member.since_s = fusion.filter().t_s();
                member.fusion = fusion;
            }
            self.members[k].lead = self.members[k].lead.max(BEHIND);
        }
    }

    /// The reported filter at the time of its last fix.
    pub fn filter(&self) -> &Filter {
        self.fusion().filter()
    }

    /// Position, velocity and attitude of the reported filter at the newest sample, with its time, s.
    pub fn predicted_nav(&mut self) -> (f64, NavState) {
        self.fusion_mut().predicted_nav()
    }

    /// Fixes that the reported filter did not use because of their time.
    pub fn passed_over(&self) -> PassedOver {
        self.fusion().passed_over()
    }
}

/// Whether walks are tried beside the model's own.
fn tries_walks(model: &Model) -> bool {
    let names_one = model.effects.iter().any(|s| s.effect.bias_walk(&s.values).gyro > 0.0);
    model.constants_walk().is_some() && !names_one
}
