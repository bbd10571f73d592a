# make train: set up and run the quickstart; make diagnose: hide an effect, find it; make test: set up and run the tests;
# make tables: train every row of the paper's tables, 45 minutes of one core each (MINUTES=10: less; STEPS=4000: so many steps in
# place of minutes, alike on every machine and GPU; WORKERS=2: so many at a time);
# interrupted in whatever way, the same line goes on; make smoke-tables: every row for seconds, no figures;
# make relay: a lease of this machine's GPU for the large trainings that docs/results/relay.json wants next (LEASE=540 seconds, FOOTAGE=../shared/data);
# make speedrun CLIPS=.. VALIDATION=.. SCENES=..: the best recipe of half an hour on two cores; interrupted, the same line goes on
# make benchmark: measure the figures of docs/results/decoder-cost.md anew, minutes of an otherwise idle machine
# make docs: build the site, docs/_build/html, and execute its notebooks
# make documentation: write the measured tables of README.md and docs/ from docs/results/
# make lock: write requirements.lock, the tested versions with the hashes of their files, from pyproject.toml and constraints.txt
PYTHON ?= python3
SEED   ?= 5
WITH   ?=
SPEEDRUN ?= outputs/speedrun
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/ready
TOOLS  := $(VENV)/ready-for-tests

.PHONY: train diagnose tables smoke-tables relay speedrun benchmark documentation docs test lint lock clean

train: $(READY)
	$(BIN)/python -m sci_lightning.train experiment=quickstart

# the effect and its parameters are chosen by SEED, and revealed only at the end
diagnose: FOUND := outputs/diagnose/seed_$(SEED)
diagnose: $(READY)
	$(BIN)/python -m sci_lightning.virtual_camera out=$(FOUND)/captures.h5 'size=[64,64]' effects=random seed=$(SEED)
	$(BIN)/python -m sci_lightning.diagnose captures=$(FOUND)/captures.h5 out=$(FOUND)
	$(BIN)/python -m sci_lightning.virtual_camera.reveal $(FOUND)/captures.truth.json $(FOUND)/report.json

# a row that fails stops neither the others nor the tables; WITH='data=folder data.root=CLIPS' adds overrides, ONLY='[table5]' leaves
# rows out, LABEL=name keeps results of their own, SEEDS= and OTHER_SEEDS= say how many of the rows that decide claims and of the others,
# SCALE=gpu30 trains the rows at another scale
tables: $(READY)
	$(if $(WORKERS),$(INSTALL) '.[launchers]')
	$(BIN)/python -m sci_lightning.tables.rows overrides='"$(WITH)"' $(if $(MINUTES),core_minutes=$(MINUTES)) $(if $(STEPS),steps=$(STEPS)) \
	  $(if $(WORKERS),hydra/launcher=joblib hydra.launcher.n_jobs=$(WORKERS)) $(if $(ONLY),'only=$(ONLY)') $(if $(LABEL),label=$(LABEL)) \
	  $(if $(SEEDS),seeds=$(SEEDS)) $(if $(OTHER_SEEDS),other_seeds=$(OTHER_SEEDS)) $(if $(SCALE),row_scale=$(SCALE))

smoke-tables: $(READY)
	failed=0; for table in table2 table3 table4 table5; do \
	  $(BIN)/python -m sci_lightning.train -m experiment=$$table scale=smoke $(WITH) || failed=1; done; \
	$(BIN)/python -m sci_lightning.tables runs=outputs/sweep/smoke out=outputs/tables/smoke && exit $$failed

# ARCHIVE=DIR: all that the lease leaves, for a machine that is lost; TAKE=DIR: take that over here; killed in whatever way, the next one goes on
relay: $(READY)
	$(BIN)/python -m sci_lightning.tables.relay $(if $(LEASE),seconds=$(LEASE)) $(if $(FOOTAGE),footage=$(FOOTAGE)) \
	  $(if $(ARCHIVE),archive=$(ARCHIVE)) $(if $(TAKE),take=$(TAKE))

# REPEATS=1 is quicker and less exact
benchmark: REPEATS ?= 3
benchmark: MEASURE = $(BIN)/python -m sci_lightning.benchmark repeats=$(REPEATS)
benchmark: $(READY)
	$(MEASURE) decoder=all 'only=[birnat,e2e_cnn,efficientsci,res2former,revsci,stformer]' size=128 out=outputs/benchmark/forward_128
	$(MEASURE) decoder=res2former size=64 training=1 out=outputs/benchmark/training_res2former
	mkdir -p docs/results/benchmark
	for folder in forward_128 training_res2former; do \
	  cp outputs/benchmark/$$folder/benchmark.json docs/results/benchmark/$$folder.json || exit 1; done

documentation: $(READY)
	$(BIN)/python -m sci_lightning.tables documentation=.

speedrun: $(READY)
	$(BIN)/python -m sci_lightning.train experiment=speedrun resume=true out=$(SPEEDRUN) \
	  data.root=$(CLIPS) data.val_root=$(VALIDATION) benchmark.root=$(SCENES) $(WITH)

test: $(TOOLS) lint
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder

# the site, in docs/_build/html; NOTEBOOKS=off leaves its notebooks as they are, which takes half a minute in place of ten
docs: $(TOOLS)
	NOTEBOOKS=$(or $(NOTEBOOKS),force) $(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet docs docs/_build/html

lint: $(TOOLS)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

INSTALL = $(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable

# What training needs; made anew whenever the pinned versions or the project's own requirements change.
$(READY): constraints.txt pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) .
	touch $@

# What the tests and the linters need besides. deepinv brings PyPI's torchvision, which is compiled for torch with CUDA; where
# it does not fit the installed torch, it would stop Lightning at its import, and the tests of deepinv do without it.
$(TOOLS): $(READY)
	$(INSTALL) '.[dev]'
	$(BIN)/python -c 'import torchvision' 2>/dev/null || $(BIN)/pip uninstall --quiet --yes torchvision
	touch $@

# PyTorch is built for CPUs and for several versions of CUDA under one version number: its hash, and which CUDA libraries come
# with it, depend on the machine. The lock leaves them out, and says so.
LOCK_HEADER = "Made by 'make lock' from pyproject.toml and constraints.txt; CONTRIBUTING.md says how to install from it." \
  "For Python 3.11.5 to 3.13 on every platform, the SHA-256 of every file that a release of these versions has." \
  "Not in it: torch and torchvision, which differ between machines (CPU, versions of CUDA), and the CUDA libraries" \
  "that they bring. Install them first, from a source that you trust; only their version is tested here." \
  "antlr4-python3-runtime is a source archive: its own file is checked, what pip builds it with is not."
lock: $(READY)
	$(BIN)/pip install --quiet --disable-pip-version-check 'uv>=0.9'
	$(BIN)/uv pip compile pyproject.toml --extra dev --universal --python-version 3.11.5 --constraint constraints.txt --quiet \
	  --generate-hashes --no-annotate --no-header --no-emit-index-url > $(VENV)/resolved
	{ printf '# %s\n' $(LOCK_HEADER); \
	  awk '/^[a-z]/ { kept = $$0 !~ /^((torch|torchvision|triton)==|nvidia-|cuda-)/ } kept' $(VENV)/resolved; } > $(VENV)/lock
	mv $(VENV)/lock requirements.lock

clean:
	rm -rf $(VENV)
