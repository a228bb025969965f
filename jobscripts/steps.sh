# Functions of the job scripts, for Slurm and PBS; sourced after env.sh, which sets program, LAUNCH,
# most_jobs, reserve and memory_per_node.
# shellcheck shell=bash disable=SC2154

# launch RANKS COMMAND…: starts an MPI program.
launch() {
    local words
    read -ra words <<<"$LAUNCH"
    "${words[@]}" "$@"
}

# numbers_of_ranks MOST: FIRST (1), twice, four times that, …, and MOST.
numbers_of_ranks() {
    local ranks
    for ((ranks = ${FIRST:-1}; ranks < $1; ranks *= 2)); do
        echo "$ranks"
    done
    echo "$1"
}

# read_settings FILE: `settings` becomes a --set for each line KEY=VALUE. Empty lines and lines that
# begin with # are skipped.
read_settings() {
    local line
    settings=()
    while IFS= read -r line || [ -n "$line" ]; do
        if [[ $line =~ [^[:space:]] && $line != \#* ]]; then
            settings+=(--set "$line")
        fi
    done <"$1"
}

# show_plan RANKS CASE [OPTION]…: checks the case and prints its plan. Options are those of `run`.
show_plan() {
    local ranks=$1 case=$2 node=() of_case=() of_plan=() option next=""
    shift 2
    # `check` looks at the case alone: it has no --ranks-x. Neither writes: no --force.
    for option in "$@"; do
        if [ "$option" = --force ]; then
            continue
        fi
        of_plan+=("$option")
        if [ "$next" = dropped ]; then
            next=""
        elif [ "$option" = --ranks-x ]; then
            next=dropped
        elif [[ $option != --ranks-x=* ]]; then
            of_case+=("$option")
        fi
    done
    if [ -n "$memory_per_node" ]; then
        node=(--memory-per-node "$memory_per_node"
            --ranks-per-node "${SLURM_NTASKS_PER_NODE:-$ranks}")
    fi
    launch 1 "$program" check "$case" "${of_case[@]}"
    launch 1 "$program" plan "$case" --ranks "$ranks" "${node[@]}" "${of_plan[@]}"
}

# seconds_of [[D-]H:]M:S: the seconds of a time; prints nothing if it is not a time.
seconds_of() {
    local days=0 rest=$1 sum=0 part parts
    if [[ $rest == *-* ]]; then
        days=${rest%%-*} rest=${rest#*-}
    fi
    if [[ ! $days-$rest =~ ^[0-9]+-[0-9]+(:[0-9]+)*$ ]]; then
        return 0
    fi
    IFS=: read -ra parts <<<"$rest"
    for part in "${parts[@]}"; do
        sum=$((60 * sum + 10#$part))
    done
    echo $((86400 * 10#$days + sum))
}

# this_job: the number by which Slurm knows this job, of an array this task of it.
this_job() {
    if [ -n "${SLURM_ARRAY_TASK_ID:-}" ]; then
        echo "${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID"
    else
        echo "${SLURM_JOB_ID:-}"
    fi
}

# read_options: `options` becomes the options of this Slurm job, for the next one.
read_options() {
    # shellcheck disable=SC2034  # read by the scripts
    options=(--job-name="$SLURM_JOB_NAME" --ntasks="$SLURM_NTASKS" --nodes="$SLURM_JOB_NUM_NODES"
        --partition="$SLURM_JOB_PARTITION"
        --time="$(squeue --noheader --jobs "$(this_job)" --format %l | tr -d ' ')"
        ${SLURM_JOB_ACCOUNT:+--account="$SLURM_JOB_ACCOUNT"}
        ${SLURM_JOB_QOS:+--qos="$SLURM_JOB_QOS"}
        ${SLURM_CPUS_PER_TASK:+--cpus-per-task="$SLURM_CPUS_PER_TASK"}
        ${SLURM_NTASKS_PER_NODE:+--ntasks-per-node="$SLURM_NTASKS_PER_NODE"}
        ${SLURM_MEM_PER_NODE:+--mem="$SLURM_MEM_PER_NODE"}
        ${SLURM_MEM_PER_CPU:+--mem-per-cpu="$SLURM_MEM_PER_CPU"})
}

# seconds_left: the seconds until the job ends; prints nothing if unknown.
seconds_left() {
    local limit
    if [ -n "${SLURM_JOB_ID:-}" ]; then
        seconds_of "$(squeue --noheader --jobs "$(this_job)" --format %L 2>/dev/null | tr -d ' ')"
    elif [ -n "${PBS_JOBID:-}" ]; then
        limit=$(qstat -f "$PBS_JOBID" 2>/dev/null | sed -n 's/.*Resource_List.walltime = //p')
        limit=$(seconds_of "$limit")
        echo "${limit:+$((limit - SECONDS))}"
    fi
}

# solve RANKS COMMAND…: a command of the program that goes on from its checkpoints, with what is
# left of the job as its wall time. A USR1 that the job receives is passed on to the program, which
# then writes a checkpoint. Returns the program's exit code.
solve() {
    local ranks=$1 words code=0 stopping="" left walltime=()
    shift
    left=$(seconds_left)
    if [ -n "$left" ] && [ "$left" -gt "$reserve" ]; then
        walltime=(--walltime $((left - reserve)))
    fi
    read -ra words <<<"$LAUNCH"
    # In the background, because the shell runs a trap at once only while it waits.
    "${words[@]}" "$ranks" "$program" "$@" "${walltime[@]}" &
    local job=$!
    trap 'stopping=yes; echo "stop signal: USR1"; kill -USR1 "$job" 2>/dev/null || true' USR1
    wait "$job" || code=$?
    while [ -n "$stopping" ]; do
        stopping="" code=0
        wait "$job" || code=$?
    done
    trap - USR1
    return "$code"
}

# finished RESULTS: the progress of the newest checkpoint; prints nothing if there is none.
finished() {
    local newest="" manifest
    for manifest in "$1"/checkpoint/*/manifest.json; do
        if [ -f "$manifest" ]; then
            newest=$manifest
        fi
    done
    if [ -n "$newest" ]; then
        sed -n 's/^ *"\(stage\|finished\|matvecs\)": \([0-9]*\),*$/\1 \2/p' "$newest" | tr '\n' ' '
    fi
}

# may_go_on JOBS BEFORE AFTER: whether to submit another job after the JOBS-th was stopped; prints
# the reason if not.
may_go_on() {
    if [ "$1" -ge "$most_jobs" ]; then
        echo "not submitted again: $1 jobs so far, most_jobs is $most_jobs"
        return 1
    fi
    if [ -z "$3" ] || [ "$2" = "$3" ]; then
        echo "not submitted again: this job finished nothing; give it more time or more ranks"
        return 1
    fi
}

# solve_in_jobs CASE RESULTS [OPTION]…: checks, plans and solves a case, and ends the script with
# the program's code. A job that stopped with a checkpoint submits another: the words `again`.
solve_in_jobs() {
    local ranks=${SLURM_NTASKS:-${default_ranks:-2}} case=$1 results=$2
    local jobs=${PHASEWARP_JOBS:-1} # with this one
    local before after code=0
    shift 2
    if [ "$jobs" -eq 1 ]; then
        show_plan "$ranks" "$case" "$@"
    fi
    before=$(finished "$results")
    solve "$ranks" run "$case" -o "$results" --resume "$@" || code=$?
    after=$(finished "$results")
    if [ "$code" -eq 75 ] && [ -n "${SLURM_JOB_ID:-}" ] &&
        may_go_on "$jobs" "$before" "$after"; then
        read_options
        echo "stopped with a checkpoint ($after); submitting job number $((jobs + 1))"
        PHASEWARP_JOBS=$((jobs + 1)) sbatch "${options[@]}" "${again[@]}"
    fi
    exit "$code"
}

# number FILE KEY: prints a number of a summary.json.
number() {
    sed -n "s/^  \"$2\": \([-+0-9.e]*\),*\$/\1/p" "$1"
}

# start_table CSV: writes the header of the tables of strong and weak scaling, which
# scripts/ranks.py reads.
start_table() {
    local columns=(command ranks space_blocks mode_groups oversubscribed cells applications
        solve_seconds wall_seconds nanoseconds_a_row_and_application_a_rank speed_up efficiency
        memory_bytes_per_rank)
    (IFS=, && echo "${columns[*]}" >"$1")
}

# add_run CSV RANKS RESULTS CASE [OPTION]…: solves a case on so many ranks, and adds the line. The
# efficiency is that of a row and application, over the one of the first line.
add_run() {
    local csv=$1 ranks=$2 summary=$3/summary.json command oversubscribed=no blocks numbers
    launch "$ranks" "$program" run "${@:4}" -o "$3" --force
    command=$(printf '%q ' "${@:4}")
    # A queue gives each rank a core.
    if [ -z "${SLURM_JOB_ID:-}" ] && [ "$ranks" -gt "$(nproc)" ]; then
        oversubscribed=yes
    fi
    blocks=$(sed -n '/"space_blocks"/,/]/p' "$summary" | grep -oE '[0-9]+' | paste -sd x)
    numbers=$(awk -v ranks="$ranks" -v first="$(sed -n 2p "$csv" | rev | cut -d, -f4 | rev)" \
        -v cells="$(number "$summary" cells)" -v applications="$(number "$summary" matvecs)" \
        -v solve="$(number "$summary" solve_seconds)" \
        -v wall="$(number "$summary" wall_seconds)" '
        BEGIN {
            OFS = ","; each = 1e9 * solve * ranks / cells / applications
            efficiency = first ? first / each : 1
            print cells, applications, solve, wall, each, efficiency * ranks, efficiency
        }')
    echo "\"${command//\"/\"\"}\",$ranks,${blocks//x/ x },$(number "$summary" mode_groups),$(
    )$oversubscribed,$numbers,$(number "$summary" memory_peak_bytes_per_rank)" >>"$csv"
}
