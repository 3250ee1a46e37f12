# Sourced: `cargo zigbuild` and `maturin` in an environment of their own, and what zig lacks for macOS.
tools="${CARGO_TARGET_DIR:-$PWD/target}/python/zig"
[ -x "$tools/bin/maturin" ] || python3 -m venv "$tools"
# zig 0.13 is the last that makes programs for macOS 12 (11.7.1); 0.14 asks for 13, 0.17 for 15.
"$tools/bin/pip" install --quiet --disable-pip-version-check 'maturin>=1.9,<2' cargo-zigbuild==0.24.1 ziglang==0.13.0
export PATH="$tools/bin:$PATH"
# zig has the system library of macOS but no frameworks.
export CARGO_TARGET_AARCH64_APPLE_DARWIN_RUSTFLAGS="-L framework=$PWD/packaging/macos"
export CARGO_TARGET_X86_64_APPLE_DARWIN_RUSTFLAGS="$CARGO_TARGET_AARCH64_APPLE_DARWIN_RUSTFLAGS"
