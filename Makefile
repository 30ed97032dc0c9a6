# Two commands on a fresh machine: `make detection` prints the paper's table, `make test` passes the tests.

# PyBullet's newest ready-made wheels are for CPython 3.11, so that one is used where it is installed.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
RUN := $(BIN)/midnet-bench
# processes that the tests share their work between
JOBS ?= auto
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# pytest keeps the tests that it has rewritten only where Python may write such files
unexport PYTHONDONTWRITEBYTECODE

.PHONY: detection labyrinth smoke leaderboard test test-all lint wheel api bench clean

detection: .venv/ready
	$(RUN) detection
	@echo "To go on, type: source .venv/bin/activate"

labyrinth: .venv/ready
	$(RUN) labyrinth

smoke: .venv/ready
	$(RUN) run smoke-detection --fresh -q -o results/smoke/smoke-detection
	$(RUN) run smoke-labyrinth --fresh -q -o results/smoke/smoke-labyrinth
	$(RUN) compare --exact results/smoke/smoke-detection
	$(RUN) compare --exact results/smoke/smoke-labyrinth

# docs/leaderboard.md and the results that it is made of
leaderboard: .venv/ready
	$(RUN) run standard --detector midnet,subtraction,clusters,background \
		--fusion "paper,components(iou=0.02)" --fresh -o results/standard
	cd results/standard && cp configuration.json provenance.json scores.csv robots.csv timing.csv cost.csv \
		leaderboard.csv ../reference/standard
	cp results/standard/leaderboard.md docs/leaderboard.md

# what a quick check needs
test: .venv/ready
	$(BIN)/pytest -n $(JOBS) --maxprocesses 4 --dist worksteal -m "not slow"

test-all: .venv/ready
	$(BIN)/pytest -n $(JOBS) --maxprocesses 4 --dist worksteal

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m tests.rooms

# builds the package and runs its commands in an empty folder, without this checkout in sight
wheel: .venv/ready
	$(BIN)/pytest tests/test_wheel.py
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

# docs/api.md from the docstrings, the tables of docs/results.md from the columns' declarations, that of the sources in
# midnet_bench/docs/readings.md from the options', what commands' help says of parameters from theirs
api: .venv/ready
	$(BIN)/python docs/make_api.py
	$(BIN)/python docs/make_results.py
	$(BIN)/python docs/make_readings.py
	$(BIN)/python docs/make_help.py

bench: .venv/ready
	$(BIN)/python -m benchmarks

# results stay
clean:
	rm -rf .venv build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/ready: pyproject.toml setup.py constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; \
	sys.exit(0 if v == (3, 11) else "midnet-bench simulates with PyBullet, whose ready-made wheels are for Python 3.11; \
	this is Python %d.%d. Install 3.11, or name it: make PYTHON=/path/to/python3.11" % v)'
	@echo "setting up .venv (a few minutes: loops are compiled once) ..."
	@$(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --no-compile --editable '.[dev]'
	@$(BIN)/python -c 'from midnet_bench.workflows.campaigns import compile_kernels; compile_kernels()'
	@touch $@
