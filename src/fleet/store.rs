//! Results under the address of their content: a file for each, whole or not there.

use super::FleetError;
use super::flight::{self, FlightEntry, SCHEMA, Work, add};
use crate::outputs::mark::{self, hex};
use crate::outputs::{self, OutputError, Outputs};
use gaware_nav::model::Model;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// What a log holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Content {
    /// SHA-256 of the log's bytes.
    pub sha256: String,
    /// Size of the log, bytes.
    pub bytes: u64,
}

/// What decides on a result, and where it therefore lies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    /// The log.
    pub content: Content,
    /// SHA-256 of all that decides on the result.
    pub key: String,
}

/// The results of a fleet in a folder.
#[derive(Debug, Clone)]
pub struct Store {
    folder: PathBuf,
    /// All that decides on a result beside the log.
    recipe: String,
}

impl Store {
    /// Opens the folder, which is made where it is not there.
    ///
    /// # Errors
    /// A folder that cannot be made.
    pub fn open(folder: &Path, work: &Work) -> Result<Self, FleetError> {
        let results = folder.join("results");
        Outputs::default().folder(&results)?;
        Ok(Self { folder: results, recipe: recipe(work) })
    }

    /// Reads the log once.
    ///
    /// # Errors
    /// A log that cannot be read.
    pub fn address(&self, log: &Path) -> Result<Address, FleetError> {
        address(log, &self.recipe)
    }

    /// The result that is there. One that cannot be read, is not as it was written, or was written for another address is none: it is
    /// made again.
    pub fn get(&self, address: &Address) -> Option<FlightEntry> {
        let text = std::fs::read(self.path(&address.key)).ok()?;
        mark::is_sealed(io::Cursor::new(&text), address.key.as_bytes()).ok().filter(|sealed| *sealed)?;
        let entry: FlightEntry = serde_json::from_slice(&text).ok()?;
        (entry.schema == SCHEMA && entry.sha256 == address.content.sha256).then_some(entry)
    }

    /// Puts a result there: whole, or not at all. Two that write the same one do not disturb each other.
    ///
    /// # Errors
    /// What the system says.
    pub fn put(&self, address: &Address, entry: &FlightEntry) -> Result<(), FleetError> {
        let path = self.path(&address.key);
        let wrong = |source| OutputError::Write { path: path.clone(), source };
        let text = serde_json::to_string(entry).map_err(|e| wrong(e.into()))?;
        let sealed = mark::sealed(mark::json(&text).into_bytes(), address.key.as_bytes());
        Ok(outputs::replace(&path, &sealed).map_err(wrong)?)
    }

    fn path(&self, key: &str) -> PathBuf {
        self.folder.join(format!("{key}.json"))
    }
}

/// Program, model and options in words.
fn recipe(work: &Work) -> String {
    let model = work.model.as_ref().map(Model::to_toml).unwrap_or_default();
    format!(
        "{SCHEMA}\n{} {}\nexplain {}\nsource {:?} vehicle {:?}\nmodel {}\n{model}\nlog ",
        env!("CARGO_PKG_VERSION"),
        env!("GAWARE_SOURCES"),
        work.explain,
        work.converter.source,
        work.converter.vehicle,
        model.len(),
    )
}

/// Analyses one log in this process. With a folder the result is kept there, and not made again where it is there.
///
/// # Errors
/// A log that cannot be opened or changes meanwhile, or a folder that cannot be written. A log that holds no flight is a result.
pub fn analysed(log: &Path, work: &Work, folder: Option<&Path>) -> Result<FlightEntry, FleetError> {
    let store = folder.map(|folder| Store::open(folder, work)).transpose()?;
    let address = address(log, &recipe(work))?;
    if let Some(there) = store.as_ref().and_then(|s| s.get(&address)) {
        return Ok(there);
    }
    let entry = flight::analyse(&log.into(), work, &address.content.sha256, address.content.bytes);
    // A result lies under the hash of what it was made of.
    if content(log).ok().as_ref() != Some(&address.content) {
        return Err(FleetError::Changed(log.to_owned()));
    }
    if let Some(store) = store {
        store.put(&address, &entry)?;
    }
    Ok(entry)
}

fn address(log: &Path, recipe: &str) -> Result<Address, FleetError> {
    let content = content(log).map_err(|source| FleetError::Read { path: log.to_owned(), source })?;
    let key = hex(&Sha256::digest(format!("{recipe}{}", content.sha256)));
    Ok(Address { content, key })
}

/// SHA-256 of a log.
pub(crate) fn sha256(log: &Path) -> io::Result<String> {
    Ok(content(log)?.sha256)
}

/// Hash and size of a log; of a folder with tables, those of its tables with their names.
fn content(log: &Path) -> io::Result<Content> {
    let mut hash = Sha256::new();
    if !log.is_dir() {
        let bytes = add(&mut hash, File::open(log)?)?;
        return Ok(Content { sha256: hex(&hash.finalize()), bytes });
    }
    let mut tables: Vec<PathBuf> =
        std::fs::read_dir(log)?.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>()?;
    tables.retain(|path| path.extension().is_some_and(|e| e == "csv"));
    tables.sort();
    let mut bytes = 0;
    for table in tables {
        hash.update(table.file_name().unwrap_or_default().as_encoded_bytes());
        hash.update([0]);
        let own = add(&mut hash, File::open(&table)?)?;
        hash.update(own.to_le_bytes());
        bytes += own;
    }
    Ok(Content { sha256: hex(&hash.finalize()), bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(address: &Address) -> FlightEntry {
        FlightEntry {
            schema: SCHEMA.to_owned(),
            sha256: address.content.sha256.clone(),
            bytes: address.content.bytes,
            failed: Some("a reason".to_owned()),
            flight: None,
        }
    }

    #[test]
    fn a_result_is_found_by_content_and_by_nothing_else() {
        let folder = std::env::temp_dir().join(format!("gaware-store-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let log = |name: &str, text: &str| {
            std::fs::write(folder.join(name), text).unwrap();
            folder.join(name)
        };
        let (a, b, c) = (log("a.tlog", "one"), log("b.tlog", "one"), log("c.tlog", "two"));
        let store = Store::open(&folder, &Work::default()).unwrap();
        let first = store.address(&a).unwrap();
        assert!(store.get(&first).is_none());
        store.put(&first, &entry(&first)).unwrap();
        assert_eq!(store.get(&first), Some(entry(&first)));
        // The same bytes under another name; other bytes; other options; another model.
        assert!(store.get(&store.address(&b).unwrap()).is_some());
        assert!(store.get(&store.address(&c).unwrap()).is_none());
        let other = Store::open(&folder, &Work { explain: true, ..Work::default() }).unwrap();
        assert!(other.get(&other.address(&a).unwrap()).is_none());
        let other = Work { model: Some(Model::standard()), ..Work::default() };
        let other = Store::open(&folder, &other).unwrap();
        assert!(other.get(&other.address(&a).unwrap()).is_none());
        // Half a result is none.
        let path = store.path(&first.key);
        let text = std::fs::read(&path).unwrap();
        std::fs::write(&path, &text[..text.len() / 2]).unwrap();
        assert!(store.get(&first).is_none());
        // Nor is one with another digit or another word in it.
        for (old, new) in [("\"bytes\":3", "\"bytes\":4"), ("a reason", "a season")] {
            let changed = String::from_utf8(text.clone()).unwrap().replace(old, new);
            assert_ne!(changed.as_bytes(), text);
            std::fs::write(&path, changed).unwrap();
            assert!(store.get(&first).is_none(), "{new}");
        }
        // Nor is that of another log, or of the same log by other options, under this key.
        let second = store.address(&c).unwrap();
        store.put(&second, &entry(&second)).unwrap();
        std::fs::copy(store.path(&second.key), &path).unwrap();
        assert!(store.get(&first).is_none());
        let other = Address { key: second.key.clone(), ..first.clone() };
        store.put(&other, &entry(&first)).unwrap();
        std::fs::copy(store.path(&other.key), &path).unwrap();
        assert!(store.get(&first).is_none());
        std::fs::write(&path, &text).unwrap();
        assert!(store.get(&first).is_some());
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn the_hash_is_the_one_of_other_tools() {
        let path = std::env::temp_dir().join(format!("gaware-hash-{}", std::process::id()));
        std::fs::write(&path, "abc").unwrap();
        // FIPS 180-4, the example of one block.
        let sha = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let found = content(&path).unwrap();
        assert_eq!((found.sha256.as_str(), found.bytes), (sha, 3));
        std::fs::remove_file(&path).unwrap();
    }
}
