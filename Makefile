# Two commands on a fresh machine: `make detection` prints the paper's table, `make test` passes the tests.

# PyBullet's newest ready wheels are for CPython 3.11, so that one is taken where it is installed.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
RUN := $(BIN)/midnet-bench
# processes that the tests share their work between
JOBS ?= auto
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: detection labyrinth smoke test test-all lint bench clean

detection: .venv/ready
	$(RUN) detection

labyrinth: .venv/ready
	$(RUN) labyrinth --trials 20

smoke: .venv/ready
	$(RUN) smoke

test: .venv/ready
	$(BIN)/pytest -n $(JOBS) --maxprocesses 4 --dist loadscope -m "not slow"

test-all: .venv/ready
	$(BIN)/pytest -n $(JOBS) --maxprocesses 4 --dist loadscope

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: .venv/ready
	$(BIN)/python -m benchmarks

clean:
	rm -rf .venv build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/ready: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; \
	sys.exit(0 if v == (3, 11) else "midnet-bench simulates with PyBullet, whose ready wheels are for Python 3.11, and \
	this is Python %d.%d: install 3.11, or name it: make PYTHON=/path/to/python3.11" % v)'
	@echo "setting up .venv (a minute or two) ..."
	@$(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --editable '.[dev]'
	@$(BIN)/python -c 'from midnet_bench.experiments.warm_up import compile_kernels; compile_kernels()'
	@touch $@
