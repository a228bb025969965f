#!/usr/bin/env bash
# Runs a script that draws a chart, by a Python with Matplotlib if one can be installed.
#
#   scripts/charted.sh study.py|ranks.py [OPTION]…    the script describes its options
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
if ! python=$(scripts/bench/setup.sh --charts); then
    python=python3
fi
exec "$python" "scripts/$1" "${@:2}"
