# make demo: set up, train an agent for about a minute, compare it with the analytic schedulers
# make test: set up, run every check that CI runs
SHELL := /bin/bash
VENV ?= .venv
OUT ?= out
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo "$$p"; break; }; done)
BIN := $(VENV)/bin
READY := $(VENV)/.ready
export OMP_NUM_THREADS ?= 1

.PHONY: demo test lint test-oldest test-learners site docs tutorial animations results leaderboard papers headroom benchmarks clean

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "wavegym needs Python >= 3.11, none found on the PATH" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@# torch by itself first: with its exact version there, no other package asks for a newer build.
	$(BIN)/python -m pip install --quiet --constraint constraints.txt torch
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[agents,tune,dev,docs]"
	touch $@

demo: $(READY)
	$(BIN)/python -m agents.demo --out $(OUT)/demo

test: $(READY) lint site
	$(BIN)/python -m pytest -n 2

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The oldest Gymnasium supported, in an environment of its own, and RLlib, which pins it.
test-oldest: $(VENV)-oldest/.ready
	$(VENV)-oldest/bin/python -m pytest -n 2 tests/core tests/envs tests/testing -m "not slow"
	$(VENV)-oldest/bin/python -m pytest tests/integrations/test_ray_cluster.py tests/integrations/test_rllib.py

$(VENV)-oldest/.ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)-oldest
	sed 's/^gymnasium==.*/gymnasium==1.2.2/' constraints.txt > $(VENV)-oldest/constraints.txt
	$(VENV)-oldest/bin/python -m pip install --quiet --constraint $(VENV)-oldest/constraints.txt torch
	$(VENV)-oldest/bin/python -m pip install --quiet --constraint $(VENV)-oldest/constraints.txt --editable ".[agents,tune,dev,ray]"
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
	$(BIN)/python -m agents.pages
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
	$(BIN)/python -m agents.leaderboard

# Rebuild the papers' figures, agile_clutter with the fast tracker; PAGE=1: with the runs of the docs, and renew their pages.
papers: $(READY)
	$(BIN)/python -m papers agile_clutter $(if $(PAGE),--runs 500 --tracker both) --out $(OUT)/agile_clutter
	$(BIN)/python -m papers rf_eo --out $(OUT)/rf_eo
	$(BIN)/python -m papers urban $(if $(PAGE),--runs 500) --out $(OUT)/urban
ifdef PAGE
	mkdir -p results/agile_clutter results/rf_eo results/urban
	cp $(addprefix $(OUT)/agile_clutter/,summary.json figure2.csv figure3.csv) results/agile_clutter/
	cp $(addprefix $(OUT)/rf_eo/,summary.json figure2.csv figure3.csv figure4.csv) results/rf_eo/
	cp $(addprefix $(OUT)/urban/,summary.json figure3.csv figure4.csv figure5.csv figure6.csv) results/urban/
	for f in 2 3; do cp $(OUT)/agile_clutter/figure$$f.png docs/images/agile_clutter_figure$$f.png || exit; done
	for f in 2 3 4; do cp $(OUT)/rf_eo/figure$$f.png docs/images/rf_eo_figure$$f.png || exit; done
	for f in 3 4 5 6; do cp $(OUT)/urban/figure$$f.png docs/images/urban_figure$$f.png || exit; done
	$(BIN)/python -m papers.page results/agile_clutter/summary.json docs/papers/agile_clutter.md
	$(BIN)/python -m papers.page results/rf_eo/summary.json docs/papers/rf_eo.md
	$(BIN)/python -m papers.page results/urban/summary.json docs/papers/urban.md
endif

# How much is there to gain: play every environment's ladder and renew its page; IDS="CameraSlew-v0" for one of them.
headroom: $(READY)
	$(BIN)/python -m wavegym.evaluation.headroom $(IDS) --out results/headroom
	$(BIN)/python -m wavegym.evaluation.headroom_page results/headroom docs/headroom.md

benchmarks: $(READY)
	$(BIN)/python -m benchmarks.run

clean:
	rm -rf $(VENV) $(VENV)-oldest $(VENV)-learners $(OUT) site
