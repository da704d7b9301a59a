"""``wavegym warm-up``: after it nothing is compiled, and mistakes take one line."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import oracles
import pytest
from numba.core import event

from wavegym.cli.main import main
from wavegym.schedulers import tuned_constants
from wavegym.testing import check

ID = "KershawEvansPosition-v0"


class Compiled(event.Listener):
    """Counts compilations of kernels of wavegym."""

    def __init__(self) -> None:
        self.count = 0

    def on_start(self, event: event.Event) -> None:
        self.count += 1

    def on_end(self, event: event.Event) -> None:
        """Nothing to count."""


def test_after_it_nothing_is_compiled(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["warm-up", ID, "--jobs", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines] == [f"wavegym/{ID}", "all"]
    assert all(line.endswith(" s") for line in lines)
    seen = Compiled()
    with event.install_listener("numba:compile", seen):
        assert main(["warm-up", ID, "--jobs", "1"]) == 0
    assert seen.count == 0


def test_what_planners_call_is_compiled_too() -> None:
    """``predict``, and futures on a time line."""
    assert main(["warm-up", "MultifunctionRadar-v1", "--jobs", "1"]) == 0
    env = gym.make("wavegym/MultifunctionRadar-v1").unwrapped
    env.reset(seed=0)
    seen = Compiled()
    with event.install_listener("numba:compile", seen):
        env.policy("dwell-rollout:2")()
        system = env.system
        system.predict(system.initial(oracles.worlds(system, 2)).belief, np.zeros(2, np.int64))
    assert seen.count == 0


def test_an_unknown_environment_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["warm-up", "KershawEvansPosition-v9"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")


def test_no_rule_is_tuned(own_environments: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tuning takes hours where a step takes milliseconds, and compiles nothing that steps do not need."""

    def tuned(*arguments: object) -> None:
        raise AssertionError("a rule was tuned")

    monkeypatch.setattr(tuned_constants, "best_simple", tuned)
    assert main(["warm-up", "tests/Uneven-v0", "--jobs", "1"]) == 0


def test_a_defect_in_what_planners_call_is_left_to_the_check(
    own_environments: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def defective(system: object) -> None:
        asked.append(system)
        raise ValueError("predict fails")

    monkeypatch.setattr(check, "prediction_defect", defective)
    assert main(["warm-up", "tests/Uneven-v0", "--jobs", "1"]) == 0
    assert len(asked) == 1
