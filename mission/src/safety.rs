//! Is this safe to fly? Every item and every point of the predicted path against fence, heights and the airframe's limits;
//! refusals say which item, where and why.

use crate::airframe::Airframe;
use crate::fence::{Fence, LocalFence, LocalFrame};
use crate::item::{AltitudeReference, Autopilot, MissionItem, command};
use crate::kinematics::Kinematics;
use gaware_nav::math::cos;
use nalgebra::{Vector2, Vector3};
use std::collections::VecDeque;

/// Height that climbs and gusts may cost, m.
const HEIGHT_MARGIN_M: f64 = 3.0;
/// Margin of a multirotor against the fence, m: braking and gusts.
const ROTOR_MARGIN_M: f64 = 8.0;
/// Least margin of a fixed wing, m.
const WING_MARGIN_M: f64 = 20.0;
/// Share of the turn radius in strongest ground speed that autopilots differ by in turning early or late.
const TURN_SHARE: f64 = 0.3;
/// Points of the line down to a landing that are checked.
const LINE_CHECKS: u32 = 50;
/// A roll from one side to the other within this time is one movement, s.
const ROLL_S: f64 = 2.5;
/// Less bank is no turn, rad.
const LEAST_ROLL_RAD: f64 = 0.35;
/// Every so manyth sample is looked at for bank.
const ROLL_THINNING: usize = 4;
/// Most wind, in shares of the cruise speed.
pub const WIND_SHARE: f64 = 0.6;

/// The limits of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// Where it may be flown.
    pub fence: Fence,
    /// Lowest height above home, m.
    pub floor_m: f64,
    /// Highest height above home, m.
    pub ceiling_m: f64,
    /// Velocity of the air, north, east, down, m/s.
    pub wind_ned_m_per_s: [f64; 3],
}

impl Limits {
    /// The wind as a vector.
    pub fn wind(&self) -> Vector3<f64> {
        Vector3::from(self.wind_ned_m_per_s)
    }

    /// Wind over ground, m/s.
    pub fn wind_speed(&self) -> f64 {
        self.wind().xy().norm()
    }

    /// Distance that the predicted path keeps from the fence, m.
    pub fn margin_m(&self, airframe: &Airframe) -> f64 {
        if airframe.is_fixed_wing() {
            let fastest = airframe.speed_cruise_m_per_s + self.wind_speed();
            WING_MARGIN_M.max(TURN_SHARE * airframe.planned_radius_m(fastest))
        } else {
            ROTOR_MARGIN_M
        }
    }
}

/// Why a flight is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Floor above ceiling, or values that are no numbers.
    #[error("floor {floor_m} m and ceiling {ceiling_m} m leave no height to fly in")]
    Band {
        /// m.
        floor_m: f64,
        /// m.
        ceiling_m: f64,
    },
    /// A fence that is none.
    #[error("{0}")]
    Fence(String),
    /// Too much wind.
    #[error("wind of {wind_m_per_s:.1} m/s is more than {limit_m_per_s:.1} m/s, {share} of the cruise speed", share = WIND_SHARE)]
    Wind {
        /// m/s.
        wind_m_per_s: f64,
        /// m/s.
        limit_m_per_s: f64,
    },
    /// An item outside the fence or too close to it.
    #[error("item {item} is {by_m:.0} m too close to the fence or outside it")]
    ItemOutside {
        /// From 1.
        item: usize,
        /// m.
        by_m: f64,
    },
    /// An item below the floor or above the ceiling.
    #[error(
        "item {item} at {height_m:.0} m is not between the floor of {floor_m:.0} m and the ceiling of {ceiling_m:.0} m"
    )]
    ItemHeight {
        /// From 1.
        item: usize,
        /// m.
        height_m: f64,
        /// m.
        floor_m: f64,
        /// m.
        ceiling_m: f64,
    },
    /// Heights that are not counted from home.
    #[error("item {item} counts its altitude from {reference:?}; only heights above home can be checked")]
    Reference {
        /// From 1.
        item: usize,
        /// What it counts from.
        reference: AltitudeReference,
    },
    /// A circle that cannot be held.
    #[error("item {item}: a circle of {radius_m:.0} m cannot be held in this wind, {needed_m:.0} m can")]
    Radius {
        /// From 1.
        item: usize,
        /// m.
        radius_m: f64,
        /// m.
        needed_m: f64,
    },
    /// A speed outside the limits.
    #[error("item {item}: {speed_m_per_s} m/s is not between {min_m_per_s} and {max_m_per_s} m/s")]
    Speed {
        /// From 1.
        item: usize,
        /// m/s.
        speed_m_per_s: f32,
        /// m/s.
        min_m_per_s: f64,
        /// m/s.
        max_m_per_s: f64,
    },
    /// A speed type with side effects.
    #[error(
        "item {item}: speed type {kind} on a fixed wing; ground speed (1) would change ArduPlane's minimum ground speed \
         for good: use airspeed (0)"
    )]
    SpeedType {
        /// From 1.
        item: usize,
        /// As in the item.
        kind: f32,
    },
    /// The predicted path leaves the fence.
    #[error(
        "{t_s:.0} s into the flight the path comes {by_m:.0} m too close to the fence, overshoot and wind included"
    )]
    PathOutside {
        /// s.
        t_s: f64,
        /// m.
        by_m: f64,
    },
    /// The predicted path leaves the heights.
    #[error("{t_s:.0} s into the flight the path is at {height_m:.0} m, outside floor and ceiling")]
    PathHeight {
        /// s.
        t_s: f64,
        /// m.
        height_m: f64,
    },
    /// A roll from bank to bank that ends in more load than the airframe bears.
    #[error(
        "{t_s:.0} s into the flight the roll from {from_deg:.0}° to {to_deg:.0}° of bank peaks at {load:.1} g, the airframe \
         bears {limit:.1} g"
    )]
    Load {
        /// s.
        t_s: f64,
        /// Bank before, deg.
        from_deg: f64,
        /// Bank after, deg.
        to_deg: f64,
        /// Load factor at its peak.
        load: f64,
        /// Load factor of the airframe.
        limit: f64,
    },
    /// A landing that is off the line.
    #[error("{t_s:.0} s into the flight the glide is {off_m:.0} m beside the line to the place of landing")]
    NotAligned {
        /// s.
        t_s: f64,
        /// m.
        off_m: f64,
    },
    /// Nothing safe at the end.
    #[error(
        "the mission does not end in a hold: its last item must be a loiter without end, a return to launch, or the \
         landing of a fixed wing"
    )]
    NoSafeEnd,
    /// Nothing to fly.
    #[error("the mission has no items")]
    Empty,
}

/// Checks against one set of limits.
#[derive(Debug, Clone)]
pub struct Checker<'a> {
    airframe: &'a Airframe,
    limits: &'a Limits,
    frame: LocalFrame,
    fence: LocalFence,
    margin_m: f64,
}

impl<'a> Checker<'a> {
    /// For this airframe in these limits.
    ///
    /// # Errors
    /// Limits that leave nothing to fly in, or too much wind for this airframe.
    pub fn new(airframe: &'a Airframe, limits: &'a Limits, frame: LocalFrame) -> Result<Self, Refusal> {
        let (floor_m, ceiling_m) = (limits.floor_m, limits.ceiling_m);
        let roomy = ceiling_m - floor_m >= 2.0 * HEIGHT_MARGIN_M;
        if !roomy || !floor_m.is_finite() || !ceiling_m.is_finite() {
            return Err(Refusal::Band { floor_m, ceiling_m });
        }
        if let Some(why) = limits.fence.problem() {
            return Err(Refusal::Fence(why));
        }
        let limit_m_per_s = WIND_SHARE * airframe.speed_cruise_m_per_s + 1e-9;
        let wind_m_per_s = limits.wind_speed();
        if wind_m_per_s.is_nan() || wind_m_per_s > limit_m_per_s {
            return Err(Refusal::Wind { wind_m_per_s, limit_m_per_s });
        }
        let fence = LocalFence::new(&limits.fence, &frame);
        Ok(Self { airframe, limits, frame, fence, margin_m: limits.margin_m(airframe) })
    }

    /// The fence in metres.
    pub fn fence(&self) -> &LocalFence {
        &self.fence
    }

    /// Distance kept from the fence, m.
    pub fn margin_m(&self) -> f64 {
        self.margin_m
    }

    /// How much further than the margin this point is from the fence, m; negative: too close.
    pub fn clearance_at(&self, ne: Vector2<f64>) -> f64 {
        self.fence.clearance(ne) - self.margin_m
    }

    /// Items one by one: place, height, radius at the speed of that moment, speed. They begin at cruise speed.
    ///
    /// # Errors
    /// The first item that breaks a limit.
    pub fn items(&self, items: &[MissionItem]) -> Result<(), Refusal> {
        let mut speed = self.airframe.speed_cruise_m_per_s;
        for (k, item) in items.iter().enumerate() {
            self.item(k + 1, item, speed)?;
            if item.command == command::DO_CHANGE_SPEED && item.params[1] > 0.0 {
                speed = f64::from(item.params[1]);
            }
        }
        Ok(())
    }

    fn item(&self, number: usize, item: &MissionItem, speed: f64) -> Result<(), Refusal> {
        if item.command == command::DO_CHANGE_SPEED {
            return self.speed(number, item);
        }
        if command::has_altitude(item.command) {
            self.height(number, item)?;
        }
        let Some(place) = item.place() else { return Ok(()) };
        let radius = match item.command {
            command::NAV_LOITER_TURNS | command::NAV_LOITER_UNLIM | command::NAV_LOITER_TIME => {
                item.params[2]
            }
            command::NAV_LOITER_TO_ALT => item.params[1],
            _ => 0.0,
        };
        let radius = f64::from(radius.abs());
        self.radius(number, item.command, radius, speed)?;
        let space = self.clearance_at(self.frame.to_local(place)) - radius;
        if space < 0.0 || space.is_nan() {
            return Err(Refusal::ItemOutside { item: number, by_m: -space });
        }
        Ok(())
    }

    fn height(&self, number: usize, item: &MissionItem) -> Result<(), Refusal> {
        let reference = item.frame.altitude_reference();
        if reference != AltitudeReference::Home {
            return Err(Refusal::Reference { item: number, reference });
        }
        let (height_m, floor_m, ceiling_m) = (f64::from(item.z), self.limits.floor_m, self.limits.ceiling_m);
        if !(floor_m..=ceiling_m).contains(&height_m) {
            return Err(Refusal::ItemHeight { item: number, height_m, floor_m, ceiling_m });
        }
        Ok(())
    }

    fn speed(&self, number: usize, item: &MissionItem) -> Result<(), Refusal> {
        let a = self.airframe;
        let [kind, speed, ..] = item.params;
        if a.is_fixed_wing() && kind != 0.0 {
            return Err(Refusal::SpeedType { item: number, kind });
        }
        // A hair for the single precision of the item.
        let (min, max) = (a.speed_min_m_per_s - 1e-3, a.speed_max_m_per_s + 1e-3);
        let fits = (min..=max).contains(&f64::from(speed)) && (a.is_fixed_wing() || speed > 0.0);
        if !fits {
            return Err(Refusal::Speed {
                item: number,
                speed_m_per_s: speed,
                min_m_per_s: a.speed_min_m_per_s,
                max_m_per_s: a.speed_max_m_per_s,
            });
        }
        Ok(())
    }

    fn radius(&self, number: usize, of: u16, radius_m: f64, speed_m_per_s: f64) -> Result<(), Refusal> {
        let circles = matches!(
            of,
            command::NAV_LOITER_TURNS
                | command::NAV_LOITER_UNLIM
                | command::NAV_LOITER_TIME
                | command::NAV_LOITER_TO_ALT
        );
        let a = self.airframe;
        if !circles || !a.is_fixed_wing() {
            return Ok(());
        }
        let (cruise, wind) = (a.speed_cruise_m_per_s, self.limits.wind_speed());
        // Slower than cruise is no excuse for a tighter circle: speed comes back in gusts.
        let needed_m = a.planned_radius_m(cruise + wind).max(if speed_m_per_s > cruise {
            a.steep_radius_m(speed_m_per_s + wind)
        } else {
            0.0
        });
        // Autopilots round down by up to a metre (below 255 m).
        if radius_m + 1.0 < needed_m {
            return Err(Refusal::Radius { item: number, radius_m, needed_m });
        }
        if a.autopilot == Autopilot::ArduPilot && radius_m > 2550.0 {
            return Err(Refusal::Radius { item: number, radius_m, needed_m });
        }
        Ok(())
    }

    /// Every point of a predicted path: fence with margin, floor, ceiling.
    ///
    /// # Errors
    /// The first point that breaks a limit.
    pub fn path(&self, samples: &[Kinematics]) -> Result<(), Refusal> {
        samples.iter().try_for_each(|k| self.point(k.t_s, &k.position_ned_m))?;
        if self.airframe.is_fixed_wing() { self.rolls(samples) } else { Ok(()) }
    }

    /// The load after each roll: the peak over the steady turn grows with the angle that was rolled through. From wings level it is
    /// the airframe's `load_overshoot`; a reversal from the same bank on the other side doubles what is beyond 1.
    fn rolls(&self, samples: &[Kinematics]) -> Result<(), Refusal> {
        let a = self.airframe;
        // The largest bank to either side within the last moments: time, bank.
        let mut before: VecDeque<(f64, f64)> = VecDeque::new();
        for k in samples.iter().step_by(ROLL_THINNING) {
            let bank = k.attitude.euler_angles().0;
            while before.front().is_some_and(|(t, _)| k.t_s - t > ROLL_S) {
                before.pop_front();
            }
            let opposite = before.iter().map(|(_, b)| -b * bank.signum()).fold(0.0, f64::max);
            before.push_back((k.t_s, bank));
            if bank.abs() < LEAST_ROLL_RAD {
                continue;
            }
            let travel = (opposite + bank.abs()) / bank.abs().max(a.steep_bank_rad());
            let load = (1.0 + (a.load_overshoot - 1.0) * travel) / cos(bank).max(0.2);
            if opposite > LEAST_ROLL_RAD && load > a.load_factor_max {
                let from_deg = -(opposite * bank.signum()).to_degrees();
                let (to_deg, limit) = (bank.to_degrees(), a.load_factor_max);
                return Err(Refusal::Load { t_s: k.t_s, from_deg, to_deg, load, limit });
            }
        }
        Ok(())
    }

    /// As [`Self::path`] for times (s) and positions north, east, down (m).
    ///
    /// # Errors
    /// The first point that breaks a limit.
    pub fn places(&self, places: &[(f64, Vector3<f64>)]) -> Result<(), Refusal> {
        places.iter().try_for_each(|(t_s, p)| self.point(*t_s, p))
    }

    fn point(&self, t_s: f64, position_ned_m: &Vector3<f64>) -> Result<(), Refusal> {
        self.inside(t_s, position_ned_m)?;
        let height_m = -position_ned_m.z;
        if !(self.limits.floor_m..=self.limits.ceiling_m).contains(&height_m) {
            return Err(Refusal::PathHeight { t_s, height_m });
        }
        Ok(())
    }

    /// A landing: the items of its approach as any others, its end inside the fence, the line down to it as well.
    ///
    /// # Errors
    /// The first thing that breaks a limit; items count within the approach.
    pub fn landing(&self, approach: &[MissionItem], land: &MissionItem) -> Result<(), Refusal> {
        self.items(approach)?;
        let item = approach.len() + 1;
        let reference = land.frame.altitude_reference();
        if reference != AltitudeReference::Home {
            return Err(Refusal::Reference { item, reference });
        }
        let ends = [approach.last().and_then(MissionItem::place), land.place()];
        let [Some(from), Some(to)] = ends.map(|p| p.map(|p| self.frame.to_local(p))) else {
            return Err(Refusal::NoSafeEnd);
        };
        for k in 0..=LINE_CHECKS {
            let space = self.clearance_at(from.lerp(&to, f64::from(k) / f64::from(LINE_CHECKS)));
            if space < 0.0 || space.is_nan() {
                return Err(Refusal::ItemOutside { item, by_m: -space });
            }
        }
        Ok(())
    }

    /// Every point against the fence with its margin, whatever its height: for what flies down to the ground. Times in s,
    /// positions north, east, down in m.
    ///
    /// # Errors
    /// The first point outside.
    pub fn ground_track(&self, places: &[(f64, Vector3<f64>)]) -> Result<(), Refusal> {
        places.iter().try_for_each(|(t_s, p)| self.inside(*t_s, p))
    }

    fn inside(&self, t_s: f64, position_ned_m: &Vector3<f64>) -> Result<(), Refusal> {
        let space = self.clearance_at(position_ned_m.xy());
        if space < 0.0 || space.is_nan() {
            return Err(Refusal::PathOutside { t_s, by_m: -space });
        }
        Ok(())
    }

    /// Whether the mission ends in something that can last.
    ///
    /// # Errors
    /// It does not, or is empty.
    pub fn end(&self, items: &[MissionItem]) -> Result<(), Refusal> {
        match items.last().map(|i| i.command) {
            None => Err(Refusal::Empty),
            Some(command::NAV_LOITER_UNLIM | command::NAV_RETURN_TO_LAUNCH | command::NAV_LAND) => Ok(()),
            Some(_) => Err(Refusal::NoSafeEnd),
        }
    }
}

#[cfg(test)]
mod tests;
