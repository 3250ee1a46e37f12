//! Which unit this is: a run begins before the vehicle has named itself, and anew with what is known of its unit once it has.
//!
//! What the engine got until then is held and given to the new one, and the recording gets the new model: its replay is the same to the last bit.

use super::model;
use crate::commands::known::UnitFileArgs;
use crate::commands::unit::today;
use crate::pipeline::{Estimator, Pipeline};
use crate::sensors::Severity;
use crate::sinks::recorder::Setup;
use crate::unit::known::KnownUnit;
use gaware_nav::model::Model;

/// What the engine gets is held for so long after the first sample, µs. A vehicle answers the first question for its version within a second; five
/// are asked, and a radio that is busy with parameters takes its time.
const HELD_US: u64 = 30_000_000;

/// How the question stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// The vehicle has not named itself.
    Open,
    /// It has not, and it is too late to begin anew.
    Late,
    /// Answered, or not asked.
    Settled,
}

/// The unit of a run.
pub(super) struct Introduction<E> {
    files: UnitFileArgs,
    given: Option<Model>,
    /// The file that the estimate began from.
    pub(super) begun: Option<KnownUnit>,
    setup: Setup,
    make: Box<dyn Fn(Model) -> E + Send>,
    stage: Stage,
    first_sample_us: Option<u64>,
}

impl<E: Estimator> Introduction<E> {
    /// Of a run that began with this; `pipeline` holds what its engine gets where the answer may change that.
    pub(super) fn new(
        files: &UnitFileArgs,
        given: Option<Model>,
        begun: Option<KnownUnit>,
        setup: Setup,
        make: Box<dyn Fn(Model) -> E + Send>,
        pipeline: &mut Pipeline<E>,
    ) -> Self {
        let open = files.asks_for_id();
        if open {
            pipeline.hold();
        }
        let stage = if open { Stage::Open } else { Stage::Settled };
        Self { files: files.clone(), given, begun, setup, make, stage, first_sample_us: None }
    }

    /// Whether the vehicle's id is still wanted.
    pub(super) fn asks(&self) -> bool {
        self.stage != Stage::Settled
    }

    /// A sample came: what is held does not grow for ever.
    pub(super) fn sampled(&mut self, t_us: u64, pipeline: &mut Pipeline<E>) {
        let first = *self.first_sample_us.get_or_insert(t_us);
        if self.stage == Stage::Open && t_us.saturating_sub(first) > HELD_US {
            self.stage = Stage::Late;
            pipeline.let_go();
        }
    }

    /// The vehicle has named itself: what is to be told, and the set-up of the recording where it is another from now on.
    pub(super) fn named(
        &mut self,
        id: &str,
        pipeline: &mut Pipeline<E>,
    ) -> Option<(Severity, String, Option<Setup>)> {
        // Every frame after the answer comes by here: the folder is read once.
        let stage = std::mem::replace(&mut self.stage, Stage::Settled);
        if stage == Stage::Settled {
            return None;
        }
        let (severity, text, known) = match self.files.decide(Some(id)) {
            Ok(known) if known.as_ref().map(|k| &k.path) == self.begun.as_ref().map(|k| &k.path) => {
                pipeline.let_go();
                return known.map(|k| (Severity::Info, k.words(&today()), None));
            }
            Ok(known) => {
                (Severity::Info, known.as_ref().map(|k| k.words(&today())).unwrap_or_default(), known)
            }
            Err(error) => (Severity::Warning, format!("{error}; the estimate begins without it"), None),
        };
        if stage == Stage::Late {
            let text = format!("the vehicle named itself too late to begin anew: {text}");
            return Some((Severity::Warning, text, None));
        }
        if known.is_none() && self.begun.is_none() {
            pipeline.let_go();
            return Some((severity, text, None));
        }
        let model = model(self.given.clone(), known.as_ref());
        self.setup.model_toml = model.to_toml();
        pipeline.begin_anew((self.make)(model));
        self.begun = known;
        Some((severity, text, Some(self.setup.clone())))
    }
}
