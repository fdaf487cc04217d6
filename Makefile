# The only task runner. Every target sets up .venv by itself.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
READY := $(VENV)/.ready
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt

# What is compiled from Python text is kept: the tests start hundreds of processes, and each would compile its own.
unexport PYTHONDONTWRITEBYTECODE

PYTEST := $(BIN)/python -m pytest --numprocesses auto --maxprocesses 5 --dist worksteal
PYTEST_OPTIONS ?=
OTHER_PROCESSOR := $(BIN)/python -m tests.support.other_processor
NUMBERS := tests/golden tests/laws tests/conformance tests/workers/solvers \
	tests/workers/cli/test_doctor.py $(addprefix tests/workers/computation/test_,outputs.py tiers.py) \
	tests/workers/sweeping/test_sweeping.py tests/workers/sweeping/parameters/test_family.py

.PHONY: demo serve test test-long test-portable test-container compiled-wheel lint docs bench screenshots format clean

# What running needs. Python compiles modules when they are first imported, which is sooner done than all at once.
$(INSTALLED): pyproject.toml constraints.txt service/client/pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable . --editable service/client
	touch $(INSTALLED)

# And what developing needs.
$(READY): $(INSTALLED)
	$(PIP) --editable '.[dev]'
	touch $(READY)

demo: $(INSTALLED)
	$(BIN)/python examples/demo.py

serve: $(INSTALLED)
	$(BIN)/polhode serve

test: $(READY)
	$(BIN)/polhode compile
	$(PYTEST) $(PYTEST_OPTIONS)

# What takes long and finds seldom: storms, a calibration in earnest, random laws with many examples, or with some.
EXAMPLES ?= many
test-long: $(READY)
	$(BIN)/polhode compile
	POLHODE_TEST_EXAMPLES=$(EXAMPLES) $(PYTEST) $(PYTEST_OPTIONS) -m 'long or random_law'

# The suites of numbers as on a processor with fewer features: docs/operations.md, "Unlike processors".
test-portable: $(READY)
	$(OTHER_PROCESSOR) $(BIN)/polhode compile
	$(OTHER_PROCESSOR) $(PYTEST) $(PYTEST_OPTIONS) $(NUMBERS)

# All kernels, compiled for the level of this processor, as a package: docs/operations.md, "Compiled code".
compiled-wheel: $(READY)
	rm -rf build/polhode_compiled
	NUMBA_CACHE_DIR=$(CURDIR)/build/polhode_compiled $(BIN)/polhode compile
	$(BIN)/python -m pip wheel --no-deps --wheel-dir build ./docker/compiled

# Builds the image and runs every service of docker/compose.yaml from it; needs root, buildah and debootstrap.
test-container: $(READY)
	$(BIN)/python -m tests.container

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# The documentation as pages in build/site, without a warning. Notebooks are executed; FIGURES=1 draws pictures anew.
docs: $(READY)
	$(if $(FIGURES),for script in theorem gallery classical; do $(BIN)/python docs/figures/$$script.py || exit 1; done)
	EXECUTE_NOTEBOOKS=1 NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict -f docs/site/mkdocs.yml

bench: $(READY)
	$(BIN)/polhode compile
	$(BIN)/python -m tests.benchmarks

# Pictures of the page for docs/, taken with Chromium.
screenshots: $(READY)
	$(BIN)/python -m tests.browser.screenshots

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
