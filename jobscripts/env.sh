# Site settings, sourced by the job scripts. Edit what differs where you are; nothing else in this folder need be touched.
# Source it in the shell you submit from, too: the SBATCH_ lines are then in force from the first job on.
# shellcheck shell=bash disable=SC2034

# 1. Modules: a C compiler, MPI, HDF5 built with that MPI; libclang (often in a module llvm or clang) to build only.
# module purge
# module load gcc openmpi hdf5/1.14-mpi llvm

# 2. Only where `scripts/setup.sh --check` does not find them by itself.
# export HDF5_DIR=/path/to/hdf5            # holds include/ and lib/
# export LIBCLANG_PATH=/path/to/llvm/lib   # holds libclang.so
# export LD_LIBRARY_PATH="$HDF5_DIR/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"

# 3. The program: built by build.sbatch in the top directory, from where jobs are submitted.
program=${PHASEWARP:-target/release/phasewarp}

# 4. The launcher, up to the number of ranks: what starts MPI programs here. `srun --mpi=list` shows what srun knows.
if [ -z "${LAUNCH:-}" ]; then
    LAUNCH="mpirun -np"
    if [ -n "${SLURM_JOB_ID:-}" ] && command -v srun >/dev/null; then
        LAUNCH="srun -n"                   # or "srun --mpi=pmix -n", "mpiexec -n", "mpirun --bind-to core -np"
    fi
fi

# 5. Whom to charge and where to run; memory of a core. Slurm reads these, also for jobs that submit themselves again.
# export SBATCH_ACCOUNT=project SBATCH_PARTITION=standard SBATCH_QOS=normal
# export SBATCH_MEM_PER_CPU=4G
memory_per_node=${MEMORY_PER_NODE:-}       # e.g. 256GiB; the plan in the log then says whether the run fits

# 6. Jobs that were stopped with a checkpoint submit themselves again, at most so many times in all.
most_jobs=${MOST_JOBS:-20}
# Seconds before the end of the job at which the program is told to be through.
reserve=${RESERVE:-60}
