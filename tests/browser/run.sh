#!/bin/sh
# The page in a real browser. Needs node 20, npm and Chromium (CHROMIUM=/path, default /usr/bin/chromium).
# SCREENSHOTS=1 also renews the pictures in docs/.
set -eu
cd "$(dirname "$0")/../.."
cargo build --quiet --example web_fixture
WEB_FIXTURE="${CARGO_TARGET_DIR:-$PWD/target}/debug/examples/web_fixture"
export WEB_FIXTURE
cd tests/browser
npm ci --no-audit --no-fund --loglevel=error
exec npm test --silent
