"""The Python blocks of the hand-written pages run, in one namespace a page."""

from __future__ import annotations

import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import wavegym

DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)


@pytest.fixture
def _registry():
    known = set(gym.registry)
    yield
    for id in set(gym.registry) - known:
        gym.registry.pop(id)


def run(page: str, namespace: dict) -> None:
    for block in BLOCK.findall((DOCS / page).read_text()):
        exec(compile(block, page, "exec"), namespace)


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", ["index.md", "how_to/compare_policies.md", "how_to/train_with_sb3.md", "how_to/trained_agents.md"]
)
def test_the_blocks_of_a_page_run(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run(page, {})
    assert "geometric" in capsys.readouterr().out  # the table of a comparison
    assert list(tmp_path.glob("out/*/report.html"))


@pytest.mark.slow
def test_the_agent_of_the_readme_beats_the_one_step_scheduler(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    namespace = {}
    run("../README.md", namespace)
    played = namespace["comparison"]
    assert played.cost("mine").mean() < 0.9 * played.cost("myopic").mean()
    assert "geometric" in capsys.readouterr().out


def test_the_scenario_files_of_the_page_are_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page, namespace = "how_to/scenario_files.md", {}
    run(page, namespace)
    system = namespace["env"].unwrapped.system
    assert (system.horizon, system.q, system.truth) == (30, 50.0, {"q": 200.0})
    assert namespace["envs"].system.horizon == 20
    (short,) = re.findall(r"^```toml\n(.*?)^```", (DOCS / page).read_text(), re.DOTALL | re.MULTILINE)
    Path("short.toml").write_text(short)
    assert gym.make("wavegym/KershawEvansPosition-v0", scenario="short.toml").unwrapped.system.start_range == (1e4, 2e4)


@pytest.mark.usefixtures("_registry")
def test_the_registrations_and_the_pulse_of_your_own_work(monkeypatch):
    made = []
    monkeypatch.setattr(gym, "make_vec", lambda id, **settings: made.append(id))  # of the package on the page
    monkeypatch.setattr("wavegym.testing.check_vector_env", made.append)  # of the example, which has its own test
    namespace = {"gym": gym}
    run("how_to/own_environment.md", namespace)
    assert made == ["mine/ShipRadar-v0", "mine/Own-v0"]
    assert {"mine/ShipRadar-v0", "mine/NarrowBand-v0"} <= set(wavegym.list_envs())
    assert namespace["R"].shape == (2, 2, 2)


@pytest.mark.slow
@pytest.mark.usefixtures("_registry")
def test_the_parts_of_your_own_work(tmp_path, monkeypatch, capsys):
    """A tracker, a library, another truth, and a composed loop that is registered and compared."""
    monkeypatch.chdir(tmp_path)
    namespace: dict = {}
    run("how_to/own_loop.md", namespace)
    assert type(namespace["envs"].system.tracker).__name__ == "FadingMemory"
    assert namespace["env"].unwrapped.system.truth_model.q == 4.0
    out = capsys.readouterr().out
    assert "lookahead:2" in out
    assert "random" in out


def test_the_scorer_in_plain_pytorch_scores_rows_alike_but_for_their_offsets():
    """The other blocks of the page are those of its libraries' own test."""
    page = (DOCS / "how_to" / "train_with_other_libraries.md").read_text()
    (block,) = (block for block in BLOCK.findall(page) if "class Scorer" in block)
    namespace = {"gym": gym}
    exec(compile(block, "scorer", "exec"), namespace)
    actor, shown = namespace["actor"], namespace["torch"].as_tensor(namespace["observation"])
    assert set(namespace["actions"].tolist()) <= set(range(namespace["choices"]))
    rows = shown[:, namespace["own"] :].unflatten(1, actor.shape)
    turned = namespace["torch"].cat([shown[:, : namespace["own"]], rows.flip(1).flatten(1)], dim=1)
    np.testing.assert_allclose(actor(turned).flip(1).detach(), actor(shown).detach(), atol=1e-6)


def test_policies_play_in_stone_soup_and_its_filters_here(capsys):
    namespace: dict = {}
    run("how_to/stone_soup.md", namespace)
    assert namespace["record"].covariance[:, 0, 0].mean() < 100.0
    assert type(namespace["clutter"].unwrapped.system.tracker).__name__ == "StoneSoupTracker"
    assert capsys.readouterr().out


@pytest.mark.slow
def test_the_dataset_of_the_page_is_written_and_read(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    namespace: dict = {}
    run("how_to/offline_data.md", namespace)
    assert "(51, 6) (50,) (50, 56)" in capsys.readouterr().out
    assert namespace["env"].spec.id == "wavegym/KershawEvansPosition-v0"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
