PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

.PHONY: run test lint clean

run: $(VENV)/.ready          ## drive the default scenario to its end
	$(BIN)/ttempc run grass

test: $(VENV)/.ready         ## the whole suite
	$(BIN)/python -m pytest

lint: $(VENV)/.ready         ## ruff and pyright
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

$(VENV)/.ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

clean:                       ## remove the virtual environment
	rm -rf $(VENV)
