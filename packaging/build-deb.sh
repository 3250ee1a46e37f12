#!/bin/sh
# The Debian package: stripped program, its debug information beside it, service, udev rule, manuals, completions, documents.
# Needs a Rust toolchain, binutils and dpkg-dev. SKIP_BUILD=1 takes the program in target/release as it is.
set -eu
cd "$(dirname "$0")/.."
target="${CARGO_TARGET_DIR:-$PWD/target}"
[ "${SKIP_BUILD:-}" ] || cargo build --release --locked
program="$target/release/gaware"
version="$("$program" --version | cut -d' ' -f2)-1"
arch="$(dpkg --print-architecture)"
out="$target/debian"
root="$out/gaware"
rm -rf "$root"
umask 022
mkdir -p "$root/DEBIAN" "$root/usr/share/doc/gaware/docs" "$root/usr/share/man/man1"

# gdb and addr2line find the debug information by its name, which the program holds.
debug="$out/gaware_${version}_$arch.debug"
objcopy --only-keep-debug --compress-debug-sections "$program" "$debug"
install -D -m 755 "$program" "$root/usr/bin/gaware"
strip --strip-unneeded "$root/usr/bin/gaware"
objcopy --add-gnu-debuglink="$debug" "$root/usr/bin/gaware"

"$program" config check packaging/gaware.toml
install -D -m 640 packaging/gaware.toml "$root/etc/gaware.toml"
install -D -m 644 packaging/gaware.service "$root/usr/lib/systemd/system/gaware.service"
install -D -m 644 packaging/60-gaware.rules "$root/usr/lib/udev/rules.d/60-gaware.rules"
"$program" manual "$root/usr/share/man/man1"
gzip -9n "$root/usr/share/man/man1"/*.1
for shell in bash:bash-completion/completions/gaware zsh:zsh/vendor-completions/_gaware fish:fish/vendor_completions.d/gaware.fish; do
    file="$root/usr/share/${shell#*:}"
    mkdir -p "$(dirname "$file")"
    "$program" completions "${shell%%:*}" >"$file"
done
install -m 644 README.md CHANGELOG.md "$root/usr/share/doc/gaware/"
install -m 644 docs/*.md docs/*.schema.json "$root/usr/share/doc/gaware/docs/"
install -m 644 LICENSE-MIT "$root/usr/share/doc/gaware/copyright"

# What the program is linked with.
mkdir -p "$out/shlibs/debian"
printf 'Source: gaware\n\nPackage: gaware\nArchitecture: any\n' >"$out/shlibs/debian/control"
depends="$(cd "$out/shlibs" && dpkg-shlibdeps -O "$root/usr/bin/gaware" 2>/dev/null | sed -n 's/^shlibs:Depends=//p')"
[ "$depends" ]
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
