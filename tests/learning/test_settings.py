from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

import wavegym
from wavegym.core.errors import InputError
from wavegym.learning.settings import ALGORITHMS, FILE, DQNSettings, PPOSettings, load_settings
from wavegym.registration import RECORDS, list_envs
from wavegym.systems.kershaw_evans.system import KershawEvans

POSITION = "wavegym/KershawEvansPosition-v0"


def test_the_file_is_complete_for_every_environment() -> None:
    for env_id in [*list_envs(), "mine/NotInTheFile-v0"]:
        for algo, kind in ALGORITHMS.items():
            assert isinstance(load_settings(env_id, algo), kind)


def test_layers_override_each_other(tmp_path: Path) -> None:
    text = FILE.read_text()
    text = re.sub(r"(?m)^gamma = .*$", "gamma = 0.5", text, count=1)
    text += '\n["wavegym/KershawEvans-v0".ppo.environment]\nq = 2.0\nhorizon = 9\n'
    file = tmp_path / "settings.toml"
    file.write_text(text)
    default = load_settings("mine/Env-v0", "ppo", file=file)
    assert default.gamma == 0.5
    assert default.reward == "cost"
    own = load_settings("wavegym/KershawEvans-v0", "ppo", file=file)
    assert own.reward == "relative"
    assert own.environment == {"q": 2.0, "horizon": 9}
    changed = load_settings("wavegym/KershawEvans-v0", "ppo", {"gamma": 0}, {"horizon": 5}, file=file)
    assert changed.gamma == 0.0
    assert changed.environment == {"q": 2.0, "horizon": 5}
    assert load_settings("wavegym/KershawEvans-v0", "dqn", file=file).environment == {}


def test_a_registration_from_outside_brings_its_settings() -> None:
    settings = {"ppo": {"like": "rollouts", "steps": 640}, "dnq": {}}
    wavegym.register("tests/Set-v0", KershawEvans, settings=settings)
    try:
        with pytest.raises(InputError, match=r"algorithm in the settings of tests/Set-v0 is 'dnq'.*did you mean 'dqn'"):
            load_settings("tests/Set-v0", "ppo")
        del settings["dnq"]
        own, like = load_settings("tests/Set-v0", "ppo"), load_settings("wavegym/SectorSetup-v0", "ppo")
        assert (own.steps, own.network, own.teacher) == (640, like.network, like.teacher)
        assert load_settings("tests/Set-v0", "dqn") == load_settings("mine/NotInTheFile-v0", "dqn")
    finally:
        del gym.registry["tests/Set-v0"], RECORDS["tests/Set-v0"]


def test_parameters_that_are_given_hold_in_all_variants(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    variants = "variants = [{ q = 1.0 }, { q = 4.0, horizon = 9 }]"
    own = f'["{POSITION}".ppo]\nnum_envs = 4\n{variants}\n["{POSITION}".ppo.environment]\nhorizon = 5\n'
    file.write_text(own + FILE.read_text().partition('["wavegym/')[0])

    def loaded(*given: dict[str, Any]) -> tuple[dict[str, Any], tuple[dict[str, Any], ...]]:
        settings = load_settings(POSITION, "ppo", *given, file=file)
        return settings.environment, settings.variants

    assert loaded() == ({"horizon": 5}, ({"q": 1.0}, {"q": 4.0, "horizon": 9}))
    assert loaded({}, {"q": 2.0}) == ({"horizon": 5, "q": 2.0}, ({}, {"horizon": 9}))
    assert loaded({"environment": {"horizon": 3}}) == ({"horizon": 3}, ({"q": 1.0}, {"q": 4.0}))
    assert loaded({}, {"q": 2.0, "horizon": 3}) == ({"horizon": 3, "q": 2.0}, ()), "nothing differs any more"
    assert loaded({"variants": [{"q": 8.0}, {}]}, {"q": 2.0})[1] == ({"q": 8.0}, {}), "variants that are asked for"


def test_a_table_that_is_like_another_takes_its_settings_and_keeps_its_own(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    shared = '\n["wavegym/AgileClutter-v0".ppo]\nlike = "long"\nlearning_rate = 0.25\n'
    shared += "[long.ppo]\nlearning_rate = 0.5\nclip_range = 0.75\n"
    file.write_text(re.sub(r'(?m)^\["wavegym/AgileClutter-v0".ppo\]\n.*\n', "", FILE.read_text()) + shared)
    settings = load_settings("wavegym/AgileClutter-v0", "ppo", {"clip_range": 0.125}, file=file)
    assert isinstance(settings, PPOSettings)
    assert (settings.learning_rate, settings.clip_range) == (0.25, 0.125)
    assert settings.gamma == load_settings("mine/Env-v0", "ppo").gamma
    for env_id in list_envs():  # nothing but settings is left of it
        load_settings(env_id, "ppo")
    file.write_text(file.read_text().replace("[long.ppo]", "[lomg.ppo]"))
    with pytest.raises(InputError, match=r"table of settings\.toml is 'lomg'"):
        load_settings("wavegym/AgileClutter-v0", "ppo", file=file)
    file.write_text(file.read_text().replace("[lomg.ppo]", '["wavegym/RfEoFar-v0".dqn.more]'))
    with pytest.raises(
        InputError, match=r"like in table 'wavegym/AgileClutter-v0' of settings\.toml is 'long', expected"
    ):
        load_settings("wavegym/AgileClutter-v0", "ppo", file=file)


def test_types_are_those_of_the_algorithms() -> None:
    ppo, dqn = load_settings(POSITION, "ppo", {"network": [32]}), load_settings(POSITION, "dqn")
    assert isinstance(ppo, PPOSettings)
    assert ppo.network == (32,)
    assert isinstance(dqn, DQNSettings)
    assert dqn.gradient_steps == 4


@pytest.mark.parametrize(
    ("algo", "changes", "message"),
    [
        ("ppo", {"gama": 0}, "PPOSettings got an unexpected keyword argument 'gama'; did you mean 'gamma'"),
        ("dqn", {"n_epochs": 3}, "DQNSettings got an unexpected keyword argument 'n_epochs'"),
        ("ppo", {"gamma": 1.5}, "gamma is 1.5"),
        ("ppo", {"gamma": "half"}, "gamma is 'half'"),
        ("ppo", {"learning_rate": float("nan")}, "learning_rate is nan"),
        ("ppo", {"num_envs": 0}, "num_envs is 0"),
        ("ppo", {"batch_size": 1}, "batch_size is 1, expected an integer >= 2 (nearest: 2)"),
        ("ppo", {"n_steps": 1, "num_envs": 1, "variants": []}, "n_steps times num_envs is 1, expected >= 2"),
        ("ppo", {"network": [64, -1]}, "network.1 is -1"),
        (
            "ppo",
            {"num_envs": 64, "variants": [{"q": 1.0}] * 3},
            "num_envs is 64, expected a multiple of the 3 variants (nearest: 63)",
        ),
        ("dqn", {"activation": "tan"}, "activation is 'tan'"),
        ("pop", {}, "algorithm is 'pop', expected one of 'ppo', 'dqn'; did you mean 'ppo'"),
    ],
)
def test_a_bad_setting_is_named_in_one_line(algo: str, changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        load_settings(POSITION, algo, changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("[pppo]\n", "table of settings.toml is 'pppo'"),
        ('["wavegym/KershawEvan-v0".ppo]\n', "did you mean 'wavegym/KershawEvans-v0'"),
        ('["wavegym/KershawEvans-v0"]\nppo2 = {gamma = 0.5}\n', "did you mean 'ppo'"),
        ("gamma 0.5\n", "cannot be read"),
    ],
)
def test_a_bad_file_is_named_in_one_line(tmp_path: Path, line: str, message: str) -> None:
    file = tmp_path / "settings.toml"
    original = re.sub(r'(?ms)^\["wavegym/KershawEvans-v0".*?\n\n', "", FILE.read_text())
    file.write_text(original + line)
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        load_settings(POSITION, "ppo", file=file)
    assert "\n" not in str(caught.value)


def test_a_missing_setting_and_a_missing_file_are_named(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text("[ppo]\ngamma = 0.5\n")
    with pytest.raises(InputError, match="is missing, expected it in the settings file"):
        load_settings(POSITION, "ppo", file=file)
    with pytest.raises(InputError, match="cannot be read"):
        load_settings(POSITION, "ppo", file=tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("num_envs", "--setting num_envs=N"),
        ("reward", "--setting reward=NAME"),
        ("autoreset_mode", "none: training needs SameStep"),
        ("measurements", "none: agents read"),
        ("observation", "none: agents observe the belief"),
        ("render_mode", "none"),
        ("wrappers", "none"),
    ],
)
def test_what_is_no_parameter_of_the_system_is_sent_where_it_belongs(name: str, hint: str) -> None:
    with pytest.raises(InputError, match=f"'{name}' is no parameter of an environment's system, expected {hint}"):
        load_settings(POSITION, "ppo", parameters={name: 3})
    with pytest.raises(InputError, match=f"'{name}' is no parameter of an environment's system"):
        load_settings(POSITION, "ppo", {"variants": [{"q": 1.0}, {name: 3}]})
