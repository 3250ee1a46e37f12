//! Mission files: what ground stations read and write. Strings in, strings out.

pub mod plan;
pub mod waypoints;

/// The number a person would write for this single-precision value: 0.1, not 0.10000000149.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}
