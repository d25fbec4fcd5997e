# Everything runs in .venv, made here from the pinned versions in constraints.txt. Needed: Python 3.11+ with venv, and make.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready

.PHONY: demo test lint types contract check clean

demo: $(READY)  ## simulate, film and track the paper's two scenarios
	$(BIN)/softaim demo --out demo --force

test: $(READY)  ## every test
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

contract: $(READY)
	$(BIN)/lint-imports

check: test lint types contract  ## what CI runs

clean:
	rm -rf .venv demo build *.egg-info

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("Softaim needs Python 3.11 or newer; try: make PYTHON=python3.12 …" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $(READY)
