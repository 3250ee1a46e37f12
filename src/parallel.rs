//! Many independent runs on all cores, with their order kept and their progress reported.

use gaware_nav::identify::Workers;
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

/// `work(0) … work(runs − 1)` on all cores; results in order.
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
    gaware_nav::identify::map(&Threads(threads), runs, |k| {
        let result = work(k);
        progress.tick();
        result
    })
}

/// So many threads, at least one. Jobs that have jobs of their own share them: who asks works along, and others join in only while
/// fewer than so many are at work. Memory that threads leave behind is kept for each of them, so few threads need less of it.
#[derive(Debug, Clone, Copy)]
pub struct Threads(pub usize);

/// Threads that work along with those that asked.
static HELPERS: AtomicUsize = AtomicUsize::new(0);

/// One of them, as long as it works.
struct Helper;

impl Helper {
    /// One more, if that makes no more than `most`.
    fn join(most: usize) -> Option<Self> {
        let more = |now: usize| (now < most).then_some(now + 1);
        HELPERS.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).ok().map(|_| Self)
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        HELPERS.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Workers for Threads {
    fn run(&self, jobs: usize, job: &(dyn Fn(usize) + Sync)) {
        let next = AtomicUsize::new(0);
        let work = || {
            loop {
                let k = next.fetch_add(1, Ordering::Relaxed);
                if k >= jobs {
                    return;
                }
                job(k);
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..jobs {
                let Some(helper) = Helper::join(self.0.saturating_sub(1)) else { break };
                scope.spawn(move || {
                    work();
                    drop(helper);
                });
            }
            work();
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Jobs of jobs take no more threads than were asked for.
    #[test]
    fn jobs_of_jobs_share_the_threads() {
        let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let workers = Threads(2);
        workers.run(4, &|_| {
            workers.run(8, &|_| {
                most.fetch_max(now.fetch_add(1, Ordering::Relaxed) + 1, Ordering::Relaxed);
                std::thread::yield_now();
                now.fetch_sub(1, Ordering::Relaxed);
            });
        });
        assert!(most.load(Ordering::Relaxed) <= 2, "{most:?}");
    }

    #[test]
    fn results_come_in_order() {
        for threads in [0, 1, 3] {
            let squares = map_runs_on(threads, 100, &Silent, |k| k * k);
            assert_eq!(squares, (0..100).map(|k| k * k).collect::<Vec<_>>());
        }
        assert!(map_runs(0, &Silent, |k| k).is_empty());
    }
}
