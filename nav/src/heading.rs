//! No heading at all: a bank of filters with different headings, weighed by how well each predicts the fixes.
//!
//! As the Gaussian-sum yaw estimators of PX4 and ArduPilot do, but with the full filter in every member, so that the
//! winner goes on as it is (Alspach & Sorenson 1972 for the weights). Stationary, all members predict alike and
//! keep their weights; motion decides.

use crate::filter::{FixOutcome, Fusion};
use crate::math::{cos, exp, ln, sin};
use crate::rotation::{wrap_pi, yaw_between};
use crate::rss;
use crate::sample::{GnssFix, ImuSample};
use nalgebra::{Matrix3, Vector3};

/// Headings that a search starts with.
pub const MEMBERS: usize = 12;
/// 1-sigma heading of each member: half the spacing, so that the sum is flat.
pub const MEMBER_SIGMA_RAD: f64 = std::f64::consts::PI / MEMBERS as f64;
/// A member below this weight is given up.
const GIVE_UP: f64 = 1e-5;
/// The search ends when this much of the weight lies around the best member …
const DECIDED: f64 = 0.995;
/// … within this angle, rad.
const AROUND: f64 = 0.6;

/// The bank.
#[derive(Debug, Clone)]
pub struct HeadingBank {
    members: Vec<Member>,
}

#[derive(Debug, Clone)]
struct Member {
    fusion: Fusion,
    log_weight: f64,
}

impl HeadingBank {
    /// From filters that differ in heading.
    pub fn new(members: impl IntoIterator<Item = Fusion>) -> Self {
        Self { members: members.into_iter().map(|fusion| Member { fusion, log_weight: 0.0 }).collect() }
    }

    /// Members still in the race.
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// Whether none is left; cannot happen after [`HeadingBank::new`] with at least one.
    pub fn is_empty(&self) -> bool {
        self.members.is_empty()
    }

    /// Takes a sample.
    pub fn push_imu(&mut self, sample: ImuSample) {
        self.members.iter_mut().for_each(|m| m.fusion.push_imu(sample));
    }

    /// Takes a fix.
    pub fn push_fix(&mut self, fix: GnssFix) {
        self.members.iter_mut().for_each(|m| m.fusion.push_fix(fix));
    }

    /// Does this to the filter of every member.
    pub fn for_each(&mut self, mut f: impl FnMut(&mut Fusion)) {
        self.members.iter_mut().for_each(|m| f(&mut m.fusion));
    }

    /// Applies the fixes whose time has come; the outcomes of the best member.
    pub fn poll(&mut self) -> Vec<FixOutcome> {
        let mut outcomes = Vec::new();
        for member in &mut self.members {
            let mut own = Vec::new();
            while let Some(outcome) = member.fusion.poll() {
                member.log_weight += outcome.position.log_likelihood + outcome.velocity.log_likelihood;
                own.push(outcome);
            }
            outcomes.push(own);
        }
        let best = self.best_index();
        let top = self.members.get(best).map_or(0.0, |m| m.log_weight);
        self.members.iter_mut().for_each(|m| m.log_weight -= top);
        let result = if best < outcomes.len() { outcomes.swap_remove(best) } else { Vec::new() };
        self.members.retain(|m| m.log_weight > ln(GIVE_UP) && !m.fusion.filter().has_failed());
        result
    }

    fn best_index(&self) -> usize {
        let by_weight =
            |a: &(usize, &Member), b: &(usize, &Member)| a.1.log_weight.total_cmp(&b.1.log_weight);
        self.members.iter().enumerate().max_by(by_weight).map_or(0, |(i, _)| i)
    }

    /// The best member so far.
    pub fn best(&self) -> Option<&Fusion> {
        self.members.get(self.best_index()).map(|m| &m.fusion)
    }

    /// The same, to be asked for its prediction.
    pub fn best_mut(&mut self) -> Option<&mut Fusion> {
        let at = self.best_index();
        self.members.get_mut(at).map(|m| &mut m.fusion)
    }

    /// Whether the motion has shown that this attitude has the wrong heading: no member near it is left.
    pub fn refutes(&self, c_nb: &Matrix3<f64>) -> bool {
        let off = |m: &Member| yaw_between(c_nb, &m.fusion.filter().nav().c_nb()).abs();
        self.members.iter().all(|m| off(m) > 2.0 * MEMBER_SIGMA_RAD)
    }

    /// The winner, once motion has decided.
    pub fn winner(&self) -> Option<Fusion> {
        let best = self.best()?;
        let reference = best.filter().nav().c_nb();
        let (mut near, mut all) = (0.0, 0.0);
        for m in &self.members {
            let w = exp(m.log_weight);
            all += w;
            if yaw_between(&reference, &m.fusion.filter().nav().c_nb()).abs() < AROUND {
                near += w;
            }
        }
        let settled = best.filter().heading_sigma() < MEMBER_SIGMA_RAD;
        (near > DECIDED * all && settled).then(|| best.clone())
    }

    /// 1-sigma of roll, pitch and heading over all members, rad: what each knows, and how far apart they are (Bar-Shalom, Li & Kirubarajan 2001,
    /// section 1.4.16). In a hover a member with a false heading has a false tilt too, since it holds the autopilot's leaning for a bias.
    pub fn euler_sigma(&self) -> Vector3<f64> {
        let most = std::f64::consts::PI / 3.0_f64.sqrt();
        let Some((reference, best)) =
            self.best().map(|f| (f.filter().nav().c_nb(), f.filter().nav().euler()))
        else {
            return Vector3::repeat(most);
        };
        let (mut s, mut c, mut all, mut square) = (0.0, 0.0, 0.0, Vector3::zeros());
        for m in &self.members {
            let (w, filter) = (exp(m.log_weight), m.fusion.filter());
            let (yaw, off) = (yaw_between(&reference, &filter.nav().c_nb()), filter.nav().euler() - best);
            (s, c, all) = (s + w * sin(yaw), c + w * cos(yaw), all + w);
            let within = filter.euler_sigma();
            square += w * Vector3::new(
                within.x.powi(2) + wrap_pi(off.x).powi(2),
                within.y.powi(2) + off.y.powi(2),
                filter.heading_sigma().powi(2),
            );
        }
        // Circular variance of the heading (Mardia & Jupp 2000, section 3.4.1), at most that of a uniform one.
        let r = (rss(s, c) / all).clamp(1e-9, 1.0);
        let apart = Vector3::new(0.0, 0.0, -2.0 * ln(r));
        (square / all + apart).map(|v| v.sqrt().min(most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;
    use crate::filter::{Filter, Initial};
    use crate::mechanization::NavState;
    use crate::model::Model;
    use crate::rotation::c_nb_from_euler;

    fn filter(roll: f64, yaw: f64) -> Fusion {
        let place = Geodetic::from_degrees(47.0, 8.0, 400.0);
        let initial = Initial {
            t_s: 0.0,
            nav: NavState::from_ned(place, &Vector3::zeros(), &c_nb_from_euler(roll, 0.0, yaw)),
            position_sigma_m: [1.0; 3],
            velocity_sigma_m_per_s: [0.1; 3],
            attitude_sigma_rad: [0.01, 0.01, 0.1],
        };
        Fusion::without_window(Filter::new(&Model::standard(), &initial))
    }

    #[test]
    fn what_members_differ_by_is_in_the_sigma() {
        let bank = HeadingBank::new([filter(0.1, -0.3), filter(-0.1, 0.3)]);
        let sigma = bank.euler_sigma();
        // The best of two that are alike is 0.2 rad of roll away from the other half of the weight.
        assert!((sigma.x - 0.02_f64.sqrt()).abs() < 2e-3, "{sigma}");
        assert!((sigma.y - 0.01).abs() < 1e-3 && (0.3..0.5).contains(&sigma.z), "{sigma}");
    }

    #[test]
    fn a_heading_that_no_member_has_is_refuted() {
        let bank = HeadingBank::new([filter(0.0, 3.0)]);
        let refuted = |yaw: f64| bank.refutes(&c_nb_from_euler(0.1, 0.0, yaw));
        assert!(refuted(0.0) && refuted(1.5) && !refuted(2.8) && !refuted(-3.0));
    }
}
