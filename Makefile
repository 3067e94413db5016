# Every target sets up what it needs: a virtual environment in .venv with the locked dependencies.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO ?= demo
TESTS := $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: demo test long lint docs validate blind golden versions bench lock clean
.DEFAULT_GOAL := demo

$(VENV)/ready: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed" if sys.version_info < (3, 11) else 0)'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

demo: $(VENV)/ready
	$(BIN)/testbed demo -o $(DEMO)

test: $(VENV)/ready
	$(TESTS) -m "not long"

long: $(VENV)/ready
	$(TESTS) -m long

lint: docs
	$(BIN)/ruff check .
	rm -rf build/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --target build/installed .
	$(BIN)/mypy
	cd build/installed && ../../$(BIN)/lint-imports --config ../../pyproject.toml

# The site, into site/: offline; a link, an anchor or a name of the reference that leads nowhere is an error
docs: $(VENV)/ready
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

validate: $(VENV)/ready
	$(BIN)/python -m tests.validation.run

blind: $(VENV)/ready
	$(BIN)/python -m tests.validation.blind.judge --first 3000 --count 202  # some seeds make no campaign
	$(BIN)/python -m tests.validation.blind.judge --first 4001 --count 138
	$(BIN)/python -m tests.validation.blind.judge --first 6001 --count 21
	$(BIN)/python -m tests.validation.blind.plane --first 8000 --count 60
	$(BIN)/python -m tests.validation.blind.propose
	$(BIN)/python -m tests.validation.outside.judge --count 120

# How some campaigns walk through the diagnosis, compared with what is kept: before and after a change of the search
golden: $(VENV)/ready
	$(BIN)/python -m tests.validation.golden

# The lowest declared and the newest allowed dependencies; VERSIONS=all: with all tests that are not long
versions: $(VENV)/ready
	$(BIN)/python -m tests.validation.run versions

bench: $(VENV)/ready
	$(BIN)/python benchmarks/run.py

# extras.lock: what a user of any extra gets. Apart, since `make test` needs neither a cluster's queues nor the benchmark's peers.
COMPILE := $(BIN)/uv pip compile --universal --generate-hashes --no-header --no-emit-index-url --no-annotate \
	--python-version 3.11 pyproject.toml
lock:
	$(COMPILE) --extra dev --extra docs build-requirements.in -o requirements.lock
	$(COMPILE) --extra formats --extra fast --extra cluster --extra bench --extra tap -c requirements.lock -o extras.lock

clean:
	rm -rf $(VENV) $(DEMO) site
