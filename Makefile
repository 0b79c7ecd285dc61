# One task runner, the same names for people and for CI. Needs: make, and Python >= 3.11 as `python3`
# (or `make PYTHON=python3.12 …`).
#
# Everything runs in one environment, .venv, made from requirements-dev.lock. The demo alone could do with
# requirements.lock, but whoever runs the demo runs the tests next, and one environment cannot disagree
# with itself.

PYTHON ?= python3
UV_VERSION := 0.13.8
CYCLONEDX_VERSION := 7.5.0
VENV := .venv
READY := $(VENV)/.ready
BIN := $(VENV)/bin
ARGS ?=

# One BLAS thread beats two at these matrix sizes, and leaves the second core to the tests beside it.
export OPENBLAS_NUM_THREADS ?= 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1

CODE := observer drivers tests benchmarks docs
COMPILE := build/uv/bin/uv pip compile --quiet --universal --python-version 3.11 --no-header --no-annotate \
	--no-emit-index-url --generate-hashes

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help env demo test unit system slow coverage lint format bench demo-under-load month hostile faults soak learning-campaign identify-campaign gap-campaign discover-campaign rods-campaign alarms-campaign alarms-observed forecast-campaign fleet-scaling config-mutants mutants figures container-check operations-check lock dist sbom clean

help:  ## list these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(READY)  ## the whole chain on a simulated machine with a live view; ARGS="--seconds 20" ends it
	$(BIN)/observer demo $(ARGS)

test: lint unit system  ## what every change is checked by: lint, then all tests but the slow ones
	@echo "make test: all passed"

lint: $(READY)  ## ruff, formatting, types, import contracts
	$(BIN)/ruff check $(CODE)
	$(BIN)/ruff format --check $(CODE)
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

# A test that fails beside others is tried once more by itself: what fails twice fails, what passes then is told.
AGAIN = { test $$? -eq 1 && echo "make $@: what failed is tried once more, by itself" >&2 && \
	$(BIN)/python -m pytest --last-failed --last-failed-no-failures none -v -p no:randomly -p no:benchmark; }

unit: $(READY)  ## tests without processes or servers, on two cores; ARGS goes to pytest
	$(BIN)/python -m pytest -m "not system and not slow" -n 2 --dist worksteal -p no:benchmark $(ARGS) || $(AGAIN)

system: $(READY)  ## tests with real processes, servers and routers, two files at a time; ARGS goes to pytest
	$(BIN)/python -m pytest -m "system and not slow" -n 2 --dist loadfile --no-loadscope-reorder -p no:benchmark $(ARGS) || $(AGAIN)

slow: $(READY) dist  ## the tests that take long, half an hour: whole searches, images, services under load; CI runs them too
	$(BIN)/python -m pytest -m slow -n 2 --dist loadfile --no-loadscope-reorder -p no:benchmark $(ARGS) || $(AGAIN)

coverage: $(READY)  ## which lines no test without processes runs; ARGS goes to pytest, "tests/model" is a part
	$(BIN)/python -m pytest -m "not system" -n 2 --dist worksteal -p no:benchmark --cov --cov-report= $(ARGS)
	$(BIN)/python -m coverage report

hostile: $(READY)  ## ten thousand hostile queries against a running service; ARGS goes to pytest
	HOSTILE_QUERIES=10000 $(BIN)/python -m pytest tests/publish/test_hostile.py -s -p no:benchmark $(ARGS)

bench: $(READY)  ## the speed table beside filterpy, statsmodels, solve_banded and the run kept last; keeps its ratios
	$(BIN)/python -m benchmarks --compare --keep $(ARGS)

demo-under-load: $(READY)  ## the demo in a terminal for ten minutes, a busy loop on every core, beside the truth
	$(BIN)/python -m pytest tests/system/demo_for_ten_minutes.py -s -p no:benchmark $(ARGS)

month: $(READY)  ## two simulated months of a machine as configured: at most one false reason each
	$(BIN)/python -m pytest tests/reference/months_as_configured.py -s -p no:benchmark $(ARGS)

faults: $(READY)  ## the table of faults: what other daemons promise, and what this one does; three minutes; needs chromium and mosquitto
	$(BIN)/python -m tests.faults

soak: $(READY)  ## an hour of the service with faults and clients coming and going; ARGS="--minutes 10"
	$(BIN)/python -m tests.soak $(ARGS)

learning-campaign: $(READY)  ## what learning is worth on 144 machines, or go on where it was stopped
	$(BIN)/python -m tests.learning.trial

identify-campaign: $(READY)  ## do the true heats of 16 logs lie within their bands? Or go on
	$(BIN)/python -m tests.learning.histories

gap-campaign: $(READY)  ## months of machines in which something appears, or nothing does; or go on
	$(BIN)/python -m tests.gap.trial

discover-campaign: $(READY)  ## search hidden effects in 1272 cases, or go on; ARGS="--slice ci --folder build/slice"
	$(BIN)/python -m tests.campaign $(ARGS)

rods-campaign: $(READY)  ## search heated rods for what is hidden in them, or go on
	$(BIN)/python -m tests.rods.trial

alarms-campaign: $(READY)  ## how often alarms of heats are false on simulated months, and how early wear is told
	$(BIN)/python -m tests.alarms.trial $(ARGS)

alarms-observed: $(READY)  ## every alarm of rough machines by the real observer, over simulated weeks; or go on
	$(BIN)/python -m tests.alarms.observed

forecast-campaign: $(READY)  ## do temperatures and error of the next hour lie within their bands? Or go on
	$(BIN)/python -m tests.forecast.trial

fleet-scaling: $(READY)  ## logs a second by one worker and by two, in pairs; ARGS="--logs 400 --pairs 3"
	$(BIN)/python -m tests.fleet.scaling $(ARGS)

config-mutants: $(READY)  ## 2000 wrong configurations, each to be answered in words; ARGS="--count 600 --seed 2"
	$(BIN)/python -m tests.hostile --count 2000 $(ARGS)

mutants: $(READY)  ## change the code in small ways: do the nearest tests notice? ARGS="--count 10 --only align"
	$(BIN)/python -m tests.mutants $(ARGS)

figures: $(READY)  ## draw the figures of docs/ again
	for script in docs/figures/[a-z]*.py; do $(BIN)/python $$script || exit 1; done

container-check: $(READY)  ## the Dockerfile's steps without a container engine, as an unprivileged user
	$(BIN)/python -m pytest tests/packaging/test_dockerfile_steps.py -m slow -s -p no:benchmark $(ARGS)

operations-check: $(READY) dist  ## docs/operations.md carried out on a Debian of its own, as root; fetches 150 MB
	$(BIN)/python -m pytest tests/packaging/test_operations.py -s -p no:benchmark $(ARGS)

format: $(READY)  ## format the code and mend what ruff can mend
	$(BIN)/ruff format $(CODE)
	$(BIN)/ruff check --fix $(CODE)

env: $(READY)  ## make or renew the environment only

# The environment is remade from nothing when a lock changes, so that a dropped package does not linger.
$(VENV)/.locked: requirements-dev.lock requirements-build.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "$(PYTHON) is missing or older than 3.11; install one or name it: make PYTHON=python3.12 …" >&2; exit 2; }
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements-build.lock -r requirements-dev.lock
	@touch $@

$(READY): $(VENV)/.locked pyproject.toml
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

lock: build/uv/bin/uv  ## write the lock files again; ARGS=--upgrade takes the newest versions
	$(COMPILE) $(ARGS) --all-extras pyproject.toml --output-file requirements.lock
	$(COMPILE) $(ARGS) --extra page --extra plant --constraint requirements.lock pyproject.toml --output-file requirements-daemon.lock
	$(COMPILE) $(ARGS) --all-extras pyproject.toml --group dev --output-file requirements-dev.lock
	$(COMPILE) $(ARGS) --group build --output-file requirements-build.lock

build/uv/bin/uv:
	$(PYTHON) -m venv build/uv
	build/uv/bin/python -m pip install --quiet uv==$(UV_VERSION)

dist: build/uv/bin/uv  ## the source distribution and the wheel, in dist/
	rm -rf dist
	build/uv/bin/uv build --quiet --build-constraint requirements-build.lock --require-hashes --out-dir dist .

sbom: build/sbom/bin/cyclonedx-py  ## the software bill of materials: what requirements.lock installs, in dist/
	mkdir -p dist
	build/sbom/bin/cyclonedx-py requirements requirements.lock --pyproject pyproject.toml --mc-type application \
		--output-reproducible --output-format JSON --output-file dist/ballscrew-observer.cdx.json

build/sbom/bin/cyclonedx-py:
	$(PYTHON) -m venv build/sbom
	build/sbom/bin/python -m pip install --quiet cyclonedx-bom==$(CYCLONEDX_VERSION)

clean:  ## remove the environment and everything made
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .benchmarks \
		.import_linter_cache .coverage
	find $(CODE) -name __pycache__ -type d -prune -exec rm -rf {} +
