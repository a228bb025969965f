#!/usr/bin/env bash
# Installs what scripts/bench/peers.py compares with: a Python environment outside of the repository
# with the packages of requirements.txt, and on Debian and Ubuntu SLEPc for complex numbers (as
# root, or by sudo without password; elsewhere it is only named). Prints the interpreter to use. If
# there is none, prints the reason and ends with exit code 1. Instant when everything is there.
#
#   scripts/bench/setup.sh [--charts]     --charts: without SLEPc
#
# Environment: PHASEWARP_BENCH_PYTHON, an interpreter that has the packages; SLEPC_PYTHON, one that
# has SLEPc.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

say() { echo "bench: $*" >&2; }

charts=${1:-}
slepc() {
    if [ "$charts" = --charts ]; then
        return
    fi
    if "${SLEPC_PYTHON:-/usr/bin/python3}" slepc_mfn.py --version >/dev/null 2>&1; then
        return
    fi
    if ! command -v apt-get >/dev/null 2>&1; then
        say "no SLEPc for complex numbers (Debian: python3-slepc4py-complex); going on without"
        return
    fi
    local root=()
    [ "$(id -u)" -eq 0 ] || root=(sudo -n)
    say "installing python3-slepc4py-complex"
    if ! "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y \
        --no-install-recommends python3-slepc4py-complex libopenblas0-pthread \
        </dev/null >/dev/null 2>&1; then
        say "apt-get could not install python3-slepc4py-complex; going on without SLEPc"
    fi
}

if [ -n "${PHASEWARP_BENCH_PYTHON:-}" ]; then
    slepc
    echo "$PHASEWARP_BENCH_PYTHON"
    exit 0
fi
if ! command -v python3 >/dev/null 2>&1; then
    say "no python3: peers skipped"
    exit 1
fi
place="${XDG_CACHE_HOME:-$HOME/.cache}/phasewarp/bench"
if ! cmp -s requirements.txt "$place/requirements.txt"; then
    say "installing the packages of scripts/bench/requirements.txt into $place"
    mkdir -p "$place"
    install() {
        python3 -m venv "$place" &&
            "$place/bin/pip" install -q --disable-pip-version-check -r requirements.txt
    }
    if ! install >"$place/log" 2>&1; then
        say "peers skipped: $(tail -n 1 "$place/log")"
        exit 1
    fi
    cp requirements.txt "$place/requirements.txt"
fi
slepc
echo "$place/bin/python"
