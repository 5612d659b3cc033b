# Two commands do everything on a machine with Python 3.11 to 3.13 and make:  make demo   make test
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null && echo $$p && break; done)
BIN := .venv/bin
STAMP := .venv/.ready

.PHONY: setup demo test lint types bench clean

setup: $(STAMP)

$(STAMP): pyproject.toml requirements.lock
	@test -n "$(PYTHON)" || { echo "Leadline needs Python 3.11, 3.12 or 3.13"; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $@

demo: $(STAMP)
	$(BIN)/python examples/synthetic_dive.py build/demo/log
	$(BIN)/leadline solve build/demo/log --vehicle examples/synthetic.toml --out build/demo/solution
	@echo "open build/demo/solution/report.html"

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

test: $(STAMP) lint types
	$(BIN)/leadline warmup
	$(BIN)/pytest -q -n 2 tests

bench: $(STAMP)
	$(BIN)/pytest -q benchmarks --benchmark-only --benchmark-columns=min,median,rounds

clean:
	rm -rf .venv build .pytest_cache .mypy_cache .ruff_cache
