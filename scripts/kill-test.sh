#!/usr/bin/env bash
# Kills fifty renders at random moments, looks that their file is the old one or the whole new one all the while, and goes on
# from their checkpoints: the same bytes as a render that was left alone. Minutes. Options go to cargo (--features oiio).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec cargo test --release "$@" --test parts -- --ignored --exact --nocapture fifty_killed_renders_go_on_to_the_same_bytes
