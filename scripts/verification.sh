#!/usr/bin/env bash
# Prints the table of tolerances in docs/verification.md: every case that takes seconds, both
# interfaces, four tolerances, one rank; then elements of degree 1 to 4. A cell has the error that
# is reached, the error estimate over it ("?": not called reliable), modes and applications. The
# last two lines are those of the summary at the top of that page. Needs `make build` and Python 3.
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
elements=()
if [ $# -eq 0 ]; then
    # CASE:DEGREE:ELEMENTS an axis.
    elements=(example1:2:24 inflow_barrier:3:16 pulsed_inflow:1:24 harmonic_step:4:16
        partial_reflection:3:16 barrier2d:1:8 quadrant2d:2:4 smooth_step3d:1:2)
    set -- cases/{example1,step_up,well,slope_jump,inflow_barrier,pulsed_inflow}.toml \
        cases/{barriers,harmonic_step,quantum_dot2d,barrier2d,periodic2d,step3d}.toml
fi
results=$(mktemp -d)
trap 'rm -rf "$results"' EXIT

# tolerances CASE LABEL SCHEME [OPTION…]: a row, with a cell for each tolerance.
tolerances() {
    local case=$1 label=$2 interface=$3 tolerance
    shift 3
    printf '| %s | %s |' "$label" "$interface"
    for tolerance in 1e-3 1e-6 1e-9 1e-11; do
        "$program" run "$case" -o "$results" --force --set solver.verify=true "$@" \
            --set solver.tolerance=$tolerance \
            >"$results/log" 2>&1 || { cat "$results/log" >&2 && exit 1; }
        python3 - "$label" "$interface" "$tolerance" "$results" <<'P'
import json, sys
label, interface, tolerance, results = sys.argv[1:]
s = json.load(open(f"{results}/summary.json"))
error = s["error_semidiscrete"]
ratio = f"{s['error_estimate'] / error:.2f}"
with open(f"{results}/ratios", "a") as file:
    print(error / float(tolerance), ratio, s["error_estimate_reliable"], file=file)
ratio += "" if s["error_estimate_reliable"] else "?"
print(f" {error:.1e}; {ratio}; {s['modes']}, {s['matvecs']} |", end="", flush=True)
if tolerance == "1e-11":
    print(f" {s['weight_sweeps']}, {s['weight_spread']:.2f} |", flush=True)
if error > float(tolerance):
    sys.exit(f"verification: {label}, {interface}: {error:.1e} exceeds the tolerance {tolerance}")
P
    done
}

# row CASE LABEL [OPTION…]: both interfaces of one case.
row() {
    local interface
    for interface in hat conservative; do
        tolerances "$1" "$2" $interface --set scheme.interface=$interface "${@:3}"
    done
}

echo "| case | interface or degree | 1e-3 | 1e-6 | 1e-9 | 1e-11 | weights: sweeps, spread |"
echo "|---|---|---|---|---|---|---|"
for case in "$@"; do
    row "$case" "$(basename "$case" .toml)"
    if [ "$(basename "$case")" = example1.toml ]; then
        row "$case" "example1 64×64" --set axis.0.x.cells=64 --set axis.0.v.cells=64
    fi
done

for entry in "${elements[@]}"; do
    IFS=: read -r name degree count <<<"$entry"
    options=(--set "scheme.degree=$degree")
    axes=$(grep -c '^\[\[axis\]\]' "cases/$name.toml")
    for ((axis = 0; axis < axes; axis++)); do
        options+=(--set "axis.$axis.x.cells=$count" --set "axis.$axis.v.cells=$count")
    done
    tolerances "cases/$name.toml" "$name" "degree $degree" "${options[@]}"
done

echo
python3 - "$results/ratios" <<'P'
import sys
rows = [line.split() for line in open(sys.argv[1])]
reliable = sorted(float(ratio) for _, ratio, known in rows if known == "True")
within = [ratio for ratio in reliable if 1 / 3 <= ratio <= 3]
beyond = ", ".join(f"{ratio:.2f}" for ratio in reliable if ratio not in within) or "none"
largest = max(float(part) for part, _, _ in rows)
print(f"{len(rows)} runs: the largest error is {largest:.2f} of the tolerance")
if within:
    print(
        f"{within[0]:.2f} to {within[-1]:.2f} times the error in {len(within)} of"
        f" {len(reliable)} reliable estimates; beyond: {beyond}"
    )
P
