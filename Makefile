# Needs GNU make. Everything else that is missing, `setup` installs or names.

RANKS   ?= 2
CASE    ?= cases/example1.toml
BUDGET  ?= 60s
RESULTS ?= results/$(basename $(notdir $(CASE)))

# A fresh rustup puts cargo where the shell finds it only after the next login.
export PATH := $(PATH):$(or $(CARGO_HOME),$(HOME)/.cargo)/bin

# Open MPI as root, as in containers, and with more ranks than cores, as the tests do (4.x, then 5.x); defaults only.
export OMPI_ALLOW_RUN_AS_ROOT ?= 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM ?= 1
export OMPI_MCA_rmaps_base_oversubscribe ?= 1
export OMPI_MCA_mpi_yield_when_idle ?= 1
export PRTE_MCA_rmaps_default_mapping_policy ?= :oversubscribe

# HDF5_DIR where cargo would not find the parallel HDF5 by itself; looked up when a recipe runs, so after setup.
CARGO   = $(shell scripts/setup.sh --environment) cargo
PROGRAM = $(or $(CARGO_TARGET_DIR),target)/release/phasewarp

.DEFAULT_GOAL := build
.PHONY: baseline stability quantum run build test bench example3 calibration study slurm check check-fmt check-clippy check-doc readers qiskit setup clean help browser examples chart

run: build ## build, then solve example 1 of the paper on two ranks (CASE=, RANKS=, RESULTS= for another)
	mpirun -np $(RANKS) $(PROGRAM) run $(CASE) -o $(RESULTS)
	@echo "Results in $(RESULTS): result.h5 (fields), summary.json (errors, cost)"

build: setup ## build the program in release mode
	$(CARGO) build --release

test: setup ## run every test, those that start mpirun included (ARGS= is passed to cargo test)
	$(CARGO) test --release $(ARGS)

bench: setup ## rates, whole-program runs and peers, into docs/performance.md (ARGS=--quick: the short form)
	CARGO="$(CARGO)" scripts/bench/bench.sh $(ARGS)

example3: $(foreach n,8 16 32,example3-$(n)) ## example 3 on 8, 16 and 32 cells an axis, into docs/performance.md

example3-%: build ## example 3 on so many cells an axis: make example3-64 takes a quarter of an hour
	mpirun -np $(RANKS) $(PROGRAM) run cases/example3.toml -o results/$@ --set solver.tolerance=1e-6 \
	    $(foreach key,axis.0.x axis.0.v axis.1.x axis.1.v,--set $(key).cells=$*)
	@if command -v python3 >/dev/null; then scripts/bench/report.py --only example3; fi

calibration: build ## what plan --calibrate expects beside what runs take, into docs/performance.md (ARGS=--quick: printed only)
	scripts/bench/calibration.py --program $(PROGRAM) $(ARGS)

study: build ## memory and time against N_p, into docs/scaling.md, .csv, .svg (ARGS=--quick: a short form into results/study-quick/)
	scripts/study.sh --program $(PROGRAM) $(ARGS)

stability: build ## where methods fail on example 1: borders beside theory, docs/charts/stability.svg for docs/stability.md (CASE= and RESULTS= for another)
	mpirun -np $(RANKS) $(PROGRAM) stability $(CASE) --budget 5m -o $(RESULTS)-stability
	@if [ "$(CASE)" = cases/example1.toml ]; then mkdir -p docs/charts && cp $(RESULTS)-stability/stability.svg docs/charts/stability.svg; fi

baseline: build ## where results differ from those of an older commit: scripts/baseline.sh (REFERENCE=DIR)
	scripts/baseline.sh --compare $(REFERENCE) --program $(PROGRAM) $(ARGS)

slurm: build ## the job scripts on a Slurm that is started here (Debian, as root; three minutes)
	PHASEWARP=$(PROGRAM) tests/slurm.sh

check: check-fmt check-clippy check-doc ## formatting, lints and documentation, warnings as errors

check-fmt:
	$(CARGO) fmt --check

check-clippy: setup
	$(CARGO) clippy --release --all-targets -- -D warnings

check-doc: setup
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --release --no-deps

examples: build ## figures 2 to 5 of the paper from runs of our own, into docs/examples/ (ARGS=--paper: its own set-ups, an hour)
	RANKS=$(RANKS) scripts/examples.sh --program $(PROGRAM) $(ARGS)

quantum: build readers ## the error budget from the continuous problem to a measured density, into docs/quantum.md
	$(or $(CARGO_TARGET_DIR),target)/readers/bin/python scripts/quantum.py --ranks $(RANKS) $(ARGS)

readers: ## install, for tests/cli/readers.rs, a Python with h5py, xarray and VTK into target/readers
	@scripts/setup.sh --readers

qiskit: ## install, for tests/cli/simulator.rs, a Python with Qiskit into target/qiskit
	@scripts/setup.sh --qiskit

browser: ## install, for tests/cli/pictures/browser.rs, a Chromium that opens reports (Debian, Ubuntu)
	@scripts/setup.sh --browser
chart: $(foreach n,1 2 3,chart-$(n)) ## accuracy against cost for examples 1 to 3, into docs/charts/ (BUDGET= for each; two ranks)

chart-%: build
	mpirun -np $(RANKS) $(PROGRAM) chart cases/example$*.toml --budget $(BUDGET) -o results/example$*-chart
	@mkdir -p docs/charts
	cp results/example$*-chart/chart.svg docs/charts/example$*.svg
	cp results/example$*-chart/chart.csv docs/charts/example$*.csv

setup: ## install Open MPI, libclang, parallel HDF5 and pkg-config where they are missing, or name them
	@scripts/setup.sh

clean: ## remove what was built; results stay
	$(CARGO) clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z0-9%-]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))
