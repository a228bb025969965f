#!/usr/bin/env bash
# Prints the table of tolerances in docs/verification.md: every case that takes seconds, both
# interfaces, four tolerances, one rank. Needs `make build` and Python 3.
#
#   scripts/verification.sh [--program PATH] [CASE…]
#
# Exit code 1 if a run fails or misses its tolerance.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

program=target/release/phasewarp
if [ "${1:-}" = --program ]; then
    program=$2 && shift 2
fi
if [ $# -eq 0 ]; then
    set -- cases/{example1,step_up,well,slope_jump,inflow_barrier,pulsed_inflow}.toml \
        cases/{barriers,harmonic_step,quantum_dot2d,barrier2d,periodic2d,step3d}.toml
fi
results=$(mktemp -d)
trap 'rm -rf "$results"' EXIT

# row CASE LABEL [OPTION…]: the rows of one case.
row() {
    local case=$1 label=$2 interface tolerance
    shift 2
    for interface in hat conservative; do
        for tolerance in 1e-3 1e-6 1e-9 1e-11; do
            "$program" run "$case" -o "$results" --force --set solver.verify=true "$@" \
                --set solver.tolerance=$tolerance --set scheme.interface=$interface \
                >"$results/log" 2>&1 || { cat "$results/log" >&2 && exit 1; }
            python3 - "$label" "$interface" "$tolerance" "$results/summary.json" <<'P'
import json, sys
label, interface, tolerance, path = sys.argv[1:]
s = json.load(open(path))
error = s["error_semidiscrete"]
ratio = f"{s['error_estimate'] / error:.2f}"
ratio += "" if s["error_estimate_reliable"] else " (not reliable)"
print(f"| {label} | {interface} | {tolerance} | {error:.1e} | {ratio} | {s['modes']} | "
      f"{s['matvecs']} | {s['weight_sweeps']}, {s['weight_spread']:.2f} |", flush=True)
if error > float(tolerance):
    sys.exit(f"verification: {label}, {interface}: {error:.1e} exceeds the tolerance {tolerance}")
P
        done
    done
}

echo "| case | interface | tolerance | reached | estimate/reached | modes | applications |" \
    "weights: sweeps, spread |"
echo "|---|---|---|---|---|---|---|---|"
for case in "$@"; do
    row "$case" "$(basename "$case" .toml)"
    if [ "$(basename "$case")" = example1.toml ]; then
        row "$case" "example1 64×64" --set axis.0.x.cells=64 --set axis.0.v.cells=64
    fi
done
