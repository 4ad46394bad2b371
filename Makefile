# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
BIN := .venv/bin
PACKAGES := trainables search_spaces orchestrator dashboards deltatune
PROCESSES ?= 3
GROUPED = -n $(PROCESSES) --dist loadgroup --no-loadscope-reorder

.PHONY: setup demo docs test test-fast test-slow lint check bench clean

setup: .venv/.installed

.venv/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; v = sys.version_info[:2]; (3, 11) <= v <= (3, 13) or sys.exit(f"deltatune needs Python 3.11 to 3.13, not {v[0]}.{v[1]}: set PYTHON=python3.12, say")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@

demo: setup
	$(BIN)/deltatune sweep demo

# The documentation site, in build/site: every warning is an error.
docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# All but the slow ones, by the groups and in the order of tests/conftest.py. In three processes (or PROCESSES=2, say):
# one more than the cores that it is made for, since the tests of Ray mostly wait.
test: setup
	$(BIN)/python -m pytest $(GROUPED)

# A loop of about a minute: nothing that takes long, or starts Ray or a browser.
test-fast: PROCESSES = 2
test-fast: setup
	$(BIN)/python -m pytest $(GROUPED) -m 'not (slow or long or ray or cluster or browser)'

# Several nodes, servers that are killed, other Pythons, MLflow in a browser, and at length what `test` does once.
test-slow: PROCESSES = 2
test-slow: setup
	$(BIN)/python -m pytest $(GROUPED) -m 'slow and not cluster' --durations=0
	$(BIN)/python -m pytest -m 'slow and cluster' --durations=0

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint test

bench: setup
	$(BIN)/python -m benchmarks --json bench.json

clean:
	rm -rf .venv build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
