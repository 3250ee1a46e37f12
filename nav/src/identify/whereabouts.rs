//! The channels of a fix.

use super::pass::Innovation;

/// In the order of the innovations.
pub const CHANNELS: [&str; 6] =
    ["position_north", "position_east", "position_down", "velocity_north", "velocity_east", "velocity_down"];

/// Normalised innovation of a channel, if the fix has it.
pub fn channel(innovation: &Innovation, channel: usize) -> Option<f64> {
    let group = if channel < 3 { &innovation.position } else { &innovation.velocity };
    (channel % 3 < group.dof).then(|| group.normalised[channel % 3])
}
