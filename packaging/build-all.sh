#!/usr/bin/env bash
# What people without Rust install: archives with the program, wheels, Debian packages; they go to target/packages.
#
#   packaging/build-all.sh [TARGET…]     without one, all of these:
#
#   x86_64-unknown-linux-musl, aarch64-unknown-linux-musl    an archive with a static program, for any Linux
#   x86_64-unknown-linux-gnu, aarch64-unknown-linux-gnu      a Debian package (build-deb.sh says what it needs), a wheel
#   x86_64-pc-windows-gnu                                    an archive, a wheel
#   aarch64-apple-darwin, x86_64-apple-darwin                an archive, a wheel
#
# Needs rustup and Python on Linux. The linker is zig, which comes as a wheel and has the C libraries of all these systems.
set -euo pipefail
cd "$(dirname "$0")/.."
target="${CARGO_TARGET_DIR:-$PWD/target}"
out="$target/packages"
version="$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -1)"
host="$(rustc -vV | sed -n 's/^host: //p')"
mkdir -p "$out"
. packaging/zig.sh

archive() { # TARGET
    local name="gaware-$version-$1" program="$target/$1/release/gaware"
    local folder="$out/$name"
    rm -rf "$folder" "$folder".*
    mkdir -p "$folder"
    cp -r README.md CHANGELOG.md THIRD-PARTY.md LICENSE-APACHE LICENSE-MIT docs "$folder"
    .ci/sbom.py "$folder/gaware.cdx.json" "$1" "$folder/LICENSES-OF-LIBRARIES.txt"
    # What `gaware serve --web` serves, where web/build has made it.
    [ ! -f "$target/web/gaware.html" ] || cp "$target/web/gaware.html" "$folder"
    case "$1" in
    *windows*)
        cp "$program.exe" "$folder"
        (cd "$out" && python3 -m zipfile -c "$name.zip" "$name")
        ;;
    *)
        cp "$program" "$folder"
        tar -C "$out" --owner=0 --group=0 -czf "$folder.tar.gz" "$name"
        ;;
    esac
    rm -r "$folder"
}

[ $# -gt 0 ] || set -- {x86_64,aarch64}-unknown-linux-{musl,gnu} x86_64-pc-windows-gnu {aarch64,x86_64}-apple-darwin
# Nobody debugs these; the Debian package keeps its debug information beside it.
small="CARGO_PROFILE_RELEASE_DEBUG=0 CARGO_PROFILE_RELEASE_STRIP=symbols"
for triple; do
    rustup target add "$triple" 2>/dev/null
    case "$triple" in
    *-linux-gnu)
        # For this machine, or for the one that is named.
        packaging/build-deb.sh $([ "$triple" = "$host" ] || echo "$triple")
        cp "$target"/debian/*.deb "$out"
        ;;
    *)
        # The features of both packages at once: what the wheel needs is compiled already.
        env $small cargo zigbuild --release --locked -p gaware -p gaware-python --bin gaware --target "$triple"
        archive "$triple"
        ;;
    esac
    case "$triple" in
    *-musl) ;; # Python of a Linux with glibc takes the other wheel.
    *) env $small maturin build --release --locked --zig --target "$triple" -m python/Cargo.toml -o "$out" ;;
    esac
done
ls -l "$out"
