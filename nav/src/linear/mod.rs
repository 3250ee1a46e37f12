//! The linear model between measurements, which the live filter and the explanation of a whole flight share: one interval per
//! measurement with its transition, driven columns and process noise. It knows nothing of filters.

pub(crate) mod fix;
pub(crate) mod interval;
