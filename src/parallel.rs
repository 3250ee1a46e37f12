//! Many independent runs on all cores, with their order kept and their progress reported.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Someone who wants to know how far a long job is.
pub trait Progress: Sync {
    /// One more unit of work is done.
    fn tick(&self);
}

/// No one wants to know.
#[derive(Debug, Clone, Copy)]
pub struct Silent;

impl Progress for Silent {
    fn tick(&self) {}
}

/// The most threads that this process takes.
static MOST: AtomicUsize = AtomicUsize::new(usize::MAX);

/// Limits this process to so many threads, where others like it share the machine.
pub fn use_at_most(threads: usize) {
    MOST.store(threads.max(1), Ordering::Relaxed);
}

/// How many things this process does at once.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from).min(MOST.load(Ordering::Relaxed))
}

/// `work(0) … work(runs − 1)` on all cores; results in order, so that sums do not depend on scheduling.
pub fn map_runs<T: Send>(runs: usize, progress: &dyn Progress, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    map_runs_on(cores(), runs, progress, work)
}

/// The same with this many threads, at least one.
pub fn map_runs_on<T: Send>(
    threads: usize,
    runs: usize,
    progress: &dyn Progress,
    work: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::with_capacity(runs));
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, runs.max(1)) {
            scope.spawn(|| {
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    if k >= runs {
                        return;
                    }
                    let result = work(k);
                    progress.tick();
                    if let Ok(mut all) = results.lock() {
                        all.push((k, result));
                    }
                }
            });
        }
    });
    let mut all = results.into_inner().unwrap_or_default();
    all.sort_by_key(|(k, _)| *k);
    all.into_iter().map(|(_, r)| r).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order() {
        for threads in [0, 1, 3] {
            let squares = map_runs_on(threads, 100, &Silent, |k| k * k);
            assert_eq!(squares, (0..100).map(|k| k * k).collect::<Vec<_>>());
        }
        assert!(map_runs(0, &Silent, |k| k).is_empty());
    }
}
