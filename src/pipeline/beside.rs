//! What a log says beside its samples: who the vehicle is, when it flew, and how it was.

use crate::advice::on_board::OnBoard;
use crate::health::HealthLog;
use crate::inputs::Input;
use crate::logs::{self, Item, LogError, LogNote, Record};

/// Stamps before 2001-09-09 count from a start, µs.
const FIRST_DATE_US: u64 = 1_000_000_000_000_000;

/// Gathered in the same pass as the samples.
#[derive(Debug, Clone, Default)]
pub struct Beside {
    /// Of the vehicle that was listened to.
    pub on_board: OnBoard,
    /// Its states and events.
    pub health: HealthLog,
    /// First stamp, µs.
    first_t_us: Option<u64>,
    /// Unix time less stamp, s, by the receiver.
    utc_offset_s: Option<f64>,
}

impl Beside {
    /// Takes an entry of the log. `vehicle`: the system id that is listened to.
    pub fn take(&mut self, record: &Record, vehicle: Option<u8>) {
        // Logs may begin with entries without a time.
        if record.t_us > 0 {
            self.first_t_us.get_or_insert(record.t_us);
        }
        if let Item::Note(LogNote::Utc(utc_s)) = &record.item {
            self.utc_offset_s.get_or_insert(utc_s - record.t_us as f64 * 1e-6);
        }
        self.on_board.take(&record.item, vehicle);
        self.health.take(record);
    }

    /// Reads a log of any format for it.
    ///
    /// # Errors
    /// A log that cannot be opened or read.
    pub fn read(log: impl Into<Input>, vehicle: Option<u8>) -> Result<Self, LogError> {
        let mut reader = logs::open(log)?;
        let mut found = Self::default();
        for record in reader.by_ref() {
            match record {
                Ok(record) => found.take(&record, vehicle),
                // What was read before a failing disk counts.
                Err(LogError::Read { .. }) => break,
                Err(error) => return Err(error),
            }
        }
        found.on_board.complete_from(reader.as_ref());
        Ok(found)
    }

    /// Start of the log, s since 1970: logs of links carry the date in every entry, those of autopilots that of their receiver.
    pub fn start_unix_s(&self) -> Option<f64> {
        let first_us = self.first_t_us?;
        if first_us > FIRST_DATE_US {
            return Some(first_us as f64 * 1e-6);
        }
        Some(self.utc_offset_s? + first_us as f64 * 1e-6)
    }

    /// The same as text; empty where the log has no date.
    pub fn date(&self) -> String {
        self.start_unix_s().map_or_else(String::new, |t| {
            let s = t as u64;
            format!("{} {:02}:{:02} UTC", crate::figures::day(t), s / 3600 % 24, s / 60 % 60)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A simulator's log stamps its entries with the date, and those before the first sample with nothing.
    #[test]
    fn a_log_whose_first_entries_have_no_time_has_its_date() {
        let note = |t_us, note| Record { t_us, item: Item::Note(note) };
        let mut beside = Beside::default();
        beside.take(&note(0, LogNote::Utc(1_710_773_351.2)), None);
        assert_eq!(beside.start_unix_s(), None);
        for stamps_begin_us in [1_710_773_350_354_000, 2_000_000] {
            let mut beside = Beside::default();
            beside.take(&note(0, LogNote::Board(Default::default())), None);
            beside.take(&note(stamps_begin_us, LogNote::Utc(1_710_773_351.2)), None);
            let start_s = beside.start_unix_s().unwrap();
            assert!((1_710_773_350.0..1_710_773_352.0).contains(&start_s), "{start_s}");
        }
    }
}
