//! The unit's own file, as long as what is measured agrees with it.

use super::{Estimator, EstimatorEvent, State};
use std::sync::Arc;

impl Estimator {
    /// A unit's file that what was measured contradicts is not believed any more.
    pub(super) fn doubt_unit(&mut self) {
        let State::Running(bank) = &self.state else { return };
        let filter = bank.filter();
        // As often as a filter is kept.
        let looked = self.kept.back().is_some_and(|kept| kept.t_s() == filter.t_s());
        let Some((worst, sigmas, constants)) = looked.then(|| filter.contradicts_unit()).flatten() else {
            return;
        };
        let free = Arc::new(filter.forgetting_unit());
        self.model = std::mem::take(&mut self.model).forgetting_unit();
        self.align_anew(EstimatorEvent::UnitContradicted { worst, sigmas, constants }, false);
        (self.before, self.certain) = (Some(free), None);
    }
}
