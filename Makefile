# Each target sets up everything that it needs (see scripts/setup.sh); a second call starts at once.
GOAL ?= place the red cube on the crate
CELL ?= cubes
ARGS ?=
# Through the environment, so that quotes in a goal reach the command as they were typed.
export GOAL CELL
MAKEFLAGS += --no-print-directory

.PHONY: run test check check-types check-tests setup setup-robot lint lock
run: setup
	@.venv/bin/replan run "$$GOAL" --cell "$$CELL" $(ARGS)

test: setup lint
	@OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder tests $(ARGS)

# For every commit, in a minute and a half on two cores: types of the program itself on one, quick tests on the other.
# Quick are whole folders whose tests start no robot, build no twin and load no weights; a new test in one of them is in.
# `make test` checks all types and runs all tests.
PROGRAM = control hw_interface perception planning prompts replan replan_base sim_check
QUICK = tests/control/trajectory tests/control/safety tests/control/tasks tests/control/motion_files \
	tests/control/retiming tests/perception/catalogue tests/perception/geometry tests/planning \
	tests/hw_interface/test_messages.py tests/replan_base tests/test_imports.py
NOT_QUICK = tests/planning/baselines tests/planning/reasoners tests/replan_base/test_wheel.py

check: setup
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@$(MAKE) -j 2 --output-sync=target check-types check-tests

check-types:
	@.venv/bin/pyright $(PROGRAM)

check-tests:
	@OMP_NUM_THREADS=1 .venv/bin/python -m pytest $(QUICK) $(NOT_QUICK:%=--ignore %) $(ARGS)

setup:
	@scripts/setup.sh

# What the robot's own computer needs, into .venv-robot: no twin, no pictures, no learned models.
setup-robot:
	@scripts/setup.sh robot

lint: setup
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/pyright

# Writes requirements.lock anew from pyproject.toml, and requirements-robot.lock with the same versions.
lock: setup
	@.tools/bin/uv pip compile --quiet --universal --python-version 3.11 --all-extras --generate-hashes \
		--no-emit-index-url --no-header --no-annotate --upgrade -o requirements.lock pyproject.toml
	@.tools/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
		--extra panda --extra robotiq --extra ros2 --extra security --constraint requirements.lock \
		--no-emit-index-url --no-header --no-annotate -o requirements-robot.lock pyproject.toml
