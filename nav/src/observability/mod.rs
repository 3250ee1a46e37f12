//! What a flight makes observable, seen three ways: the paper's conditions, the covariance, the weak directions.
//!
//! Where a segment's attitude is constant, ω̃ = const + G f + noise (the paper, eq. 27 before differentiation), so
//! changes of specific force there determine G. Nothing here runs a filter: samples come with bias and G already removed,
//! covariances come from whoever has one.

pub mod conditions;
pub mod covariance;
pub mod gramian;
pub mod segments;
pub mod words;
