# One task runner, the same names for people and for CI. Needs: make, and Python >= 3.11 with its headers as
# `python3` (or `make PYTHON=python3.12 …`). A C compiler is taken where there is one (build_kernels.py).
#
# Everything runs in one environment, .venv, so that nothing can disagree: for the demo it holds what the program
# itself needs, requirements.lock, which is half as much to fetch; the first target that tests adds the rest,
# requirements-dev.lock, which pins the same versions. All extras are in it from the beginning (they are a fifth of
# it), so that every command of the tutorial works after the demo.

PYTHON ?= python3
UV_VERSION := 0.13.8
CYCLONEDX_VERSION := 7.5.0
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=

# A uv on the path is taken if it is not older than the one that is known to do; else that one is installed here.
UV := $(shell printf '%s\n' $(UV_VERSION) "$$(uv --version 2>/dev/null | cut -d ' ' -f 2)" | sort -V -C \
	&& command -v uv || echo build/uv/bin/uv)

# Stamps. READY: the environment with all packages and the program in it; RUNS: with those of the program at least.
READY := $(VENV)/.ready
RUNS := $(if $(wildcard $(VENV)/requirements-dev.lock.synced),$(READY),$(VENV)/.runs)
# What the built kernels are made of.
KERNELS := build_kernels.py $(wildcard setup.py observer/kernels/*.py observer/kernels/*.pxd)

# One BLAS thread beats two at these matrix sizes, and leaves the second core to the tests beside it.
export OPENBLAS_NUM_THREADS ?= 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Tests start some hundred processes: one whose libraries are compiled anew takes twice as long until it works.
unexport PYTHONDONTWRITEBYTECODE

CODE := observer drivers tests campaigns benchmarks docs build_kernels.py $(wildcard setup.py)
COMPILE := $(UV) pip compile --quiet --universal --python-version 3.11 --no-header --no-annotate \
	--no-emit-index-url --generate-hashes
BUILD := $(UV) build --python $(PYTHON) --no-create-gitignore --build-constraint requirements-build.lock \
	--require-hashes --out-dir dist

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
# `make -j demo test` would make the environment for both at once.
.NOTPARALLEL:
.PHONY: help env runtime demo test announced near unit system processors slow nightly coverage lint format bench demo-under-load month hostile faults soak learning-campaign identify-campaign gap-campaign discover-campaign rods-campaign alarms-campaign releases-campaign alarms-observed forecast-campaign integrity first-day fleet-scaling config-mutants mutants reference evidence figures docs container-check operations-check lock dist wheels sbom clean

help:  ## list these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(RUNS)  ## the whole chain on a simulated machine with a live view; ARGS="--seconds 20" ends it
	$(BIN)/observer demo $(ARGS)

test: announced lint unit system  ## the checks that every change must pass: lint, then all tests but the slow ones
	@echo "make test: all passed"

announced:
	@echo "make test takes about 20 minutes on two quiet cores, after the environment is made."
	@for program in chromium mosquitto prometheus clang cppcheck; do \
	  PATH="$$PATH:/usr/sbin" command -v $$program > /dev/null || echo "$$program is missing: its tests are skipped; install the package of that name."; \
	done

near: $(READY)  ## the tests nearest to changed files, FILE="observer/model/couple.py"; ARGS goes to pytest
	$(BIN)/python -m tests.near $(FILE) --pytest="$(ARGS)"

lint: $(READY)  ## ruff, formatting, plain English, types of the product, campaigns and benchmarks, import contracts
	$(BIN)/ruff check $(CODE)
	$(BIN)/ruff format --check $(CODE)
	$(BIN)/python -m tests.plain_english
	$(BIN)/mypy --num-workers 2
	$(BIN)/lint-imports --no-cache

unit: $(READY)  ## tests without processes or servers, on two cores; ARGS goes to pytest
	$(BIN)/python -m pytest -m "not system and not slow" -n 2 --dist worksteal -p no:benchmark $(ARGS)

system: $(READY)  ## tests with real processes, servers and routers, four at a time; ARGS goes to pytest
	$(BIN)/python -m pytest -m "system and not slow" -n 4 --dist loadscope --no-loadscope-reorder -p no:benchmark $(ARGS)

processors: $(READY)  ## the numeric tests as on four generations of processors; CI runs them too
	$(BIN)/python -m tests.processors $(ARGS)

slow: $(READY) dist  ## the tests that take long: four whole searches, images, services under load; CI runs them too
	$(BIN)/python -m pytest -m "slow and not nightly" -n 2 --dist loadfile --no-loadscope-reorder -p no:benchmark $(ARGS)

nightly: $(READY)  ## the other whole searches; a release runs them too
	$(BIN)/python -m pytest -m nightly -n 2 --dist worksteal -p no:benchmark $(ARGS)

coverage: $(READY)  ## which lines no test without processes runs; ARGS goes to pytest, "tests/model" is a part
	$(BIN)/python -m pytest -m "not system" -n 2 --dist worksteal -p no:benchmark --cov --cov-report= $(ARGS)
	$(BIN)/python -m coverage report

hostile: $(READY)  ## ten thousand hostile queries against a running service; ARGS goes to pytest
	HOSTILE_QUERIES=10000 $(BIN)/python -m pytest tests/bus/test_hostile.py -s -p no:benchmark $(ARGS)

bench: $(READY)  ## the speed table beside filterpy, statsmodels, solve_banded and the run kept last; keeps its ratios
	$(BIN)/python -m benchmarks --compare --keep $(ARGS)

demo-under-load: $(READY)  ## the demo in a terminal for ten minutes, a busy loop on every core, beside the truth
	$(BIN)/python -m pytest campaigns/demo_under_load.py -s -p no:benchmark $(ARGS)

month: $(READY)  ## two simulated months of a machine as configured: at most one false reason each
	$(BIN)/python -m pytest campaigns/months_as_configured.py -s -p no:benchmark $(ARGS)

faults: $(READY)  ## the table of faults: what other daemons promise, and what this one does; three minutes; needs chromium and mosquitto
	$(BIN)/python -m campaigns.faults

soak: $(READY)  ## an hour of the service with faults and clients coming and going; ARGS="--minutes 10"
	$(BIN)/python -m campaigns.soak $(ARGS)

learning-campaign: $(READY)  ## what learning is worth on 144 machines, or go on where it was stopped
	$(BIN)/python -m campaigns.learning.trial

identify-campaign: $(READY)  ## do the true heats of 16 logs lie within their bands? Or go on
	$(BIN)/python -m campaigns.learning.histories

gap-campaign: $(READY)  ## months of machines in which something appears, or nothing does; or go on
	$(BIN)/python -m campaigns.gap.trial

discover-campaign: $(READY)  ## search hidden effects in 1272 cases, or go on; ARGS="--slice ci --folder build/slice"
	$(BIN)/python -m campaigns.discovery $(ARGS)

rods-campaign: $(READY)  ## search heated rods for what is hidden in them, or go on
	$(BIN)/python -m campaigns.rods.trial

alarms-campaign: $(READY)  ## how often alarms of heats are false on simulated months, and how early wear is reported
	$(BIN)/python -m campaigns.alarms.trial $(ARGS)

releases-campaign: $(READY)  ## a thousand drawn faults of an armed compensation: each release has one alarm
	$(BIN)/python -m campaigns.releases $(ARGS)

alarms-observed: $(READY)  ## every alarm of rough machines by the real observer, over simulated weeks; or go on
	$(BIN)/python -m campaigns.alarms.observed

forecast-campaign: $(READY)  ## do temperatures and error of the next hour lie within their bands? Or go on
	$(BIN)/python -m campaigns.forecast.trial

integrity: $(READY)  ## is what is called good right, whatever is wrong with the readings? 60 faults, 12 machines; or go on
	$(BIN)/python -m campaigns.integrity.trial $(ARGS)

first-day: $(READY)  ## 24 machines as most users have them, configured by init: is the error good, and right? Or go on
	$(BIN)/python -m campaigns.first_day $(ARGS)

fleet-scaling: $(READY)  ## logs a second by one worker and by two, in pairs; ARGS="--logs 400 --pairs 3"
	$(BIN)/python -m campaigns.fleet.scaling $(ARGS)

config-mutants: $(READY)  ## 2000 wrong configurations, each to be answered in words; ARGS="--count 600 --seed 2"
	$(BIN)/python -m campaigns.config_mutants --count 2000 $(ARGS)

evidence: $(READY)  ## date, version and commit of each campaign on its page, and whether its code has changed since
	$(BIN)/python -m campaigns.runs

mutants: $(READY)  ## change the code in small ways: do the nearest tests notice? ARGS="--count 10 --only align"
	$(BIN)/python -m campaigns.mutants $(ARGS)

reference: $(READY)  ## write the tables of docs/reference/ again, from the code
	$(BIN)/python -m tests.docs.reference

figures: $(READY)  ## draw the figures of docs/ again
	for script in docs/figures/[a-z]*.py; do $(BIN)/python $$script || exit 1; done
	$(BIN)/python -m benchmarks.picture

# Copies in the same places, so that a link works in the repository, on the site and in both from page to page.
SITE := README.md CHANGELOG.md CONTRIBUTING.md SECURITY.md LICENSE docs config drivers tests/README.md tests/data/rig/config.toml
docs: $(READY)  ## the site of the documentation, in build/site; a broken link or anchor fails
	rm -rf build/site build/site-source
	mkdir -p build/site-source
	git ls-files -z -- $(SITE) | xargs -0 cp --parents --target-directory=build/site-source
	NO_COLOR=1 $(BIN)/zensical build --clean --strict

container-check: $(READY)  ## the Dockerfile's steps without a container engine, as an unprivileged user
	$(BIN)/python -m pytest tests/packaging/test_dockerfile_steps.py -m slow -s -p no:benchmark $(ARGS)

operations-check: $(READY) dist  ## docs/operations.md carried out on a Debian of its own, as root; fetches 150 MB
	$(BIN)/python -m pytest tests/packaging/test_operations.py -s -p no:benchmark $(ARGS)

format: $(READY)  ## format the code and fix what ruff can fix
	$(BIN)/ruff format $(CODE)
	$(BIN)/ruff check --fix $(CODE)

env: $(READY)  ## make or renew the environment only, with all that tests and tools need
runtime: $(RUNS)  ## the same with what the program itself needs, as the demo does

# `uv pip sync` also removes what a lock no longer names, the program included: hence it is installed after it.
$(VENV)/%.synced: % | $(UV)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "$(PYTHON) is missing or older than 3.11; install one or name it: make PYTHON=python3.12 …" >&2; exit 2; }
	@test -x $(BIN)/python || $(UV) venv --clear --python $(PYTHON) $(VENV)
	$(UV) pip sync --python $(BIN)/python --require-hashes $<
	@rm -f $(VENV)/*.synced
	@touch $@

$(VENV)/.runs: $(VENV)/requirements.lock.synced
$(READY): $(VENV)/requirements-dev.lock.synced
# Built again although nothing but a kernel has changed, which uv does not look at.
$(VENV)/.runs $(READY): $(KERNELS) requirements-build.lock pyproject.toml | $(UV)
	@echo "building the kernels; this takes a minute or so …"
	$(UV) pip install --python $(BIN)/python --no-deps --build-constraint requirements-build.lock \
		--reinstall-package ballscrew-observer --editable .
	@touch $@

lock: | $(UV)  ## write the lock files again; ARGS=--upgrade takes the newest versions
	$(COMPILE) $(ARGS) --all-extras pyproject.toml --output-file requirements.lock
	$(COMPILE) $(ARGS) --extra page --extra plant --constraint requirements.lock pyproject.toml --output-file requirements-daemon.lock
	$(COMPILE) $(ARGS) --all-extras --constraint requirements.lock pyproject.toml --group dev --output-file requirements-dev.lock
	$(COMPILE) $(ARGS) --group build --constraint requirements-dev.lock --output-file requirements-build.lock

build/uv/bin/uv:
	$(PYTHON) -m venv build/uv
	build/uv/bin/python -m pip install uv==$(UV_VERSION)

dist: | $(UV)  ## the source distribution, and the wheel for computers like this one, in dist/
	rm -rf dist
	$(BUILD) .

# From the source distribution, so that nothing of an earlier build gets in. Both by zig, for the C library that the
# oldest wheels of numpy and scipy ask for too; the Python that builds needs headers that do not differ by processor, as
# every Python has but Debian's own.
wheels: | $(UV)  ## the source distribution, and the wheels of a release, for x86-64 and for arm64, in dist/
	rm -rf dist
	$(BUILD) --sdist .
	for machine in x86_64 aarch64; do \
		KERNELS_TARGET=$$machine-linux-gnu.2.28 $(BUILD) --wheel \
			--config-setting=--build-option=--plat-name=manylinux_2_28_$$machine dist/*.tar.gz || exit 1; \
	done

sbom: | $(UV)  ## the software bill of materials: what requirements.lock installs, in dist/
	mkdir -p dist
	$(UV) tool run --python $(PYTHON) --from cyclonedx-bom==$(CYCLONEDX_VERSION) cyclonedx-py \
		requirements requirements.lock --pyproject pyproject.toml --mc-type application \
		--output-reproducible --output-format JSON --output-file dist/ballscrew-observer.cdx.json

clean:  ## remove the environment and everything made
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .benchmarks \
		.import_linter_cache .coverage
	find observer -name '*.so' -delete
	find $(CODE) -name __pycache__ -type d -prune -exec rm -rf {} +
