//! What effects may depend on: the inertial unit at the instant of a sample, the vehicle at the time of validity of a fix.

use super::{ActsOn, Effect};
use crate::earth::STANDARD_GRAVITY;
use crate::operating::{LAGS, Operating};
use nalgebra::{Matrix3, Vector3};

/// The ideal inertial unit at one instant: what its effects may depend on.
#[derive(Debug, Clone, Copy, Default)]
pub struct Instant {
    /// Time, s.
    pub t_s: f64,
    /// True angular rate ω_ib^b, rad/s.
    pub rate: Vector3<f64>,
    /// True specific force f^b, m/s².
    pub force: Vector3<f64>,
    /// Temperature above 25 °C; 0 where unknown.
    pub temperature_above_25_degc: f64,
    /// What the samples before and after it show.
    pub around: Surroundings,
    /// What the vehicle does beside that.
    pub conditions: Conditions,
}

/// The vehicle at the instant of a sample: what effects outside the catalogue may depend on. Zero or absent where it is not at hand.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Conditions {
    /// Throttle, battery, outputs, speed of the air, flight mode.
    pub operating: Operating,
    /// Speed over ground, m/s.
    pub speed: f64,
    /// Height above where the estimation began, m.
    pub height_m: f64,
    /// Heading, rad.
    pub heading_rad: f64,
    /// Since the start of the estimation, s.
    pub elapsed_s: f64,
    /// Temperature above 25 °C behind first-order lags of [`LAGS_S`](crate::operating::LAGS_S).
    pub lagged_degc: [f64; LAGS],
}

/// What a single sample does not show but those before and after it do; zero where they are not at hand.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Surroundings {
    /// First and second derivative of the angular rate, rad/s² and rad/s³.
    pub rate_derivatives: [Vector3<f64>; 2],
    /// The rate of a while ago.
    pub late: LateRate,
    /// Variance of the specific force above a few hertz, by axis, (m/s²)².
    pub vibration: Vector3<f64>,
}

impl Surroundings {
    /// The same of a unit that does not turn.
    #[must_use]
    pub fn at_rest(self) -> Self {
        let late = LateRate { lag_s: self.late.lag_s, ..LateRate::default() };
        Self { late, vibration: self.vibration, ..Self::default() }
    }
}

/// By how much the angular rate of a while ago differs from that of now, as the samples in between have it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LateRate {
    /// How long ago, s (negative: in the future); 0 where the samples are not at hand.
    pub lag_s: f64,
    /// In body axes, rad/s.
    pub change: Vector3<f64>,
}

/// The vehicle at the time of validity of a fix: what effects on GNSS may depend on. North-east-down.
#[derive(Debug, Clone, Copy)]
pub struct FixInstant {
    /// Time, s.
    pub t_s: f64,
    /// Velocity of the inertial unit, m/s.
    pub v_n: Vector3<f64>,
    /// Acceleration of the inertial unit relative to Earth, m/s².
    pub a_n: Vector3<f64>,
    /// The same as a receiver that smooths has it ([`Antenna::kernel`]), m/s²: what a delay moves its velocity by.
    pub smoothed_a_n: Vector3<f64>,
    /// Third derivative of the velocity over the instants of the kernel, m/s⁴; zero where it is not known.
    pub skewed_n: Vector3<f64>,
    /// C_b^n.
    pub c_nb: Matrix3<f64>,
    /// Rate of the body relative to Earth ω_eb^b, rad/s.
    pub rate_eb: Vector3<f64>,
    /// Rate of change of the specific force in body axes, m/s³; zero where it is not known.
    pub force_rate: Vector3<f64>,
    /// The antenna and the receiver behind it, as the rest of the model has them.
    pub antenna: Antenna,
    /// The velocity of a while ago.
    pub older: Older,
    /// Since the start of the estimation, s.
    pub elapsed_s: f64,
    /// What the vehicle does beside that.
    pub conditions: Conditions,
}

/// By how much the velocity of a while ago differs from that of now, as the samples in between have it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Older {
    /// How long ago, s; 0 where the samples are not at hand.
    pub lag_s: f64,
    /// North, east, down, m/s.
    pub change: Vector3<f64>,
    /// The acceleration of that time as a receiver that smooths has it, north, east, down, m/s².
    pub acceleration: Vector3<f64>,
}

/// What a receiver smooths a motion with: the second and third moment of its kernel about the mean, which of receivers one after the other add up.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Kernel {
    /// Half its variance, s².
    pub smoothing_s2: f64,
    /// A sixth of its third moment, s³: negative where the later of two epochs weighs more.
    pub skew_s3: f64,
}

impl Kernel {
    /// Motion so long before and after an instant is compared, s: two epochs of a receiver at 5 Hz, as its interpolation compares them.
    pub const SPAN_S: f64 = 0.1;
    /// A sixth of the third moment of two instants, by half their variance and by what their mean is later than their middle.
    pub const BY_AHEAD: f64 = -2.0 / 3.0;
    /// Half variance with nineteen times the weight on one of two epochs at 5 Hz, s². A kernel with less hardly depends on where its instants are.
    const LEAST_S2: f64 = 0.5 * 0.19 * Self::SPAN_S * Self::SPAN_S;

    /// By how much the mean of two instants with these moments is later than their middle, s, as far as epochs of a receiver at 5 Hz leave it.
    pub fn ahead_s(self) -> f64 {
        let smoothing_s2 = self.smoothing_s2.max(0.0);
        let per_s2 = smoothing_s2 / smoothing_s2.max(Self::LEAST_S2).powi(2);
        (self.skew_s3 / Self::BY_AHEAD * per_s2).clamp(-Self::SPAN_S, Self::SPAN_S)
    }

    /// How far two instants are from their mean, later one first, s, which is so much later than their middle: those of a kernel with this variance, but no nearer to one another
    /// than the epochs of a receiver at 5 Hz.
    pub fn instants(self, ahead_s: f64) -> [f64; 2] {
        let apart_s = (2.0 * self.smoothing_s2.max(0.0) + ahead_s * ahead_s).sqrt().max(Self::SPAN_S);
        [apart_s - ahead_s, -apart_s - ahead_s]
    }

    /// Both at once.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self { smoothing_s2: self.smoothing_s2 + other.smoothing_s2, skew_s3: self.skew_s3 + other.skew_s3 }
    }

    /// Whether there is anything of it.
    pub fn is_none(self) -> bool {
        self == Self::default()
    }
}

/// What effects on fixes have to know of one another: a receiver smooths the path of the antenna, wherever that is.
#[derive(Debug, Clone, Copy, Default)]
pub struct Antenna {
    /// What the receiver smooths with.
    pub kernel: Kernel,
    /// Position of the antenna relative to the inertial unit, m.
    pub arm: Vector3<f64>,
    /// First and second derivative of the angular rate, rad/s² and rad/s³; zero where they are not known.
    pub rate_derivatives: [Vector3<f64>; 2],
}

impl Antenna {
    /// That of effects with their parameters.
    pub fn of<'a>(
        effects: impl Iterator<Item = (&'static dyn Effect, &'a [f64])>,
        rate_derivatives: [Vector3<f64>; 2],
    ) -> Self {
        let mut antenna = Self { rate_derivatives, ..Self::default() };
        for (effect, p) in effects {
            if effect.acts_on(ActsOn::Fixes) {
                antenna.kernel = antenna.kernel.and(effect.kernel(p));
                antenna.arm += effect.arm(p);
            }
        }
        antenna
    }
}

impl FixInstant {
    /// The same of a unit that is known to rest: what samples around show beyond that is their noise.
    #[must_use]
    pub fn at_rest(self) -> Self {
        Self {
            a_n: Vector3::zeros(),
            smoothed_a_n: Vector3::zeros(),
            skewed_n: Vector3::zeros(),
            rate_eb: Vector3::zeros(),
            force_rate: Vector3::zeros(),
            antenna: Antenna { rate_derivatives: Default::default(), ..self.antenna },
            older: Older { lag_s: self.older.lag_s, ..Older::default() },
            ..self
        }
    }

    /// Specific force, north-east-down, m/s².
    fn force_n(&self) -> Vector3<f64> {
        self.a_n - Vector3::new(0.0, 0.0, STANDARD_GRAVITY)
    }

    /// The inertial unit at this instant, but for its temperature and what the samples around show of vibration.
    pub fn instant(&self) -> Instant {
        let rate_derivatives = self.antenna.rate_derivatives;
        Instant {
            t_s: self.t_s,
            rate: self.rate_eb,
            force: self.c_nb.transpose() * self.force_n(),
            around: Surroundings { rate_derivatives, ..Surroundings::default() },
            conditions: self.conditions,
            ..Instant::default()
        }
    }

    /// Rate of change of the acceleration, m/s³: specific force turns with the body, and changes in it.
    pub fn jerk_n(&self) -> Vector3<f64> {
        (self.c_nb * self.rate_eb).cross(&self.force_n()) + self.c_nb * self.force_rate
    }

    /// Second and third derivative of the position of a point of the vehicle relative to the inertial unit, m/s² and m/s³.
    pub fn derivatives_of(&self, arm: &Vector3<f64>) -> [Vector3<f64>; 2] {
        let w = &self.rate_eb;
        let [first, second] = &self.antenna.rate_derivatives;
        let velocity = w.cross(arm);
        let acceleration = first.cross(arm) + w.cross(&velocity);
        let jerk = second.cross(arm) + first.cross(&velocity) + w.cross(&(first.cross(arm) + acceleration));
        [self.c_nb * acceleration, self.c_nb * jerk]
    }
}
