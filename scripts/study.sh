#!/usr/bin/env bash
# What `make study` runs: scripts/study.py, by a Python with Matplotlib if one can be installed.
# scripts/study.py describes the options.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
if ! python=$(scripts/bench/setup.sh --charts); then
    python=python3
fi
exec "$python" scripts/study.py "$@"
