# make train: set up and run the quickstart; make diagnose: hide an effect, find it; make test: set up and run the tests
PYTHON ?= python3
SEED   ?= 5
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/ready

.PHONY: train diagnose test lint clean

train: $(READY)
	$(BIN)/python -m sci_lightning.train experiment=quickstart

# the effect and its parameters are chosen by SEED, and told only at the end
diagnose: FOUND := outputs/diagnose/seed_$(SEED)
diagnose: $(READY)
	$(BIN)/python -m sci_lightning.virtual_camera out=$(FOUND)/captures.h5 effects=random seed=$(SEED)
	$(BIN)/python -m sci_lightning.diagnose captures=$(FOUND)/captures.h5 out=$(FOUND)
	$(BIN)/python -m sci_lightning.virtual_camera.reveal $(FOUND)/captures.truth.json $(FOUND)/report.json

test: $(READY) lint
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# made anew whenever the pinned versions or the project's own requirements change
$(READY): constraints.txt pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV)
