# Settings of the site, sourced by the job scripts. Edit this file; the others can stay as they are.
# Source it also in the shell that you submit from: then the SBATCH_ lines hold for the first job.
# shellcheck shell=bash disable=SC2034

# 1. Modules: a C compiler, MPI, HDF5 built with that MPI. To build also libclang, often in a module
#    llvm or clang.
# module purge
# module load gcc openmpi hdf5/1.14-mpi llvm

# 2. Only if `scripts/setup.sh --check` does not find them.
# export HDF5_DIR=/path/to/hdf5            # holds include/ and lib/
# export LIBCLANG_PATH=/path/to/llvm/lib   # holds libclang.so
# export LD_LIBRARY_PATH="$HDF5_DIR/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"

# 3. The program, as built by build.sbatch in the top directory, from which jobs are submitted.
program=${PHASEWARP:-target/release/phasewarp}

# 4. The launcher: the words that start an MPI program, up to the number of ranks.
#    `srun --mpi=list` shows what srun supports.
if [ -z "${LAUNCH:-}" ]; then
    LAUNCH="mpirun -np"
    if [ -n "${SLURM_JOB_ID:-}" ] && command -v srun >/dev/null; then
        # or "srun --mpi=pmix -n", "mpiexec -n", "mpirun --bind-to core -np"
        LAUNCH="srun -n"
    fi
fi

# 5. Account, partition, memory of a core. Slurm reads these when a job submits itself, too.
# export SBATCH_ACCOUNT=project SBATCH_PARTITION=standard SBATCH_QOS=normal
# export SBATCH_MEM_PER_CPU=4G
# e.g. 256GiB; the plan in the log then says whether the run fits
memory_per_node=${MEMORY_PER_NODE:-}

# 6. A job that stopped with a checkpoint submits itself again, up to this number of jobs in all.
most_jobs=${MOST_JOBS:-20}
# The program stops so many seconds before the end of the job.
reserve=${RESERVE:-60}
