#!/usr/bin/env bash
# Prints the tables of docs/high-order.md: errors, modes, applications and seconds by degree, one
# rank. Needs `make build` and Python 3.
#
#   scripts/high_order.sh [--program PATH] [smooth|order|plane|example1|limited|unitary|steps]…
#
# smooth    smooth beams through a step, about 128 unknowns an axis
# order     the same under refinement, classical, so that only the grid's error is seen
# plane     a beam that goes down a step in two dimensions, under refinement, classical
# example1  quarter discs at a step, about 256 unknowns an axis
# limited   both cases: modes of high degree beside van Leer's slopes with SSP-RK3, by error
# unitary   degree 0: the central flux with closed ends beside upwind, a Gaussian and example 1
# steps     classical SSP-RK3 at its default step beside the exponential, smooth beams
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

program=target/release/phasewarp
if [ "${1:-}" = --program ]; then
    program=$2 && shift 2
fi
[ $# -gt 0 ] || set -- smooth order plane example1 limited unitary steps
results=$(mktemp -d)
trap 'rm -rf "$results"' EXIT

# run CASE DEGREE ELEMENTS [OPTION…]: leaves summary.json and result.h5 in $results.
run() {
    local case=$1 degree=$2 elements=$3
    shift 3
    "$program" run "cases/$case.toml" -o "$results" --force --set "scheme.degree=$degree" \
        --set "axis.0.x.cells=$elements" --set "axis.0.v.cells=$elements" "$@" \
        >"$results/log" 2>&1 || { cat "$results/log" >&2 && exit 1; }
}

# row FORMAT LABEL…: a line of a table; FORMAT is a Python format over the summary `s`.
row() {
    python3 - "$results/summary.json" "$@" <<'P'
import json, sys
path, form, *label = sys.argv[1:]
s = json.load(open(path))
print("| " + " | ".join(label + [form.format(s=s)]) + " |", flush=True)
P
}

# Smooth beams by the exponential, which has no time error, and by SSP-RK3, whose distance to it is.
steps() {
    echo "| degree | elements | f | density | time error | density by SSP-RK3 |"
    echo "|---|---|---|---|---|---|"
    local classical=(--set solver.method=classical --set scheme.flux=0.5)
    for pair in 2:42 4:26 4:38 6:26 6:56 8:20 8:28 8:40; do
        run smooth-beams "${pair%:*}" "${pair#*:}" "${classical[@]}"
        local grid
        grid=$(row "{s[error_l2_relative]:.2e} | {s[error_density_l2_relative]:.2e}")
        grid=${grid#| } && grid=${grid% |}
        run smooth-beams "${pair%:*}" "${pair#*:}" "${classical[@]}" \
            --set solver.verify=true --set solver.classical.integrator=ssp-rk3
        row "{s[error_semidiscrete]:.1e} | {s[error_density_l2_relative]:.2e}" \
            "${pair%:*}" "${pair#*:}" "$grid"
    done
}

# Even numbers of elements: faces on x = 0 and v = 0.
smooth() {
    echo "| degree | flux | elements | relative L2: f | density | modes | applications | seconds |"
    echo "|---|---|---|---|---|---|---|---|"
    local figures="{s[error_l2_relative]:.2e} | {s[error_density_l2_relative]:.2e} | "
    figures+="{s[modes]} | {s[matvecs]} | {s[solve_seconds]:.2f}"
    for pair in 0:128 1:64 2:42 3:32 4:26 6:18; do
        for flux in 1 0.5; do
            # Degree 0 has no choice of flux.
            [ "$pair" != 0:128 ] || [ $flux = 1 ] || continue
            local options=()
            [ "$pair" = 0:128 ] || options=(--set "scheme.flux=$flux")
            run smooth-beams "${pair%:*}" "${pair#*:}" "${options[@]}"
            row "$figures" "${pair%:*}" "$flux" "${pair#*:}"
        done
    done
}

order() {
    echo "| degree | elements | relative L2 of f |"
    echo "|---|---|---|"
    for pair in 1:64 1:128 1:256 2:42 2:84 2:168 3:32 3:64 3:128 4:26 4:52 4:104; do
        run smooth-beams "${pair%:*}" "${pair#*:}" --set solver.method=classical \
            --set scheme.flux=1
        row "{s[error_l2_relative]:.3e}" "${pair%:*}" "${pair#*:}"
    done
}

# DEGREE:ELEMENTS:ELEMENTS along (x, vx), and along y; one element along vy.
plane() {
    echo "| degree | elements along x and vx, y | relative L2 of f | density |"
    echo "|---|---|---|---|"
    local along degree falling streaming beam=(
        --set solver.method=classical --set scheme.flux=1 --set time.end=0.9
        --set 'potential=[{where="x < 0", value="0.2"}, {value="0"}]'
        --set 'initial.f=exp(-((x + 0.85)^2 + (vx - 0.9)^2)/0.06)*(1 + 0.5*sin(pi*y + x))'
        --set axis.0.x.lower=-1.6 --set axis.0.x.upper=1.6
        --set axis.0.v.lower=-1.8 --set axis.0.v.upper=1.8
        --set axis.1.x.boundary=periodic
        --set 'axis.1.v={lower=0.6, upper=0.7, cells=1}')
    for along in 1:40:8 1:60:12 1:80:16 2:16:4 2:24:6 2:36:8 3:16:6 3:24:8 3:36:10; do
        IFS=: read -r degree falling streaming <<<"$along"
        run quadrant2d "$degree" "$falling" "${beam[@]}" --set "axis.1.x.cells=$streaming"
        row "{s[error_l2_relative]:.2e} | {s[error_density_l2_relative]:.2e}" \
            "$degree" "$falling, $streaming"
    done
}

example1() {
    echo "| degree | elements | relative L1 of f | density | modes | applications | seconds |"
    echo "|---|---|---|---|---|---|---|"
    local figures="{s[error_l1_relative]:.3f} | {s[error_density_l1_relative]:.4f} | "
    figures+="{s[modes]} | {s[matvecs]} | {s[solve_seconds]:.2f}"
    for pair in 0:256 1:128 2:86 3:64; do
        run example1 "${pair%:*}" "${pair#*:}"
        row "$figures" "${pair%:*}" "${pair#*:}"
    done
}

# against CASE ERROR DEGREE:ELEMENTS…: van Leer's slopes on three grids, then modes.
against() {
    local case=$1 norm=$2 cells pair
    local figures="{s[$norm]:.2e} | {s[matvecs]} | {s[solve_seconds]:.2f}"
    shift 2
    for cells in 128 256 512; do
        run "$case" 0 "$cells" --set solver.method=classical \
            --set solver.classical.integrator=ssp-rk3 --set scheme.limiter=van-leer
        row "$figures" "$case" "van Leer, SSP-RK3" "$cells cells"
    done
    for pair in "$@"; do
        run "$case" "${pair%:*}" "${pair#*:}"
        row "$figures" "$case" "modes, degree ${pair%:*}" "${pair#*:} elements"
    done
}

limited() {
    echo "| case | method | an axis | relative error | applications | seconds |"
    echo "|---|---|---|---|---|---|"
    against smooth-beams error_l2_relative 4:18 4:26 4:38 6:14 6:18 6:26
    against example1 error_l1_relative 2:42 2:86 3:32 3:64 3:128
}

unitary() {
    echo "| case | cells | scheme | L2 of f | L2 of the density | L1 of the density | modes |"
    echo "|---|---|---|---|---|---|---|"
    local figures="{s[error_l2_relative]:.3g} | {s[error_density_l2_relative]:.3g} | "
    figures+="{s[error_density_l1_relative]:.3g} | {s[modes]}"
    local gaussian=(--set "initial.f=exp(-((x + 0.5)^2 + (v - 0.6)^2)/0.02)")
    local central=(--set scheme.flux=0 --set scheme.ends=closed)
    local upwind=(--set scheme.interface=conservative) cells
    for cells in 64 128 256; do
        run smooth-beams 0 "$cells" "${gaussian[@]}" "${central[@]}"
        row "$figures" Gaussian "$cells" unitary
        run smooth-beams 0 "$cells" "${gaussian[@]}" "${upwind[@]}"
        row "$figures" Gaussian "$cells" upwind
    done
    run example1 0 128 "${central[@]}"
    row "$figures" "example 1" 128 unitary
    run example1 0 128 "${upwind[@]}"
    row "$figures" "example 1" 128 upwind
}

for table in "$@"; do
    case $table in
    smooth | order | plane | example1 | limited | unitary | steps) "$table" && echo ;;
    *)
        echo "high_order: no table $table; see the first lines of $0" >&2
        exit 2
        ;;
    esac
done
