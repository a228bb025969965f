#!/usr/bin/env bash
# What `make bench` runs: rates of the inner loop, whole-program runs, peers; then the tables of
# docs/performance.md.
#
#   scripts/bench/bench.sh [--quick] [--counts] [--no-peers] [--error]
#
# --quick     fewer and smaller runs, tables into results/bench-quick/ instead of docs/: a trial
# --counts    whole-program runs only, each once and not timed: modes, applications, errors and
#             memory, for a machine that others use; tables of seconds are left as they were
# --no-peers  without the other programs
# --error     only seconds to an error of the exact solution, and their table
#
# Raw figures go to results/bench/. Without Python the runs are made, and the document is left as it
# was. CARGO names the cargo command with its environment.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

quick=() counts=() only=() peers=yes place=$PWD/results/bench documents=$PWD/docs
for option in "$@"; do
    case $option in
    --quick) quick=(--quick) place=$PWD/results/bench-quick ;;
    --counts) counts=(--counts) peers=no ;;
    --no-peers) peers=no ;;
    --error) only=(--only error) peers=no ;;
    *)
        echo "bench: unknown option $option; known: --quick, --counts, --no-peers, --error" >&2
        exit 1
        ;;
    esac
done
# A part of the figures does not take the place of all.
[ "${#only[@]}" -eq 0 ] || place=$place-error
mkdir -p "$place"
if [ "${#quick[@]}" -gt 0 ]; then
    documents=$place
    cp docs/performance.md "$place/"
fi
if [ -z "${CARGO:-}" ]; then
    CARGO="$(scripts/setup.sh --environment) cargo"
fi
run_cargo() {
    # The words of CARGO: assignments, then the command.
    local words
    read -ra words <<<"$CARGO"
    env "${words[@]}" "$@"
}

# Built before, so that nothing is compiled while something is timed.
run_cargo bench --no-run
if [ "${#counts[@]}" -eq 0 ] && [ "${#only[@]}" -eq 0 ]; then
    run_cargo bench --bench application | tee "$place/application.txt"
fi
run_cargo bench --bench programs -- "${quick[@]}" "${counts[@]}" "${only[@]}" \
    --output "$place/programs.json"

if ! command -v python3 >/dev/null 2>&1; then
    echo "bench: no python3: no peers, no tables; raw figures are in $place"
    exit 0
fi
python=python3
if [ "$peers" = yes ] && python=$(scripts/bench/setup.sh); then
    program=${CARGO_TARGET_DIR:-target}/release/phasewarp
    "$python" scripts/bench/peers.py "$program" "$place/peers.json" "${quick[@]}" ||
        echo "bench: peers failed; their tables stay as they were"
else
    python=python3
    echo "bench: peers skipped"
fi
"$python" scripts/bench/report.py --results "$place" --document "$documents/performance.md" \
    "${only[@]}"
