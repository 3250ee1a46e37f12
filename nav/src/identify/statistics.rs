//! Means, ranges and quantiles of series.

/// Largest less smallest.
pub(in crate::identify) fn range(of: impl Iterator<Item = f64>) -> f64 {
    let (low, high) = of.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    high - low
}

/// 0 of nothing.
pub(in crate::identify) fn mean(of: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = of.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / f64::max(count, 1.0)
}

/// Of what is finite.
pub(in crate::identify) fn rms(of: impl Iterator<Item = f64>) -> f64 {
    mean(of.filter(|v| v.is_finite()).map(|v| v * v)).sqrt()
}

/// The value that this share of them, a fraction, is no more than; `None` of nothing.
pub(in crate::identify) fn quantile(
    of: impl Iterator<Item = f64>,
    (share, of_parts): (usize, usize),
) -> Option<f64> {
    let mut all: Vec<f64> = of.collect();
    let at = all.len() * share / of_parts;
    (at < all.len()).then(|| *all.select_nth_unstable_by(at, f64::total_cmp).1)
}

/// The greater of the two in the middle; `None` of nothing.
pub(in crate::identify) fn median(of: impl Iterator<Item = f64>) -> Option<f64> {
    quantile(of, (1, 2))
}

/// The 90th percentile; 0 of nothing.
pub(in crate::identify) fn high(of: impl Iterator<Item = f64>) -> f64 {
    quantile(of, (9, 10)).unwrap_or(0.0)
}

/// What differs from the mean over so long before and after, s. `all`: time, s, and value, in order.
pub(in crate::identify) fn about_mean(all: &[(f64, f64)], about_s: f64) -> Vec<f64> {
    let (mut from, mut to, mut sum) = (0, 0, 0.0);
    let one = |(t_s, own): &(f64, f64)| {
        while all.get(to).is_some_and(|next| next.0 <= t_s + about_s) {
            sum += all[to].1;
            to += 1;
        }
        while all[from].0 < t_s - about_s {
            sum -= all[from].1;
            from += 1;
        }
        own - sum / (to - from).max(1) as f64
    };
    all.iter().map(one).collect()
}
