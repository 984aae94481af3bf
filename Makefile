# Each target does its own set-up on a fresh machine with Python 3.11 or newer.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
VENV_ROS := .venv-ros
VENV_OPENVINO := .venv-openvino
FUZZ_SECONDS ?= 1800

.PHONY: demo test coverage test-slow fuzz test-ros test-openvino test-pythons docs full-setup check format bench wheels wheel-check clean

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

# tests that run on a machine without recordings, cameras, ROS, a browser or a GPU; what silently skips
# turns the run red
LEAST_EXECUTED ?= 2700

coverage: $(READY)        ## all tests but the slow ones, with floors on lines covered and on tests executed
	$(BIN)/python -m pytest -n auto --cov --cov-report=term --least-executed $(LEAST_EXECUTED)

test-slow: $(READY)       ## the slow tests
	$(BIN)/python -m pytest -m slow -n auto

fuzz: $(READY)            ## damaged files for every reader, for FUZZ_SECONDS (1800); failing ones stay in fuzz_failures/
	$(BIN)/python -m tests.fuzz.run $(FUZZ_SECONDS)

# what of tests/ros needs no ROS runs among the other tests
test-ros:                 ## the ROS 2 node over real DDS; skipped where there are no wheels of ROS
	$(PYTHON) -m venv $(VENV_ROS)
	$(VENV_ROS)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,gps,synth]' colcon-ros
	@if $(VENV_ROS)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,gps,synth,ros]'; then \
	  $(VENV_ROS)/bin/python -m pytest -m 'slow or not slow' $$(grep -l rclpy tests/ros/test_*.py); \
	else \
	  echo "skipped: the wheels of ROS 2 cannot be had for this Python and platform (see above)"; \
	fi

test-openvino:            ## the network by OpenVINO's provider against the CPU's; skipped where there is no wheel of it
	$(PYTHON) -m venv $(VENV_OPENVINO)
	$(VENV_OPENVINO)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	$(VENV_OPENVINO)/bin/python -m pip uninstall --quiet --disable-pip-version-check --yes onnxruntime
	@if $(VENV_OPENVINO)/bin/python -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps onnxruntime-openvino; then \
	  $(VENV_OPENVINO)/bin/python -c 'import onnxruntime as o; assert "OpenVINOExecutionProvider" in o.get_available_providers()' && \
	  $(VENV_OPENVINO)/bin/python -m pytest tests/models/test_providers.py; \
	else \
	  echo "skipped: there is no onnxruntime-openvino for this Python and platform (see above)"; \
	fi

test-pythons:             ## the tests on each version of Python that is declared and found, in environments of their own
	@for version in 3.11 3.12 3.13; do \
	  if command -v python$$version >/dev/null && python$$version -c '' 2>/dev/null; then \
	    $(MAKE) test PYTHON=python$$version VENV=.venv-$$version || exit 1; \
	  else \
	    echo "skipped: no python$$version on this machine"; \
	  fi; \
	done

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

docs: $(READY)            ## the pages and the API as a site in site/, searchable and readable without a network
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

bench: $(READY)           ## the numbers of docs/benchmarks.md
	$(BIN)/python benchmarks/bench_pipeline.py

wheels: $(READY)          ## the package and the models of the gardens, into dist/
	rm -rf build dist
	$(BIN)/python -m build --wheel --outdir dist .
	$(BIN)/python -m build --wheel --outdir dist garden_assets

wheel-check: wheels       ## build both wheels, install them in a clean environment, run the demo and open the models from them
	rm -rf build/clean && $(PYTHON) -m venv build/clean
	build/clean/bin/python -m pip install --quiet --disable-pip-version-check dist/*.whl
	cd build && clean/bin/swardmap demo --out demo --frames 3 --overwrite
	cd build && clean/bin/python -c 'from swardmap.synth.assets import open_assets; print("models of the gardens:", open_assets().digest)'

clean:
	rm -rf build dist demo site .mypy_cache .ruff_cache .pytest_cache .hypothesis
