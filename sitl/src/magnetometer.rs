//! The compasses of a simulated vehicle: a field that is the same everywhere near the place where most scenarios fly, through the effects of
//! the model, with noise and the rounding of the message.
//!
//! On purpose no world model: the field is a constant vector, and who estimates has a formula of its own.

use crate::noise::{Noise, Purpose};
use crate::truth::Truth;
use gaware_nav::effects::FieldInstant;
use gaware_nav::model::Model;
use nalgebra::Vector3;

/// Where the field holds, rad, and how far around it.
const PLACE: ([f64; 2], f64) = ([0.82725, 0.14915], 0.05);
/// There in 2026, north, east, down, T: NOAA's on-line calculator says 21.5, 1.4, 43.3 μT for Zurich.
pub const EARTH_FIELD_T: [f64; 3] = [21.5e-6, 1.36e-6, 43.3e-6];
/// Noise of a sample: 3 mG, an IST8310 or an RM3100 at 20 Hz, T.
const SIGMA_T: f64 = 3e-7;
/// Compasses of a vehicle; the effects of the model are those of the first, the others have none.
pub const COMPASSES: u8 = 2;

/// All compasses.
#[derive(Debug, Clone)]
pub struct Magnetometers(Vec<Noise>);

impl Magnetometers {
    /// Of this seed.
    pub fn new(seed: u64) -> Self {
        Self((0..COMPASSES).map(|k| Noise::numbered(seed, Purpose::Field, u32::from(k))).collect())
    }

    /// What a compass measures at this truth with this current, T; nothing far from the place.
    pub fn at(&mut self, compass: u8, truth: &Truth, model: &Model, current_a: f64) -> Option<Vector3<f64>> {
        let ([lat, lon], near) = PLACE;
        if (truth.place.lat_rad - lat).abs() > near || (truth.place.lon_rad - lon).abs() > near {
            return None;
        }
        let noise = self.0.get_mut(usize::from(compass))?;
        let field_n = Vector3::from(EARTH_FIELD_T);
        let to_body = truth.c_nb.transpose();
        let x = FieldInstant {
            field: to_body * field_n,
            by_declination: to_body * Vector3::z().cross(&field_n),
            rate: truth.rate_eb,
            current_a,
        };
        let mut shown = x.field + noise.normal3() * SIGMA_T;
        for setting in model.effects.iter().filter(|_| compass == 0) {
            if let Some(effect) = setting.effect.on_field() {
                shown += effect.field(&setting.values, &x);
            }
        }
        Some(shown)
    }
}
