//! The two uses of the linear model beside each other, on recordings: the live filter, fix by fix about a trajectory of its own, and the flight
//! linearised as a whole about the smoothed one, as `explain` has it. With the same model and the same noise both must say the same of the constants.

use gaware::parallel::{Progress, map_runs};
use gaware::pipeline::samples;
use gaware::sensors::ConverterOptions;
use gaware_nav::effects;
use gaware_nav::filter::layout::index;
use gaware_nav::filter::{Filter, Fusion};
use gaware_nav::identify::Serial;
use gaware_nav::identify::flight::Flight;
use gaware_nav::identify::linear::Problem;
use gaware_nav::identify::linear::reference::Reference;
use gaware_nav::identify::noise::Noise;
use gaware_nav::identify::pass::Options;
use gaware_nav::identify::select::{self, Settings};
use gaware_nav::identify::watched::Watched;
use gaware_nav::model::{EffectSetting, Model};
use serde::Serialize;
use std::fmt::{Display, Formatter};
use std::path::{Path, PathBuf};

/// Effects of the explicit models, beside the delay that every receiver has; the standard one comes first.
const EXPLICIT: [&[&str]; 3] = [
    &["gps_latency", "gps_lever_arm"],
    &["gps_latency", "accel_scale_factor"],
    &["gps_latency", "gyro_g_sensitivity"],
];
/// The flight as a whole is linearised anew until no value moves by more than this share of its sigma …
const STILL: f64 = 0.02;
/// … or so often.
const MOST_TURNS: usize = 5;

/// One constant of one recording.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// File.
    pub log: String,
    /// `standard`, or the effects of the model.
    pub model: String,
    /// Parameter.
    pub name: &'static str,
    /// Unit of the values.
    pub unit: &'static str,
    /// Value and sigma of the live filter at the end.
    pub live: [f64; 2],
    /// Of the flight as a whole.
    pub whole: [f64; 2],
    /// Difference over the sigma of the whole.
    pub difference: f64,
    /// Sigma of the live filter over that of the whole.
    pub sigma_ratio: f64,
}

/// All of them.
#[derive(Debug, Clone, Serialize)]
pub struct Agreement {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// Recordings that say nothing, with the reason.
    pub failed: Vec<(String, String)>,
    /// Constants.
    pub rows: Vec<Row>,
}

/// How many comparisons these recordings are.
pub fn comparisons(logs: &[PathBuf]) -> usize {
    logs.len() * (1 + EXPLICIT.len())
}

/// Compares on these recordings.
pub fn run(logs: &[PathBuf], progress: &dyn Progress) -> Agreement {
    let models = 1 + EXPLICIT.len();
    let made = map_runs(comparisons(logs), progress, |k| one(&logs[k / models], k % models));
    let mut study = Agreement { schema: "gaware.study/1", failed: Vec::new(), rows: Vec::new() };
    for (k, result) in made.into_iter().enumerate() {
        match result {
            Ok(rows) => study.rows.extend(rows),
            Err(error) => study.failed.push((logs[k / models].display().to_string(), error)),
        }
    }
    study
}

/// The model number `which`, nothing of it known but its priors.
fn model(which: usize) -> (String, Model) {
    let Some(names) = which.checked_sub(1).and_then(|k| EXPLICIT.get(k)) else {
        return ("standard".to_owned(), Model::standard().with_receiver());
    };
    let mut model = Model::default().with_receiver();
    names.iter().filter_map(|n| effects::find(n)).for_each(|e| model.set(EffectSetting::unknown(e)));
    (names.join("+"), model)
}

fn one(log: &Path, which: usize) -> Result<Vec<Row>, String> {
    let samples = samples(log, ConverterOptions::default()).map_err(|error| error.to_string())?;
    let (name, prior) = model(which);
    let flight = Flight::prepare(&samples, &prior).map_err(|error| error.to_string())?;
    // Noise is fitted about the values, values are found with the noise.
    let settings = Settings { options: Options::default().all(), ..Settings::default() };
    let mut noise = Noise::measured(&prior, &[&flight]);
    let mut filter = live(&flight, &prior, &noise);
    for _ in 0..2 {
        noise = select::best_noise(&[&flight], &known(&prior, &filter), &noise, &settings, &Serial).0;
        filter = live(&flight, &prior, &noise);
    }
    let whole =
        whole(&flight, &prior, known(&prior, &filter), &noise).ok_or("the information is singular")?;
    let rows = filter.layout().slots().iter().zip(whole).map(|(slot, (value, sigma))| {
        let name = &filter.layout().names()[slot.state - index::GYRO_BIAS];
        let own = filter.calibration().get(filter.layout(), slot.state);
        let own_sigma = filter.covariance().sigma(slot.state);
        let unit = name.unit.si;
        Row {
            log: log.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
            model: String::new(),
            name: name.name,
            unit: name.unit.symbol,
            live: [own / unit, own_sigma / unit],
            whole: [value / unit, sigma / unit],
            difference: (own - value) / sigma,
            sigma_ratio: own_sigma / sigma,
        }
    });
    Ok(rows.map(|r| Row { model: name.clone(), ..r }).collect())
}

/// The live filter with this noise at the end of a flight.
fn live(flight: &Flight, model: &Model, noise: &Noise) -> Filter {
    let mut fusion = Fusion::new(Filter::new(&noise.of(model), flight.initial()));
    let (kind, rounding) = (flight.stream().kind, flight.rounding_noise(model));
    let mut fixes = flight.fixes().iter().peekable();
    for sample in flight.samples_of(model).iter() {
        while let Some(fix) = fixes.next_if(|f| f.t_s <= sample.t_s) {
            fusion.push_fix(*fix);
        }
        fusion.filter_mut().set_stream(kind, rounding(sample.t_s));
        fusion.push_imu(*sample);
        while fusion.poll().is_some() {}
    }
    fusion.filter().clone()
}

/// The model with the values of a filter, taken for known.
fn known(prior: &Model, filter: &Filter) -> Model {
    let mut model = prior.clone();
    for (setting, values) in model.effects.iter_mut().zip(filter.calibration().parameters()) {
        setting.values.clone_from(values);
        setting.sigmas.fill(0.0);
    }
    model
}

/// Values and sigmas of all estimated parameters by the flight as a whole, from where a model has them.
fn whole(flight: &Flight, prior: &Model, mut model: Model, noise: &Noise) -> Option<Vec<(f64, f64)>> {
    let mut found = Vec::new();
    for _ in 0..MOST_TURNS {
        let effects = model.effects.iter().zip(&prior.effects);
        let effects = effects.map(|(m, p)| EffectSetting { sigmas: p.sigmas.clone(), ..m.clone() });
        let watched = Watched { effects: effects.collect() };
        let reference = Reference::find(flight, &model, noise, &Serial);
        let problem = Problem::new(flight, &model, &reference, &watched, &Serial);
        let run = problem.run(noise, &Options { settle_s: 0.0, ..Options::default() }.all());
        let mut information = run.information[0].clone();
        for (column, (e, p)) in watched.slots().into_iter().enumerate() {
            let weight = prior.effects[e].sigmas[p].powi(-2);
            information.matrix[(column, column)] += weight;
            information.score[column] += weight * (prior.effects[e].values[p] - model.effects[e].values[p]);
        }
        let covariance = information.matrix.clone().try_inverse()?;
        let step = &covariance * &information.score;
        let mut largest = 0.0f64;
        found.clear();
        for (column, (e, p)) in watched.slots().into_iter().enumerate() {
            let sigma = covariance[(column, column)].sqrt();
            model.effects[e].values[p] += step[column];
            largest = largest.max((step[column] / sigma).abs());
            found.push((model.effects[e].values[p], sigma));
        }
        if largest < STILL {
            break;
        }
    }
    Some(found)
}

impl Display for Agreement {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        self.failed.iter().try_for_each(|(log, error)| writeln!(f, "{log}: {error}"))?;
        writeln!(
            f,
            "{:34} {:26}{:>6}{:>12}{:>12}{:>12}{:>12}",
            "recording", "model", "states", "RMS, sigma", "largest", "of", "sigma ratio"
        )?;
        for own in self.rows.chunk_by(|a, b| a.log == b.log && a.model == b.model) {
            let worst = own.iter().max_by(|a, b| a.difference.abs().total_cmp(&b.difference.abs()));
            let (Some(first), Some(worst)) = (own.first(), worst) else { continue };
            let rms = (own.iter().map(|r| r.difference.powi(2)).sum::<f64>() / own.len() as f64).sqrt();
            let ratios = || own.iter().map(|r| r.sigma_ratio);
            let (low, high) = (ratios().fold(f64::INFINITY, f64::min), ratios().fold(0.0, f64::max));
            writeln!(
                f,
                "{:34} {:26}{:6}{rms:12.2}{:12.2}{:>12}   {low:.2} to {high:.2}",
                first.log,
                first.model,
                own.len(),
                worst.difference,
                worst.name
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware::parallel::Silent;

    /// The recordings of this repository, whatever model: 54 constants each.
    #[test]
    fn the_live_filter_and_the_flight_as_a_whole_say_the_same() {
        let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data");
        let logs = ["small_clean_dither.tlog", "small_gsens_typical_dither.tlog"].map(|name| data.join(name));
        let study = run(&logs, &Silent);
        assert_eq!((study.failed.len(), study.rows.len()), (0, 108));
        for own in study.rows.chunk_by(|a, b| a.log == b.log && a.model == b.model) {
            let rms = (own.iter().map(|r| r.difference.powi(2)).sum::<f64>() / own.len() as f64).sqrt();
            assert!(rms < 0.2, "{rms}: {own:?}");
            assert!(own.iter().all(|r| r.difference.abs() < 0.45), "{own:?}");
        }
    }
}
