# Site settings, sourced by the job scripts. Copy this folder and edit the lines that differ where you are.
# shellcheck shell=bash

# 1. Modules: a C compiler, MPI, HDF5 built with that MPI; libclang (often in a module llvm or clang) to build only.
# module purge
# module load gcc openmpi hdf5/1.14-mpi llvm

# 2. Only where `scripts/setup.sh --check` does not find them by itself.
# export HDF5_DIR=/path/to/hdf5            # holds include/ and lib/
# export LIBCLANG_PATH=/path/to/llvm/lib   # holds libclang.so
# export LD_LIBRARY_PATH="$HDF5_DIR/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"

# 3. The program: built by build.sbatch in the top directory, from where jobs are submitted.
# shellcheck disable=SC2034
program=${PHASEWARP:-target/release/phasewarp}

# 4. The launcher: launch RANKS COMMAND…; srun inside a Slurm job, mpirun elsewhere. Name yours here if that is wrong,
#    e.g. `srun --mpi=pmix -n` or `mpiexec -n`.
launch() {
    if [ -n "${SLURM_JOB_ID:-}" ] && command -v srun >/dev/null; then
        srun -n "$@"
    else
        mpirun -np "$@"
    fi
}
