//! Stretches: what lies between two restarts, for those who take a flight as a whole.

use gaware_nav::sample::{AttitudeHint, GnssFix, ImuSample, ImuStream, Sample};

/// Samples of one stream on one time base, without a restart in between.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Stretch {
    /// What the inertial samples are.
    pub stream: ImuStream,
    /// Inertial samples in order of time.
    pub samples: Vec<ImuSample>,
    /// Fixes in order of time.
    pub fixes: Vec<GnssFix>,
    /// The autopilot's own attitude.
    pub attitudes: Vec<AttitudeHint>,
}

/// Cuts what a time line gave out at its restarts; stretches without an inertial sample are left out.
pub fn stretches(samples: &[Sample]) -> Vec<Stretch> {
    let mut all = vec![Stretch::default()];
    for sample in samples {
        if matches!(sample, Sample::Restart(_)) {
            let stream = all.last().map(|s| s.stream.clone()).unwrap_or_default();
            all.push(Stretch { stream, ..Stretch::default() });
        }
        let Some(now) = all.last_mut() else { continue };
        match sample {
            Sample::Stream(stream) => now.stream = stream.clone(),
            Sample::Imu(imu) => now.samples.push(*imu),
            Sample::Fix(fix) => now.fixes.push(*fix),
            Sample::Attitude(hint) => now.attitudes.push(*hint),
            Sample::Restart(_)
            | Sample::Recalibrated
            | Sample::Place(_)
            | Sample::Field(_)
            | Sample::Air(_)
            | Sample::Operating(_) => {}
        }
    }
    all.retain(|s| !s.samples.is_empty());
    all
}
