# What the job scripts do, for Slurm and PBS; sourced after env.sh.
# shellcheck shell=bash disable=SC2154  # program, LAUNCH, most_jobs, reserve, memory_per_node: env.sh

# launch RANKS COMMAND…
launch() {
    local words
    read -ra words <<<"$LAUNCH"
    "${words[@]}" "$@"
}

# read_settings FILE: `settings` becomes a --set for each line KEY=VALUE; empty lines and those that begin with # are left out.
read_settings() {
    local line
    settings=()
    while IFS= read -r line || [ -n "$line" ]; do
        if [[ $line =~ [^[:space:]] && $line != \#* ]]; then
            settings+=(--set "$line")
        fi
    done <"$1"
}

# show_plan RANKS CASE [OPTION]…: is the case right, does it fit? Options are those of `run` that say what is computed and where.
show_plan() {
    local ranks=$1 case=$2 node=() of_case=() option next=""
    shift 2
    # `check` looks at the case alone: who computes what is no option of it.
    for option in "$@"; do
        if [ "$next" = dropped ]; then
            next=""
        elif [ "$option" = --ranks-x ]; then
            next=dropped
        elif [[ $option != --ranks-x=* ]]; then
            of_case+=("$option")
        fi
    done
    if [ -n "$memory_per_node" ]; then
        node=(--memory-per-node "$memory_per_node" --ranks-per-node "${SLURM_NTASKS_PER_NODE:-$ranks}")
    fi
    launch 1 "$program" check "$case" "${of_case[@]}"
    launch 1 "$program" plan "$case" --ranks "$ranks" "${node[@]}" "$@"
}

# seconds_of [[D-]H:]M:S: as batch systems write times; nothing where it is none.
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

# seconds_left: until the job ends; nothing where that is not known.
seconds_left() {
    local limit
    if [ -n "${SLURM_JOB_ID:-}" ]; then
        seconds_of "$(squeue --noheader --jobs "$SLURM_JOB_ID" --format %L 2>/dev/null | tr -d ' ')"
    elif [ -n "${PBS_JOBID:-}" ]; then
        limit=$(qstat -f "$PBS_JOBID" 2>/dev/null | sed -n 's/.*Resource_List.walltime = //p')
        limit=$(seconds_of "$limit")
        echo "${limit:+$((limit - SECONDS))}"
    fi
}

# solve RANKS CASE RESULTS [OPTION]…: from the newest checkpoint on, if there is one. A USR1 that the job gets reaches the
# program, which then makes a checkpoint. Returns its exit code.
solve() {
    local ranks=$1 case=$2 results=$3 words code=0 told="" left walltime=()
    shift 3
    left=$(seconds_left)
    if [ -n "$left" ] && [ "$left" -gt "$reserve" ]; then
        walltime=(--walltime $((left - reserve)))
    fi
    read -ra words <<<"$LAUNCH"
    # In the background: the shell runs a trap at once only while it waits.
    "${words[@]}" "$ranks" "$program" run "$case" -o "$results" --resume "${walltime[@]}" "$@" &
    local job=$!
    trap 'told=yes; echo "told to stop: USR1"; kill -USR1 "$job" 2>/dev/null || true' USR1
    wait "$job" || code=$?
    while [ -n "$told" ]; do
        told="" code=0
        wait "$job" || code=$?
    done
    trap - USR1
    return "$code"
}

# finished RESULTS: how far the newest checkpoint is; nothing where there is none.
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

# may_go_on JOBS BEFORE AFTER: whether another job is worth it, as the JOBS-th was stopped, and says why not.
may_go_on() {
    if [ "$1" -ge "$most_jobs" ]; then
        echo "not submitted again: $1 jobs so far, most_jobs is $most_jobs"
        return 1
    fi
    if [ -z "$3" ] || [ "$2" = "$3" ]; then
        echo "not submitted again: nothing was finished in this job; give it more time or more ranks"
        return 1
    fi
}

# number FILE KEY: a number of a summary.json.
number() {
    sed -n "s/^  \"$2\": \([-+0-9.e]*\),*\$/\1/p" "$1"
}
