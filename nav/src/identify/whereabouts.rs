//! Where the gap lies: channel, stretch of time and regime of the innovations that are larger than their sigmas say.

use super::pass::Innovation;

/// A place in the flight whose innovations stand out.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// `velocity_north`, `position_down`, …
    pub channel: &'static str,
    /// From, s.
    pub t_start_s: f64,
    /// To, s.
    pub t_end_s: f64,
    /// What the vehicle did then.
    pub regime: String,
    /// Share of the whole excess.
    pub share: f64,
}

/// Channels in the order of the innovations.
pub const CHANNELS: [&str; 6] =
    ["position_north", "position_east", "position_down", "velocity_north", "velocity_east", "velocity_down"];
/// Stretches are looked for in steps of this, s.
const WINDOW_S: f64 = 10.0;
/// At most so many places are told.
const MOST: usize = 6;

/// Normalised innovation of a channel, if the fix has it.
pub fn channel(innovation: &Innovation, channel: usize) -> Option<f64> {
    let group = if channel < 3 { &innovation.position } else { &innovation.velocity };
    (channel % 3 < group.dof).then(|| group.normalised[channel % 3])
}

/// The places whose squared normalised innovations exceed one the most, largest first.
pub fn find(innovations: &[Innovation]) -> Vec<Place> {
    let counted: Vec<&Innovation> = innovations.iter().filter(|i| i.part.is_some()).collect();
    let Some(first) = counted.first() else { return Vec::new() };
    let mut cells: Vec<(usize, i64, f64)> = Vec::new();
    for c in 0..6 {
        let mut at: std::collections::BTreeMap<i64, f64> = std::collections::BTreeMap::new();
        for i in &counted {
            if let Some(v) = channel(i, c) {
                *at.entry(((i.t_s - first.t_s) / WINDOW_S) as i64).or_default() += v * v - 1.0;
            }
        }
        cells.extend(at.into_iter().map(|(w, v)| (c, w, v)));
    }
    let whole: f64 = cells.iter().map(|c| c.2.max(0.0)).sum();
    if whole <= 0.0 {
        return Vec::new();
    }
    cells.sort_by(|a, b| b.2.total_cmp(&a.2));
    let mut places: Vec<(usize, i64, i64, f64)> = Vec::new();
    for (c, w, v) in cells.into_iter().filter(|c| c.2 > 0.0) {
        let full = places.len() >= MOST;
        match places.iter_mut().find(|p| p.0 == c && w >= p.1 - 1 && w <= p.2 + 1) {
            Some(p) => *p = (c, p.1.min(w), p.2.max(w), p.3 + v),
            None if !full => places.push((c, w, w, v)),
            None => {}
        }
    }
    places.sort_by(|a, b| b.3.total_cmp(&a.3));
    places
        .into_iter()
        .map(|(c, from, to, v)| {
            let (t0, t1) = (first.t_s + from as f64 * WINDOW_S, first.t_s + (to + 1) as f64 * WINDOW_S);
            Place {
                channel: CHANNELS[c],
                t_start_s: t0,
                t_end_s: t1,
                regime: regime(&counted, t0, t1),
                share: v / whole,
            }
        })
        .collect()
}

/// What the vehicle did between two times, compared with the rest of the flight.
fn regime(all: &[&Innovation], from: f64, to: f64) -> String {
    let within: Vec<&&Innovation> = all.iter().filter(|i| i.t_s >= from && i.t_s < to).collect();
    let most = |f: &dyn Fn(&Innovation) -> f64| within.iter().map(|i| f(i)).fold(f64::MIN, f64::max);
    let g = crate::earth::STANDARD_GRAVITY;
    let mut words = Vec::new();
    let load = most(&|i| -i.force.z / g);
    if load > 1.3 {
        words.push(format!("specific force z up to {load:.1} g"));
    }
    let side = most(&|i| i.force.y.abs() / g);
    if side > 0.12 {
        words.push(format!("specific force y up to {side:.2} g"));
    }
    let along = most(&|i| i.force.x.abs() / g);
    if along > 0.25 {
        words.push(format!("specific force x up to {along:.2} g"));
    }
    let rate = most(&|i| i.rate.norm().to_degrees());
    if rate > 15.0 {
        words.push(format!("rate up to {rate:.0} deg/s"));
    }
    let speeds: Vec<f64> = within.iter().map(|i| i.speed).collect();
    let (low, high) = speeds.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    if high - low > 4.0 {
        words.push(format!("speed {low:.0} to {high:.0} m/s"));
    }
    if words.is_empty() {
        format!("steady flight at {:.0} m/s", speeds.iter().sum::<f64>() / speeds.len().max(1) as f64)
    } else {
        words.join(", ")
    }
}
