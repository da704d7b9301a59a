"""``describe`` says what an environment really does."""

import dataclasses
import re
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from small_systems import has_form

import wavegym
from wavegym.core.errors import InputError
from wavegym.core.traits import UnequalSteps
from wavegym.envs.describe import describe, section, summary
from wavegym.registration import SYSTEMS
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition
from wavegym.systems.rf_eo.system import RfEo

IDS = list(SYSTEMS)
STEPS = 5  # of a short episode, whose account still pays a pulse
SHORT = {"wavegym/SharedSpectrum-v0": {"history": STEPS}}  # what must be as short


def rows(page, first_heading):
    """Cells of the table whose first column is headed so, as strings."""
    lines = page.partition(f"\n| {first_heading} |")[2].splitlines()[2:]
    table = lines[: next((i for i, line in enumerate(lines) if not line.startswith("|")), len(lines))]
    return [[cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in table]


def chapter(page, heading):
    return "\n" + page.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def test_a_page_with_parameters_is_that_environment_s():
    given = {"starts": ((0.0, 0.0, 2e3, 0.0),), "penalty": "huber"}
    page = wavegym.describe("wavegym/RfEo-v0", **given)
    assert f"gym.make(\"wavegym/RfEo-v0\", starts={given['starts']}, penalty='huber')" in page
    fields = RfEo(**given).observation_fields
    assert len(rows(chapter(page, "Observations"), "index")) == len(fields) != len(RfEo().observation_fields)
    values = {row[0]: row[1] for row in rows(chapter(page, "Parameters"), "parameter")}
    assert (values["`starts`"], values["`penalty`"]) == ("((0, 0, 2000, 0),)", "`'huber'`")
    with pytest.raises(InputError, match="did you mean 'starts'"):
        describe("wavegym/RfEo-v0", start=3)


@pytest.mark.parametrize("id", IDS)
def test_the_observation_table_is_the_observation_space(id):
    env = gym.make(id)
    table = rows(chapter(describe(id), "Observations"), "index")
    fields = env.unwrapped.system.observation_fields
    assert env.observation_space.shape == (len(table),)
    assert f"`Box(-10, 10, ({len(table)},), float32)`" in describe(id)
    for i, (index, name, unit, centre, scale, bounds, meaning) in enumerate(table):
        assert (int(index), name, unit, meaning) == (i, f"`{fields[i].name}`", fields[i].unit, fields[i].meaning)
        low, high = (float(bound) for bound in bounds.split(" to "))
        scaled = (np.array([low, high]) - float(centre)) / float(scale)
        np.testing.assert_allclose(scaled, [env.observation_space.low[i], env.observation_space.high[i]], rtol=1e-5)


@pytest.mark.parametrize("id", IDS)
def test_what_the_table_says_is_what_the_agent_sees(id):
    env = gym.make_vec(id, 5)
    observations, _ = env.reset(seed=0)
    values = env.unwrapped.system.observe(env.unwrapped.belief)
    for i, (_, _, _, centre, scale, _, _) in enumerate(rows(chapter(describe(id), "Observations"), "index")):
        np.testing.assert_allclose(
            observations[:, i], (values[:, i] - float(centre)) / float(scale), rtol=1e-5, atol=1e-6
        )


@pytest.mark.parametrize("id", IDS)
def test_the_action_tables_are_the_forms_of_the_action_space(id):
    page = chapter(describe(id), "Actions")
    finite = gym.make(id, action="library") if has_form(id, "library") else gym.make(id)
    labels, space = finite.unwrapped.system.actions.labels, finite.action_space
    assert rows(page, "index") == [[str(i), label] for i, label in enumerate(labels)]
    several = isinstance(space, gym.spaces.MultiDiscrete)
    assert (f"`MultiDiscrete({space.nvec.tolist()})`" if several else f"`Discrete({space.n})`") in page
    if not has_form(id, "box"):
        assert "`Box(" not in page
        return
    box = gym.make(id, action="box")
    parameters = box.unwrapped.system.actions.parameters
    table = rows(page, "parameter")
    assert box.action_space.shape == (len(table),)
    for (name, unit, low, high, scale), parameter in zip(table, parameters, strict=True):
        assert (name, unit, scale) == (f"`{parameter.name}`", parameter.unit, parameter.scale)
        np.testing.assert_allclose([float(low), float(high)], [parameter.low, parameter.high], rtol=1e-5)


@pytest.mark.parametrize("id", IDS)
def test_the_info_table_has_every_key_that_comes(id):
    listed = {name.strip("`") for name, *_ in rows(chapter(describe(id), "Info"), "key")}
    seen = set()
    forms = [{"action": form} for form in ("box", "library") if has_form(id, form)]
    relative = [] if isinstance(gym.make(id).unwrapped.system, UnequalSteps) else [{"reward": "relative"}]
    for settings in ({}, *forms, *relative):
        env = gym.make_vec(id, 2, autoreset_mode="SameStep", horizon=STEPS, **SHORT.get(id, {}), **settings)
        env.reset(seed=0)
        for _ in range(STEPS):  # to the end, which has keys of its own
            seen |= set(env.step(env.action_space.sample())[-1])
    assert {key for key in seen if not key.startswith("_")} == listed


@pytest.mark.parametrize("id", IDS)
def test_the_parameter_table_has_every_parameter_with_a_meaning(id):
    system = gym.make(id).unwrapped.system
    table = {name.strip("`"): cells for name, *cells in rows(describe(id), "parameter | value")}
    assert list(table) == [field.name for field in dataclasses.fields(system) if field.name != "truth"]
    assert table["dt"][:2] == [f"{system.dt:g}", "s"]
    assert all(meaning for *_, meaning in table.values())
    settings = dict(rows(describe(id), "setting"))
    assert settings["`truth`"].startswith("parameters in which the world differs")
    assert settings["`max_episode_steps`"] == "truncate after this many steps, before the system's own end"


def test_sections_come_from_the_class_or_else_from_its_base():
    assert summary(KershawEvansPosition).startswith("Kershaw & Evans's loop with a manoeuvring target")
    assert "position-only cost" in section(KershawEvansPosition, "Description")
    assert section(KershawEvansPosition, "Episode end") == section(KershawEvans, "Episode end") != ""
    assert section(KershawEvans, "No such heading") == ""
    page = describe("wavegym/KershawEvansPosition-v0")
    headings = re.findall(r"^## (.*)$", page, re.MULTILINE)
    first = ["Description", "Rewards", "Starting state", "Episode end", "Actions", "Timing", "Observations", "Info"]
    assert headings[: len(first)] == first


def test_an_unknown_environment_is_refused_with_the_nearest_named():
    with pytest.raises(InputError, match="did you mean 'wavegym/KershawEvans-v0'"):
        wavegym.describe("wavegym/KershawEvan-v0")
    with pytest.raises(InputError, match="environment is 'wavegym/CartPole-v1'"):
        wavegym.describe("CartPole-v1")


def test_importing_wavegym_stays_light():
    heavy = ("numba", "matplotlib", "scipy.stats", "filterpy", "torch")
    code = f"import sys, wavegym; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
