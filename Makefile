# make demo: set up, train an agent for less than a minute, compare it with the analytic schedulers
# make check: set up, the quick tests, two minutes; make test: what CI runs; make test-release: everything
SHELL := /bin/bash
VENV ?= .venv
OUT ?= out
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo "$$p"; break; }; done)
BIN := $(VENV)/bin
READY := $(VENV)/.ready
export OMP_NUM_THREADS ?= 1
# Tests start many processes. Without bytecode on disk each process compiles the sources again, which takes a second.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo check test test-release lint test-oldest test-learners site docs tutorial animations results leaderboard league papers headroom \
	benchmarks promises clean

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "wavegym needs Python >= 3.11, none found on the PATH" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@# torch first: if its exact version is installed, no other package asks for a newer build.
	$(BIN)/python -m pip install --quiet --constraint constraints.txt torch
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[agents,tune,dev,docs]"
	touch $@

demo: $(READY)
	$(BIN)/python -m agents.demo --out $(OUT)/demo

# Kernels are compiled first; otherwise both processes of pytest would compile the same kernels.
check: $(READY) lint
	$(BIN)/wavegym warm-up > /dev/null
	@# A test above one second needs a mark. The limit here is two, because some machines are slow.
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow and not release" --hypothesis-profile check --unmarked-seconds 2

test: $(READY) lint site
	$(BIN)/wavegym warm-up
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not release"

# Before a release: tests that depend on other packages' versions, or that take hours.
test-release: test test-oldest test-learners papers promises
	$(BIN)/python -m pytest -m release

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The oldest supported versions, in a separate environment, and RLlib, which pins Gymnasium.
test-oldest: $(VENV)-oldest/.ready
	$(VENV)-oldest/bin/wavegym warm-up
	$(VENV)-oldest/bin/python -m pytest -n 2 --dist worksteal tests/core tests/envs tests/testing tests/systems/rf_eo/test_rf_eo.py \
		-m "not slow"
	$(VENV)-oldest/bin/python -m pytest tests/integrations/test_ray_cluster.py tests/integrations/test_rllib.py

$(VENV)-oldest/.ready: pyproject.toml constraints-oldest.txt
	$(PYTHON) -m venv $(VENV)-oldest
	$(VENV)-oldest/bin/python -m pip install --quiet --constraint constraints-oldest.txt torch
	$(VENV)-oldest/bin/python -m pip install --quiet --constraint constraints-oldest.txt \
		--editable ".[agents,tune,onnx,pettingzoo,window,stonesoup,ray]" pytest pytest-xdist hypothesis networkx
	touch $@

# The examples with TorchRL, skrl and RL Zoo, in a separate environment: RL Zoo needs an older python-dateutil than the
# other tests.
test-learners: $(VENV)-learners/.ready
	$(VENV)-learners/bin/python -m pytest tests/test_learners.py

$(VENV)-learners/.ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)-learners
	sed '/^python-dateutil==/d' constraints.txt > $(VENV)-learners/constraints.txt
	$(VENV)-learners/bin/python -m pip install --quiet --constraint $(VENV)-learners/constraints.txt torch
	$(VENV)-learners/bin/python -m pip install --quiet --constraint $(VENV)-learners/constraints.txt \
		--editable ".[agents,tune,dev]" "torchrl>=0.14" "skrl>=2.1" "rl_zoo3>=2.9"
	touch $@

# The documentation in site/; `make docs` first renews the environments' pages from the code.
site: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

docs: $(READY)
	$(BIN)/python -m research.pages
	$(MAKE) site

# Run the notebook of the tutorial and keep its output.
tutorial: $(READY)
	mkdir -p $(OUT)/tutorial
	cp docs/tutorial.ipynb $(OUT)/tutorial/
	$(BIN)/jupyter nbconvert --to notebook --execute --inplace --ExecutePreprocessor.record_timing=False \
		$(OUT)/tutorial/tutorial.ipynb
	cp $(OUT)/tutorial/tutorial.ipynb docs/

# The animated pictures on the environments' pages, a few minutes each.
animations: $(READY)
	$(BIN)/python -m agents.animations $(IDS)

# Train missing agents and rebuild every table under results/; EXPERIMENTS="SectorSetup" for one of them.
results: $(READY)
	$(BIN)/python -m agents.experiment $(EXPERIMENTS)

# Play the saved agents on the worlds of `make headroom`, and renew the tables of both.
leaderboard: $(READY)
	$(BIN)/python -m agents.leaderboard

# Rebuild the papers' figures, agile_clutter with the fast tracker. PAGE=1 plays as many runs as the docs and renews their
# pages. PAPERS="kershaw_evans" for one of them.
PAPERS ?= agile_clutter kershaw_evans rf_eo urban
PAPER_OPTIONS_agile_clutter = --runs 500 --tracker both
PAPER_OPTIONS_urban = --runs 500
papers: $(READY)
	for p in $(PAPERS); do $(MAKE) --no-print-directory paper-$$p || exit; done

paper-%: $(READY)
	$(BIN)/python -m research.papers $* $(if $(PAGE),$(PAPER_OPTIONS_$*)) --out $(OUT)/$*
ifdef PAGE
	mkdir -p results/$*
	cp $(OUT)/$*/summary.json results/$*/
	for f in $(OUT)/$*/figure*.csv; do xz -9c $$f > results/$*/$$(basename $$f).xz || exit; done
	for f in $(OUT)/$*/figure*.png; do cp $$f docs/images/$*_$$(basename $$f) || exit; done
	$(BIN)/python -m research.papers.page results/$*/summary.json docs/papers/$*.md
endif

# All results of some environments: train missing agents, play ladders, agents, quick planners, stages of learning and
# changed environments, and renew the tables. NAMES="KershawEvansPosition SectorSetup"; by default all environments with
# shifts in results/experiments.toml.
NAMES ?= $(shell sed -n 's/^\[\(.*\)\.shifts\]$$/\1/p' results/experiments.toml)
league: $(READY)
	$(BIN)/python -m agents.experiment --train $(NAMES)
	$(BIN)/python -m agents.package
	$(MAKE) headroom IDS="$(addsuffix -v0,$(NAMES))"
	$(BIN)/python -m agents.leaderboard $(addsuffix -v0,$(NAMES))
	$(BIN)/python -m agents.quick_planners $(NAMES)
	$(BIN)/python -m agents.stages $(NAMES)
	$(BIN)/python -m agents.distribution_shift $(NAMES)

# Gain of planning: play every environment's ladder and renew the page; IDS="CameraSlew-v0" for one of them.
headroom: $(READY)
	$(BIN)/python -m wavegym.evaluation.headroom $(IDS) --out results/headroom
	$(BIN)/python -m agents.headroom_page results/headroom docs/headroom.md results/baselines

benchmarks: $(READY)
	$(BIN)/python -m research.benchmarks.run
	$(BIN)/python -m research.benchmarks.steps
	$(BIN)/python -m research.benchmarks.startup

# Random changes of files, killed commands, simulated intervals and planted defects: half an hour.
promises: $(READY)
	$(BIN)/python -m research.promises.fuzz
	$(BIN)/python -m research.promises.faults
	$(BIN)/python -m research.promises.determinism
	$(BIN)/python -m research.promises.coverage
	$(BIN)/python -m research.promises.mutate

clean:
	rm -rf $(VENV) $(VENV)-oldest $(VENV)-learners $(OUT) site
