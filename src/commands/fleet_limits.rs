//! What the process of one log may take: time and memory. A log beyond its limit is counted as failed, with the option that gives it more; its
//! result is not kept, so that a later run with other limits tries again.

use super::CommandError;
use std::io::{self, Read};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

/// Between two looks at a process.
const LOOK: Duration = Duration::from_millis(50);

/// Limits for each log.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct Limits {
    /// End the analysis of a log after this time, s (default: no limit).
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..))]
    pub limit_time: Option<u32>,
    /// End the analysis of a log that takes more memory than this, MB (default: no limit; Linux only).
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u32).range(1..))]
    pub limit_memory: Option<u32>,
}

/// How a process ended.
#[derive(Debug)]
pub enum Ended {
    /// By itself.
    Alone(Output),
    /// It was ended.
    AtLimit {
        /// At what.
        limit: String,
        /// The option that sets it.
        option: &'static str,
    },
}

impl Limits {
    /// Whether this system can hold a process to them.
    ///
    /// # Errors
    /// A limit of memory where the system does not show what a process takes.
    pub fn check(&self) -> Result<(), CommandError> {
        if self.limit_memory.is_some() && resident_mb(std::process::id()).is_none() {
            let text = "--limit-memory needs /proc of Linux; this system does not have it".to_owned();
            return Err(CommandError::Arguments(text));
        }
        Ok(())
    }

    /// Runs a process to its end, or to its limit.
    ///
    /// # Errors
    /// What the system says.
    pub fn run(&self, command: &mut Command) -> io::Result<Ended> {
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
        // A full pipe would stop the process.
        let stderr = child.stderr.take();
        let reader = std::thread::spawn(move || {
            let mut said = Vec::new();
            stderr.map_or(Ok(0), |mut pipe| pipe.read_to_end(&mut said)).map(|_| said)
        });
        let ended = match self.watch(&mut child)? {
            Ok(status) => {
                let stderr = reader.join().unwrap_or(Ok(Vec::new()))?;
                return Ok(Ended::Alone(Output { status, stdout: Vec::new(), stderr }));
            }
            Err(ended) => ended,
        };
        child.kill()?;
        child.wait()?;
        Ok(ended)
    }

    /// Waits for the end of a process, or for the limit that it reaches.
    fn watch(&self, child: &mut Child) -> io::Result<Result<ExitStatus, Ended>> {
        let began = Instant::now();
        if self.limit_time.is_none() && self.limit_memory.is_none() {
            return Ok(Ok(child.wait()?));
        }
        loop {
            if let Some(status) = child.try_wait()? {
                return Ok(Ok(status));
            }
            if let Some(s) = self.limit_time.filter(|s| began.elapsed().as_secs() >= u64::from(*s)) {
                return Ok(Err(Ended::AtLimit { limit: format!("{s} s"), option: "--limit-time" }));
            }
            let over = |mb: &u32| resident_mb(child.id()).is_some_and(|now| now > u64::from(*mb));
            if let Some(mb) = self.limit_memory.filter(over) {
                let limit = format!("{mb} MB of memory");
                return Ok(Err(Ended::AtLimit { limit, option: "--limit-memory" }));
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// The memory that a process has at present, where the system shows it.
fn resident_mb(process: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.trim().strip_suffix("kB"));
    Some(resident?.trim().parse::<u64>().ok()? / 1024)
}
