#!/bin/sh
# The pages in a real browser. Needs node 20, npm and Chromium (CHROMIUM=/path, default /usr/bin/chromium); one test is of Firefox, where there is one (FIREFOX=/path).
# SCREENSHOTS=1 also renews the pictures in docs/, of the program itself: `gaware demo` in mid-flight.
set -eu
cd "$(dirname "$0")/../.."
cargo build --quiet --bin gaware --example web_fixture
web/build
WEB_FIXTURE="${CARGO_TARGET_DIR:-$PWD/target}/debug/examples/web_fixture"
GAWARE="${CARGO_TARGET_DIR:-$PWD/target}/debug/gaware"
ANALYSIS="${CARGO_TARGET_DIR:-$PWD/target}/web/gaware.html"
export WEB_FIXTURE GAWARE ANALYSIS
cd tests/browser
npm ci --no-audit --no-fund --loglevel=error
if [ "${SCREENSHOTS:-}" ]; then node pictures.mjs; fi
exec npm test --silent
