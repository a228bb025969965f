# Needs GNU make. `setup` installs what else is missing, or names it.

RANKS   ?= 2
CASE    ?= cases/example1.toml
BUDGET  ?= 60s
TRIALS  ?= 200
SCENES  ?= 1000
FUZZ    ?= 1000000
FIRST   ?= 0
RESULTS ?= results/$(basename $(notdir $(CASE)))

# After a fresh rustup the shell finds cargo only at the next login.
export PATH := $(PATH):$(or $(CARGO_HOME),$(HOME)/.cargo)/bin

# Open MPI as root, as in containers, and with more ranks than cores, as in tests (4.x, then 5.x).
# The environment takes precedence.
export OMPI_ALLOW_RUN_AS_ROOT ?= 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM ?= 1
export OMPI_MCA_rmaps_base_oversubscribe ?= 1
export OMPI_MCA_mpi_yield_when_idle ?= 1
export PRTE_MCA_rmaps_default_mapping_policy ?= :oversubscribe

# Tests wait for MPI to start and to end: four at a time on fewer cores.
export RUST_TEST_THREADS ?= $(shell n=$$(getconf _NPROCESSORS_ONLN); \
    if [ "$$n" -gt 4 ]; then echo "$$n"; else echo 4; fi)

# With HDF5_DIR if cargo would not find the parallel HDF5; expanded when a recipe runs, after setup.
CARGO   = $(shell scripts/setup.sh --environment) cargo
PROGRAM = $(or $(CARGO_TARGET_DIR),target)/release/phasewarp
PYTHON  = $(abspath $(or $(CARGO_TARGET_DIR),target))/python/bin/python

.DEFAULT_GOAL := build
.PHONY: run build test torture fuzz bench example3 calibration study scaling stability chart \
    lines examples quantum baseline slurm docs check check-fmt check-clippy check-doc check-python \
    deny mutants readers qiskit python mkdocs browser mpich setup clean help

run: build ## solve example 1 of the paper on two ranks (or CASE=, RANKS=, RESULTS=)
	mpirun -np $(RANKS) $(PROGRAM) run $(CASE) -o $(RESULTS) --force
	@echo "Results in $(RESULTS): result.h5 (fields), summary.json (errors, cost)"

build: setup ## build the program in release mode
	$(CARGO) build --release

test: setup ## run every test, also on several ranks (ARGS= is passed to cargo test)
	$(CARGO) test --release $(ARGS)

torture: setup ## faults, full and lost disks, random cases, many (TRIALS=, SCENES=, FIRST=)
	PHASEWARP_TRIALS=$(TRIALS) PHASEWARP_SCENES=$(SCENES) PHASEWARP_FIRST_TRIAL=$(FIRST) \
	    $(CARGO) test --release --test cli -- --nocapture torture disks random_cases definition \
	    answers_of_random random_fields random_runs

# Each file of `changed_words` takes a process of its own: a hundredth as many.
fuzz: setup ## readers on random inputs, for hours (FUZZ=, FIRST=)
	TMPDIR=$(or $(wildcard /dev/shm),/tmp) PHASEWARP_FUZZ=$(FUZZ) PHASEWARP_FUZZ_FIRST=$(FIRST) \
	    nice $(CARGO) test --release --lib --test library --test cli -- --nocapture \
	    --test-threads=1 end_in_a_ changed_files changed_manifests changed_schemas
	PHASEWARP_FUZZ=$$(( ($(FUZZ) + 99) / 100 )) PHASEWARP_FUZZ_FIRST=$(FIRST) \
	    nice $(CARGO) test --release --test cli -- --nocapture changed_words

bench: setup ## measure, into docs/performance.md (ARGS=--quick, --counts, --error)
	CARGO="$(CARGO)" scripts/bench/bench.sh $(ARGS)

example3: $(foreach n,8 16 32,example3-$(n)) ## example 3 by size, into docs/performance.md

example3-%: build ## example 3 on so many cells an axis (64: a quarter of an hour)
	mpirun -np $(RANKS) $(PROGRAM) run cases/example3.toml -o results/$@ --force \
	    --set solver.tolerance=1e-6 \
	    $(foreach key,axis.0.x axis.0.v axis.1.x axis.1.v,--set $(key).cells=$*)
	@if command -v python3 >/dev/null; then scripts/bench/report.py --only example3; fi

calibration: build ## predictions and meshes beside runs, into docs/performance.md (ARGS=--quick: print only)
	scripts/bench/calibration.py --program $(PROGRAM) $(ARGS)

study: build ## memory and time against N_p, into docs/scaling.md (ARGS=--quick, --counts)
	scripts/charted.sh study.py --program $(PROGRAM) $(ARGS)

scaling: build ## 64 to 6400 ranks, modelled and simulated, into docs/scaling.md (ARGS=--measured F)
	scripts/charted.sh ranks.py --program $(PROGRAM) $(ARGS)

stability: build ## where methods fail on example 1, for docs/stability.md (or CASE=, RESULTS=)
	mpirun -np $(RANKS) $(PROGRAM) stability $(CASE) --budget 5m -o $(RESULTS)-stability --force
	@if [ "$(CASE)" = cases/example1.toml ]; then \
	    mkdir -p docs/charts && cp $(RESULTS)-stability/stability.svg docs/charts/; fi

baseline: build ## where results differ from those of an older commit (REFERENCE=DIR)
	scripts/baseline.sh --compare $(REFERENCE) --program $(PROGRAM) $(ARGS)

lines: ## lines of code by module, without comments and unit tests
	scripts/lines.sh

slurm: build ## test the job scripts on a Slurm started here
	PHASEWARP=$(PROGRAM) tests/slurm.sh

check: check-fmt check-clippy check-doc ## formatting, lints, documentation; warnings are errors

check-fmt:
	$(CARGO) fmt --check

check-clippy: setup
	$(CARGO) clippy --release --all-targets -- -D warnings

check-doc: setup
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --release --no-deps

deny: ## licences, advisories and duplicates of dependencies, with cargo-deny (ARGS=licenses, …)
	@cargo deny --version >/dev/null 2>&1 || \
	    { echo "make deny needs cargo-deny: cargo install cargo-deny --locked" >&2; exit 1; }
	cargo deny check $(ARGS)

mutants: setup ## faults in the core that no test notices, with cargo-mutants (ARGS="--file F")
	@cargo mutants --version >/dev/null 2>&1 || \
	    { echo "make mutants needs cargo-mutants: cargo install cargo-mutants --locked" >&2; exit 1; }
	$(CARGO) mutants $(ARGS)

check-python: build python ## test the Python package, notebooks, lints and types
	cd python && $(PYTHON) -m ruff format --check . && $(PYTHON) -m ruff check . && \
	    $(PYTHON) -m mypy && PHASEWARP=$(abspath $(PROGRAM)) OMP_NUM_THREADS=1 \
	    OPENBLAS_NUM_THREADS=1 $(PYTHON) -m pytest -n 3 --dist worksteal

examples: build ## figures 2 to 5 of the paper, into docs/examples/ (ARGS=--paper: its own set-ups)
	RANKS=$(RANKS) scripts/examples.sh --program $(PROGRAM) $(ARGS)

quantum: build readers ## the error budget of a measured density, into docs/quantum.md
	$(or $(CARGO_TARGET_DIR),target)/readers/bin/python scripts/quantum.py --ranks $(RANKS) $(ARGS)

readers: ## install a Python with h5py, xarray, meshio and VTK, for tests/cli/readers.rs
	@scripts/setup.sh --readers

qiskit: ## install a Python with Qiskit, for tests/cli/simulator.rs
	@scripts/setup.sh --qiskit

python: ## install the Python package and what its tests take into target/python
	@scripts/setup.sh --python

mkdocs: ## install MkDocs into target/docs, for `make docs`
	@scripts/setup.sh --docs

browser: ## install a Chromium, for tests/cli/pictures/browser.rs (Debian, Ubuntu)
	@scripts/setup.sh --browser

# Ranks of MPICH keep their core while they wait: of tests/cli, faults and damage only.
MPICH_TESTS = torture reliability checkpoint::stalled checkpoint::stopped::runs_killed

mpich: setup ## with MPICH, built in target/mpich: the MPI tests, and faults (TRIALS=, FIRST=)
	variables="$$(scripts/setup.sh --mpich)" && export $$variables PHASEWARP_MPIRUN=mpirun.mpich \
	    CARGO_TARGET_DIR=$(or $(CARGO_TARGET_DIR),target)/mpich PHASEWARP_TRIALS=$(TRIALS) \
	    PHASEWARP_FIRST_TRIAL=$(FIRST) && \
	cargo test --release --test parallel $(ARGS) && \
	cargo test --release --test cli -- --nocapture --test-threads=2 $(MPICH_TESTS)

docs: build mkdocs ## build the documents as a site
	scripts/docs.sh $(PROGRAM)

chart: $(foreach n,1 2 3,chart-$(n)) ## accuracy against cost, examples 1 to 3 (BUDGET=)

chart-%: build
	mpirun -np $(RANKS) $(PROGRAM) chart cases/example$*.toml --budget $(BUDGET) \
	    -o results/example$*-chart --force
	@mkdir -p docs/charts
	cp results/example$*-chart/chart.svg docs/charts/example$*.svg
	cp results/example$*-chart/chart.csv docs/charts/example$*.csv

setup: ## install Open MPI, libclang, parallel HDF5 and pkg-config, or name them
	@scripts/setup.sh

clean: ## remove what was built; results stay
	$(CARGO) clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z0-9%-]+:.*## / { printf "make %-11s %s\n", $$1, $$2 }' \
	    $(firstword $(MAKEFILE_LIST))
