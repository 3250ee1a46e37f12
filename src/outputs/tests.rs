use super::mark::{Style, blank, is_own, json, text};
use super::*;
use crate::commands::OverwriteArgs;

/// A folder of this test.
fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("gaware-outputs-{name}-{}", std::process::id()));
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

const NO: OverwriteArgs = OverwriteArgs { force: false };
const FORCE: OverwriteArgs = OverwriteArgs { force: true };

fn none() -> [&'static Path; 0] {
    []
}

#[test]
fn an_input_is_no_output_whatever_name_leads_to_it() {
    let folder = folder("input");
    let log = folder.join("flight.tlog");
    fs::write(&log, "a recording").unwrap();
    let mut names =
        vec![log.clone(), folder.join("../").join(folder.file_name().unwrap()).join("flight.tlog")];
    fs::hard_link(&log, folder.join("second.csv")).unwrap();
    names.push(folder.join("second.csv"));
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("flight.tlog", folder.join("link.html")).unwrap();
        names.push(folder.join("link.html"));
    }
    for name in names {
        // Not even where the user insists.
        let error = FORCE.outputs([&log]).write(&name, "a page").unwrap_err();
        assert!(error.is_usage() && error.to_string().contains("is read by this command"), "{error}");
    }
    // A folder with tables is an input too.
    let error = FORCE.outputs([&folder]).write(&log, "a page").unwrap_err();
    assert!(matches!(error, OutputError::Input(_)), "{error}");
    assert_eq!(fs::read_to_string(&log).unwrap(), "a recording");
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn only_what_this_program_wrote_and_no_one_edited_is_overwritten() {
    let folder = folder("foreign");
    let outputs = NO.outputs(none());
    for (name, content) in [
        ("page.html", text("<p>one</p>".to_owned(), Style::Angle)),
        ("model.toml", text("a = 1".to_owned(), Style::Hash)),
        ("page.1", text(".TH one".to_owned(), Style::Roff)),
        ("report.json", json("{\"one\": 1}")),
        ("empty.json", json("{}")),
    ] {
        let path = folder.join(name);
        outputs.write(&path, content.clone()).unwrap();
        assert!(is_own(&path), "{name}");
        // Another run of the same command.
        outputs.write(&path, content.clone()).unwrap();
        let own = fs::read_to_string(&path).unwrap();
        assert_ne!(own, content, "the digest is in it");
        for edited in
            [format!("{own} "), own.replacen(&own[..1], "Z", 1), own.replacen("gaware", "gawere", 1)]
        {
            fs::write(&path, &edited).unwrap();
            let error = outputs.write(&path, content.clone()).unwrap_err();
            assert!(error.to_string().contains("--force") && !error.is_usage(), "{error}");
            assert_eq!(fs::read_to_string(&path).unwrap(), edited);
        }
        FORCE.outputs(none()).write(&path, content).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), own);
    }
    // What has no room for a mark is never known to be this program's.
    let table = folder.join("states.csv");
    outputs.write(&table, "a,b\n1,2\n").unwrap();
    assert!(outputs.write(&table, "a,b\n1,2\n").is_err());
    let json: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("empty.json")).unwrap()).unwrap();
    assert!(json["written_by"].as_str().unwrap().starts_with("gaware-sha256:"));
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_mark_is_found_far_from_the_end_and_in_no_shortened_file() {
    let whole = mark::sealed(format!("x{}{}", blank(), "y".repeat(300_000)).into_bytes(), b"key");
    let sealed = |bytes: &[u8], key: &[u8]| mark::is_sealed(io::Cursor::new(bytes), key).unwrap();
    assert!(sealed(&whole, b"key") && !sealed(&whole, b"") && !sealed(&whole, b"kez"));
    assert!(!sealed(&whole[..whole.len() - 1], b"key") && !sealed(&whole[..40], b"key"));
    assert!(!sealed(b"", b"key") && !sealed(mark::WORD.as_bytes(), b"key"));
    // What another file quotes is no mark of its own.
    assert!(!sealed(blank().as_bytes(), b""));
}

#[cfg(unix)]
#[test]
fn a_link_stays_a_link_and_permissions_stay() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = folder("link");
    let (file, link) = (folder.join("page.html"), folder.join("link.html"));
    let page = || text("<p>".to_owned(), Style::Angle);
    NO.outputs(none()).write(&file, page()).unwrap();
    fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
    symlink("page.html", &link).unwrap();
    NO.outputs(none()).write(&link, page()).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
    NO.outputs(none()).write(Path::new("/dev/null"), "nothing is lost").unwrap();
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_new_file_takes_no_ones_place_and_leaves_no_part() {
    let folder = folder("new");
    let path = folder.join("backup.plan");
    create(&path, b"one").unwrap();
    assert_eq!(create(&path, b"two").unwrap_err().kind(), io::ErrorKind::AlreadyExists);
    assert_eq!(fs::read(&path).unwrap(), b"one");
    assert!(create(&folder.join("none/backup.plan"), b"one").is_err());
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
    fs::remove_dir_all(&folder).unwrap();
}
