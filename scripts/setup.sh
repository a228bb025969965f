#!/usr/bin/env bash
# Finds what phasewarp is built and run with, and installs what is missing.
#
#   scripts/setup.sh                 check; on Debian and Ubuntu install what is missing (as root,
#                                    or by sudo without password)
#   scripts/setup.sh --check         check only
#   scripts/setup.sh --readers       install a Python with h5py, xarray, meshio and VTK into
#                                    target/readers, for tests/readers.py (half a minute)
#   scripts/setup.sh --qiskit        install a Python with Qiskit into target/qiskit, for
#                                    tests/simulator.py (half a minute)
#   scripts/setup.sh --python        install the package of python/, with what its tests take, into
#                                    target/python (a minute)
#   scripts/setup.sh --docs          install MkDocs into target/docs, for scripts/docs.sh (half a
#                                    minute)
#   scripts/setup.sh --browser       install a Chromium by apt-get, for
#                                    tests/cli/pictures/browser.rs (a minute)
#   scripts/setup.sh --mpich         install MPICH and an HDF5 built with it by apt-get, beside Open
#                                    MPI, and print the variables with which cargo builds with them
#   scripts/setup.sh --environment   print the variable that cargo needs to find parallel HDF5:
#                                    "HDF5_DIR=…", or nothing if none is needed
#
# Exit code 0 if everything is there, 1 if something is missing. Prints nothing and takes no time if
# there is nothing to do. Environment: HDF5_DIR, LIBCLANG_PATH, MPICC name places to look in first,
# as they do for cargo.

# shellcheck disable=SC2329  # the have_… functions are called by name
set -euo pipefail
shopt -s nullglob

# --- what is looked for; each function prints nothing and returns whether it was found ---

have_cargo() {
    command -v cargo >/dev/null 2>&1 || [ -x "${CARGO_HOME:-${HOME:-}/.cargo}/bin/cargo" ]
}

have_compiler() { command -v cc >/dev/null 2>&1; }

have_launcher() { mpirun --version >/dev/null 2>&1; }

have_mpi() { "${MPICC:-mpicc}" -show >/dev/null 2>&1; }

have_pkg_config() { command -v "${PKG_CONFIG:-pkg-config}" >/dev/null 2>&1; }

# libclang, with the compiler headers that bindgen reads (stddef.h and the like).
have_libclang() {
    local directory prefix
    if [ -n "${LIBCLANG_PATH:-}" ]; then
        [ -f "$LIBCLANG_PATH" ] || has_libclang "$LIBCLANG_PATH"
        return
    fi
    prefix=$("${LLVM_CONFIG_PATH:-llvm-config}" --libdir 2>/dev/null) || prefix=""
    for directory in ${prefix:+"$prefix"} /usr/lib/llvm-*/lib /usr/lib64/llvm*/lib \
        /usr/lib64 /usr/lib /usr/local/lib; do
        if has_libclang "$directory" && has_clang_headers "$directory"; then
            return 0
        fi
    done
    return 1
}

has_libclang() {
    local found=("$1"/libclang.so* "$1"/libclang-[0-9]*.so*)
    [ "${#found[@]}" -gt 0 ]
}

has_clang_headers() {
    local found=("$1"/clang/*/include/stddef.h "$1"/../lib/clang/*/include/stddef.h)
    [ "${#found[@]}" -gt 0 ]
}

# Whether a directory of headers belongs to an HDF5 built with MPI.
is_parallel() {
    local headers=("$1"/H5pubconf.h "$1"/H5pubconf-64.h)
    grep -qsE '^#define +H5_HAVE_PARALLEL +1' "${headers[@]}"
}

# Whether cargo finds a parallel HDF5 by itself: where HDF5_DIR points or, without it, where
# pkg-config does.
cargo_finds_hdf5() {
    local directory
    if [ -n "${HDF5_DIR:-}" ]; then
        is_parallel "$HDF5_DIR/include"
        return
    fi
    for directory in $("${PKG_CONFIG:-pkg-config}" --cflags-only-I hdf5 2>/dev/null); do
        if is_parallel "${directory#-I}"; then
            return 0
        fi
    done
    return 1
}

# Prints the root of a parallel HDF5 that cargo does not find by itself: a cluster's module, or
# Debian's Open MPI build standing next to a serial one.
hdf5_elsewhere() {
    local root compiler
    compiler=$(command -v h5pcc) || compiler=""
    for root in "${HDF5_ROOT:-}" "${EBROOTHDF5:-}" "${compiler%/bin/h5pcc}" \
        /usr/lib/*/hdf5/openmpi; do
        if [ -n "$root" ] && [ -d "$root/lib" ] && is_parallel "$root/include"; then
            echo "$root"
            return 0
        fi
    done
    return 1
}

have_hdf5() { cargo_finds_hdf5 || { [ -z "${HDF5_DIR:-}" ] && hdf5_elsewhere >/dev/null; }; }

# --- what is missing: fills `missing` (for people) and `packages` (for apt) ---

look() {
    missing=()
    packages=()
    want have_compiler "a C compiler (cc)" gcc libc6-dev
    want have_launcher "mpirun" openmpi-bin
    want have_mpi "MPI for C (mpicc)" libopenmpi-dev
    want have_libclang "libclang with its headers" libclang-dev
    want have_pkg_config "pkg-config" pkg-config
    want have_hdf5 "HDF5 built with MPI" libhdf5-openmpi-dev
    want have_cargo "cargo"
}

want() {
    local check=$1 name=$2
    shift 2
    if ! "$check"; then
        missing+=("$name")
        packages+=("$@")
    fi
}

# --- installing ---

say() { echo "setup: $*" >&2; }

as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    else
        sudo -n "$@"
    fi
}

can_install() {
    command -v apt-get >/dev/null 2>&1 && { [ "$(id -u)" -eq 0 ] || sudo -n true 2>/dev/null; }
}

# apt-get, not asking anything, waiting for another one to end.
apt_get() {
    as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get -qq -o Dpkg::Use-Pty=0 -o DPkg::Lock::Timeout=300 "$@" </dev/null >&2
}

install_packages() {
    local try
    for try in 1 2 3 4; do
        # A failed update is not the end: one package list of many may be out of reach, and not be
        # needed.
        apt_get update || say "apt-get update failed"
        if apt_get install -y --no-install-recommends "$@"; then
            return 0
        fi
        if [ "$try" -lt 4 ]; then
            say "apt-get install failed; trying again in $((try * 10)) seconds"
            sleep $((try * 10))
        fi
    done
    return 1
}

explain() {
    local item
    say "missing:"
    for item in "${missing[@]}"; do
        echo "         $item" >&2
    done
    if ! have_cargo; then
        say "cargo comes with Rust, 1.89 or later: https://rustup.rs"
    fi
    if [ -n "${HDF5_DIR:-}" ] && ! have_hdf5; then
        say "HDF5_DIR=$HDF5_DIR holds no include/H5pubconf.h with H5_HAVE_PARALLEL:" \
            "unset or correct it"
    fi
    if [ "${#packages[@]}" -gt 0 ]; then
        cat >&2 <<'TEXT'
setup: install, as root, and run this again:
         Debian, Ubuntu    apt-get install openmpi-bin libopenmpi-dev libclang-dev \
                           libhdf5-openmpi-dev pkg-config gcc
         Fedora, RHEL      dnf install openmpi-devel hdf5-openmpi-devel clang-devel \
                           pkgconf-pkg-config gcc
                           then: module load mpi/openmpi-x86_64
       or, on a cluster, load modules; their names differ, typically
                           module load gcc openmpi hdf5/<version>-mpi llvm
       and say where they are if they still are not found:
         HDF5_DIR          directory with include/ and lib/ of an HDF5 built with the same MPI
         LIBCLANG_PATH     the directory that holds libclang.so
TEXT
    fi
}

# --- Pythons for tests, each in a place of its own; nothing to do where it is there ---

# A Python with pip and nothing else, in the directory $1.
new_python() {
    if ! python3 -c 'import ensurepip' 2>/dev/null && can_install; then
        say "installing python3-venv"
        install_packages python3-venv
    fi
    python3 -m venv --clear "$1"
}

# set_up_python NAME SCRIPT REQUIREMENTS PACKAGE…: target/NAME with the requirements, and packages
# without theirs.
set_up_python() {
    local root place script requirements
    root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
    place=${CARGO_TARGET_DIR:-$root/target}/$1
    script=$root/tests/$2
    requirements=$root/tests/$3
    shift 3
    if "$place/bin/python" "$script" --packages 2>/dev/null; then
        return 0
    fi
    say "installing what $script takes into $place"
    new_python "$place" &&
        "$place/bin/python" -m pip --quiet --disable-pip-version-check install -r "$requirements" &&
        { [ "$#" -eq 0 ] ||
            "$place/bin/python" -m pip --quiet --disable-pip-version-check install \
                --no-deps "$@"; } &&
        "$place/bin/python" "$script" --packages
}

# set_up_from NAME FILE PIP_ARGUMENT…: target/NAME with what pip installs, again if FILE has
# changed since.
set_up_from() {
    local root place file
    root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
    place=${CARGO_TARGET_DIR:-$root/target}/$1
    file=$root/$2
    shift 2
    if cmp -s "$file" "$place/${file##*/}"; then
        return 0
    fi
    say "installing what $file names into $place"
    new_python "$place" &&
        (cd "$root" &&
            "$place/bin/python" -m pip --quiet --disable-pip-version-check install "$@") &&
        cp "$file" "$place/"
}

# --- a browser for a test of reports ---

have_browser() {
    local name
    for name in chromium chromium-browser google-chrome; do
        if command -v "$name" >/dev/null 2>&1; then
            return 0
        fi
    done
    return 1
}

set_up_browser() {
    have_browser && return
    if ! can_install; then
        say "no chromium, chromium-browser or google-chrome, and no way to install one"
        return 1
    fi
    say "installing chromium"
    install_packages chromium && have_browser
}

# --- another MPI beside Open MPI, as Debian names it ---

hdf5_of_mpich() {
    local root
    for root in /usr/lib/*/hdf5/mpich; do
        if is_parallel "$root/include"; then
            echo "$root"
            return 0
        fi
    done
    return 1
}

have_mpich() {
    mpicc.mpich -show >/dev/null 2>&1 && mpirun.mpich --version >/dev/null 2>&1 &&
        hdf5_of_mpich >/dev/null
}

set_up_mpich() {
    if ! have_mpich; then
        if ! can_install; then
            say "no mpicc.mpich, mpirun.mpich or HDF5 built with MPICH, and no way to install them"
            return 1
        fi
        say "installing mpich and libhdf5-mpich-dev"
        install_packages mpich libmpich-dev libhdf5-mpich-dev >&2 && have_mpich || return 1
    fi
    printf 'MPICC=mpicc.mpich HDF5_DIR=%q\n' "$(hdf5_of_mpich)"
}

# --- requested actions ---

case ${1:-} in
"" | --check) ;;
--readers)
    # VTK's own requirements are for plots.
    set_up_python readers readers.py readers.txt vtk
    exit
    ;;
--qiskit)
    set_up_python qiskit simulator.py simulator.txt
    exit
    ;;
--python)
    set_up_from python python/pyproject.toml -e "./python[test]"
    exit
    ;;
--docs)
    set_up_from docs tests/docs.txt -r tests/docs.txt
    exit
    ;;
--browser)
    set_up_browser
    exit
    ;;
--mpich)
    set_up_mpich
    exit
    ;;
--environment)
    if ! cargo_finds_hdf5 && [ -z "${HDF5_DIR:-}" ] && root=$(hdf5_elsewhere); then
        printf 'HDF5_DIR=%q\n' "$root"
    fi
    exit 0
    ;;
*)
    say "unknown option $1; known: --check, --readers, --qiskit, --python, --docs, \
--browser, --mpich, --environment"
    exit 1
    ;;
esac

look
if [ "${#missing[@]}" -eq 0 ]; then
    exit 0
fi
if [ "${1:-}" != --check ] && [ "${#packages[@]}" -gt 0 ] && can_install; then
    say "installing ${packages[*]}"
    install_packages "${packages[@]}" || say "apt-get could not install them"
    hash -r
    look
    if [ "${#missing[@]}" -eq 0 ]; then
        say "everything is there"
        exit 0
    fi
fi
explain
exit 1
