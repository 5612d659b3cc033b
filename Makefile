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

DEMO := build/demo
ABOARD := --vehicle missions/vehicles/survey-auv.toml

demo: $(STAMP)
	rm -f $(DEMO)/mission.html
	$(BIN)/leadline simulate missions/survey.toml --out $(DEMO)/log --seed 2
	$(BIN)/leadline solve $(DEMO)/log $(ABOARD) --out $(DEMO)/solution
	$(BIN)/leadline solve $(DEMO)/log $(ABOARD) --out $(DEMO)/smoothed --smooth > $(DEMO)/smoothed.txt
	$(BIN)/leadline assess $(DEMO)/smoothed --truth $(DEMO)/log
	$(BIN)/leadline report $(DEMO)/log --solution $(DEMO)/solution --solution $(DEMO)/smoothed --out $(DEMO)/mission.html
	@echo "open $(DEMO)/mission.html (the dive in three dimensions) and $(DEMO)/solution/report.html (how good the estimate is)"

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
