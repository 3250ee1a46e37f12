//! The newest state at the rate of the samples, for those who need it faster than a snapshot.

use gaware_nav::earth::Geodetic;
use gaware_nav::estimator::{Estimator, Stage};
use gaware_nav::mechanization::acceleration;
use gaware_nav::sample::{FixVelocity, GnssFix};
use nalgebra::{Rotation3, UnitQuaternion};

/// Attitude, motion and their sigmas at the time of the newest inertial sample. Body axes: forward, right, down.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Navigation {
    /// Time of the sample on the autopilot's clock, s.
    pub t_s: f64,
    /// Whether one filter runs (while headings compete, the best of them is shown).
    pub running: bool,
    /// Time since a fix was used, s.
    pub since_used_fix_s: Option<f64>,
    /// From body to north-east-down: w, x, y, z.
    pub quaternion: [f64; 4],
    /// The same as roll, pitch, yaw, rad.
    pub roll_pitch_yaw_rad: [f64; 3],
    /// 1-sigma of roll, pitch, yaw, rad.
    pub attitude_sigma_rad: [f64; 3],
    /// Latitude, longitude, deg; height as the fixes count it, m.
    pub place_deg_deg_m: [f64; 3],
    /// 1-sigma north, east, down, m.
    pub position_sigma_m: [f64; 3],
    /// Velocity north, east, down, m/s.
    pub velocity_ned_m_per_s: [f64; 3],
    /// 1-sigma north, east, down, m/s.
    pub velocity_sigma_m_per_s: [f64; 3],
    /// Change of velocity north, east, down, m/s².
    pub acceleration_ned_m_per_s2: [f64; 3],
    /// Angular rate with bias, g-sensitivity and all other effects removed, body axes, rad/s.
    pub rate_rad_per_s: [f64; 3],
    /// Specific force with bias and all other effects removed, body axes, m/s².
    pub force_m_per_s2: [f64; 3],
    /// Angular rate as the autopilot sends it, rad/s.
    pub measured_rate_rad_per_s: [f64; 3],
    /// Specific force as the autopilot sends it, m/s².
    pub measured_force_m_per_s2: [f64; 3],
    /// Temperature of the inertial unit, °C.
    pub temperature_degc: Option<f64>,
    /// The newest fix.
    pub fix: Option<LastFix>,
}

/// A fix as it came.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LastFix {
    /// Time since it came, s.
    pub age_s: f64,
    /// Latitude, longitude, deg; height, m.
    pub place_deg_deg_m: [f64; 3],
    /// Velocity north, east, down, m/s; 0 where the receiver gives none.
    pub velocity_ned_m_per_s: [f64; 3],
    /// Its own 1-sigma north, east, down, m; that of the model where it gives none.
    pub position_sigma_m: [f64; 3],
    /// Its own 1-sigma, m/s; that of the model where it gives none.
    pub velocity_sigma_m_per_s: [f64; 3],
}

impl Navigation {
    /// From the estimator; nothing before there is an attitude. `fix`: the newest with its age, s.
    pub(super) fn of(
        estimator: &mut Estimator,
        fix: Option<(&GnssFix, f64)>,
        since_used_fix_s: Option<f64>,
    ) -> Option<Self> {
        let (t_s, nav) = estimator.predicted_nav()?;
        let running = estimator.stage() == Stage::Running;
        let searched_yaw = estimator.searched_yaw_sigma();
        let filter = estimator.filter()?;
        let sample = estimator.last_sample()?;
        let motion = filter.calibration().motion(filter.model(), sample);
        let c_nb = nav.c_nb();
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(c_nb));
        // From ECEF to body and on to north-east-down.
        let felt = c_nb * nav.c_eb().transpose() * acceleration(&nav, &motion.force);
        let mut sigma = filter.euler_sigma();
        sigma.z = searched_yaw.map_or(sigma.z, |searched| searched.max(sigma.z));
        let [position, velocity] = filter.ned_sigmas();
        let gnss = &filter.model().gnss;
        Some(Self {
            t_s,
            running,
            since_used_fix_s,
            quaternion: [q.w, q.i, q.j, q.k],
            roll_pitch_yaw_rad: nav.euler().into(),
            attitude_sigma_rad: sigma.into(),
            place_deg_deg_m: degrees(&nav.geodetic()),
            position_sigma_m: position.into(),
            velocity_ned_m_per_s: nav.v_n().into(),
            velocity_sigma_m_per_s: velocity.into(),
            acceleration_ned_m_per_s2: felt.into(),
            rate_rad_per_s: motion.rate.into(),
            force_m_per_s2: motion.force.into(),
            measured_rate_rad_per_s: sample.gyro.into(),
            measured_force_m_per_s2: sample.accel.into(),
            temperature_degc: sample.temperature_degc,
            fix: fix.map(|(fix, age_s)| LastFix {
                age_s,
                place_deg_deg_m: degrees(&fix.position),
                velocity_ned_m_per_s: match fix.velocity {
                    FixVelocity::Full(v) => v,
                    FixVelocity::Horizontal([n, e]) => [n, e, 0.0],
                    FixVelocity::None => [0.0; 3],
                },
                position_sigma_m: fix.position_sigma_m.unwrap_or(gnss.position_sigma_m),
                velocity_sigma_m_per_s: fix.velocity_sigma_m_per_s.unwrap_or(gnss.velocity_sigma_m_per_s),
            }),
        })
    }

    /// Whether every value is a number.
    pub fn is_finite(&self) -> bool {
        let threes = [
            &self.roll_pitch_yaw_rad,
            &self.attitude_sigma_rad,
            &self.place_deg_deg_m,
            &self.position_sigma_m,
            &self.velocity_ned_m_per_s,
            &self.velocity_sigma_m_per_s,
            &self.acceleration_ned_m_per_s2,
            &self.rate_rad_per_s,
            &self.force_m_per_s2,
        ];
        threes.iter().all(|t| t.iter().all(|v| v.is_finite()))
            && self.quaternion.iter().all(|v| v.is_finite())
    }
}

fn degrees(place: &Geodetic) -> [f64; 3] {
    [place.lat_rad.to_degrees(), place.lon_rad.to_degrees(), place.height_m]
}
