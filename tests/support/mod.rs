//! What the end-to-end tests share: the real binary as a process, and where recorded flights are.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

pub mod page;

use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Condvar, LazyLock, Mutex, PoisonError};
use std::time::Duration;

/// Longer than anything here takes on a busy machine, shorter than a test runner's patience.
pub const PATIENCE: Duration = Duration::from_secs(600);

/// A `gaware` process whose output is collected; it does not outlive the test.
pub struct Gaware {
    child: Child,
    line: String,
    stderr: Receiver<String>,
    stdout: Receiver<String>,
}

/// How a process ended.
pub struct Ended {
    /// Status.
    pub status: ExitStatus,
    /// All of stdout.
    pub stdout: String,
    /// What of stderr had not been read before.
    pub stderr: String,
}

impl Ended {
    /// The exit status as a shell sees it.
    pub fn code(&self) -> Option<i32> {
        self.status.code()
    }

    /// Stdout as the JSON document that it must be.
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {:?}", self.stdout))
    }
}

impl Gaware {
    /// Starts the binary.
    pub fn start(args: &[&str]) -> Self {
        Self::of(Command::new(env!("CARGO_BIN_EXE_gaware")).args(args), args)
    }

    /// Starts the binary where no file may grow beyond this many blocks of 512 bytes: to it the disk is full then.
    pub fn start_on_a_small_disk(blocks: u32, args: &[&str]) -> Self {
        let line = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
        Self::of(Command::new("sh").args(["-c", &line, env!("CARGO_BIN_EXE_gaware")]).args(args), args)
    }

    /// Starts the binary with its stdout led elsewhere in a shell's words: `| true`, where the reader is gone before anything is written,
    /// or `> FILE`. The exit status is the binary's.
    pub fn start_with_stdout(to: &str, args: &[&str]) -> Self {
        // The reader of the pipe ends first: the binary waits for it.
        let line = match to.strip_prefix('|') {
            Some(reader) => format!(
                "d=$(mktemp -d); mkfifo $d/p; {reader} < $d/p & exec 3> $d/p; wait $!; rm -r $d; exec \"$0\" \"$@\" >&3"
            ),
            None => format!("exec \"$0\" \"$@\" {to}"),
        };
        Self::of(Command::new("sh").args(["-c", &line, env!("CARGO_BIN_EXE_gaware")]).args(args), args)
    }

    fn of(command: &mut Command, args: &[&str]) -> Self {
        let mut child = command
            .env_remove("RUST_LOG")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (lines, stderr) = channel();
        let errors = BufReader::new(child.stderr.take().unwrap());
        std::thread::spawn(move || {
            for line in errors.lines().map_while(Result::ok) {
                let _ = lines.send(line);
            }
        });
        let (text, stdout) = channel();
        let mut out = child.stdout.take().unwrap();
        std::thread::spawn(move || {
            let mut all = String::new();
            let _ = out.read_to_string(&mut all);
            let _ = text.send(all);
        });
        Self { child, line: args.join(" "), stderr, stdout }
    }

    /// The next line of stderr.
    pub fn line(&self) -> String {
        self.stderr.recv_timeout(PATIENCE).unwrap_or_else(|e| panic!("{}: no line on stderr: {e}", self.line))
    }

    /// The first line of stderr that holds this text.
    pub fn line_with(&self, text: &str) -> String {
        std::iter::repeat_with(|| self.line()).find(|line| line.contains(text)).unwrap()
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Asks it to end, as a service manager does.
    pub fn terminate(&self) {
        self.signal("-TERM");
    }

    /// Sends it a signal by name: `-HUP` as a terminal that goes away does.
    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill").args([name, &self.child.id().to_string()]).status().unwrap();
        assert!(sent.success());
    }

    /// Ends it without asking (`kill -9`).
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Waits for its end.
    pub fn ended(mut self) -> Ended {
        let stdout =
            self.stdout.recv_timeout(PATIENCE).unwrap_or_else(|e| panic!("{} does not end: {e}", self.line));
        let status = self.child.wait().unwrap();
        let stderr = self.stderr.iter().collect::<Vec<_>>().join("\n");
        Ended { status, stdout, stderr }
    }
}

impl Drop for Gaware {
    fn drop(&mut self) {
        // Already ended, mostly.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What computes as fast as it can; all else mostly waits for a link.
const COMPUTES: [&str; 6] = ["compare", "explain", "export", "fleet", "replay", "report"];

/// One computation for each processor at once, however many tests run: with more of them each would take longer than anybody waits.
pub struct Processors {
    free: Mutex<usize>,
    given_back: Condvar,
}

/// A processor, until it is dropped.
pub struct Processor(&'static Processors);

impl Processors {
    /// Waits for one. Nobody takes a second one, by [`gaware`] or here, before the first is given back.
    pub fn take() -> Processor {
        static ALL: LazyLock<Processors> = LazyLock::new(|| Processors {
            free: Mutex::new(std::thread::available_parallelism().map_or(1, usize::from)),
            given_back: Condvar::new(),
        });
        let free = ALL.free.lock().unwrap_or_else(PoisonError::into_inner);
        let mut free = ALL.given_back.wait_while(free, |n| *n == 0).unwrap_or_else(PoisonError::into_inner);
        *free -= 1;
        Processor(&ALL)
    }
}

impl Drop for Processor {
    fn drop(&mut self) {
        *self.0.free.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        self.0.given_back.notify_one();
    }
}

/// Runs the binary to its end.
pub fn gaware(args: &[&str]) -> Ended {
    let _processor = args.first().filter(|command| COMPUTES.contains(command)).map(|_| Processors::take());
    Gaware::start(args).ended()
}

/// A fresh folder of this test, emptied at the start and removed at the end.
pub struct Folder(PathBuf);

impl Folder {
    /// Makes it.
    pub fn new(name: &str) -> Self {
        // The tests of all files run in one process.
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("gaware-{name}-{}-{count}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// A file in it, as an argument.
    pub fn file(&self, name: &str) -> String {
        self.0.join(name).to_str().unwrap().to_owned()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A small recorded flight that belongs to the repository.
pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// The folder of recorded flights that are too big for the repository. Tests that need it are ignored unless they are asked for
/// (`cargo test -- --ignored`), and then it must be there.
pub fn flights() -> PathBuf {
    let folder = std::env::var_os("GAWARE_FLIGHTS")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    assert!(
        folder.is_dir(),
        "no recorded flights at {}; GAWARE_FLIGHTS names another folder",
        folder.display()
    );
    folder
}

/// Fails on a number that is none anywhere in the document (`null` stands where a float was not finite).
pub fn assert_finite(document: &Value, at: &str) {
    match document {
        Value::Null => panic!("{at} is not finite"),
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(k, v)| assert_finite(v, &format!("{at}/{k}")))
        }
        Value::Object(map) => map.iter().for_each(|(k, v)| assert_finite(v, &format!("{at}/{k}"))),
        _ => {}
    }
}
