# Everything a person needs here. `make benchmark` and `make test` work on a fresh machine with Python 3.11+ and make.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
WORKERS ?= 2

# BLAS threads would fight with the worker processes.
export OPENBLAS_NUM_THREADS = 1
# Most modules of the libraries are never imported, a tenth of a gigabyte as bytecode; those that are, are compiled then.
export PIP_COMPILE = 0
# What the tests pass with; pip alone takes any version that pyproject.toml allows.
export PIP_CONSTRAINT = $(CURDIR)/constraints.txt
# Without bytecode on disk every process of pytest rewrites all tests anew.
unexport PYTHONDONTWRITEBYTECODE

EXTRAS ?= dev
DATA ?= data/ordinary
TESTS ?= not slow and not nightly

.PHONY: help setup check test test-all nightly golden mutants smoke benchmark tables docs dist data train tune-llm clean

help:
	@echo "make benchmark   drive the default suite with the recommended planner, print the table, write report.html"
	@echo "make test        everything but the slow tests, real SUMO included (3 minutes on two quick cores; WORKERS=8 on eight)"
	@echo "make test-all    the slow and the nightly tests, too; TESTS='not nightly' with make test: what every change must pass"
	@echo "make nightly     a million agent-seconds of traffic around rude egos (an hour on two cores; FUZZ_SEED=1: others)"
	@echo "make check       lint, format and types"
	@echo "make golden      only the comparison with nuPlan's own values"
	@echo "make mutants     200 small wrong changes to the code: does a test notice each? (a quarter of an hour on two cores)"
	@echo "make tables      the tables of README and docs anew from the stored drives; RUN=folder stores those of a run first"
	@echo "make docs        the documentation as a site, in build/site; refuses links that lead nowhere"
	@echo "make dist        wheel and sdist below dist/, installed in a fresh environment: what it weighs, and a scored drive"
	@echo "make smoke       one scenario per family, in a minute"
	@echo "make data        115,000 samples of ordinary driving to train on, below data/ordinary (fifty minutes on two cores)"
	@echo "make tune-llm    EXAMPLES=choices.jsonl [OUT=hybrid.gguf] [TUNE=...]: teach the small language model"
	@echo "make train       PLANNER=pdm_open [DATA=folder] [TRAIN='--epochs 20']: train a learned planner anew"
	@echo "make setup       make $(VENV) with everything for development"

$(BIN)/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(None if (3, 11) <= v < (3, 15) else "error: Python %d.%d found, 3.11 to 3.14 needed; name one: make PYTHON=python3.12 ..." % v[:2])'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable ".[$(EXTRAS)]"
	@touch $@ $(VENV)/.installed

setup: $(VENV)/.installed-dev

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyrefly check --python-interpreter-path $(BIN)/python

test: setup
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m "$(TESTS)"

test-all: TESTS =
test-all: test

nightly: setup
	PYTHONPATH=.:planners $(BIN)/python -m benchmarks.traffic_fuzz --agent-seconds 1000000 --seed $(or $(FUZZ_SEED),0) --workers $(WORKERS)

golden: setup
	@PYTHONPATH=.:planners $(BIN)/python -m tests.golden_table

mutants: setup
	$(BIN)/python -m tools.mutants --workers $(WORKERS)

smoke: $(VENV)/.installed
	$(BIN)/interplan-sumo doctor
	rm -rf runs/smoke
	$(BIN)/interplan-sumo run --suite smoke==1 --out runs/smoke
	$(BIN)/interplan-sumo report runs/smoke

benchmark: $(VENV)/.installed
	$(BIN)/interplan-sumo run --out runs/benchmark
	$(BIN)/interplan-sumo report runs/benchmark --html runs/benchmark/report.html --replays lost
	@echo "report: runs/benchmark/report.html"

$(VENV)/.installed-docs: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable ".[docs,gym]"
	@touch $@

tables: setup
	$(BIN)/python -m tools.tables $(if $(RUN),--take $(RUN))

docs: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "open build/site/index.html"

# The wheel is made from the sdist, so both are what they should be if it works where no checkout is near.
dist: setup
	rm -rf dist build/fresh
	$(BIN)/python -m build --no-isolation --outdir dist
	$(PYTHON) -m venv build/fresh
	build/fresh/bin/python -m pip install --quiet dist/*.whl
	@cd build/fresh && du -sm lib/python*/site-packages/* | sort -rn | head -12 && du -sm .
	cd build/fresh && bin/interplan-sumo doctor && \
	bin/interplan-sumo run --planner idm --suite smoke==1 --limit 1 --out first --quiet && bin/interplan-sumo verify first --all --quiet

data: $(VENV)/.installed
	$(BIN)/interplan-sumo dataset ordinary --out $(DATA) --samples 112000 --holdout-maps back_bay --workers $(WORKERS)

# torch is in no other extra; its build for CPUs is enough, and small, where an index has it.
$(VENV)/.installed-train: pyproject.toml | $(VENV)/.installed-dev
	-$(BIN)/python -m pip install --quiet "torch==2.13.0+cpu" 2> /dev/null
	$(BIN)/python -m pip install --quiet --editable ".[train]"
	@touch $@

train: $(VENV)/.installed-train
	@test -n "$(PLANNER)" || { echo "error: which planner? make train PLANNER=pdm_open" >&2; exit 2; }
	$(BIN)/python -m tools.train $(PLANNER) --data $(DATA) --out planners/interplan_learned/$(PLANNER:pdm_offset=pdm_hybrid) $(TRAIN)

tune-llm: $(VENV)/.installed-train
	@test -n "$(EXAMPLES)" || { echo "error: which examples? make tune-llm EXAMPLES=choices.jsonl" >&2; exit 2; }
	$(BIN)/python -m tools.tune_llm $(EXAMPLES) --out $(or $(OUT),hybrid.gguf) $(TUNE)

clean:
	rm -rf build dist runs .pytest_cache .ruff_cache
