#!/usr/bin/env bash
# Runs a table of cases on 1 and 3 ranks and says where results differ from those of a reference.
#
#   scripts/baseline.sh --record DIR  [--program PATH] [--only REGEX]
#   scripts/baseline.sh --compare DIR [--program PATH] [--only REGEX] [--words]
#
# Record the reference in a directory outside of the repository with the program of an older
# commit, then compare today's (target/release/phasewarp) with it. Both use the table below: record
# a case that is added to it with the old program too (--only: other records stay as they are).
#
# Compared are the bits and the storage of every dataset, every attribute, every field of JSON and
# CSV files, the other files of a run, exit codes, and the numbers in texts (--words: the texts
# themselves). Of seconds, measured memory, versions and pictures only the presence counts. Of a
# chart the trials that both have are compared, since the clock decides how many there are.
#
# One line a difference: case, ranks, place, old -> new; at most twelve a run. Then, in the same
# way, differences between 1 and 3 ranks that the reference lacks. The new records stay in
# target/baseline. Exit code 0: nothing differs; 1: something does; 2: the command is wrong.
#
# Takes two minutes of processor time. JOBS (2): how many runs at a time. Needs a python3 (3.11)
# with h5py: that of $PYTHON, of the path, or of `make readers`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Name; on how many ranks (13: on 1 and on 3); subcommand; case file, or @NAME for the results of an
# earlier line; settings. A setting that begins with - is an option, any other goes to --set.
# grid=16x12,… are the cells in x and v of each axis; `solver.` may be left out. A line that begins
# with a space continues the one before it.
table() {
    sed ':a; N; $!ba; s/\n  */ /g' <<'TABLE'
# cases as they are, and those of minutes on coarser grids
example1            13 run       example1
example2            13 run       example2       grid=64x64
example3            13 run       example3       tolerance=1e-4
step_up             13 run       step_up
well                13 run       well           grid=48x40
slope_jump          13 run       slope_jump
inflow_barrier      13 run       inflow_barrier
barriers            13 run       barriers       grid=60x40
harmonic_step       13 run       harmonic_step  grid=48x42
pulsed_inflow       13 run       pulsed_inflow  grid=20x28
barrier2d           13 run       barrier2d
quantum_dot2d       13 run       quantum_dot2d  grid=12x8,12x7
lens2d              13 run       lens2d         grid=18x8,12x6 tolerance=1e-4
periodic2d          13 run       periodic2d
step3d              13 run       step3d
step_slope3d        13 run       step_slope3d   grid=6x6,6x6,6x6
partial_reflection  13 run       partial_reflection
quadrant2d          13 run       quadrant2d     tolerance=1e-3
smooth-beams        13 run       smooth-beams
smooth_step3d       13 run       smooth_step3d  tolerance=1e-2
unitary_advection   13 run       unitary_advection
paper1              13 run       paper/example1 grid=32x32 warp.points=512
paper2              13 run       paper/example2 grid=16x16 warp.points=512
paper3              13 run       paper/example3 grid=4x4,4x4 warp.points=512
# tolerance, verified
verify-1e-3         13 run       example1       grid=64x64 tolerance=1e-3 verify=true
verify-1e-9         13 run       example1       grid=32x32 tolerance=1e-9 verify=true
verify-1e-11        13 run       slope_jump     grid=48x40 tolerance=1e-11 verify=true
verify-inflow       13 run       inflow_barrier grid=32x28 verify=true
verify-pulse        13 run       pulsed_inflow  grid=20x28 tolerance=1e-3 verify=true
# interface and weights
conservative        13 run       example1       scheme.interface=conservative
conservative-well   13 run       well           grid=48x40 scheme.interface=conservative
conservative-2d     13 run       barrier2d      scheme.interface=conservative
conservative-inflow 13 run       inflow_barrier grid=32x28 scheme.interface=conservative
conservative-level  13 run       example2       grid=32x32 scheme.interface=conservative
no-weights          13 run       example1       grid=32x32 warp.weights=none
reflection          13 run       partial_reflection grid=24x20
# elements, flux, ends
degree-1            13 run       example1       grid=16x16 scheme.degree=1
degree-3            13 run       slope_jump     grid=12x10 scheme.degree=3 tolerance=1e-4
degree-2-2d         13 run       barrier2d      grid=3x4,3x4 scheme.degree=2 tolerance=1e-3
degree-inflow       13 run       inflow_barrier grid=8x8 scheme.degree=2 scheme.flux=1
degree-classical    13 run       example1       grid=16x16 scheme.degree=2 method=classical
flux                13 run       example1       grid=16x16 scheme.degree=2 scheme.flux=0.25
flux-0              13 run       smooth-beams   grid=16x16 scheme.degree=0 scheme.flux=0
ends-closed         13 run       smooth-beams   grid=8x8 scheme.ends=closed tolerance=1e-3
# profile
designed            13 run       step_up        grid=48x40 warp.profile=designed
gaussian            13 run       step_up        grid=48x40 warp.profile=gaussian
gaussian-sampled    13 run       step_up        grid=48x40 warp.profile=gaussian
                                                warp.coefficients=sampled
exponential         13 run       step_up        grid=24x20 warp.profile=exponential tolerance=1e-2
exponential-alpha   13 run       step_up        grid=24x20 warp.profile=exponential warp.alpha=2
                                                tolerance=1e-2
exponential-sampled 13 run       step_up        grid=24x20 warp.profile=exponential
                                                warp.coefficients=sampled tolerance=1e-2
smooth              13 run       step_up        grid=48x40 warp.profile=smooth tolerance=1e-4
smooth-order        13 run       step_up        grid=48x40 warp.profile=smooth warp.order=2
                                                tolerance=1e-3
low-somma           13 run       step_up        grid=48x40 warp.profile=low-somma
low-somma-c         13 run       step_up        grid=48x40 warp.profile=low-somma warp.c=1
                                                tolerance=1e-3
acl                 13 run       step_up        grid=24x20 warp.profile=acl tolerance=1e-3
acl-beta            13 run       step_up        grid=24x20 warp.profile=acl warp.beta=0.6
                                                tolerance=1e-2
by-hand             13 run       step_up        grid=24x20 warp.profile=gaussian
                                                warp.interval=[-60,20] warp.points=512
                                                warp.recovery=2 tolerance=1e-4
# recovery
integral            13 run       example1       grid=32x32 warp.recovery_method=integral
least-squares       13 run       example1       grid=32x32 warp.recovery_method=least-squares
one-point           13 run       example1       grid=32x32 output.recovery_points=1
plateau             13 run       example1       grid=32x32 output.plateau={from=0,to=2,points=5}
plateau-level       13 run       example2       grid=32x32 output.plateau={from=0,to=1,points=3}
                                                warp.profile=gaussian
# inflow: embedding, delta, shift
embed-boundary      13 run       inflow_barrier grid=32x28 warp.inflow=boundary warp.delta=2
embed-full          13 run       inflow_barrier grid=32x28 warp.inflow=full
embed-full-max      13 run       inflow_barrier grid=32x28 warp.inflow=full warp.delta="max"
embed-scalar        13 run       inflow_barrier grid=32x28 warp.inflow=scalar
embed-scalar-pulse  13 run       pulsed_inflow  grid=20x14 warp.inflow=scalar tolerance=1e-3
embed-full-pulse    13 run       pulsed_inflow  grid=20x14 warp.inflow=full tolerance=1e-3
embed-level         13 run       example2       grid=32x32 warp.inflow=full tolerance=1e-4
inflow-initial      13 run       example1       grid=32x32 inflow.value="initial"
                                                initial.f=exp(-x^2-v^2)
shift               13 run       example1       grid=32x32 warp.shift=0.5
shift-growth        13 run       example1       grid=32x32 warp.shift="growth" warp.weights=none
# propagator
krylov              13 run       example1       grid=32x32 propagator.method=krylov
krylov-step         13 run       inflow_barrier grid=16x14 propagator.method=krylov
                                                propagator.step=0.5
crank-nicolson      13 run       example1       grid=32x32 propagator.method=crank-nicolson
                                                propagator.step=0.02 tolerance=1e-3
crank-nicolson-2d   13 run       barrier2d      grid=6x9,5x11 propagator.method=crank-nicolson
                                                propagator.step=0.1 tolerance=1e-2
crank-nicolson-in   13 run       inflow_barrier grid=16x14 propagator.method=crank-nicolson
                                                propagator.step=0.05 tolerance=1e-2
backward-euler      13 run       example1       grid=16x16 propagator.method=backward-euler
                                                propagator.step=0.01 tolerance=1e-1
# what is left out
reduce-none         13 run       periodic2d     grid=12x14,5x9 reduce=false
reduce-no-axes      13 run       periodic2d     grid=12x14,5x9 reduce={axes=false}
reduce-no-velocity  13 run       example1       grid=32x32 reduce={velocities=false}
reduce-no-inflow    13 run       example1       grid=32x32 reduce={inflow=false}
reduce-no-modes     13 run       example1       grid=32x32 reduce={modes=false}
expand              13 run       periodic2d     output.expand=true
# classical
exponential-exact   13 run       example1       method=classical
exponential-inflow  13 run       inflow_barrier method=classical
exponential-pulse   13 run       pulsed_inflow  method=classical
exponential-level   13 run       example2       grid=64x64 method=classical
exponential-3d      13 run       step3d         method=classical
forward-euler       13 run       example1       method=classical classical.integrator=forward-euler
forward-euler-cfl   13 run       harmonic_step  method=classical classical.integrator=forward-euler
                                                classical.cfl=0.5
forward-euler-pulse 13 run       pulsed_inflow  method=classical classical.integrator=forward-euler
ssp-rk3             13 run       barrier2d      method=classical classical.integrator=ssp-rk3
ssp-rk3-times       13 run       example1       grid=32x32 method=classical
                                                classical.integrator=ssp-rk3
                                                output.field_times=[0.25,0.5]
minmod              13 run       example1       grid=64x64 method=classical
                                                classical.integrator=ssp-rk3 scheme.limiter=minmod
minmod-euler        13 run       slope_jump     grid=48x40 method=classical
                                                classical.integrator=forward-euler
                                                scheme.limiter=minmod
van-leer            13 run       quantum_dot2d  grid=12x8,12x7 method=classical
                                                classical.integrator=ssp-rk3 scheme.limiter=van-leer
van-leer-level      13 run       example2       grid=64x64 method=classical
                                                classical.integrator=ssp-rk3 scheme.limiter=van-leer
limiter-conserving  13 run       well           grid=48x40 method=classical
                                                classical.integrator=ssp-rk3 scheme.limiter=van-leer
                                                scheme.interface=conservative
# output times, storage, process meshes
moments             13 run       example1       grid=32x32 output.moments_every=0.25
                                                output.moment_times=[0.1]
fields              13 run       inflow_barrier grid=32x28 output.field_times=[0.5,1.5]
                                                output.moment_times=[1]
fields-level        13 run       example2       grid=32x32 output.field_times=[0.9] tolerance=1e-4
fields-implicit     13 run       example1       grid=16x16 output.field_times=[0.5]
                                                propagator.method=crank-nicolson
                                                propagator.step=0.05 tolerance=1e-2
delta-gradient      13 run       example3       output.delta_width=gradient tolerance=1e-3
compressed          13 run       example1       grid=32x32 output.compression=1 output.chunks=[8,16]
                                                output.xdmf=false
exact-formula       13 run       example1       grid=32x32 exact={f="exp(-x^2-(v-t)^2)"}
resume              13 run       example1       grid=32x32 --resume
ranks-x              3 run       barrier2d      --ranks-x=3,1
mode-groups          3 run       barrier2d      --ranks-x=1,1
checkpoints         13 run       example1       grid=32x32 checkpoint.minutes=0.00001
# all modes kept
full                13 run       example1       grid=32x32 --mode=full
full-inflow         13 run       inflow_barrier grid=16x14 --mode=full tolerance=1e-3
full-level          13 run       example2       grid=16x16 --mode=full tolerance=1e-3
full-points         13 run       step_up        grid=24x20 --mode=full warp.profile=smooth
                                                warp.coefficients=sampled tolerance=1e-2
full-times          13 run       example1       grid=16x16 --mode=full output.field_times=[0.5]
                                                tolerance=1e-3
full-implicit       13 run       example1       grid=16x16 --mode=full
                                                propagator.method=crank-nicolson
                                                propagator.step=0.05 tolerance=1e-2
from-full           13 run       example1       grid=32x32 initial={warped="@full/warped_f.h5"}
                                                exact={} output.warped_field=true
# quantum side
readout             13 run       example1       grid=32x32
                                                readout={points=[[-0.5],[0.5]],accuracy=0.05,seed=1}
                                                warp.profile=low-somma tolerance=1e-3
readout-shots       13 run       barrier2d      grid=6x9,5x11
                                                readout={cells=[[2,3]],shots=1000,evaluations=64}
                                                tolerance=1e-3
readout-inflow      13 run       inflow_barrier grid=16x14 readout={cells=[[3],[8]]} tolerance=1e-3
readout-unavailable 13 run       example2       grid=16x16 readout={cells=[[3]]} tolerance=1e-3
resources            1 resources example1       --format=json
resources-text       1 resources example1
resources-azure      1 resources example1       --format=azure
resources-qref       1 resources example1       --format=qref
resources-optimise   1 resources example1       grid=32x32 --optimise tolerance=1e-3
resources-inflow     1 resources inflow_barrier --format=json
resources-2d         1 resources barrier2d      --format=json
resources-level      1 resources example2       --format=json
resources-paper      1 resources paper/example1 grid=32x32 --format=json
export               1 export-quantum example1       grid=8x8 tolerance=1e-2
resources-accuracy   1 resources example1       grid=16x16 --accuracy=1e-1 --format=json
export-circuit       1 export-circuit example1       grid=8x8 scheme.interface=conservative
                                                tolerance=1e-2 --sub-bins=9
export-matrix       13 export-matrix  slope_jump     grid=9x8
export-inflow        1 export-quantum inflow_barrier grid=4x4 tolerance=1e-1 warp.inflow=scalar
# plan, check
plan-example1        1 plan      example1       --json --memory-per-rank=4GiB
plan-example1-text   1 plan      example1       --memory-per-rank=4GiB
plan-example2        1 plan      example2       --json --memory-per-rank=4GiB --ranks=3
plan-example3        1 plan      example3       --json --memory-per-rank=4GiB --ranks=12
                                                --ranks-x=2,2
plan-inflow          1 plan      inflow_barrier --json --memory-per-rank=4GiB --ranks=4
plan-pulse           1 plan      pulsed_inflow  --json --memory-per-rank=4GiB --ranks=4
plan-lens            1 plan      lens2d         --json --memory-per-node=64GiB --ranks=32
                                                --ranks-per-node=16
plan-large           1 plan      step_slope3d   grid=8x8,8x8,8x8 --json --memory-per-node=64GiB
                                                --ranks=64 --ranks-per-node=16
plan-full            1 plan      example1       --json --memory-per-rank=4GiB --mode=full --ranks=8
plan-classical       1 plan      well           --json --memory-per-rank=4GiB method=classical
plan-implicit        1 plan      paper/example3 --json --memory-per-rank=4GiB --ranks=16
plan-paper2          1 plan      paper/example2 --json --memory-per-rank=4GiB --ranks=16
check-example1       1 check     example1
check-example2       1 check     example2
check-periodic       1 check     periodic2d
check-inflow         1 check     inflow_barrier
check-pulse          1 check     pulsed_inflow
check-well           1 check     well
check-dot            1 check     quantum_dot2d
check-paper          1 check     paper/example3
check-moved          1 check     slope_jump     grid=33x20
# studies
spectrum             1 spectrum  example1       grid=32x32 --json
spectrum-refined     1 spectrum  step_up        grid=12x10 --refine=1,2 --json
spectrum-inflow      1 spectrum  inflow_barrier grid=16x14 --json
spectrum-full        1 spectrum  inflow_barrier grid=16x14 --json warp.inflow=full warp.delta="max"
spectrum-2d          1 spectrum  barrier2d      grid=6x9,5x11
stability           13 stability example1       grid=16x16 --only=cfl --budget=1h
stability-growth     1 stability example1       grid=8x8 --only=growth,interval,grazing --budget=1h
stability-recovery   1 stability example1       grid=16x16 --only=recovery --budget=1h
stability-step       1 stability example1       grid=8x8 --only=step --budget=1h
stability-delta      1 stability inflow_barrier grid=8x8 --only=delta,growth --budget=1h
advise              13 advise    example1       grid=32x32 --accuracy=0.2 --json --budget=1h
advise-well          1 advise    well           grid=24x20 --accuracy=0.5 --json --budget=1h
advise-inflow        1 advise    inflow_barrier grid=8x5 --accuracy=0.5 --json --budget=1h
advise-level         1 advise    example2       grid=32x32 --accuracy=0.5 --json --budget=1h
sweep               13 sweep     example1       --vary=axis.0.x.cells=16,24 tolerance=1e-3
chart                1 chart     example1       grid=8x8 time.end=0.2 --budget=10s
# finished runs; pictures are looked for, not at
plot                 1 plot      @example1
plot-times           1 plot      @fields
movie                1 movie     @fields
plot-2d              1 plot      @barrier2d     --slice=y=0.1,vy=0
report               1 report    @example2
check-result        13 check-result @full
# refused
refused-key          1 run       example1       solver.tolerence=1e-3
refused-value        1 run       example1       time.end=-1
refused-tolerance    1 run       example1       tolerance=1e-16
refused-limiter     13 run       example1       scheme.limiter=minmod
refused-interval     1 run       paper/example1 tolerance=1e-4
refused-ranks        3 run       example1       --ranks-x=2
TABLE
}

die() {
    echo "baseline: $*" >&2
    exit 2
}

task="" reference="" only="" texts="" program=target/release/phasewarp
while [ $# -gt 0 ]; do
    case $1 in
    --record | --compare | --program | --only) [ $# -gt 1 ] || die "$1 takes a value" ;;&
    --record | --compare) task=${1#--} && reference=$2 && shift 2 ;;
    --program) program=$2 && shift 2 ;;
    --only) only=$2 && shift 2 ;;
    --words) texts=--words && shift ;;
    *) die "unknown option $1; known: --record, --compare, --program, --only, --words" ;;
    esac
done
[ -n "$task" ] || die "--record DIR or --compare DIR?"
[ "$task" = record ] || [ -d "$reference" ] || die "no reference in $reference"
[ -x "$program" ] || die "no program $program"
program=$(realpath "$program")

target=${CARGO_TARGET_DIR:-target}
python=""
for candidate in "${PYTHON:-}" python3 "$target/readers/bin/python"; do
    if [ -n "$candidate" ] && "$candidate" -c 'import h5py, tomllib' 2>/dev/null; then
        python=$candidate
        break
    fi
done
if [ -z "$python" ]; then
    scripts/setup.sh --readers || die "no python3 with h5py"
    python=$target/readers/bin/python
fi

# Open MPI as root and with more ranks than cores, as in the Makefile.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
export OMPI_MCA_rmaps_base_oversubscribe=1 OMPI_MCA_mpi_yield_when_idle=1
export PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe

results=$(mktemp -d)
trap 'rm -rf "$results"' EXIT

# The lines of the table that --only names, and those whose results they need.
selected() {
    table | awk -v only="$only" '
        !/^#/ { line[++n] = $0; place[$1] = n; if (only == "" || $1 ~ only) wanted[n] = 1 }
        END {
            for (i = n; i > 0; i--)
                if (wanted[i] && match(line[i], /@[a-z0-9-]+/))
                    wanted[place[substr(line[i], RSTART + 1, RLENGTH - 1)]] = 1
            for (i = 1; i <= n; i++) if (wanted[i]) print line[i]
        }'
}

# start NAME RANKS COMMAND CASE SETTING…: one run; its files, `stdout`, `stderr`, `exit` go to
# $results/NAME.RANKS.
start() {
    local name=$1 ranks=$2 command=$3 case=$4 setting words=() launch=() code=0
    local place=$results/$name.$ranks
    shift 4
    mkdir -p "$place"
    [ "$ranks" -eq 1 ] || launch=(mpirun -np "$ranks")
    case $case in
    @*) case=$results/${case#@}.$ranks ;;
    *) case=cases/$case.toml ;;
    esac
    for setting in "$@"; do
        case $setting in
        -*) words+=("$setting") ;;
        grid=*) add_grid "${setting#grid=}" ;;
        warp.* | propagator.* | classical.* | method=* | tolerance=* | verify=* | reduce=*)
            words+=(--set "solver.$setting")
            ;;
        *) words+=(--set "${setting//@full/$results/full.$ranks}") ;;
        esac
    done
    case $command in
    run | sweep | export-* | stability | chart | plot | movie | report) words+=(-o "$place") ;;
    esac
    timeout 120 "${launch[@]}" "$program" "$command" "$case" "${words[@]}" \
        >"$place/stdout" 2>"$place/stderr" </dev/null || code=$?
    echo "$code" >"$place/exit"
}

# add_grid 16x12,…: the cells of each axis, to `words` of the caller.
add_grid() {
    local axis=0 cells
    for cells in ${1//,/ }; do
        words+=(--set "axis.$axis.x.cells=${cells%x*}" --set "axis.$axis.v.cells=${cells#*x}")
        axis=$((axis + 1))
    done
}

set -f # settings are words, but no patterns
while read -r name ranks command case settings; do
    # Results of an earlier line are needed.
    if [[ "$case $settings" = *@* ]]; then wait; fi
    for ((i = 0; i < ${#ranks}; i++)); do
        while [ "$(jobs -rp | wc -l)" -ge "${JOBS:-2}" ]; do wait -n || true; done
        # shellcheck disable=SC2086
        start "$name" "${ranks:i:1}" "$command" "$case" $settings &
    done
done < <(selected)
wait
echo "baseline: $(find "$results" -mindepth 1 -maxdepth 1 | wc -l) runs in $SECONDS s" >&2

# A line that does not work shows nothing.
broken=0
set +f
for place in "$results"/*; do
    case ${place##*/} in refused-*) continue ;; esac
    [ "$(<"$place/exit")" = 0 ] || {
        echo "baseline: ${place##*/} ends with $(<"$place/exit"): $(tail -n 1 "$place/stderr")" >&2
        broken=1
    }
done
[ "$task" = compare ] || [ "$broken" = 0 ] || die "nothing recorded"

if [ "$task" = record ]; then
    "$python" scripts/baseline.py record "$results" "$reference"
else
    rm -rf "$target/baseline"
    "$python" scripts/baseline.py record "$results" "$target/baseline"
    "$python" scripts/baseline.py compare "$reference" "$target/baseline" ${only:+--some} $texts
fi
