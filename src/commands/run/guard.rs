//! Signing in a run: what goes out is signed, what comes in is believed only with a signature of the same key.

use crate::commands::CommandError;
use crate::link::frame::Frame;
use crate::link::signing::{Key, Signer, TimeFile, Trust, Verifier};
use std::path::Path;

/// Signs what goes out and refuses what is not signed with the same key.
pub struct Guard {
    signer: Signer,
    verifier: Verifier,
    times: TimeFile,
    told: Vec<Trust>,
}

/// A frame that is not believed.
pub struct Refusal {
    /// What to tell the user, once per reason.
    pub first_of_its_kind: Option<String>,
}

impl Guard {
    /// With the key in this file; the last time used is kept beside it.
    pub fn load(path: &Path, now_us: u64) -> Result<Self, CommandError> {
        let key = Key::load(path)?;
        let (times, last) = TimeFile::open(&path.with_extension("time"));
        let verifier = Verifier::new(key.clone(), now_us);
        Ok(Self { signer: Signer::new(key, 0, last), verifier, times, told: Vec::new() })
    }

    /// The frame with a signature.
    pub fn sign(&mut self, frame: &Frame, now_us: u64) -> Frame {
        let signed = self.signer.sign(frame, now_us);
        if let Err(error) = self.times.keep(self.signer.last_ticks()) {
            tracing::warn!(%error, "the time of the last signature cannot be kept; after a restart frames may be refused");
        }
        signed
    }

    /// Whether the frame is to be dropped.
    pub fn refuse(&mut self, frame: &Frame) -> Option<Refusal> {
        let trust = self.verifier.judge(frame);
        let reason = match trust {
            Trust::Genuine => return None,
            Trust::Unsigned => "they are not signed",
            Trust::WrongKey => "they are signed with another key",
            Trust::Old => "their signature is old; one of the clocks may be wrong",
        };
        let first = !self.told.contains(&trust);
        if first {
            self.told.push(trust);
        }
        let (system, component) = (frame.system_id, frame.component_id);
        Some(Refusal {
            first_of_its_kind: first
                .then(|| format!("frames of system {system}, component {component} are refused: {reason}")),
        })
    }
}
