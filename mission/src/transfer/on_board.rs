//! What is on a vehicle after a transfer that was interrupted, against the two missions that it can have come from.

use crate::compare::{differences, same_item};
use crate::item::{Autopilot, Mission};

/// What was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum OnBoard {
    /// No items at all, and neither mission is empty.
    Nothing,
    /// The previous mission, whole.
    Previous,
    /// The new mission, whole.
    New,
    /// The two are the same, and it is there whole.
    Either,
    /// Parts of one or of both.
    Mixture {
        /// Which items are whose.
        parts: String,
        /// Items of neither.
        foreign: usize,
    },
    /// Nothing of either.
    Other {
        /// Items there.
        items: usize,
    },
}

/// Whose an item is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Owner {
    New,
    Previous,
    Both,
    Nobody,
}

impl OnBoard {
    /// Judges what was read.
    pub fn judge(autopilot: Autopilot, new: &Mission, previous: &Mission, got: &Mission) -> Self {
        let whole = |mission| differences(autopilot, mission, got).is_empty();
        match (whole(new), whole(previous)) {
            (true, true) => return Self::Either,
            (true, false) => return Self::New,
            (false, true) => return Self::Previous,
            (false, false) if got.items.is_empty() => return Self::Nothing,
            (false, false) => {}
        }
        let owners: Vec<Owner> = got
            .items
            .iter()
            .enumerate()
            .map(|(k, item)| {
                let of = |m: &Mission| m.items.get(k).is_some_and(|want| same_item(autopilot, want, item));
                match (of(new), of(previous)) {
                    (true, true) => Owner::Both,
                    (true, false) => Owner::New,
                    (false, true) => Owner::Previous,
                    (false, false) => Owner::Nobody,
                }
            })
            .collect();
        if owners.iter().all(|o| *o == Owner::Nobody) {
            return Self::Other { items: got.items.len() };
        }
        let foreign = owners.iter().filter(|o| **o == Owner::Nobody).count();
        Self::Mixture { parts: parts(&owners), foreign }
    }
}

impl std::fmt::Display for OnBoard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Nothing => f.write_str("no mission at all"),
            Self::Previous => f.write_str("the previous mission, whole"),
            Self::New => f.write_str("the new mission, whole"),
            Self::Either => f.write_str("the mission, whole (the new and the previous one are the same)"),
            Self::Mixture { parts, .. } => write!(f, "A MIXTURE: {parts}"),
            Self::Other { items } => write!(f, "{items} items that are of neither mission"),
        }
    }
}

/// "item 1 of both, items 2 to 5 of the new mission, …".
fn parts(owners: &[Owner]) -> String {
    let mut runs: Vec<(usize, usize, Owner)> = Vec::new();
    for (k, owner) in owners.iter().enumerate() {
        match runs.last_mut() {
            Some((_, last, of)) if of == owner => *last = k + 1,
            _ => runs.push((k + 1, k + 1, *owner)),
        }
    }
    let words = runs.into_iter().map(|(first, last, owner)| {
        let items = if first == last { format!("item {first}") } else { format!("items {first} to {last}") };
        let owner = match owner {
            Owner::New => "of the new mission",
            Owner::Previous => "of the previous one",
            Owner::Both => "that both have",
            Owner::Nobody => "of neither",
        };
        format!("{items} {owner}")
    });
    format!("{} and nothing more", words.collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::item::{LatLon, MissionItem, command};

    fn mission(places: std::ops::Range<u32>) -> Mission {
        let at = |k: u32| LatLon { lat_deg: 47.0 + f64::from(k) * 1e-3, lon_deg: 8.0 };
        let item = |k| MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], at(k), 60.0);
        Mission { home: None, items: places.map(item).collect() }
    }

    #[test]
    fn every_item_is_given_its_owner() {
        let (new, previous) = (mission(0..5), mission(100..106));
        let said = |got: &Mission| OnBoard::judge(Autopilot::ArduPilot, &new, &previous, got);
        assert_eq!(said(&new), OnBoard::New);
        assert_eq!(said(&previous), OnBoard::Previous);
        assert_eq!(said(&Mission::default()), OnBoard::Nothing);
        assert_eq!(said(&mission(50..53)), OnBoard::Other { items: 3 });
        let mut mixed = previous.clone();
        mixed.items[..3].copy_from_slice(&new.items[..3]);
        assert_eq!(
            said(&mixed).to_string(),
            "A MIXTURE: items 1 to 3 of the new mission, items 4 to 6 of the previous one and nothing more"
        );
        let part = mission(0..1);
        assert_eq!(said(&part).to_string(), "A MIXTURE: item 1 of the new mission and nothing more");
        assert_eq!(OnBoard::judge(Autopilot::Px4, &new, &new, &new), OnBoard::Either);
    }
}
