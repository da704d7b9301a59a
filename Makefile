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
# Tests start many processes. Without bytecode on disk each of them compiles the sources again, which takes a second.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo check test test-release lint test-oldest test-learners site docs tutorial animations results leaderboard league papers headroom \
	benchmarks promises clean

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "wavegym needs Python >= 3.11, none found on the PATH" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@# torch by itself first: with its exact version there, no other package asks for a newer build.
	$(BIN)/python -m pip install --quiet --constraint constraints.txt torch
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[agents,tune,dev,docs]"
	touch $@

demo: $(READY)
	$(BIN)/python -m agents.demo --out $(OUT)/demo

# Kernels are compiled first: two processes of pytest would both compile those that their first tests need.
check: $(READY) lint
	$(BIN)/wavegym warm-up > /dev/null
	@# Twice the second above which a test needs a mark: some machines are slow.
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow and not release" --hypothesis-profile check --unmarked-seconds 2

test: $(READY) lint site
	$(BIN)/wavegym warm-up
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not release"

# What no commit can break alone, or what takes hours: before a release.
test-release: test test-oldest test-learners papers promises
	$(BIN)/python -m pytest -m release

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The oldest versions supported, in an environment of its own, and RLlib, which pins Gymnasium.
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

# The examples of examples/learners with TorchRL, skrl and RL Zoo, in an environment of its own: RL Zoo needs an older
# python-dateutil than the other tests have.
test-learners: $(VENV)-learners/.ready
	$(VENV)-learners/bin/python -m pytest tests/test_learners.py

$(VENV)-learners/.ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)-learners
	sed '/^python-dateutil==/d' constraints.txt > $(VENV)-learners/constraints.txt
	$(VENV)-learners/bin/python -m pip install --quiet --constraint $(VENV)-learners/constraints.txt torch
	$(VENV)-learners/bin/python -m pip install --quiet --constraint $(VENV)-learners/constraints.txt \
		--editable ".[agents,tune,dev]" "torchrl>=0.14" "skrl>=2.1" "rl_zoo3>=2.9"
	touch $@

# The documentation in site/; `docs` renews the environments' pages from the code first.
site: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

docs: $(READY)
	$(BIN)/python -m research.pages
	$(MAKE) site

# Run the notebook of the tutorial and keep what it prints.
tutorial: $(READY)
	mkdir -p $(OUT)/tutorial
	cp docs/tutorial.ipynb $(OUT)/tutorial/
	$(BIN)/jupyter nbconvert --to notebook --execute --inplace --ExecutePreprocessor.record_timing=False \
		$(OUT)/tutorial/tutorial.ipynb
	cp $(OUT)/tutorial/tutorial.ipynb docs/

# The animated pictures on the environments' pages, a few minutes each.
animations: $(READY)
	$(BIN)/python -m agents.animations $(IDS)

# Train what is missing and rebuild every table under results/; EXPERIMENTS="SectorSetup" for one of them.
results: $(READY)
	$(BIN)/python -m agents.experiment $(EXPERIMENTS)

# Play the saved agents on the worlds of `make headroom`, and renew the tables in which both meet.
leaderboard: $(READY)
	$(BIN)/python -m agents.experiment --train RfEoFar  # two seeds are not kept in the repository
	$(BIN)/python -m agents.leaderboard

# Rebuild the papers' figures, agile_clutter with the fast tracker; PAGE=1: with the runs of the docs, and renew their pages.
# PAPERS="kershaw_evans" for one of them.
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

# Everything about some environments: trains missing agents, plays ladders, agents, quick planners, stages of learning and
# changed environments, and renews the tables; NAMES="KershawEvansPosition SectorSetup", all with shifts in results/experiments.toml without it.
NAMES ?= $(shell sed -n 's/^\[\(.*\)\.shifts\]$$/\1/p' results/experiments.toml)
league: $(READY)
	$(BIN)/python -m agents.experiment --train $(NAMES)
	$(BIN)/python -m agents.package
	$(MAKE) headroom IDS="$(addsuffix -v0,$(NAMES))"
	$(BIN)/python -m agents.leaderboard $(addsuffix -v0,$(NAMES))
	$(BIN)/python -m agents.quick_planners $(NAMES)
	$(BIN)/python -m agents.stages $(NAMES)
	$(BIN)/python -m agents.distribution_shift $(NAMES)

# How much is there to gain: play every environment's ladder and renew its page; IDS="CameraSlew-v0" for one of them.
headroom: $(READY)
	$(BIN)/python -m wavegym.evaluation.headroom $(IDS) --out results/headroom
	$(BIN)/python -m agents.headroom_page results/headroom docs/headroom.md results/baselines

benchmarks: $(READY)
	$(BIN)/python -m research.benchmarks.run
	$(BIN)/python -m research.benchmarks.steps
	$(BIN)/python -m research.benchmarks.startup

# Files changed at random, commands killed at random, intervals simulated, and planted defects: half an hour.
promises: $(READY)
	$(BIN)/python -m research.promises.fuzz
	$(BIN)/python -m research.promises.faults
	$(BIN)/python -m research.promises.determinism
	$(BIN)/python -m research.promises.coverage
	$(BIN)/python -m research.promises.mutate

clean:
	rm -rf $(VENV) $(VENV)-oldest $(VENV)-learners $(OUT) site
