# make run · make test · make test-fast · make test-lowest · make coverage · make lint · make bench · make soak: each sets up .venv by itself, once.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
DOCS := $(VENV)/.docs
EXTRAS := .[ros,report,campaign,test]

# uv takes a third of pip's time; where it cannot be had or finds no index, pip installs the same.
define install
$(BIN)/python -m pip install --quiet --disable-pip-version-check uv -c constraints.txt && \
  $(BIN)/uv pip install --quiet --python $(BIN)/python --compile-bytecode -c constraints.txt -e '$(1)' || \
  $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '$(1)'
endef

.PHONY: run test test-long test-fast test-lowest coverage lint warm bench bench-campaign soak screenshots format schema docs

run: $(READY)
	$(BIN)/weld-force demo

test: $(DOCS)
	$(BIN)/pytest -n 3 --dist loadfile # more than cores: tests of nodes mostly wait

coverage: $(DOCS)
	$(BIN)/pytest -n 2 --dist loadfile --cov --cov-fail-under=90

test-long: $(DOCS)
	$(BIN)/pytest -n 2 --dist loadfile --long -m long

test-fast: $(DOCS)
	$(BIN)/pytest -n 2 --dist loadfile -m 'not slow'

# The lowest versions that pyproject.toml allows, which are those of Ubuntu 24.04 where that has them: the science, the
# recordings and the command line, without ROS. What is old may be deprecated.
LOWEST := .venv-lowest
test-lowest: $(LOWEST)/.ready
	$(LOWEST)/bin/pytest -n 2 --dist loadfile -m 'not slow' -W ignore::DeprecationWarning \
	  tests/messages tests/physics tests/measurement tests/simulation tests/assessment tests/recording tests/cli
	$(LOWEST)/bin/weld-force replay verify bags/demo

$(LOWEST)/.ready: pyproject.toml $(READY)
	$(BIN)/uv venv --quiet --clear --python $(BIN)/python $(LOWEST)
	$(BIN)/uv pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct -e '.[report,foreign,test]'
	touch $@

# The documentation, into out/site; needs no network, and a warning is an error.
docs: $(DOCS)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

lint: $(DOCS)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	@if command -v npm > /dev/null; then \
	  npm install --no-package-lock --no-audit --no-fund --silent && npm run --silent types; \
	else echo "lint: no npm on PATH; the pages' JavaScript is not checked" >&2; fi

# What the first simulation compiles, and the hanging sleepers that many tests ask for: a minute and a half, on one core.
warm: $(READY)
	$(BIN)/weld-force simulate tests/data/instrument_files/dip_clean.csv --uncertainty-samples 32 --json /dev/null
	for hanging in 0=0.02 0=0.02,1=0.02; do \
	  $(BIN)/weld-force simulate tests/data/instrument_files/dip_clean.csv --track bilbao-viscous --support $$hanging \
	    --speeds 80 --positions 2 --uncertainty-samples 0 --json /dev/null > /dev/null || exit; \
	done

bench: $(READY)
	$(BIN)/weld-force bench

bench-campaign: $(READY)
	$(BIN)/python -m benchmarks.campaign

soak: $(READY)
	$(BIN)/python -m tests.soak.malformed
	$(BIN)/python -m benchmarks.detection
	$(BIN)/python -m tests.soak.kills
	$(BIN)/python -m tests.soak.lives
	$(BIN)/python -m tests.soak.clients
	$(BIN)/python -m tests.soak.endurance

screenshots: $(READY)
	$(BIN)/python -m benchmarks.screenshots docs

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

schema: $(READY)
	$(BIN)/weld-force schema --write msgs_json --config weld_force_ros/data/config
	$(BIN)/python -m benchmarks.interface_page > docs/nodes.md

$(READY): pyproject.toml constraints.txt setup.py setup.cfg package.xml launch/weld_force.launch.py
	$(PYTHON) -c 'import sys; sys.exit(0 if (3, 11) <= sys.version_info[:2] < (3, 14) else "Python 3.11 to 3.13 is needed; name it: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(call install,$(EXTRAS))
	touch $(READY)

# The site's builder is no part of what runs, and needs Python 3.11.5.
$(DOCS): $(READY)
	$(call install,.[docs])
	touch $(DOCS)
