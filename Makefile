# `make run` flies the default mission, `make test` runs every test, `make check` the linters.
# All that is needed is git, make and Python >= 3.11 with venv; the first call sets everything up.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
RUN ?=

.PHONY: run test check format clean

run: $(READY)
	$(BIN)/edc-swarm run $(RUN)

# Tests of real processes are about time, so they run one after the other; all others in parallel.
test: $(READY)
	$(BIN)/pytest -n auto --ignore tests/processes --ignore tests/docker
	$(BIN)/pytest tests/processes tests/docker

check: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(READY)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "error: PYTHON = $(PYTHON): must be Python >= 3.11 (make PYTHON=python3.12 ...)" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@
