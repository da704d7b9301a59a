from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from small_studies import RF_EO_RUNS, RF_EO_SEED, RF_EO_STEPS, URBAN_RUNS, URBAN_SEED

from research.papers import contents
from research.papers.__main__ import main
from research.papers.rf_eo import numbers as rf_eo_numbers
from research.papers.rf_eo import study as rf_eo
from research.papers.urban import numbers as urban_numbers
from research.papers.urban import study as urban
from wavegym.evaluation import statistics
from wavegym.testing.lockstep import difference

CLOCKED = "seconds"  # the field of runs that a clock fills


def without_clocks(study: Any) -> dict[str, Any]:
    """What a study holds, but for times."""
    held = vars(study)
    return {**held, "runs": {case: {**runs._asdict(), CLOCKED: None} for case, runs in held["runs"].items()}}


@pytest.fixture
def quick(monkeypatch):
    """Pictures of few pixels, and intervals without width: resampling thousands of them would take a minute."""
    monkeypatch.setattr(contents, "DPI", 30)
    monkeypatch.setattr(statistics, "_over_worlds", lambda statistic, worlds, *given: np.full(2, statistic(worlds)))


@pytest.fixture
def rebuilt(tmp_path, monkeypatch):
    """Rebuild the files of a paper in two processes, from runs that must be those of one; the folder with the files."""

    def rebuild(paper: ModuleType, runs: int):
        alone, studies, play = paper.play(runs, 0, 1), [], paper.play
        monkeypatch.setattr(paper, "play", lambda *given, **more: studies.append(play(*given, **more)) or studies[-1])
        name = paper.__name__.rpartition(".")[2]
        assert main([name, "--runs", str(runs), "--jobs", "2", "--out", str(tmp_path)]) == 0
        (together,) = studies
        assert difference(without_clocks(together), without_clocks(alone)) is None
        assert {path.name for path in tmp_path.iterdir()} == set(paper.FILES)
        return tmp_path

    return rebuild


@pytest.fixture(scope="session")
def rf_eo_study():
    """Every policy of both scenes, a few steps of a few worlds."""
    return rf_eo.play(RF_EO_RUNS, RF_EO_SEED, 1, tuning=2, horizon=RF_EO_STEPS)


@pytest.fixture(scope="session")
def rf_eo_summary(rf_eo_study):
    return rf_eo_numbers.summarise(rf_eo_study)


@pytest.fixture(scope="session")
def urban_study():
    """Every filter with every policy, whole episodes of a few worlds."""
    return urban.play(URBAN_RUNS, URBAN_SEED, 1)


@pytest.fixture(scope="session")
def urban_summary(urban_study):
    return urban_numbers.summarise(urban_study)
