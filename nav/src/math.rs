//! Sines, logarithms and the like with the same digits everywhere.
//!
//! Those of `f64` are the C library's, and libraries differ in the last digit: of processors, of systems, of a browser. A digit decides whether
//! a threshold is met a sample earlier, and then results differ by a ten-thousandth of a sigma. These are computed by the same
//! operations wherever the program runs. [`f64::sqrt`] is exact by IEEE 754 and stays.

pub use libm::{
    acos, asin, atan, atan2, cbrt, cos, exp, expm1 as exp_m1, hypot, log as ln, log2, log10, pow as powf,
    sin, sincos as sin_cos, sinh, tan,
};
