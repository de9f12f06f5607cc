PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

.PHONY: run test bench lint docs wheels clean

run: $(VENV)/.ready          ## drive the default scenario to its end
	$(BIN)/ttempc run grass

test: $(VENV)/.ready         ## the whole suite, a process per core
	$(BIN)/python -m pytest -n logical --maxprocesses 8

bench: $(VENV)/.ready        ## cost and speed beside their limits; leave the machine idle
	$(BIN)/python -m proving_ground.experiments.benchmarks

lint: $(VENV)/.ready         ## ruff and pyright
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

docs: $(VENV)/.ready         ## the documentation site: dist/site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

wheels: $(VENV)/.ready       ## dist/: the control library alone, and the proving ground
	TTEMPC_LIBRARY="==$$($(BIN)/python -c 'import ttempc; print(ttempc.__version__)')" \
		$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist ./ttempc .

# Both editable: the library is named here, so that no copy of it is installed.
$(VENV)/.ready: pyproject.toml ttempc/pyproject.toml
	$(PYTHON) -m venv $(VENV)
	TTEMPC_LIBRARY= $(BIN)/python -m pip install --quiet \
		--editable ttempc --editable '.[dev]'
	touch $@

clean:                       ## remove the virtual environment
	rm -rf $(VENV)
