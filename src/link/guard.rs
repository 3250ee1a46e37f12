//! Signing in a run: what goes out is signed, what comes in is accepted only with a signature of the same key.

use super::frame::Frame;
use super::signing::{Key, Signer, SigningError, TimeFile, Trust, Verifier};
use std::path::Path;

/// Why a frame is refused that may be a repetition.
const OLD: &str = "their signature is old; one of the clocks may be wrong";
/// Told once, like each reason of a refusal.
const AHEAD: &str = "ahead";

/// Signs what goes out and refuses what is not signed with the same key.
pub struct Guard {
    signer: Signer,
    verifier: Verifier,
    times: TimeFile,
    told: Vec<&'static str>,
    /// What is to be reported of a frame that was accepted.
    warning: Option<String>,
    cannot_keep: bool,
}

/// A frame that is not accepted.
pub struct Refusal {
    /// The message to the user, once per reason.
    pub first_of_its_kind: Option<String>,
}

impl Guard {
    /// With the key in this file; the last time used is kept beside it.
    ///
    /// # Errors
    /// The key cannot be read, or is none.
    pub fn load(path: &Path) -> Result<Self, SigningError> {
        let key = Key::load(path)?;
        if Key::is_exposed(path) {
            tracing::warn!(
                path = %path.display(),
                "the signing key can be read by others than its owner; chmod 600 it"
            );
        }
        let (file, times) = TimeFile::open(&path.with_extension("time"));
        let verifier = Verifier::new(key.clone(), times.others);
        let signer = Signer::new(key, times.ours);
        Ok(Self { signer, verifier, times: file, told: Vec::new(), warning: None, cannot_keep: false })
    }

    /// The frame with a signature for this link.
    pub fn sign(&mut self, frame: &Frame, link_id: u8, now_us: u64) -> Frame {
        let signed = self.signer.sign(frame, link_id, now_us);
        let kept = self.times.keep(self.signer.last_ticks(), self.verifier.newest());
        self.report(kept);
        signed
    }

    /// Writes the times down, at the end of a run.
    pub fn close(&mut self) {
        let kept = self.times.write(self.signer.last_ticks(), self.verifier.newest());
        self.report(kept);
    }

    fn report(&mut self, kept: std::io::Result<()>) {
        if let Err(error) = kept
            && !std::mem::replace(&mut self.cannot_keep, true)
        {
            tracing::warn!(%error, "the times of signatures cannot be kept; after a restart frames may be refused, and old ones accepted");
        }
    }

    /// Whether the frame is to be dropped.
    pub fn refuse(&mut self, frame: &Frame, now_us: u64) -> Option<Refusal> {
        let (system, component) = (frame.system_id, frame.component_id);
        let reason = match self.verifier.judge(frame, now_us) {
            Trust::Genuine => return None,
            Trust::Ahead(days) => {
                if self.is_new(AHEAD) {
                    self.warning = Some(format!(
                        "signed frames of system {system}, component {component} are stamped {days} days ahead of this computer: one of the \
                         clocks is wrong"
                    ));
                }
                return None;
            }
            Trust::Unsigned => "they are not signed",
            Trust::WrongKey => "they are signed with another key",
            Trust::Old => OLD,
        };
        let mut words = format!("frames of system {system}, component {component} are refused: {reason}");
        if reason == OLD {
            words.push_str(&format!(" (the newest stamps so far are in {})", self.times.path().display()));
        }
        Some(Refusal { first_of_its_kind: self.is_new(reason).then_some(words) })
    }

    /// What is to be reported of a frame that was accepted, once.
    pub fn take_warning(&mut self) -> Option<String> {
        self.warning.take()
    }

    fn is_new(&mut self, what: &'static str) -> bool {
        let new = !self.told.contains(&what);
        if new {
            self.told.push(what);
        }
        new
    }
}
