//! On the ground: what is known of a vehicle that people turn by hand, where no fix says it.
//!
//! A unit that is turned by hand stays where it is, to an arm's length, and stands still between the turns. That is as good as a fix for G,
//! scale factors and axes (IEEE 952 and 1293; Tedaldi, Pretto & Menegatti 2014, "A robust and easy to implement method for IMU
//! calibration without external equipments"). So the place takes the part of the receiver: `PlaceAid` gives fixes with velocity zero
//! to an arm's speed and a position that says nothing, which no lever arm and no latency can be learnt from, while nothing
//! contradicts that the vehicle is on the ground. Everything else is the filter's: rest, turns, constants.

mod place;
pub mod session;

pub(crate) use place::{Contact, PlaceAid, REFERENCE_ERROR};
