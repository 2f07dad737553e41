# make demo: complete the sample frame.  make check, make docs, make test: what CI runs.
# make bench: time and memory on this machine (docs/performance.md).  make page: the page in a browser.
# make faults: the long tests of docs/reliability.md, an hour.  make sbom: what is installed, CycloneDX.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := src tests rooms training benchmarks examples docs

.PHONY: demo test check docs format bench page faults sbom

# one environment, one stamp per set of requirements
$(VENV)/.user: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	touch $@

$(VENV)/.dev: $(VENV)/.user
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,all,docs,train]'
	touch $@

demo: $(VENV)/.user
	$(BIN)/python examples/demo.py

test: $(VENV)/.dev
	$(BIN)/python -m pytest -q

check: $(VENV)/.dev
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/lint-imports
	$(BIN)/mypy

docs: $(VENV)/.dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

format: $(VENV)/.dev
	$(BIN)/ruff check --fix $(SOURCES)
	$(BIN)/ruff format $(SOURCES)

bench: $(VENV)/.user
	$(BIN)/python -m benchmarks.waiting
	$(BIN)/python -m benchmarks.performance
	$(BIN)/python -m benchmarks.growth

page: $(VENV)/.dev
	$(BIN)/python -m pytest -q -m browser tests/app

faults: $(VENV)/.dev
	FAULTS=10000 $(BIN)/python -m pytest -q -m "slow or not slow" tests/faults tests/batch

sbom: $(VENV)/.dev
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt cyclonedx-bom
	$(BIN)/cyclonedx-py environment $(BIN)/python -o sbom.json
