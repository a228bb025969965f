#!/usr/bin/env bash
# The job scripts on a real Slurm, started here on one node and stopped again: a run is stopped by a
# signal, submits itself again, finishes, and has the same bits as one that was not stopped. Takes
# about three minutes, most of it in the runs.
#
#   tests/slurm.sh
#
# Where Slurm is missing it is installed (Debian, as root, in a minute at most); else the test is
# skipped with a message.
#
# Exit code 0: passed or skipped; with PHASEWARP_SLURM=required only if passed. PHASEWARP names
# another program than target/release/phasewarp.
set -Eeuo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

say() { echo "slurm: $*"; }
failure=
fail() {
    failure="FAILED: $*"
    say "$failure"
    exit 1
}
skip() {
    say "skipped: $*"
    if [ "${PHASEWARP_SLURM:-}" = required ]; then
        exit 1
    fi
    exit 0
}

# --- what the scripts work out by themselves ---

# shellcheck source=jobscripts/env.sh
source jobscripts/env.sh
# shellcheck source=jobscripts/steps.sh
source jobscripts/steps.sh

is() {
    if [ "$2" != "$3" ]; then
        fail "$1: \"$2\", \"$3\" expected"
    fi
}
is "seconds of 29:58" "$(seconds_of 29:58)" 1798
is "seconds of 1:30:00" "$(seconds_of 1:30:00)" 5400
is "seconds of 2-01:00:08" "$(seconds_of 2-01:00:08)" 176408
is "seconds of UNLIMITED" "$(seconds_of UNLIMITED)" ""
# shellcheck disable=SC2034  # read by may_go_on
most_jobs=3
goes_on() { if may_go_on "$@" >/dev/null; then echo yes; else echo no; fi; }
is "something finished" "$(goes_on 1 "stage 0 finished 8 " "stage 0 finished 16 ")" yes
is "a first checkpoint" "$(goes_on 1 "" "stage 0 finished 16 ")" yes
is "nothing finished" "$(goes_on 1 "stage 0 finished 8 " "stage 0 finished 8 ")" no
is "no checkpoint" "$(goes_on 1 "" "")" no
is "too many jobs" "$(goes_on 3 "" "stage 0 finished 16 ")" no

# Settings come through as they are written: commas, blanks, stars, quotes; a last line without its
# end.
file=$(mktemp)
printf '%s\n' '# finer' '' "output.field_times=[0.1, 0.2]" "exact={f='x * v'}" >"$file"
printf 'solver.tolerance=1e-9' >>"$file"
read_settings "$file"
rm "$file"
# shellcheck disable=SC2154  # settings: read_settings
is "settings" "$(printf '<%s>' "${settings[@]}")" \
    "<--set><output.field_times=[0.1, 0.2]><--set><exact={f='x * v'}><--set><solver.tolerance=1e-9>"
# Of the options of a run, `check` gets those of the case, and `plan` all.
is "check and plan" "$(program=say LAUNCH=echo memory_per_node="" &&
    show_plan 4 c.toml --mode full --force --ranks-x 2,1 --set a=1 --ranks-x=2 | tr '\n' ';')" \
    "1 say check c.toml --mode full --set a=1;$(
    )1 say plan c.toml --ranks 4 --mode full --ranks-x 2,1 --set a=1 --ranks-x=2;"

# --- is everything there ---

program=$(realpath "${PHASEWARP:-${CARGO_TARGET_DIR:-target}/release/phasewarp}")
[ -x "$program" ] || fail "$program is not there: make build"
have() { command -v slurmctld slurmd munged h5diff | [ "$(wc -l)" -eq 4 ]; }
if ! have; then
    { [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; } ||
        skip "no Slurm here, and it cannot be installed"
    say "installing slurm-wlm, munge and hdf5-tools"
    timeout 60 apt-get -qq -o DPkg::Lock::Timeout=30 install -y --no-install-recommends \
        slurm-wlm munge hdf5-tools </dev/null >/dev/null 2>&1 || true
    have || skip "slurm-wlm, munge and hdf5-tools could not be installed within a minute"
fi

# --- Slurm on one node ---

place=$(mktemp -d)
user=$(id -un) host=$(hostname -s)
port=$((20000 + 2 * ($$ % 10000)))
stop() {
    local code=$? file
    if [ -e "$place/up" ]; then
        scancel --user="$user" >/dev/null 2>&1 || true
    fi
    for file in slurmd slurmctld munged; do
        if [ -s "$place/$file.pid" ]; then
            kill "$(cat "$place/$file.pid")" 2>/dev/null || true
        fi
    done
    if [ "$code" -ne 0 ]; then
        tail -n 20 "$place"/*.log "$place"/work/*.log 2>/dev/null || true
        # Again, where the end of a long log shows it.
        say "${failure:-FAILED at: $failed_command}"
    fi
    sleep 1
    rm -rf "$place"
}
trap stop EXIT
failed_command=unknown
trap 'failed_command="line $LINENO: $BASH_COMMAND"' ERR

mkdir -p "$place"/{munge,state,spool,work}
chmod 755 "$place"
chmod 700 "$place/munge"
dd if=/dev/urandom of="$place/munge/key" bs=1 count=1024 status=none
chmod 400 "$place/munge/key"
last_line() { tail -n 1 "$place/start.log"; }
munged --force --key-file="$place/munge/key" --socket="$place/munge.socket" \
    --pid-file="$place/munged.pid" --log-file="$place/munged.log" \
    --seed-file="$place/munge/seed" >"$place/start.log" 2>&1 ||
    skip "munged does not start: $(last_line)"
cores=$(nproc)
cat >"$place/slurm.conf" <<CONF
ClusterName=phasewarp
SlurmctldHost=$host(127.0.0.1)
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
AuthInfo=socket=$place/munge.socket
CryptoType=crypto/munge
SlurmctldPort=$port
SlurmdPort=$((port + 1))
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
SlurmctldLogFile=$place/slurmctld.log
SlurmdLogFile=$place/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=pmix
JobAcctGatherType=jobacct_gather/linux
JobCompType=jobcomp/filetxt
JobCompLoc=$place/completed
AccountingStorageType=accounting_storage/none
ReturnToService=2
KillWait=5
SwitchType=switch/none
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores Sockets=1 CoresPerSocket=$cores ThreadsPerCore=1 \
    RealMemory=4000 State=UNKNOWN
PartitionName=debug Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
touch "$place/completed"
export SLURM_CONF=$place/slurm.conf
slurmctld -c >>"$place/start.log" 2>&1 || skip "slurmctld does not start: $(last_line)"
slurmd -c >>"$place/start.log" 2>&1 || skip "slurmd does not start: $(last_line)"
touch "$place/up"
for ((tries = 0; tries < 60; tries++)); do
    if [ "$(sinfo --noheader --format %T 2>/dev/null)" = idle ]; then
        break
    fi
    sleep 0.5
done
[ "$(sinfo --noheader --format %T 2>/dev/null)" = idle ] ||
    skip "Slurm is not ready after 30 s: $(sinfo --noheader 2>&1)"
say "Slurm $(sinfo --version | cut -d' ' -f2) is up after $SECONDS s"

# --- jobs ---

# Submitted from a folder like the top one, into which logs and results go.
top=$PWD
cd "$place/work"
ln -s "$top/jobscripts" "$top/cases" .
export PHASEWARP=$program
ranks=$((cores < 2 ? cores : 2))

# submit OPTIONS… : the job's number.
submit() { sbatch --parsable --ntasks="$ranks" --mem-per-cpu=1000 "$@"; }
# about JOB KEY: what scontrol says.
about() { scontrol show job --oneliner "$1" | sed -n "s/.* $2=\([^ ]*\).*/\1/p"; }
# finish JOB SECONDS: waits for its end.
finish() {
    local until=$((SECONDS + $2))
    while [ "$SECONDS" -lt "$until" ]; do
        case $(about "$1" JobState) in
        PENDING | RUNNING | COMPLETING | CONFIGURING) sleep 0.5 ;;
        *) return 0 ;;
        esac
    done
    fail "job $1 is $(about "$1" JobState) after $2 s"
}
ended() {
    local state
    state="$(about "$1" JobState) $(about "$1" ExitCode)"
    is "job $1" "$state" "$2"
}

# Timings decide nothing here: a run is stopped as soon as it says that it is at work, and the one
# that waits for Slurm's own signal takes 400 s by the plan; the signal comes after 15 to 45 s.
case=cases/example1.toml
settings=(--set solver.warp.profile=exponential --set solver.tolerance=1e-2)
seconds_of_1024=$(srun -n "$ranks" "$program" plan "$case" --calibrate --json "${settings[@]}" \
    --set solver.warp.points=1024 2>"$place/calibrate.log" |
    sed -n 's/^ *"solve_seconds": \([0-9.e-]*\),*$/\1/p')
[ -n "$seconds_of_1024" ] || fail "no calibration: $(cat "$place/calibrate.log")"
# points_for SECONDS: N_p of a run of that length. Seconds grow with the square of N_p.
points_for() {
    awk -v seconds="$1" -v of_1024="$seconds_of_1024" \
        'BEGIN { print 2 * int(512 * sqrt(seconds / of_1024)) }'
}
long=("${settings[@]}" --set "solver.warp.points=$(points_for 400)")
settings+=(--set "solver.warp.points=$(points_for 25)")
say "1024 points take $seconds_of_1024 s; N_p = $(points_for 25) and $(points_for 400)"

# running JOB LOG: waits until the job's run has said how far it is.
running() {
    local until=$((SECONDS + 120))
    until grep -q "^modes .* to go" "$2" 2>/dev/null; do
        [ "$SECONDS" -lt "$until" ] || fail "job $1 does not say how far it is"
        case $(about "$1" JobState) in
        PENDING | RUNNING | CONFIGURING) sleep 0.2 ;;
        *) fail "job $1 is $(about "$1" JobState) before it was stopped" ;;
        esac
    done
}

started=$SECONDS
whole=$(submit --time=20 --job-name=whole jobscripts/run.sbatch "$case" results/whole \
    "${settings[@]}")
finish "$whole" 600
ended "$whole" "COMPLETED 0:0"
solve_seconds=$(number results/whole/summary.json solve_seconds)
say "a whole run: $solve_seconds s to solve, job $((SECONDS - started)) s"

# Stopped by hand, submitted again by the script itself, finished: the same bits.
started=$SECONDS
first=$(submit --time=20 --job-name=stopped jobscripts/run.sbatch "$case" results/stopped \
    "${settings[@]}")
running "$first" "stopped-$first.log"
scancel --batch --signal=USR1 "$first"
finish "$first" 60
ended "$first" "FAILED 75:0"
grep -q "stop signal: USR1" "stopped-$first.log" || fail "job $first did not get the signal"
[ ! -e results/stopped/result.h5 ] || fail "job $first has results"
job=$(sed -n 's/^Submitted batch job //p' "stopped-$first.log")
[ -n "$job" ] || fail "job $first did not submit another"
finish "$job" 600
ended "$job" "COMPLETED 0:0"
say "in two jobs: $((SECONDS - started)) s"
is "time limit of job $job" "$(about "$job" TimeLimit)" 00:20:00
is "tasks of job $job" "$(about "$job" NumTasks)" "$ranks"
for dataset in /f /density /momentum /velocity; do
    h5diff results/whole/result.h5 results/stopped/result.h5 "$dataset" || fail "$dataset differs"
done
is "applications" "$(number results/stopped/summary.json matvecs)" \
    "$(number results/whole/summary.json matvecs)"
[ ! -e results/stopped/checkpoint ] || fail "checkpoints were left"
say "the same bits, nothing computed twice"
scontrol show job "$job" | grep -E "JobId|JobState|RunTime|Command"
sacct --completion --format=jobid,jobname,state 2>/dev/null || true

# Stopped by Slurm before the time limit. Slurm looks every 30 s, so the signal comes 15 to 45 s
# after the start. The environment wins over the script's own lines.
started=$SECONDS
signalled=$(SBATCH_SIGNAL=B:USR1@15 submit --time=1 --job-name=signalled jobscripts/run.sbatch \
    "$case" results/signalled "${long[@]}")
finish "$signalled" 120
ended "$signalled" "FAILED 75:0"
grep -q "stop signal: USR1" "signalled-$signalled.log" ||
    fail "job $signalled did not get the signal"
job=$(sed -n 's/^Submitted batch job //p' "signalled-$signalled.log")
[ -n "$job" ] || fail "job $signalled did not submit another"
scancel "$job"
finish "$job" 60
say "stopped by Slurm after $((SECONDS - started)) s"

# Scaling: a table with a line for each number of ranks.
for script in strong weak; do
    job=$(submit --time=5 "jobscripts/${script}_scaling.sbatch" cases/example1.toml \
        "results/$script" --set axis.0.v.cells=32)
    finish "$job" 120
    ended "$job" "COMPLETED 0:0"
    is "lines of $script.csv" "$(wc -l <"results/$script/$script.csv")" $((ranks + 1))
    if tail -n +2 "results/$script/$script.csv" | grep -qE ',,|,$|nan|inf'; then
        fail "$script.csv: $(cat "results/$script/$script.csv")"
    fi
done

# A sweep as an array, of a case whose name a shell would take apart; then its table.
name="results/a b; exit 9"
mkdir -p "$name"
cp "$case" "$name/c d.toml"
sweep=("$name/c d.toml" "$name" --set axis.0.v.cells=32 --vary "solver.tolerance=1e-2,1e-3"
    --vary 'output.field_times=[0.5, 0.1],[]')
job=$(submit --time=5 --array=1-4 --job-name=sweep jobscripts/sweep.sbatch "${sweep[@]}")
for task in 1 2 3 4; do
    finish "${job}_$task" 120
    ended "${job}_$task" "COMPLETED 0:0"
done
srun -n 1 "$program" sweep "${sweep[0]}" -o "${sweep[@]:1}" --table >"$place/table.log"
is "rows of the sweep" "$(wc -l <"$name/table.csv")" 5
if grep -q "not finished" "$name/table.csv"; then
    fail "the sweep: $(cat "$name/table.csv")"
fi

# The script that a plan writes, submitted from another directory, of a case whose name a shell
# would take apart; then once more, where it is stopped by hand and submits itself again.
planned="$name/planned; exit 9.sbatch"
"$program" plan "$name/c d.toml" --ranks "$ranks" --sbatch "$planned" -o "$name/planned" \
    --set solver.tolerance=1e-2 2>"$place/planned.log" >/dev/null
planned=$(realpath "$planned")
mkdir elsewhere
job=$(cd elsewhere && env -u PHASEWARP sbatch --parsable --time=5 "$planned")
finish "$job" 120
ended "$job" "COMPLETED 0:0"
[ -s "$name/planned/result.h5" ] || fail "the planned script: $(cat elsewhere/*.log)"
is "files beside the log of job $job" "$(ls elsewhere | wc -l)" 1
"$program" plan "$case" --ranks "$ranks" --sbatch again.sbatch -o results/again "${settings[@]}" \
    2>"$place/planned.log" >/dev/null
job=$(cd elsewhere && submit --time=20 --job-name=again "$place/work/again.sbatch")
running "$job" "elsewhere/again-$job.log"
scancel --batch --signal=USR1 "$job"
finish "$job" 60
ended "$job" "FAILED 75:0"
next=$(sed -n 's/^Submitted batch job //p' "elsewhere/again-$job.log")
[ -n "$next" ] || fail "job $job did not submit another"
finish "$next" 600
ended "$next" "COMPLETED 0:0"
h5diff results/whole/result.h5 results/again/result.h5 /f || fail "f of the planned script differs"

# A mistake in the case ends at once, with its own code, and is not submitted again.
job=$(submit --time=5 --job-name=mistake jobscripts/run.sbatch "$case" results/mistake \
    --set solver.tolerance=2)
finish "$job" 60
ended "$job" "FAILED 2:0"
grep -q "solver.tolerance" "mistake-$job.log" || fail "the mistake is not named"

say "passed in $SECONDS s"
