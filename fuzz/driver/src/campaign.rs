//! A campaign over one target: numbered inputs, each judged by panic, time and memory.
//!
//! An input follows from the seed of the campaign, the target's name and its number, so that any of them can be made again.

use crate::mutate::mutate;
use crate::random::Random;
use crate::{Target, corpus};
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::panic::{self, AssertUnwindSafe};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Longest time for one input, s.
pub const LONGEST_S: f64 = 1.0;
/// An input that takes longer ends the campaign. Time in which its thread waits for a processor does not count: a
/// campaign beside other work is starved for minutes.
const HANG: Duration = Duration::from_secs(60);
/// Most memory of the process, KiB.
pub const MOST_KIB: u64 = 200 * 1024;
/// Inputs between two looks at the memory.
const MEMORY_EVERY: u64 = 256;
/// A campaign ends with so many findings.
const MOST_FINDINGS: usize = 10;
/// Where there are more seeds than this, inputs of a short campaign still are mutations for the most part.
const WHOLE_SEEDS: u64 = 1000;

/// The inputs of a campaign.
#[derive(Debug)]
pub struct Inputs {
    target: &'static Target,
    corpus: Vec<Vec<u8>>,
    seed: u64,
}

impl Inputs {
    /// Of a target.
    ///
    /// # Errors
    /// When its corpus cannot be read.
    pub fn new(target: &'static Target, seed: u64) -> io::Result<Self> {
        Ok(Self { target, corpus: corpus::all(target)?, seed })
    }

    /// Input of this number: first those of the corpus as they are, then mutations of them.
    pub fn at(&self, number: u64) -> Vec<u8> {
        if let Some(whole) = self.corpus.get(number as usize).filter(|_| number < WHOLE_SEEDS) {
            return whole.clone();
        }
        let mut random = Random::of_input(self.seed, self.target.name, number);
        let mut one = || random.pick(&self.corpus).cloned().unwrap_or_default();
        let (base, other) = (one(), one());
        mutate(self.target.shape, &base, &other, &mut random)
    }
}

/// Something that must not be.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Number of the input.
    pub number: u64,
    /// What happened.
    pub what: String,
}

/// What came of a campaign.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Report {
    /// Inputs that were run.
    pub inputs: u64,
    /// Of these the ones that were not refused at the first look.
    pub accepted: u64,
    /// Time for all of them, s.
    pub elapsed_s: f64,
    /// Longest time for one of them, s.
    pub slowest_s: f64,
    /// Most memory of the process, KiB.
    pub peak_kib: u64,
    /// Findings, one of each kind.
    pub findings: Vec<Finding>,
}

/// How far a campaign is, for a watchdog and for whoever asks after a process that died.
#[derive(Debug, Default)]
struct Now {
    number: AtomicU64,
    /// Time of the campaign at the start of this input, without that in which its thread waited for a processor, ms.
    since_ms: AtomicU64,
}

/// Runs inputs `first..first + inputs`. The number of the present one is kept in `state`, for a process that does not
/// survive it; inputs on which something was found are kept in the corpus.
///
/// # Errors
/// When corpus or state cannot be read or written.
pub fn run(inputs: Inputs, first: u64, count: u64, state: &File) -> io::Result<Report> {
    let began = Instant::now();
    let inputs = Arc::new(inputs);
    let now = Arc::new(Now::default());
    let thread = Thread::this();
    watch(Arc::clone(&inputs), Arc::clone(&now), began, thread.clone())?;
    let message = catch_messages();
    let mut report = Report::default();
    for number in first..first + count {
        state.write_all_at(&number.to_le_bytes(), 0)?;
        let input = inputs.at(number);
        now.since_ms.store(thread.served(began).as_millis() as u64, Ordering::Relaxed);
        now.number.store(number, Ordering::Release);
        let start = Instant::now();
        let result = panic::catch_unwind(AssertUnwindSafe(|| (inputs.target.run)(&input)));
        let mut elapsed_s = start.elapsed().as_secs_f64();
        if elapsed_s > LONGEST_S {
            // Others use the machine too: what counts is the time of this thread.
            elapsed_s = thread
                .cpu_time_s(|| _ = panic::catch_unwind(AssertUnwindSafe(|| (inputs.target.run)(&input))));
        }
        report.inputs += 1;
        report.accepted += u64::from(*result.as_ref().unwrap_or(&false));
        report.slowest_s = report.slowest_s.max(elapsed_s);
        let mut found = |what: String| {
            let kind = |text: &str| text.split(" | ").next().map(str::to_owned);
            if report.findings.iter().all(|f| kind(&f.what) != kind(&what)) {
                report.findings.push(Finding { number, what });
                corpus::keep(inputs.target, &input)?;
            }
            io::Result::Ok(())
        };
        if result.is_err() {
            found(message.lock().unwrap_or_else(PoisonError::into_inner).clone())?;
        }
        if elapsed_s > LONGEST_S {
            found(format!("slow | {elapsed_s:.2} s"))?;
        }
        if number.is_multiple_of(MEMORY_EVERY) || number + 1 == first + count {
            let peak = peak_kib();
            report.peak_kib = report.peak_kib.max(peak);
            if peak > MOST_KIB {
                found(format!("memory | {peak} KiB at or up to {MEMORY_EVERY} inputs before this one"))?;
            }
        }
        if report.findings.len() >= MOST_FINDINGS {
            break;
        }
    }
    report.elapsed_s = began.elapsed().as_secs_f64();
    Ok(report)
}

/// Ends the process when an input takes much too long.
fn watch(inputs: Arc<Inputs>, now: Arc<Now>, began: Instant, worker: Thread) -> io::Result<()> {
    let look = move || {
        loop {
            std::thread::sleep(HANG / 10);
            let number = now.number.load(Ordering::Acquire);
            let since = Duration::from_millis(now.since_ms.load(Ordering::Relaxed));
            if worker.served(began).saturating_sub(since) > HANG {
                let kept = corpus::keep(inputs.target, &inputs.at(number));
                eprintln!("{}: input {number} does not end, kept as {kept:?}", inputs.target.name);
                std::process::exit(3);
            }
        }
    };
    std::thread::Builder::new().name("watchdog".to_owned()).spawn(look).map(|_| ())
}

/// From now on the last panic's place and message are kept instead of printed.
fn catch_messages() -> Arc<Mutex<String>> {
    let last = Arc::new(Mutex::new(String::new()));
    let kept = Arc::clone(&last);
    panic::set_hook(Box::new(move |info| {
        let place = info.location().map(ToString::to_string).unwrap_or_default();
        let text = info.payload_as_str().unwrap_or_default();
        *kept.lock().unwrap_or_else(PoisonError::into_inner) = format!("panic at {place} | {text}");
    }));
    last
}

/// A thread's account with the scheduler: `proc_pid_schedstat(5)`. Zeros where the kernel keeps none.
#[derive(Debug, Clone)]
struct Thread(PathBuf);

impl Thread {
    /// The one that runs this.
    fn this() -> Self {
        Self(std::fs::canonicalize("/proc/thread-self").unwrap_or_default().join("schedstat"))
    }

    /// Time on a processor and time of waiting for one.
    fn account(&self) -> (Duration, Duration) {
        let text = std::fs::read_to_string(&self.0).unwrap_or_default();
        let mut of = text.split_whitespace().map(|t| Duration::from_nanos(t.parse().unwrap_or(0)));
        (of.next().unwrap_or_default(), of.next().unwrap_or_default())
    }

    /// Time since `began` without that of waiting for a processor.
    fn served(&self, began: Instant) -> Duration {
        began.elapsed().saturating_sub(self.account().1)
    }

    /// Time on a processor that a job takes, s.
    fn cpu_time_s(&self, job: impl FnOnce()) -> f64 {
        let before = self.account().0;
        job();
        self.account().0.saturating_sub(before).as_secs_f64()
    }
}

/// Most memory of this process so far, KiB.
fn peak_kib() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}
