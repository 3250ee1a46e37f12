//! The fault campaign: every fault of link, clocks and sensors in the middle of a flight, in one process and virtual time.
//!
//! Sensors are drawn from what the companion assumes, so that the normalised squared error of honest sigmas is chi-squared before
//! and after each fault. For each fault: what the pilot can read, how long the estimate takes to be right again, what was lost, and
//! whether the sigmas still hold. A fault that costs something and is not reported, or after which they do not, is a failure of
//! the program, and the study says so.

mod flight;
pub mod long;
mod registry;
mod spoiler;
mod station;

use super::statistics::{Summary, summary};
pub use flight::Lost;
use flight::{Course, at, fly, kinds};
use gaware::parallel::{Progress, map_runs};
use gaware::sinks::events::cause_of;
use gaware_sitl::scenario::scenario;
use registry::{Case, registry};
use serde::Serialize;

/// Mean normalised squared error per degree of freedom that honest sigmas keep to …
const MEAN_LIMIT: f64 = 1.25;
/// … and a single flight's.
const WORST_LIMIT: f64 = 3.0;
/// Degrees of freedom of the standard model, roughly: how far the mean of few flights may stray by chance.
const DOF: f64 = 36.0;
/// After its end a fault must be over within this, s.
const RECOVERED_WITHIN_S: f64 = 60.0;
/// "After" is so long after the end of the fault, s.
const AFTER_S: f64 = 40.0;
/// The last look is so long before the end of the flight, s.
const END_S: f64 = 3.0;

/// What is asked for.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Vehicles of each kind per fault.
    pub seeds: usize,
    /// First seed.
    pub seed: u64,
    /// Only faults whose name contains one of these.
    pub faults: Vec<String>,
}

/// Errors against sigmas at one instant, over all flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// Flights in which a filter ran.
    pub running: usize,
    /// Mean normalised squared error per degree of freedom.
    pub mean: f64,
    /// The worst flight's.
    pub worst: f64,
    /// The same for the constants of the sensors alone.
    pub constants_mean: f64,
    /// The worst flight's.
    pub constants_worst: f64,
}

/// A sentence on the screens that was not there before the fault.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sentence {
    /// As the first flight has it.
    pub text: String,
    /// Flights in which it was shown.
    pub flights: usize,
    /// Median of the time since the begin of the fault, s.
    pub after_s: f64,
}

/// One fault over all flights.
#[derive(Debug, Clone, Serialize)]
pub struct FaultResult {
    /// Name.
    pub fault: &'static str,
    /// What happens, in words.
    pub happens: &'static str,
    /// Flights.
    pub flights: usize,
    /// When, s after power-on.
    pub span_s: (f64, f64),
    /// What the pilot can read.
    pub shown: Vec<Sentence>,
    /// From the end of the fault until link, phase and position are right, median and worst, s; nothing where a flight never got there.
    pub recovered_after_s: Option<[f64; 2]>,
    /// Mean losses of a flight.
    pub lost: Lost,
    /// Just before.
    pub before: Consistency,
    /// While it lasts: the mean of each flight; nothing where it is over at once, or where the estimate rests until its end.
    pub during: Option<Consistency>,
    /// 40 s after it.
    pub after: Consistency,
    /// At the end of the flight.
    pub end: Consistency,
    /// What must not be, in words.
    pub failures: Vec<String>,
}

/// The whole campaign.
#[derive(Debug, Clone, Serialize)]
pub struct Faults {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// First seed.
    pub seed: u64,
    /// Every fault.
    pub faults: Vec<FaultResult>,
}

impl Faults {
    /// What must not be, with the fault that did it.
    pub fn failures(&self) -> Vec<String> {
        let one =
            |f: &FaultResult| f.failures.iter().map(|w| format!("{}: {w}", f.fault)).collect::<Vec<_>>();
        self.faults.iter().flat_map(one).collect()
    }
}

/// Why the campaign cannot run.
#[derive(Debug, thiserror::Error)]
pub enum FaultsError {
    /// A scenario is gone.
    #[error("the scenario \"{0}\" does not exist in this build")]
    NoScenario(&'static str),
    /// Nothing of that name.
    #[error("no fault is called {asked}; faults: {known}")]
    NoFault {
        /// As written.
        asked: String,
        /// The names.
        known: String,
    },
    /// Nothing to do.
    #[error("a study needs at least 1 seed")]
    NoSeeds,
    /// The recording cannot be started.
    #[error(transparent)]
    Recorder(#[from] gaware::sinks::recorder::RecorderError),
    /// A recording cannot be read back.
    #[error("cannot read {path}: {source}")]
    Read {
        /// Which.
        path: std::path::PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
}

fn chosen(asked: &[String]) -> Result<Vec<Case>, FaultsError> {
    let all = registry();
    if let Some(wrong) = asked.iter().find(|a| !all.iter().any(|c| c.name.contains(a.as_str()))) {
        let known = all.iter().map(|c| c.name).collect::<Vec<_>>().join(", ");
        return Err(FaultsError::NoFault { asked: wrong.clone(), known });
    }
    let wanted = |c: &Case| asked.is_empty() || asked.iter().any(|a| c.name.contains(a.as_str()));
    Ok(all.into_iter().filter(wanted).collect())
}

/// Number of flights that [`run`] will make.
///
/// # Errors
/// A name that no fault has.
pub fn flights(settings: &Settings) -> Result<usize, FaultsError> {
    Ok(chosen(&settings.faults)?.len() * 2 * settings.seeds)
}

/// Runs the campaign.
///
/// # Errors
/// No seeds, or a name that no fault has.
pub fn run(settings: &Settings, progress: &dyn Progress) -> Result<Faults, FaultsError> {
    if settings.seeds == 0 {
        return Err(FaultsError::NoSeeds);
    }
    let base = scenario("fixed_wing").ok_or(FaultsError::NoScenario("fixed_wing"))?;
    let kinds = kinds();
    let mut faults = Vec::new();
    for case in chosen(&settings.faults)? {
        let courses = map_runs(2 * settings.seeds, progress, |k| {
            let kind = if k % 2 == 0 || case.highres { &kinds[0] } else { &kinds[1] };
            fly(&case, kind, &base, settings.seed.wrapping_add(k as u64))
        });
        faults.push(summarise(&case, &courses));
    }
    Ok(Faults { schema: "gaware.study/1", seed: settings.seed, faults })
}

fn consistency(nees: &[[f64; 2]]) -> Consistency {
    let of = |k: usize| -> Summary { summary(nees.iter().map(|n| if k == 0 { n[0] } else { n[1] })) };
    let (all, constants) = (of(0), of(1));
    Consistency {
        running: nees.len(),
        mean: all.mean,
        worst: all.max,
        constants_mean: constants.mean,
        constants_worst: constants.max,
    }
}

fn summarise(case: &Case, courses: &[Course]) -> FaultResult {
    let (from_s, to_s) = case.span_s;
    let when =
        |t_s: f64| -> Vec<[f64; 2]> { courses.iter().filter_map(|c| at(&c.looks, t_s)?.nees).collect() };
    let last: Vec<[f64; 2]> =
        courses.iter().filter_map(|c| at(&c.looks, c.looks.last()?.t_s - END_S)?.nees).collect();
    let recovered: Vec<f64> = courses
        .iter()
        .filter_map(|c| c.looks.iter().find(|l| l.t_s > to_s && l.right))
        .map(|l| l.t_s - to_s)
        .collect();
    let times = summary(recovered.iter().copied());
    let mut result = FaultResult {
        fault: case.name,
        happens: case.happens,
        flights: courses.len(),
        span_s: case.span_s,
        shown: sentences(courses),
        recovered_after_s: (recovered.len() == courses.len()).then_some([times.median, times.max]),
        lost: mean_of(courses),
        before: consistency(&when(from_s - 2.0)),
        during: Some(consistency(&means(courses, from_s, to_s))).filter(|c| c.running > 0),
        after: consistency(&when(to_s + AFTER_S)),
        end: consistency(&last),
        failures: Vec::new(),
    };
    result.failures = failures(case, courses, &result);
    result
}

/// Mean of each flight over a span of time.
fn means(courses: &[Course], from_s: f64, to_s: f64) -> Vec<[f64; 2]> {
    let mean = |course: &Course| {
        let inside = course.looks.iter().filter(|l| l.t_s > from_s && l.t_s <= to_s);
        let nees: Vec<[f64; 2]> = inside.filter_map(|l| l.nees).collect();
        let n = nees.len() as f64;
        (n > 0.0).then(|| nees.iter().fold([0.0; 2], |a, b| [a[0] + b[0] / n, a[1] + b[1] / n]))
    };
    courses.iter().filter_map(mean).collect()
}

fn mean_of(courses: &[Course]) -> Lost {
    let mean = |f: fn(&Lost) -> f64| courses.iter().map(|c| f(&c.lost)).sum::<f64>() / courses.len() as f64;
    Lost {
        frames: mean(|l| l.frames),
        samples: mean(|l| l.samples),
        gaps_s: mean(|l| l.gaps_s),
        fixes: mean(|l| l.fixes),
        restarts: mean(|l| l.restarts),
    }
}

/// What was shown, by cause, in the order of the first time.
fn sentences(courses: &[Course]) -> Vec<Sentence> {
    let mut found: Vec<(String, String, Vec<f64>)> = Vec::new();
    for (after_s, text) in courses.iter().flat_map(|c| &c.reported) {
        let cause = cause_of(text);
        match found.iter_mut().find(|(known, ..)| *known == cause) {
            Some((_, _, times)) => times.push(*after_s),
            None => found.push((cause, text.clone(), vec![*after_s])),
        }
    }
    let mut all: Vec<Sentence> = found
        .into_iter()
        .map(|(_, text, times)| Sentence {
            text,
            flights: times.len(),
            after_s: summary(times.into_iter()).median,
        })
        .collect();
    all.sort_by(|a, b| a.after_s.total_cmp(&b.after_s));
    all
}

fn failures(case: &Case, courses: &[Course], result: &FaultResult) -> Vec<String> {
    let mut wrong = Vec::new();
    let silent = courses.iter().filter(|c| {
        let said = |words: &&str| c.reported.iter().any(|(_, text)| text.contains(words));
        !case.reported.is_empty() && !case.reported.iter().any(said)
    });
    match silent.count() {
        0 => {}
        n => wrong.push(format!("not reported to the pilot in {n} of {} flights", courses.len())),
    }
    match result.recovered_after_s {
        Some([_, worst]) if worst <= RECOVERED_WITHIN_S => {}
        Some([_, worst]) => wrong.push(format!("right again only {worst:.0} s after its end")),
        None => wrong.push("not every flight was right again before its end".to_owned()),
    }
    let chance = 1.0 + 3.3 * (2.0 / (DOF * courses.len() as f64)).sqrt();
    let mean_limit = MEAN_LIMIT.max(chance);
    for (when, c) in [("40 s after it", &result.after), ("at the end of the flight", &result.end)] {
        for (what, mean, worst) in
            [("all states", c.mean, c.worst), ("the sensors' constants", c.constants_mean, c.constants_worst)]
        {
            if !(mean <= mean_limit && worst <= WORST_LIMIT) {
                wrong.push(format!("NEES/dof of {what} {when}: mean {mean:.2}, worst {worst:.2}"));
            }
        }
    }
    if let Some(c) = result.during
        && !(c.constants_mean <= mean_limit && c.constants_worst <= WORST_LIMIT)
    {
        let (mean, worst) = (c.constants_mean, c.constants_worst);
        wrong.push(format!(
            "NEES/dof of the sensors' constants while it lasts: mean {mean:.2}, worst {worst:.2}"
        ));
    }
    wrong
}

#[cfg(test)]
mod tests;
