# Each target does its own set-up on a fresh machine with Python 3.11 or newer.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
VENV_ROS := .venv-ros

.PHONY: demo test test-slow test-ros full-setup check format bench wheel-check clean

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "swardmap needs Python 3.11 or newer; name one: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

demo: $(READY)            ## the main job: a garden to an obstacle map, pictures in demo/
	$(BIN)/swardmap demo --out demo --overwrite

test: $(READY)            ## all tests but the slow ones
	$(BIN)/python -m pytest -n auto

test-slow: $(READY)       ## the slow tests
	$(BIN)/python -m pytest -m slow

test-ros:                 ## the ROS 2 node over real DDS; skipped where there are no wheels of ROS
	$(PYTHON) -m venv $(VENV_ROS)
	$(VENV_ROS)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,gps]' colcon-ros
	@if $(VENV_ROS)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,gps,ros]'; then \
	  $(VENV_ROS)/bin/python -m pytest -m 'slow or not slow' tests/ros; \
	else \
	  echo "skipped: the wheels of ROS 2 cannot be had for this Python and platform (see above)"; \
	fi

full-setup: $(READY)      ## every extra that runs without hardware; torch first, as a CPU build where there is one
	$(BIN)/python -m pip install --quiet --disable-pip-version-check torch==2.13.0
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,train,ray,synth,view,gps]'

check: $(READY)           ## linters and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(READY)          ## put the code in order
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(READY)           ## the numbers of docs/benchmarks.md
	$(BIN)/python benchmarks/bench_pipeline.py

wheel-check: $(READY)     ## build the wheel, install it in a clean environment, run the demo from it
	rm -rf build dist
	$(BIN)/python -m build --wheel --outdir dist .
	rm -rf build/clean && $(PYTHON) -m venv build/clean
	build/clean/bin/python -m pip install --quiet --disable-pip-version-check dist/*.whl
	cd build && clean/bin/swardmap demo --out demo --frames 3 --overwrite

clean:
	rm -rf build dist demo .mypy_cache .ruff_cache .pytest_cache .hypothesis
