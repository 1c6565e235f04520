# `make run` flies the default mission, `make check` runs the linters, `make test` the tests that a change needs before
# it is committed (six minutes on two processors), `make test-all` every test.
# `make latency-figures` makes the figures of docs/latency.md again, in about an hour.
# `make docs` builds the documentation as a site, in build/site. `make wheel` builds a wheel for machines like this one,
# with the planner compiled (it needs `ld`, of binutils); `pip wheel .` builds one for all, whose first flight compiles.
# All that is needed is git, make and Python >= 3.11 with venv; the first call sets everything up.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
RUN ?=

# Tests start hundreds of processes of this package: each would compile every module anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run test test-all check format docs wheel clean latency-figures

run: $(READY)
	$(BIN)/edc-swarm run $(RUN)

# Tests of real processes wait more than they compute, so four run side by side; of those marked `timing` only two, and
# one of a file. A machine may stall: one of them that fails is run once more, and named at the end; never one that says
# that a guarantee is broken.
RETRY := --reruns 1 --rerun-except broken -raR

test: $(READY)
	$(BIN)/pytest -n auto -m "not long" --ignore tests/processes --ignore tests/docker
	$(BIN)/pytest -n 4 $(RETRY) -m "not timing and not long" tests/processes

test-all: $(READY)
	$(BIN)/pytest -n auto --ignore tests/processes --ignore tests/docker
	$(BIN)/pytest -n 4 $(RETRY) -m "not timing" tests/processes
	$(BIN)/pytest -n 2 --dist loadfile $(RETRY) -m timing tests/processes tests/docker

check: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(READY)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

docs: $(READY)
	$(BIN)/sphinx-build -q -W --keep-going -b html -c docs . build/site
	@echo build/site/docs/contents.html

wheel: $(READY)
	$(BIN)/python -m processes.uav.compile_ahead --library edc_swarm/planner
	$(BIN)/pip wheel --quiet --no-deps --wheel-dir dist . ; built=$$?; rm edc_swarm/planner/kernels-*.so; exit $$built

# Both sweeps go on where they were; a figure is a quantity against an axis, of the simulator or of both engines.
latency-figures: $(READY)
	$(BIN)/edc-swarm latency --out build/latency
	$(BIN)/edc-swarm latency --engine processes --out build/latency-processes
	mkdir -p docs/latency
	for figure in held_pct makespan_s command_age_ms; do \
		cp build/latency/$$figure-by-delay.svg docs/latency/; \
	done
	cp build/latency/completed_pct-by-loss.svg docs/latency/
	for figure in held_pct fix_to_command_ms; do \
		cp build/latency-processes/$$figure-by-delay.svg docs/latency/$$figure-both-engines.svg; \
	done

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "error: PYTHON = $(PYTHON): must be Python >= 3.11 (make PYTHON=python3.12 ...)" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	@# Most modules of the tools are never imported: Python compiles the others when they are.
	$(BIN)/pip install --no-compile --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	$(BIN)/python -m processes.uav.compile_ahead
	@touch $@
