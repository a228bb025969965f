#!/usr/bin/env bash
# Prints the tolerance table of docs/verification.md: every case that takes seconds, both interfaces, four tolerances.
# Usage: scripts/verification.sh [case …]      (after make build; needs python3 for reading JSON)
set -euo pipefail
cd "$(dirname "$0")/.."
program=target/release/phasewarp
results=$(mktemp -d)
trap 'rm -rf "$results"' EXIT
[ $# -gt 0 ] || set -- cases/example1.toml cases/step_up.toml cases/well.toml cases/slope_jump.toml \
    cases/inflow_barrier.toml cases/pulsed_inflow.toml cases/barriers.toml cases/harmonic_step.toml \
    cases/quantum_dot2d.toml cases/barrier2d.toml cases/step3d.toml
echo "| case | interface | tolerance | reached | estimate/reached | modes | applications | weights: sweeps, spread |"
echo "|---|---|---|---|---|---|---|---|"
row() { # case, label, further options
    local case=$1 label=$2
    shift 2
    for interface in hat conservative; do
        for tolerance in 1e-3 1e-6 1e-9 1e-11; do
            "$program" run "$case" -o "$results" --set solver.verify=true --set solver.tolerance=$tolerance \
                --set scheme.interface=$interface "$@" >/dev/null 2>&1
            python3 - "$label" "$interface" "$tolerance" "$results/summary.json" <<'P'
import json, sys
label, interface, tolerance, path = sys.argv[1:]
s = json.load(open(path))
e = s["error_semidiscrete"]
print(f"| {label} | {interface} | {tolerance} | {e:.1e} | {s['error_estimate']/e:.2f} | {s['modes']} | "
      f"{s['matvecs']} | {s['weight_sweeps']}, {s['weight_spread']:.2f} |")
P
        done
    done
}
for case in "$@"; do
    row "$case" "$(basename "$case" .toml)"
    if [ "$(basename "$case")" = example1.toml ]; then
        row "$case" "example1 64×64" --set axis.0.x.cells=64 --set axis.0.v.cells=64
    fi
done
