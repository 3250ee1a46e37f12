#!/bin/sh
# The Debian package: stripped program, its debug information beside it, service, udev rule, manuals, completions, documents.
#
#   packaging/build-deb.sh                              for this machine; needs a Rust toolchain, binutils and dpkg-dev
#   packaging/build-deb.sh aarch64-unknown-linux-gnu    for arm64 (Raspberry Pi 3 and later with a 64-bit system); needs on Debian
#       rustup target add aarch64-unknown-linux-gnu
#       apt install gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user-static
#
# SKIP_BUILD=1 takes the program in the target folder as it is.
set -eu
cd "$(dirname "$0")/.."
target="${CARGO_TARGET_DIR:-$PWD/target}"
case "${1:-}" in
"")
    arch="$(dpkg --print-architecture)"
    program="$target/release/gaware" cross="" run=""
    [ "${SKIP_BUILD:-}" ] || cargo build --release --locked -p gaware --bin gaware
    ;;
aarch64-unknown-linux-gnu)
    arch=arm64 cross=aarch64-linux-gnu-
    program="$target/$1/release/gaware"
    # The program writes its manuals and completions itself.
    run="qemu-aarch64-static -L /usr/aarch64-linux-gnu"
    [ "${SKIP_BUILD:-}" ] || CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=${cross}gcc \
        cargo build --release --locked -p gaware --bin gaware --target "$1"
    ;;
*)
    echo "no package for $1: packaging/build-deb.sh [aarch64-unknown-linux-gnu]" >&2
    exit 2
    ;;
esac
version="$($run "$program" --version | cut -d' ' -f2)-1"
out="$target/debian"
root="$out/gaware-$arch"
rm -rf "$root"
umask 022
mkdir -p "$root/DEBIAN" "$root/usr/share/doc/gaware/docs" "$root/usr/share/man/man1"

# gdb and addr2line find the debug information by its name, which the program holds.
debug="$out/gaware_${version}_$arch.debug"
"${cross}objcopy" --only-keep-debug --compress-debug-sections "$program" "$debug"
install -D -m 755 "$program" "$root/usr/bin/gaware"
"${cross}strip" --strip-unneeded "$root/usr/bin/gaware"
"${cross}objcopy" --add-gnu-debuglink="$debug" "$root/usr/bin/gaware"

$run "$program" config check packaging/gaware.toml
install -D -m 640 packaging/gaware.toml "$root/etc/gaware.toml"
install -D -m 644 packaging/gaware.service "$root/usr/lib/systemd/system/gaware.service"
install -D -m 644 packaging/60-gaware.rules "$root/usr/lib/udev/rules.d/60-gaware.rules"
$run "$program" manual "$root/usr/share/man/man1"
gzip -9n "$root/usr/share/man/man1"/*.1
for shell in bash:bash-completion/completions/gaware zsh:zsh/vendor-completions/_gaware fish:fish/vendor_completions.d/gaware.fish; do
    file="$root/usr/share/${shell#*:}"
    mkdir -p "$(dirname "$file")"
    $run "$program" completions "${shell%%:*}" >"$file"
done
# What `gaware serve --web` serves, where web/build has made it.
[ ! -f "$target/web/gaware.html" ] || install -D -m 644 "$target/web/gaware.html" "$root/usr/share/gaware/gaware.html"
install -m 644 README.md CHANGELOG.md "$root/usr/share/doc/gaware/"
install -m 644 docs/*.md docs/*.schema.json "$root/usr/share/doc/gaware/docs/"
install -m 644 LICENSE-MIT "$root/usr/share/doc/gaware/copyright"

# What the program is linked with: the C library, of at least the version whose symbols it asks for, and that of the compiler.
unknown="$(readelf -d "$root/usr/bin/gaware" | sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p' | grep -vE '^(libc|libm|libgcc_s|ld-linux.*)\.so' || true)"
[ -z "$unknown" ] || { echo "no package is known for $unknown" >&2; exit 1; }
glibc="$(readelf -V "$root/usr/bin/gaware" | grep -o 'GLIBC_[0-9.]*' | sort -Vu | tail -1)"
depends="libc6 (>= ${glibc#GLIBC_}), libgcc-s1 (>= 4.2)"
[ "$glibc" ]
cat >"$root/DEBIAN/control" <<CONTROL
Package: gaware
Version: $version
Architecture: $arch
Maintainer: gaware maintainers
Section: science
Priority: optional
Depends: $depends
Installed-Size: $(du -sk "$root" | cut -f1)
Description: MAVLink flight-test companion for ArduPilot and PX4
 Estimates gyro g-sensitivity in flight, shows which states are observable,
 proposes and uploads excitation maneuvers, and identifies unmodelled sensor
 errors after the flight.
CONTROL
echo /etc/gaware.toml >"$root/DEBIAN/conffiles"
# The service is neither enabled nor started: it needs its configuration first.
cat >"$root/DEBIAN/postinst" <<'POSTINST'
#!/bin/sh
set -e
if [ "$1" = configure ] && [ -d /run/systemd/system ]; then
    systemctl daemon-reload
    udevadm control --reload || true
    # After an upgrade only: a service that runs takes the new program.
    [ -z "$2" ] || systemctl try-restart gaware.service
fi
POSTINST
cat >"$root/DEBIAN/prerm" <<'PRERM'
#!/bin/sh
set -e
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
    systemctl disable --now gaware.service || true
fi
PRERM
chmod 755 "$root/DEBIAN/postinst" "$root/DEBIAN/prerm"
dpkg-deb --root-owner-group -Zxz --build "$root" "$out/gaware_${version}_$arch.deb"
