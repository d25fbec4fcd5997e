# Everything runs in .venv, made here from the pinned versions in constraints.txt. Needed: Python 3.11+ with venv, and make.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
# compat installs by a path: a folder named softaim where Python starts would hide the default, an import hook
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --config-settings editable_mode=compat -c constraints.txt
# At some twenty states more threads of a linear algebra library only wait for each other
export OPENBLAS_NUM_THREADS ?= 1
# Each package is compiled to bytecode once, when it is first imported; most of what is installed never is
unexport PYTHONDONTWRITEBYTECODE
# A worker for each core; on a busy machine: make test WORKERS=1
WORKERS ?= auto

.PHONY: demo test quick lint types contract architecture architecture-page docs wheel mutants check clean

demo: $(READY)  ## simulate, film and track the paper's two scenarios
	$(BIN)/softaim demo --out demo --force

test: $(READY)  ## every test
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

quick: $(READY)  ## lint, contract and the tests beside what was changed, slow ones left out
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/python -m tests.changed | xargs $(BIN)/python -m pytest -n $(WORKERS) -m "not slow" -q

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

contract: $(READY)
	$(BIN)/lint-imports

architecture: $(READY)  ## is docs/architecture.md what the code is
	$(BIN)/python -m experiments.studies.architecture --check

architecture-page: $(READY)  ## rewrite docs/architecture.md and its drawing from the code
	$(BIN)/python -m experiments.studies.architecture

docs: $(READY)  ## the documentation site, in site/; warnings are errors
	$(INSTALL) -e '.[dev,cluster,live,export,mesh,docs]'
	rm -rf site docs/generated jupyter_execute
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet --jobs auto --conf-dir docs . site

wheel: $(READY)  ## the wheel, in dist/, and whether all that belongs in it is there
	rm -rf build dist
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist .
	$(BIN)/python -m tests.wheel dist/*.whl

mutants: $(READY)  ## which changes of the modules that safety rests on no test notices; about an hour
	$(INSTALL) -e '.[dev,cluster,live,export,mesh,mutants]'
	$(BIN)/mutmut run
	$(BIN)/mutmut results

check: lint types contract architecture docs wheel test  ## what CI runs

clean:
	rm -rf .venv demo build dist site docs/generated jupyter_execute mutants *.egg-info

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("Softaim needs Python 3.11 or newer; try: make PYTHON=python3.12 …" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv .venv
	@echo "Installing into .venv, in a minute or two"
	$(INSTALL) --no-compile -e '.[dev,cluster,live,export,mesh]'
	@touch $(READY)
