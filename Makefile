# Every target makes its own virtual environment first: a fresh machine needs Python >= 3.11
# and make, nothing else.
PYTHON ?= $(firstword $(foreach name,python3.13 python3.12 python3.11 python3 python,$(shell \
  $(name) -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 && echo $(name))))
BIN := .venv/bin

.PHONY: help demo test tests thorough blas extras lowest newest lint bench docs validation plotly release clean

help:
	@echo "make demo   simulate an instrument, calibrate it, write a report to demo/"
	@echo "make test   lint and tests, side by side"
	@echo "make thorough   the tests of a third of a second and more"
	@echo "make blas   the numerical tests, with the arithmetic of another processor"
	@echo "make extras   whether all extras can be installed beside one another, as pinned"
	@echo "make lowest   calibrations with the lowest versions that are allowed"
	@echo "make newest   calibrations and tests with the newest, on every Python there is"
	@echo "make lint   style, types and layers"
	@echo "make bench  speed beside other programs; writes benchmarks/README.md"
	@echo "make docs   the documentation as a web site in site/"
	@echo "make validation   more than an hour: the tables of docs/validation, written again"
	@echo "make plotly   the figures' library in the package, of the version in design/plotly"
	@echo "make release   sdist and wheel in dist/, tried in an empty environment"

demo: .venv/installed-run
	$(BIN)/foucault demo -o demo

# The types take a minute of one processor.
test: .venv/installed-dev
	@$(MAKE) --no-print-directory -j2 lint tests

# Needs npm; the library it writes is kept, so that nobody else does.
plotly:
	cd design/plotly && npm install --no-audit --no-fund && npm run build

# Small matrices: a second BLAS thread only costs. Neighbours stay with one worker, which has their
# fixtures already. Programs that tests start should find what was compiled of Python.
PYTEST = OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/pytest -n auto --dist worksteal

QUICK = not thorough and not long

# A test that fails beside others runs again by itself: what fails then too is wrong, what passes
# needed more of a busy machine than it got.
ALONE = $(subst -n auto --dist worksteal,-n 0 --last-failed --last-failed-no-failures=none,$(PYTEST))

# To rewrite what is asserted takes each worker half a minute in a fresh clone: only what fails runs
# again with it, and then says its numbers.
tests: .venv/installed-dev
	$(PYTEST) -m "$(QUICK)" --assert=plain || $(ALONE) -m "$(QUICK)"

# Statistics over many sessions, searches, studies that are killed, peak memory, the release.
thorough: .venv/installed-dev
	$(PYTEST) -m "thorough or long" --assert=plain || $(ALONE) -m "thorough or long"

# OpenBLAS has another arithmetic for each processor: nothing may hang on its rounding. Prescott's,
# without fused operations, runs on every x86 and is unlike all of today.
NUMERICAL = $(addprefix tests/,diagnose estimate infer kernels models navigate papers plans \
  procedures/test_systematic_plan.py)
blas: .venv/installed-dev
	OPENBLAS_CORETYPE=Prescott $(PYTEST) -m "not thorough" --assert=plain $(NUMERICAL) || \
	  OPENBLAS_CORETYPE=Prescott $(ALONE) -m "not thorough" $(NUMERICAL)

# uv resolves to the lowest; in environments of their own, since they are other versions.
UV = build/uv/bin/uv
build/uv/bin/uv:
	$(PYTHON) -m venv build/uv
	build/uv/bin/python -m pip install --quiet uv

# Resolved, not installed.
extras: build/uv/bin/uv
	$(UV) pip compile --quiet --python $(PYTHON) --constraint constraints.txt \
	  --all-extras --output-file build/extras.txt pyproject.toml

NEWEST = python3.11 python3.12 python3.13
OLDEST = $(shell command -v python3.11)
lowest: build/uv/bin/uv
ifeq ($(OLDEST),)
	@echo "make lowest: skipped, python3.11 was not found"
else
	$(UV) venv --quiet --clear --python $(OLDEST) build/lowest
	$(UV) pip install --quiet --python build/lowest/bin/python --resolution lowest-direct .
	OPENBLAS_NUM_THREADS=1 build/lowest/bin/python tests/calibrations.py
endif

# The shims of pyenv answer only for the versions that are named.
newest: export PYENV_VERSION := $(shell pyenv versions --bare 2>/dev/null | paste -sd: -)
newest: build/uv/bin/uv
	@for name in $(NEWEST); do \
	  $$name -c '' >/dev/null 2>&1 || { echo "make newest: skipped, no $$name"; continue; }; \
	  python=build/newest-$$name/bin/python; \
	  $(UV) venv --quiet --clear --python $$name build/newest-$$name && \
	  $(UV) pip install --quiet --python $$python '.[dev]' && \
	  OPENBLAS_NUM_THREADS=1 $$python tests/calibrations.py && \
	  OPENBLAS_NUM_THREADS=1 $$python -m pytest -n auto -m "not thorough" \
	    tests/logs tests/fuzz tests/test_units.py tests/test_cli.py || exit 1; \
	done

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/mypy

bench: .venv/installed-bench
	$(BIN)/python benchmarks/run.py

docs: .venv/installed-docs
	$(BIN)/python docs/generate.py build/docs
	$(BIN)/sphinx-build -W --keep-going -q -c docs -d build/doctrees build/docs site

# All of them, also after one that fails; make then ends with an error.
validation: .venv/installed-bench
	$(BIN)/python validation/run.py

# The demo runs from the wheel with what it requires and nothing else.
release: .venv/installed-release
	rm -rf dist build
	$(BIN)/python -m build
	$(PYTHON) -m venv build/empty
	build/empty/bin/python -m pip install --quiet --constraint constraints.txt dist/*.whl
	cd build && empty/bin/foucault demo -o demo

clean:
	rm -rf .venv build dist site demo .mypy_cache .ruff_cache .pytest_cache

.venv/bin/python:
	@test -n "$(PYTHON)" || { echo "Foucault needs Python 3.11 or later; none was found." >&2; exit 1; }
	$(PYTHON) -m venv .venv

# One stamp per set of extras, so that `make demo` installs only what a user would.
.venv/installed-%: constraints.txt pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.$(if $(filter run,$*),,[$*])'
	@touch $@
.PRECIOUS: .venv/installed-%
