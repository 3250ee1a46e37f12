//! What the linker is to know of the module's memory.

/// One flight of any length that people fly needs far less; more would be refused by phones, and a page without a limit takes the machine along.
const MEMORY: usize = 1 << 30;
/// Matrices of 45 states lie on the stack; the linker's own figure is 1 MiB.
const STACK: usize = 8 << 20;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if std::env::var("CARGO_CFG_TARGET_FAMILY").is_ok_and(|family| family == "wasm") {
        println!("cargo:rustc-link-arg-cdylib=--max-memory={MEMORY}");
        println!("cargo:rustc-link-arg-cdylib=-zstack-size={STACK}");
    }
}
