# `make demo` and `make test` set up all they need in .venv: Python 3.10 to 3.13, git and make are enough.

SUPPORTED := import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))
PYTHON ?= $(shell for python in python3 python3.12 python3.11 python3.13 python3.10; do \
	$$python -c '$(SUPPORTED)' 2>/dev/null && { echo $$python; break; }; done)
# Another version of Python, where it is installed, by pyenv too: $(call installed,3.13).
installed = $(shell for python in python$(1) $(or $(PYENV_ROOT),$(HOME)/.pyenv)/versions/$(1).*/bin/python; do \
	$$python -c '$(SUPPORTED)' 2>/dev/null && { echo $$python; break; }; done)
VENV := .venv
CONSTRAINTS :=
BIN := $(VENV)/bin
# Files beside each other: many tests wait for processes.
PYTEST := $(BIN)/pytest -n 2 --dist loadfile
# An index outside its array is an error here. Kernels with that check need a cache of their own.
BOUNDS := NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR="$(CURDIR)/.cache/numba-boundscheck"
# Minutes of each of the two runs of `make fuzz`.
MINUTES ?= 10
FUZZ := $(BIN)/pytest -n 2 test/fuzz
PACKAGE := setup.py package.xml $(wildcard config/* launch/*)

.PHONY: demo test test-bounds test-oldest fuzz siege soak coverage lint tables clean

demo: $(VENV)/installed
	$(BIN)/lrtrav demo --output demo --overwrite

test: $(VENV)/installed-for-tests
	$(PYTEST)

# One run for two questions: array bounds, and the newest Python where that is installed.
test-bounds:
	$(BOUNDS) $(MAKE) test VENV=.venv-newest PYTHON=$(or $(call installed,3.13),$(PYTHON))

# What test/fuzz does shortly, for long: other examples in every run. Those that fail are kept in .cache, and tried first.
fuzz: $(VENV)/installed-for-tests
	FUZZ_MINUTES=$(MINUTES) $(FUZZ)
	$(BOUNDS) FUZZ_MINUTES=$(MINUTES) $(FUZZ)

# Hostile messages on every input of the nodes, among good frames: make siege MESSAGES=2000.
siege: $(VENV)/installed-for-tests
	$(BIN)/python test/nodes/hostile_messages.py --messages $(or $(MESSAGES),20000)

# Frames at full speed through the nodes, with all that happens in days: make soak FRAMES=100000.
soak: $(VENV)/installed-for-tests
	$(BIN)/python benchmarks/soak.py --frames $(or $(FRAMES),20000)
	$(BIN)/python benchmarks/soak.py --frames $(or $(FRAMES),20000) --executable detector

# The oldest dependencies that setup.py allows, on the oldest Python where that is installed. Each numba caches kernels of
# its own.
test-oldest:
	NUMBA_CACHE_DIR="$(CURDIR)/.cache/numba-oldest" $(MAKE) test VENV=.venv-oldest \
		PYTHON=$(or $(call installed,3.10),$(PYTHON)) CONSTRAINTS="--constraint test/oldest-dependencies.txt"

# Branches of the package that the tests take, and the lines that they do not, in .cache/coverage.txt.
coverage: $(VENV)/installed-for-tests
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest -n 2 --dist loadfile
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report --show-missing --sort=miss | tee .cache/coverage.txt

lint: $(VENV)/installed-for-tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

tables: $(VENV)/installed
	$(BIN)/python docs/make_tables.py

clean:
	rm -rf .venv .venv-oldest .venv-newest .cache build install log demo *.egg-info

$(BIN)/python:
	$(if $(PYTHON),,$(error No Python 3.10 to 3.13 found: install one, or name it: make PYTHON=/path/to/python))
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(BIN)/python $(PACKAGE)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable . $(CONSTRAINTS)
	touch $@

$(VENV)/installed-for-tests: $(BIN)/python $(PACKAGE)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable .[test] $(CONSTRAINTS)
	touch $@ $(VENV)/installed
