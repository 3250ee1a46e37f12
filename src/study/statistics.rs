//! Small statistics shared by the studies.

/// Root mean square of each component.
#[derive(Debug, Clone, Copy, Default)]
pub struct Rms3 {
    sum: [f64; 3],
    n: u64,
}

impl Rms3 {
    /// Adds one error.
    pub fn add(&mut self, error: [f64; 3]) {
        for (s, e) in self.sum.iter_mut().zip(error) {
            *s += e * e;
        }
        self.n += 1;
    }

    /// The result; zero when nothing was added.
    pub fn value(&self) -> [f64; 3] {
        self.sum.map(|s| if self.n == 0 { 0.0 } else { (s / self.n as f64).sqrt() })
    }

    /// How many were added.
    pub fn count(&self) -> u64 {
        self.n
    }
}
