#!/usr/bin/env bash
# What `make study` runs: scripts/study.py, with a Python that has Matplotlib where one can be had. See there for the options.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
if ! python=$(scripts/bench/setup.sh --charts); then
    python=python3
fi
exec "$python" scripts/study.py "$@"
