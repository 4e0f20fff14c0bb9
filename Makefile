# `make demo` and `make test` set up all they need in .venv: Python 3.10 to 3.13, git and make are enough.

SUPPORTED := import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))
PYTHON ?= $(shell for python in python3 python3.12 python3.11 python3.13 python3.10; do \
	$$python -c '$(SUPPORTED)' 2>/dev/null && { echo $$python; break; }; done)
BIN := .venv/bin
# Files beside each other: many tests wait for processes.
PYTEST := $(BIN)/pytest -n 2 --dist loadfile
PACKAGE := setup.py package.xml $(wildcard config/* launch/*)

.PHONY: demo test test-bounds lint tables clean

demo: .venv/installed
	$(BIN)/lrtrav demo --output demo --overwrite

test: .venv/installed-for-tests
	$(PYTEST)

# An index outside its array is an error here. Kernels with that check need a cache of their own.
test-bounds: .venv/installed-for-tests
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR="$(CURDIR)/.cache/numba-boundscheck" $(PYTEST)

lint: .venv/installed-for-tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

tables: .venv/installed
	$(BIN)/python docs/make_tables.py

clean:
	rm -rf .venv .cache build install log demo *.egg-info

$(BIN)/python:
	$(if $(PYTHON),,$(error No Python 3.10 to 3.13 found: install one, or name it: make PYTHON=/path/to/python))
	$(PYTHON) -m venv .venv

.venv/installed: $(BIN)/python $(PACKAGE)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable .
	touch $@

.venv/installed-for-tests: $(BIN)/python $(PACKAGE)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable .[test]
	touch $@ .venv/installed
