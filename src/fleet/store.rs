//! Results under the address of their content: a file for each, whole or not there.

use super::FleetError;
use super::flight::{self, FlightEntry, SCHEMA, Work};
use gaware_nav::model::Model;
use sha2::{Digest, Sha256};
use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::UNIX_EPOCH;

/// Bytes that are hashed at once.
const BLOCK: usize = 1 << 16;

/// What a log holds, and the version of its file for which that was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Content {
    /// SHA-256 of the log's bytes.
    pub sha256: String,
    /// Size of the log, bytes.
    pub bytes: u64,
    /// When the file was changed last, ns since 1970; `None` where that is not known, and for a folder with tables.
    pub modified_ns: Option<u128>,
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
        std::fs::create_dir_all(&results)
            .map_err(|source| FleetError::Write { path: results.clone(), source })?;
        Ok(Self { folder: results, recipe: recipe(work) })
    }

    /// Reads the log once.
    ///
    /// # Errors
    /// A log that cannot be read.
    pub fn address(&self, log: &Path) -> Result<Address, FleetError> {
        address(log, &self.recipe)
    }

    /// The result that is there. One that cannot be read is none: it is made again.
    pub fn get(&self, address: &Address) -> Option<FlightEntry> {
        let text = std::fs::read(self.path(&address.key)).ok()?;
        serde_json::from_slice(&text).ok().filter(|e: &FlightEntry| e.schema == SCHEMA)
    }

    /// Puts a result there: whole, or not at all. Two that write the same one do not disturb each other.
    ///
    /// # Errors
    /// What the system says.
    pub fn put(&self, address: &Address, entry: &FlightEntry) -> Result<(), FleetError> {
        let path = self.path(&address.key);
        let beside = self.folder.join(format!("{}.{}.part", address.key, std::process::id()));
        let wrong = |source| FleetError::Write { path: path.clone(), source };
        let text = serde_json::to_vec(entry).map_err(|e| wrong(e.into()))?;
        let done = std::fs::write(&beside, text).and_then(|()| std::fs::rename(&beside, &path));
        done.map_err(|source| {
            let _ = std::fs::remove_file(&beside);
            wrong(source)
        })
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
        work.listen.source,
        work.listen.vehicle,
        model.len(),
    )
}

/// Analyses one log in this process. With a folder the result is kept there, and not made again where it is there. `known`: what was found
/// of the log before; it counts as long as the file is the same.
///
/// # Errors
/// A log that cannot be opened or changes meanwhile, or a folder that cannot be written. A log that holds no flight is a result.
pub fn analysed(
    log: &Path,
    work: &Work,
    folder: Option<&Path>,
    known: Option<Content>,
) -> Result<FlightEntry, FleetError> {
    let store = folder.map(|folder| Store::open(folder, work)).transpose()?;
    let recipe = recipe(work);
    let address = match known.filter(|content| content.is_of(log)) {
        Some(content) => Address::of(content, &recipe),
        None => address(log, &recipe)?,
    };
    if let Some(there) = store.as_ref().and_then(|s| s.get(&address)) {
        return Ok(there);
    }
    let content = &address.content;
    let entry = flight::analyse(log, work, &content.sha256, content.bytes);
    // A result lies under the hash of what it was made of.
    if content.modified_ns.is_some() && !content.is_of(log) {
        return Err(FleetError::Changed(log.to_owned()));
    }
    if let Some(store) = store {
        store.put(&address, &entry)?;
    }
    Ok(entry)
}

fn address(log: &Path, recipe: &str) -> Result<Address, FleetError> {
    let content = content(log).map_err(|source| FleetError::Read { path: log.to_owned(), source })?;
    Ok(Address::of(content, recipe))
}

impl Address {
    fn of(content: Content, recipe: &str) -> Self {
        let key = hex(&Sha256::digest(format!("{recipe}{}", content.sha256)));
        Self { content, key }
    }
}

impl Content {
    /// Whether the file of a log is the one of which this was found, by its size and the time of its last change.
    fn is_of(&self, log: &Path) -> bool {
        let size = std::fs::metadata(log).map(|m| m.len()).ok();
        self.modified_ns.is_some() && self.modified_ns == modified_ns(log) && size == Some(self.bytes)
    }
}

impl fmt::Display for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:", self.sha256, self.bytes)?;
        self.modified_ns.map_or(Ok(()), |t| write!(f, "{t}"))
    }
}

impl FromStr for Content {
    type Err = FleetError;

    fn from_str(text: &str) -> Result<Self, FleetError> {
        let wrong = || FleetError::Content(text.to_owned());
        let mut parts = text.split(':');
        let (Some(sha256), Some(bytes), Some(modified), None) =
            (parts.next(), parts.next(), parts.next(), parts.next())
        else {
            return Err(wrong());
        };
        let modified_ns =
            if modified.is_empty() { None } else { Some(modified.parse().map_err(|_| wrong())?) };
        Ok(Self { sha256: sha256.to_owned(), bytes: bytes.parse().map_err(|_| wrong())?, modified_ns })
    }
}

/// When a file was changed last, ns since 1970; `None` for a folder.
fn modified_ns(log: &Path) -> Option<u128> {
    let about = std::fs::metadata(log).ok().filter(|m| m.is_file())?;
    Some(about.modified().ok()?.duration_since(UNIX_EPOCH).ok()?.as_nanos())
}

/// Hash and size of a log; of a folder with tables, those of its tables with their names.
fn content(log: &Path) -> io::Result<Content> {
    // Before the file is read: one that is changed meanwhile is not the same any more.
    let modified_ns = modified_ns(log);
    let mut hash = Sha256::new();
    if !log.is_dir() {
        let bytes = add(&mut hash, log)?;
        return Ok(Content { sha256: hex(&hash.finalize()), bytes, modified_ns });
    }
    let mut tables: Vec<PathBuf> =
        std::fs::read_dir(log)?.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>()?;
    tables.retain(|path| path.extension().is_some_and(|e| e == "csv"));
    tables.sort();
    let mut bytes = 0;
    for table in tables {
        hash.update(table.file_name().unwrap_or_default().as_encoded_bytes());
        hash.update([0]);
        let own = add(&mut hash, &table)?;
        hash.update(own.to_le_bytes());
        bytes += own;
    }
    Ok(Content { sha256: hex(&hash.finalize()), bytes, modified_ns: None })
}

fn add(hash: &mut Sha256, path: &Path) -> io::Result<u64> {
    let mut file = File::open(path)?;
    let mut block = vec![0_u8; BLOCK];
    let mut bytes = 0;
    loop {
        let n = file.read(&mut block)?;
        let Some(part) = block.get(..n).filter(|p| !p.is_empty()) else { return Ok(bytes) };
        hash.update(part);
        bytes += n as u64;
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
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
        assert_eq!(found.to_string().parse::<Content>().unwrap(), found);
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn what_was_found_of_a_log_counts_until_its_file_is_changed() {
        let folder = std::env::temp_dir().join(format!("gaware-known-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let log = folder.join("a.ulg");
        std::fs::write(&log, "one").unwrap();
        let found = content(&log).unwrap();
        let known = Content { sha256: "of another process".to_owned(), ..found.clone() };
        let hash_of = |known: Content| analysed(&log, &Work::default(), None, Some(known)).unwrap().sha256;
        assert_eq!(hash_of(known.clone()), "of another process");
        // As many bytes, another time.
        let later = File::options().write(true).open(&log).unwrap();
        later.set_modified(UNIX_EPOCH + std::time::Duration::from_secs(1)).unwrap();
        assert_eq!(hash_of(known.clone()), found.sha256);
        assert_eq!(hash_of(Content { modified_ns: None, ..known }), found.sha256);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
