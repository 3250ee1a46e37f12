//! One barometer or airspeed sensor as a series of measurements: what each fix says of its effects, and what is left with some of them.

mod errors;
mod foreseen;

use super::super::aids::choose::{Chosen, Widths};
use super::super::aids::judged::{BLOCK_S, Judged};
use super::super::aids::series::{self, BOUNDED, Bounded, Figures, GIVEN, Known, Noise, Row, States};
use super::super::statistics::{about_mean, high, mean, range, rms};
use super::{Air, AirFound, AirQuantity, Carriage, FLIES, Instant, Wind, by_wind, carriage_at};
use crate::effects::{AIRSPEED, AirDriver, AirInstant, BAROMETER, Effect, SEA_LEVEL_DENSITY};
use crate::rss;
use crate::sample::AirKind;
pub(in crate::identify) use foreseen::AirForeseen;
use nalgebra::{DVector, Rotation3, Vector2, Vector3};

/// What is left of each effect of a sensor in order, 1-sigma, SI: 3 % of the dynamic pressure (.6 m at 20 m/s), 5 Pa of propeller wash (.4 m), .1 s, .05 m/°C,
/// 3 % (air 9 K from the standard's); 3 % of the airspeed, 3 Pa (.2 m/s at 15 m/s), .2 s.
const TOLERANCES: [&[f64]; 2] = [&[0.03, 5.0, 0.1, 0.05, 0.03], &[0.03, 3.0, 0.2]];
/// Noise of heights, m, and airspeeds, m/s: white; walk per √s (the weather, 3 m in an hour of it; the wind, 1.2 m/s in ten minutes); what is bounded with its correlation time, s
/// (the height of trajectory or receiver; gusts, over 100 to 260 m of air at 30 to 100 m height: MIL-F-8785C).
const FIGURES: [Figures; 2] = [
    Figures {
        usual: [(0.2, 3.0), (0.03, 2.5), (0.3, 3.0), (15.0, 3.0)],
        limits: [(0.03, 3.0), (0.001, 1.0), (0.02, 10.0), (1.0, 120.0)],
        smooth: &[false, true],
    },
    Figures {
        usual: [(0.3, 2.0), (0.05, 2.5), (0.5, 2.0), (8.0, 2.0)],
        limits: [(0.05, 3.0), (0.002, 1.0), (0.02, 5.0), (1.0, 30.0)],
        smooth: &[false],
    },
];
/// Offset of a barometer at the start, m, and a component of the wind, m/s.
const START: [f64; 2] = [300.0, 8.0];
/// What a port's dynamic pressure knows of a wind that nothing measures, m/s …
const WIND_SIGMA: f64 = 5.0;
/// … or that an airspeed sensor shows in circles both ways, m/s: .1 to .3 on simulated planes …
const SHOWN_WIND_SIGMA: f64 = 0.2;
/// … and its gusts, m/s and s: moderate turbulence at 50 m is 1.5 m/s over a length of 100 m (MIL-F-8785C), light is half of it.
const GUSTS: Bounded = (0.7, 7.0);
/// Sideslip of a wing, 1-sigma as a share of the airspeed, with the 25 fixes of 5 s in which it stays the same.
const SLIP: f64 = 0.05 * 5.0;
/// Its constant part: our own heading, and a fin that is not straight, rad.
const SLIP_CONSTANT: f64 = 0.05;
/// And the part that shows as a side force, rad per m/s² at the speed below: light aircraft with a fuselage have .11 (.19 g at 12°); two recorded flights of a small wing have .18 g
/// in turns with 45° of bank.
const SLIP_BY_FORCE: f64 = 0.15;
/// … which it goes with in proportion to its inverse square, m/s.
const FORCE_SPEED: f64 = 20.0;
/// A temperature or a throttle that changes by less drives nothing: °C, share.
const DRIVES: [f64; 2] = [2.0, 0.1];
/// The height of a barometer is judged about its mean over so long before and after, s: the weather and the wandering of a receiver's height are no error of it.
const ABOUT_S: f64 = 60.0;
/// What is not known of the square root of the density: air 9 K from the standard's, as of a barometer's scale.
const DENSITY: f64 = 0.016;
/// A wing follows a gust after it has felt it, so that its speed over ground lags a share of its airspeed: on simulated flights in gusts of .3 m/s a sensor without a delay showed .05 to
/// .13 s of one, 1-sigma. In stronger gusts [`AirSensor::gusts_delay_s`] is more.
const GUSTS_DELAY_S: f64 = 0.1;
/// No delay is longer, s.
const LONGEST_DELAY_S: f64 = 5.0;

/// A sensor with what its passes need.
pub(super) struct AirSensor<'a> {
    kind: AirKind,
    catalogue: &'static [&'static dyn Effect],
    widths: Widths,
    carriage: &'a [Carriage],
    instants: Vec<Instant>,
    mean_height_m: f64,
    is_wing: bool,
    /// The wind at each instant about which it is linearised.
    wind: Vec<Vector2<f64>>,
    /// Gusts along the flow that an airspeed sensor shows, m/s: an airspeed that is held has none of them, and the speed over ground has all, so that without them a port came out
    /// 18 to 28 % too small.
    along: Vec<f64>,
    /// Gusts at a port.
    gusts: Bounded,
}

/// What there was to measure at an instant.
struct Ideal {
    c_nb: Rotation3<f64>,
    /// Height or equivalent airspeed.
    value: f64,
    /// Side force as at [`FORCE_SPEED`], m/s².
    side_force: f64,
    x: AirInstant,
}

/// Whether an airspeed sensor measures anything.
fn flies(i: &Instant, s: &Ideal, wind: &Vector2<f64>) -> bool {
    let ground = (s.c_nb * s.x.velocity + Vector3::new(wind.x, wind.y, 0.0)).norm();
    s.x.velocity.norm() > FLIES && (ground > FLIES || i.measured > FLIES)
}

/// What is open of a sensor. `wind`: 1-sigma of its components, where an airspeed sensor shows it.
fn widths(kind: AirKind, wind: Option<[f64; 2]>, is_there: impl Fn(&str) -> bool) -> Widths {
    let widths = Widths::new([BAROMETER, AIRSPEED][kind as usize], TOLERANCES[kind as usize], is_there);
    match kind {
        AirKind::Barometer => {
            (0..2).fold(widths, |w, k| w.along("baro_dynamic_pressure", wind.map_or(WIND_SIGMA, |s| s[k])))
        }
        AirKind::Airspeed => {
            let widths = widths.always(SLIP_CONSTANT).always(SLIP_BY_FORCE);
            widths.known_to("airspeed_scale", DENSITY).known_to("airspeed_delay", GUSTS_DELAY_S)
        }
    }
}

/// What is known of the noise of a sensor.
fn known(kind: AirKind, gusts: Bounded) -> Known {
    let given = if kind == AirKind::Barometer { gusts } else { (0.0, 1.0) };
    Known { given, start: START[kind as usize] }
}

impl Judged for AirSensor<'_> {
    fn widths(&self) -> &Widths {
        &self.widths
    }

    fn noise_figures(&self) -> (&'static Figures, Known) {
        (&FIGURES[self.kind as usize], known(self.kind, self.gusts))
    }

    fn rows(&self, values: &[f64], with_columns: bool) -> Vec<Row> {
        let ideal = self.ideal(values, &self.wind);
        let all = self.instants.iter().zip(&ideal).zip(&self.wind);
        all.flat_map(|((i, s), wind)| self.rows_of((i, s, wind), values, with_columns)).collect()
    }

    /// Linearises an airspeed about the wind that it shows with these values.
    fn follow(&mut self, values: &[f64], noise: &Noise) {
        if self.kind == AirKind::Airspeed {
            self.wind = self.wind_alone(values, noise);
            self.widths.know("airspeed_delay", self.gusts_delay_s(values, noise).max(GUSTS_DELAY_S));
        }
    }

    fn left(&self, values: &[f64], by: &[f64], noise: &Noise) -> Vec<(f64, f64)> {
        self.instants.iter().map(|i| i.elapsed_s).zip(self.residuals(values, by, noise)).collect()
    }
}

impl<'a> AirSensor<'a> {
    pub(super) fn new(air: &'a Air<'_>, kind: AirKind, instants: Vec<Instant>, wind: Option<&Wind>) -> Self {
        let catalogue = [BAROMETER, AIRSPEED][kind as usize];
        let carriage = &air.carriage;
        let changes =
            [range(instants.iter().map(|i| i.temperature)), range(carriage.iter().map(|c| c.throttle))];
        let is_there = |effect: &str| match effect {
            "baro_temperature" => changes[0] > DRIVES[0],
            "baro_thrust" => changes[1] > DRIVES[1],
            _ => true,
        };
        let widths = widths(kind, wind.map(|w| w.sigma), is_there);
        let blows = |i: &Instant| wind.map_or_else(Default::default, |w| w.at(i.elapsed_s));
        let (blowing, along) = instants.iter().map(blows).unzip();
        Self {
            kind,
            catalogue,
            widths,
            carriage,
            mean_height_m: mean(carriage.iter().map(|c| c.height_m)),
            is_wing: air.is_wing,
            wind: blowing,
            along,
            gusts: wind.map_or(GUSTS, |w| w.gusts),
            instants,
        }
    }

    /// The delay that gusts may pretend, s: a wing that follows a gust g within its own time has dv/dt = −g/τ, and the regression of g on dv/dt is
    /// E[g²]/τ / E[(dv/dt)²]. How fast it follows is not known: as fast as gusts last. In gusts of .3 to 1.2 m/s that lasted 5 s and were followed in 4 s
    /// a sensor with a lag of .23 s showed .5 to 1.24 s (28 independent flights, 2026-11-30).
    fn gusts_delay_s(&self, values: &[f64], noise: &Noise) -> f64 {
        let changes = self.ideal(values, &self.wind).into_iter().zip(&self.instants).zip(&self.wind);
        let flown =
            changes.filter(|((s, i), wind)| flies(i, s, wind)).map(|((s, _), _)| s.x.airspeed[1].powi(2));
        let (sum, count) = flown.fold((0.0, 0.0), |(sum, n), square| (sum + square, n + 1.0));
        let (sigma, tau_s) = noise.bounded;
        if sum > 0.0 { sigma * sigma / tau_s * count / sum } else { 0.0 }
    }

    /// Parameters of effects, before those that go with them.
    fn effects(&self) -> usize {
        self.catalogue.iter().map(|e| e.len()).sum()
    }

    /// By how much the wind differs that a port's dynamic pressure shows.
    fn shift(&self, values: &[f64]) -> Vector2<f64> {
        match self.kind {
            AirKind::Barometer => Vector2::new(values[self.effects()], values[self.effects() + 1]),
            AirKind::Airspeed => Vector2::zeros(),
        }
    }

    /// Sum of the values of parameters that such a driver multiplies.
    fn sum_of(&self, values: &[f64], is_one: impl Fn(AirDriver) -> bool) -> f64 {
        let drivers = self.catalogue.iter().filter_map(|e| e.on_air()).flat_map(|a| a.drivers);
        drivers.zip(values).filter(|(d, _)| is_one(**d)).map(|(_, v)| v).sum()
    }

    /// What there was to measure in this wind, with a delay at the time before.
    fn ideal(&self, values: &[f64], wind: &[Vector2<f64>]) -> Vec<Ideal> {
        let shift = self.shift(values);
        let delay_s = self.sum_of(values, AirDriver::is_delay).clamp(-LONGEST_DELAY_S, LONGEST_DELAY_S);
        let offset_pa = self.sum_of(values, |d| d == AirDriver::SpeedByPressure);
        let one = |((i, wind), along): ((&Instant, &Vector2<f64>), &f64)| {
            let c = carriage_at(self.carriage, i.elapsed_s - delay_s)?;
            Some(self.ideal_of(&c, (&(wind + shift), *along), [i.density, i.temperature, offset_pa]))
        };
        let mut all: Vec<Ideal> = self.instants.iter().zip(wind).zip(&self.along).filter_map(one).collect();
        let speeds: Vec<(f64, f64)> =
            self.instants.iter().zip(&all).map(|(i, s)| (i.elapsed_s, s.x.airspeed[0])).collect();
        for (s, w) in all.iter_mut().skip(1).zip(speeds.windows(3)) {
            s.x.airspeed[1] = (w[2].1 - w[0].1) / (w[2].0 - w[0].0).max(1e-3);
        }
        all
    }

    /// What there was to measure here in this wind, with density and temperature of the sensor and the offset of its pressure.
    fn ideal_of(
        &self,
        c: &Carriage,
        (wind, along): (&Vector2<f64>, f64),
        [density, temperature, offset_pa]: [f64; 3],
    ) -> Ideal {
        let still = c.c_nb.inverse() * (c.v_n - Vector3::new(wind.x, wind.y, 0.0));
        let velocity = still * (1.0 + along / still.norm().max(FLIES));
        let airspeed = velocity.norm() * (density / SEA_LEVEL_DENSITY).sqrt();
        let x = AirInstant {
            velocity,
            density,
            height_m: c.height_m - self.mean_height_m,
            climb: -c.v_n.z,
            throttle: c.throttle,
            temperature,
            airspeed: [airspeed, 0.0],
            // Not what was measured: its noise would be in the driver too, and an offset of 35 Pa become one of 50.
            shown: (airspeed.powi(2) + 2.0 * offset_pa / SEA_LEVEL_DENSITY).max(0.0).sqrt(),
            ..AirInstant::default()
        };
        let value = if self.kind == AirKind::Barometer { c.height_m } else { airspeed };
        let as_at = (FORCE_SPEED / velocity.norm().max(FLIES)).powi(2);
        let side_force = c.force.map_or(0.0, |f| f.y) * as_at;
        Ideal { c_nb: c.c_nb, value, side_force, x }
    }

    /// What the effects beside the delay add at an instant with these values.
    fn added(&self, values: &[f64], x: &AirInstant) -> f64 {
        let x = AirInstant { climb: 0.0, airspeed: [x.airspeed[0], 0.0], ..*x };
        let mut at = 0;
        let one = |e: &&dyn Effect| {
            let p = &values[at..at + e.len()];
            at += e.len();
            e.on_air().map_or(0.0, |a| a.added(p, &x))
        };
        self.catalogue.iter().map(one).sum()
    }

    /// What one instant says.
    fn rows_of(
        &self,
        (i, s, wind): (&Instant, &Ideal, &Vector2<f64>),
        values: &[f64],
        with_columns: bool,
    ) -> Vec<Row> {
        let effects = self.catalogue.iter().filter_map(|e| e.on_air());
        let columns = effects.flat_map(|a| a.drivers.iter().map(|d| d.value(&s.x)));
        let columns = if with_columns { columns.collect() } else { Vec::new() };
        match self.kind {
            AirKind::Barometer => vec![self.height(values, i, s, columns)],
            AirKind::Airspeed => self.speed((i, s, wind), values, columns),
        }
    }

    fn height(&self, values: &[f64], i: &Instant, s: &Ideal, mut columns: Vec<f64>) -> Row {
        let by_wind = by_wind(&s.c_nb, &s.x, |x| self.added(values, x));
        if !columns.is_empty() {
            columns.extend(by_wind.iter());
        }
        let mut by_state = States::x();
        by_state[BOUNDED] = 1.0;
        by_state[GIVEN] = by_wind.norm();
        let residual = i.measured - s.value - self.added(values, &s.x);
        Row { elapsed_s: i.elapsed_s, residual, noise: 1.0, least: 0.0, by_state, columns }
    }

    /// The airspeed, and for a wing that it does not slip; nothing on the ground.
    fn speed(
        &self,
        (i, s, wind): (&Instant, &Ideal, &Vector2<f64>),
        values: &[f64],
        mut columns: Vec<f64>,
    ) -> Vec<Row> {
        if !flies(i, s, wind) {
            return Vec::new();
        }
        let against = s.x.velocity.norm();
        let scale = values[0];
        let [slip, by_force] = [0, 1].map(|k| values[self.effects() + k]);
        let slip = slip + by_force * s.side_force;
        let by_speed = (1.0 + scale) * (s.x.density / SEA_LEVEL_DENSITY).sqrt();
        let unit = s.c_nb * s.x.velocity / against;
        let by_state = States::from([-unit.x * by_speed, -unit.y * by_speed, by_speed, 0.0, 0.0]);
        let with_columns = !columns.is_empty();
        let none = if with_columns { vec![0.0; self.effects()] } else { Vec::new() };
        columns.extend(with_columns.then_some([0.0; 2]).into_iter().flatten());
        let speed = Row {
            elapsed_s: i.elapsed_s,
            residual: i.measured - s.value - self.added(values, &s.x) + by_state.xy().dot(wind),
            noise: 1.0,
            least: 0.0,
            by_state,
            columns,
        };
        if !self.is_wing {
            return vec![speed];
        }
        let across = s.c_nb * Vector3::y();
        let by_state = States::from([-across.x, -across.y, 0.0, 0.0, 0.0]);
        let slipping = Row {
            residual: slip * against - s.x.velocity.y + by_state.xy().dot(wind),
            noise: 0.0,
            least: SLIP * against,
            by_state,
            columns: none
                .into_iter()
                .chain(with_columns.then_some([-against, -against * s.side_force]).into_iter().flatten())
                .collect(),
            ..speed.clone()
        };
        vec![speed, slipping]
    }

    /// The wind at every instant, with the gust along the flow, and 1-sigma of its mean along each axis.
    fn winds(&self, values: &[f64], noise: &Noise) -> (Vec<(Vector2<f64>, f64)>, Vector2<f64>) {
        let rows = self.rows(values, false);
        let smoothed = series::pass(&rows, noise, BLOCK_S).smoothed();
        let mut next = 0;
        let at = |i: &Instant| {
            while rows.get(next + 1).is_some_and(|r| r.elapsed_s <= i.elapsed_s) {
                next += 1;
            }
            smoothed.get(next).map_or_else(Default::default, |s| (s.0.xy(), s.0[BOUNDED]))
        };
        let winds = self.instants.iter().map(at).collect();
        let count = smoothed.len().max(1) as f64;
        let variance = smoothed.iter().map(|s| s.1.diagonal().xy()).sum::<Vector2<f64>>() / count;
        (winds, variance.map(|v| v.max(0.0).sqrt()))
    }

    /// The wind without gusts: those along the flow are a state of the airspeed.
    fn wind_alone(&self, values: &[f64], noise: &Noise) -> Vec<Vector2<f64>> {
        self.winds(values, noise).0.into_iter().map(|w| w.0).collect()
    }

    /// What is left of the measurement at every instant: of a height about its mean over [`ABOUT_S`] before and after, of an airspeed in the wind that goes with the values `by`, and on the ground nothing.
    fn residuals(&self, values: &[f64], by: &[f64], noise: &Noise) -> Vec<f64> {
        let wind = match self.kind {
            AirKind::Barometer => self.wind.clone(),
            AirKind::Airspeed => self.wind_alone(by, noise),
        };
        let ideal = self.ideal(values, &wind);
        let left = |(i, s): (&Instant, &Ideal)| i.measured - s.value - self.added(values, &s.x);
        let all: Vec<f64> = self.instants.iter().zip(&ideal).map(left).collect();
        match self.kind {
            AirKind::Barometer => {
                let heights: Vec<(f64, f64)> = self.instants.iter().map(|i| i.elapsed_s).zip(all).collect();
                about_mean(&heights, ABOUT_S)
            }
            AirKind::Airspeed => {
                let parts = self.instants.iter().zip(&ideal).zip(&wind).zip(all);
                parts.map(|(((i, s), w), left)| if flies(i, s, w) { left } else { f64::NAN }).collect()
            }
        }
    }

    pub(super) fn found(&self, sensor: u8, chosen: &Chosen, noise: Noise) -> AirFound {
        let (named, zero) = (&chosen.named, vec![0.0; self.widths.len()]);
        let [before, after] = [&zero, named].map(|v| self.residuals(v, named, &noise));
        let values = self.of_the_sensor(chosen);
        let within = self.ideal(&values, &self.wind);
        let errors = self.errors(&values, &within);
        // Where an airspeed sensor measures nothing there is no residual, and no error.
        let flown =
            errors.iter().zip(&within).zip(&before).filter(|(_, left)| left.is_finite()).map(|(e, _)| e);
        let largest = flown.max_by(|a, b| a.0.0.abs().total_cmp(&b.0.0.abs()));
        let slope = largest.map_or_else(|| DVector::zeros(self.widths.len()), |l| self.slope(l.1));
        let every = self.instants.len().div_ceil(600).max(1);
        let points = errors.iter().zip(before.iter().zip(&after)).step_by(every);
        AirFound {
            kind: [AirQuantity::Height, AirQuantity::Airspeed][self.kind as usize],
            sensor,
            instants: self.instants.len(),
            largest: largest.map_or((0.0, 0.0), |l| *l.0),
            largest_sigma: slope.dot(&(&chosen.covariance * &slope)).max(0.0).sqrt(),
            residual: [&before, &after].map(|of| rms(of.iter().copied())),
            held_out: [&zero, &chosen.fitted].map(|v| self.held_out_rms(v, &chosen.fitted, &noise)),
            unexplained: self.held_out_rms(&chosen.within[1], &chosen.within[1], &noise),
            noise: [noise.sigma, noise.walk],
            known_to: self.known_to(chosen, &within),
            effects: chosen.findings.clone(),
            shared: self.shared(&slope, &values, chosen),
            removed: chosen.removed.clone(),
            not_found: chosen.not_found.clone(),
            wind: (self.kind == AirKind::Airspeed).then(|| self.wind(named, &noise, chosen)),
            points: points.map(|((_, speed), (b, a))| [*speed, *b, *a]).collect(),
            density: 0.0,
        }
    }

    /// 1-sigma of what may have stayed unseen of the first effect (port or scale) at the 90th percentile of the speed.
    fn known_to(&self, chosen: &Chosen, ideal: &[Ideal]) -> f64 {
        let first = self.catalogue[0].on_air().and_then(|a| a.drivers.first());
        chosen.first_sigma * high(ideal.iter().filter_map(|s| Some(first?.value(&s.x).abs())))
    }

    fn wind(&self, named: &[f64], noise: &Noise, chosen: &Chosen) -> Wind {
        let (blowing, own) = self.winds(named, noise);
        let winds: Vec<Vector2<f64>> = blowing.iter().map(|w| w.0).collect();
        // On the ground nothing shows the wind, and there it is weaker.
        let ideal = self.ideal(named, &winds);
        let flown: Vec<bool> =
            self.instants.iter().zip(&ideal).zip(&winds).map(|((i, s), w)| flies(i, s, w)).collect();
        let count = flown.iter().filter(|f| **f).count().max(1) as f64;
        let sum_of = |of: &mut dyn Iterator<Item = (Vector2<f64>, bool)>| {
            of.filter(|w| w.1).map(|w| w.0).sum::<Vector2<f64>>()
        };
        let mean_of = |w: &[Vector2<f64>]| sum_of(&mut w.iter().copied().zip(flown.iter().copied())) / count;
        let mean = mean_of(&winds);
        // What the sensor's own error leaves open.
        let mut shifted = named.to_vec();
        shifted[0] += chosen.first_sigma;
        let by_scale = mean_of(&self.wind_alone(&shifted, noise)) - mean;
        let squares: Vec<Vector2<f64>> = winds.iter().map(|w| (w - mean).map(|d| d * d)).collect();
        let changed = mean_of(&squares).sum();
        Wind {
            mean: mean.into(),
            sigma: [0, 1].map(|k| rss(own[k], by_scale[k])),
            changed: (0.5 * changed).sqrt(),
            gusts: noise.bounded,
            track: self.instants.iter().map(|i| i.elapsed_s).zip(blowing).collect(),
        }
    }
}
