#!/usr/bin/env bash
# Draws figures 2 to 5 of the paper from our own runs, into docs/examples/: `make examples`.
#
#   scripts/examples.sh [--program PATH] [--paper] [--out DIR]
#
# The grids are the paper's. The classical solution is by forward Euler, like the paper's; the
# Schrödingerized one is planned for 1e-6. With --paper it uses the paper's own set-up (profile,
# interval, N_p, p◇ and step: cases/paper/), which takes minutes: examples 1 and 3 as they are,
# example 2 on 64 x 64 cells with N_p = 4096. Files are then called paper-figureN. RANKS is the
# number of ranks (2).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

program=target/release/phasewarp
out=docs/examples
paper=""
while [ $# -gt 0 ]; do
    case $1 in
    --program) program=$2 && shift 2 ;;
    --out) out=$2 && shift 2 ;;
    --paper) paper=paper/ && shift ;;
    *)
        echo "examples: unknown option $1; known: --program PATH, --paper, --out DIR" >&2
        exit 1
        ;;
    esac
done
prefix=${paper%/}
prefix=${prefix:+$prefix-}
mkdir -p "$out"

# example N OVERRIDE…: makes both runs and draws them beside each other.
example() {
    local n=$1 results=results/examples/${prefix}example$1 set=()
    shift
    local key
    for key in "$@"; do
        set+=(--set "$key")
    done
    mpirun -np "${RANKS:-2}" "$program" run "cases/${paper}example$n.toml" -o "$results" --force \
        "${set[@]}"
    mpirun -np "${RANKS:-2}" "$program" run "cases/example$n.toml" -o "$results-classical" --force \
        --set solver.method=classical --set solver.classical.integrator=forward-euler "${set[@]}"
    "$program" plot "$results" --beside "$results-classical" -o "$results/plots" >/dev/null
}

# figure K N PICTURE: copies a picture of example N to the paper's figure K.
figure() {
    cp "results/examples/${prefix}example$2/plots/$3.svg" "$out/${prefix}figure$1.svg"
    echo "$out/${prefix}figure$1.svg"
}

example 1
figure 2 1 phase_space
if [ -n "$paper" ]; then
    example 2 axis.0.x.cells=64 axis.0.v.cells=64 solver.warp.points=4096
else
    example 2
    cp results/examples/example1/plots/profile.svg "$out/profile.svg"
fi
figure 3 2 phase_space
figure 4 2 moments
example 3
figure 5 3 density
