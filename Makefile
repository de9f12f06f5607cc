PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

.PHONY: run test bench lint docs wheels release clean

run: $(VENV)/.run          ## drive the default scenario to its end
	$(BIN)/ttempc run grass

# The suite starts hundreds of processes: each would compile all modules where the environment forbids keeping byte code.
test: export PYTHONDONTWRITEBYTECODE =
test: export PYTHONPYCACHEPREFIX = $(CURDIR)/$(VENV)/bytecode
test: $(VENV)/.dev         ## the whole suite, a process per core; kernels are compiled once before
	folder=$$(mktemp -d) && $(BIN)/ttempc run grass --json --set path.kind=straight -o $$folder/run \
		--set path.length_m=12 >$$folder/summary.json; rm -r $$folder
	$(BIN)/python -m pytest -n logical --maxprocesses 8 --dist worksteal

bench: $(VENV)/.dev        ## cost and speed beside their limits; leave the machine idle
	$(BIN)/python -m proving_ground.experiments.papers.benchmarks

lint: $(VENV)/.dev         ## style, types, layers, readability
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/python packaging/lint.py

docs: $(VENV)/.dev         ## the documentation site: dist/site/index.html
	$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going docs dist/site

wheels: $(VENV)/.dev       ## dist/: the control library alone, and the proving ground, with their kernels
	rm -f dist/*.whl
	$(BIN)/python packaging/kernels.py
	TTEMPC_LIBRARY="==$$($(BIN)/python -c 'import ttempc; print(ttempc.__version__)')" \
		$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist ./ttempc .

release: $(VENV)/.dev      ## dist/: wheels and sources, checked, and driven in an environment without compiler and cache
	rm -rf dist ttempc/kernels packaging/proving_ground/kernels
	$(BIN)/python -m pip install --quiet 'build>=1.2,<2' 'twine>=7,<8'
	$(BIN)/python -m build --sdist --outdir dist ttempc
	$(BIN)/python -m build --sdist --outdir dist .
	$(MAKE) wheels
	$(BIN)/python -m twine check --strict dist/*
	$(BIN)/python packaging/release.py

# Both editable: the library is named here, so that no copy of it is installed. Modules are compiled when they are first imported.
PIP := TTEMPC_LIBRARY= $(BIN)/python -m pip install --quiet --no-compile --editable ttempc

$(VENV)/.run: pyproject.toml ttempc/pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable .
	touch $@

$(VENV)/.dev: $(VENV)/.run
	$(PIP) --editable '.[dev]'
	touch $@

clean:                       ## remove the virtual environment
	rm -rf $(VENV)
