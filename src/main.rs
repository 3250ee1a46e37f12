//! gaware
fn main() {}
