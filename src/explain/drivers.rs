//! What a sensor does against what drives it: residuals of the smoothed trajectory by the value of the driver of an effect that the catalogue
//! does not hold, before and after.

use super::FlightResiduals;
use gaware_nav::effects::data;
use gaware_nav::identify::flight::Flight;
use gaware_nav::identify::judge::Judged;
use gaware_nav::identify::residual::{CHANNELS, Point};
use gaware_nav::identify::size::instant;

/// Points are gathered in so many bins with as many points each.
const BINS: usize = 14;
/// Fewer points say nothing.
const ENOUGH: usize = 140;

/// Points of about one value of the driver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// Mean of the driver, SI.
    pub driver: f64,
    /// Mean of the residual, in the unit of the plot.
    pub residual: f64,
    /// Standard error of that.
    pub error: f64,
}

/// One axis of one effect.
#[derive(Debug, Clone, PartialEq)]
pub struct DriverPlot {
    /// Name of the effect.
    pub effect: &'static str,
    /// `gyro z`.
    pub channel: String,
    /// Unit of the residual.
    pub unit: &'static str,
    /// The expression.
    pub driver: String,
    /// Coefficient, unit of the residual by driver in SI.
    pub slope: f64,
    /// With the given model, and with the new one.
    pub bins: [Vec<Bin>; 2],
}

/// The most significant axis of each effect that is data.
pub(super) fn plots(judged: &Judged, residuals: &[FlightResiduals], flights: &[&Flight]) -> Vec<DriverPlot> {
    let one = |added: &gaware_nav::identify::select::Added| {
        let setting = &added.setting;
        let effect = setting.effect;
        let definition = data::definition(effect.name())?;
        let z = |k: usize| {
            if setting.sigmas[k] > 0.0 { (setting.values[k] / setting.sigmas[k]).abs() } else { 0.0 }
        };
        let best = (0..effect.len()).max_by(|a, b| z(*a).total_cmp(&z(*b)))?;
        let mut alone = vec![0.0; effect.len()];
        alone[best] = 1.0;
        let (target, shown) = (definition.target, definition.target.unit());
        let name = setting.parameters().nth(best)?.0;
        let axis = definition.axes().iter().position(|a| *a == name)?;
        // Channels are three of each target, in its order.
        let channel = axis + 3 * target as usize;
        let gathered = |of: fn(&FlightResiduals) -> &Vec<Point>| {
            let mut points = Vec::new();
            for (flight_residuals, flight) in residuals.iter().zip(flights) {
                for point in of(flight_residuals) {
                    let x = instant(&point.motion, flight);
                    let added = data::added(effect.name(), &alone, &x).map_or(0.0, |a| a.1[axis]);
                    points.extend(point.residuals[channel].map(|r| (added, r.value / shown.si)));
                }
            }
            binned(points)
        };
        Some(DriverPlot {
            effect: effect.name(),
            channel: CHANNELS[channel].replace('_', " "),
            unit: shown.symbol,
            driver: definition.drivers[axis].as_ref()?.text().to_owned(),
            slope: setting.values[best] / shown.si,
            bins: [gathered(|g| &g.before), gathered(|g| &g.after)],
        })
    };
    let all = judged.selection.added.iter().filter_map(one);
    all.filter(|p| p.bins.iter().all(|b| !b.is_empty())).collect()
}

fn binned(mut points: Vec<(f64, f64)>) -> Vec<Bin> {
    if points.len() < ENOUGH {
        return Vec::new();
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let bin = |points: &[(f64, f64)]| {
        let n = points.len() as f64;
        let mean = |of: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
        let residual = mean(&|p| p.1);
        let square = mean(&|p| (p.1 - residual).powi(2));
        Bin { driver: mean(&|p| p.0), residual, error: (square / n).sqrt() }
    };
    points.chunks(points.len().div_ceil(BINS)).map(bin).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_have_the_mean_of_their_points_and_its_error() {
        let points: Vec<(f64, f64)> = (0..1400)
            .map(|k| (f64::from(k), 2.0 * f64::from(k) + if k % 2 == 0 { 1.0 } else { -1.0 }))
            .collect();
        let bins = binned(points);
        assert_eq!(bins.len(), BINS);
        assert!(bins.iter().all(|b| (b.residual - 2.0 * b.driver).abs() < 0.1 && b.error > 1.0), "{bins:?}");
        assert!(binned(vec![(0.0, 0.0); 10]).is_empty());
    }
}
