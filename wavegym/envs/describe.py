"""The page of an environment in the docs, as Markdown: actions, observations, rewards, info and parameters.

>>> from wavegym.envs.describe import describe
>>> describe("wavegym/KershawEvans-v0").splitlines()[0]
'# wavegym/KershawEvans-v0'
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from contextlib import suppress
from typing import Any

import gymnasium as gym
import numpy as np

from wavegym.core.action_sets import JointLibrary, ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.parameters import parameter_infos
from wavegym.core.system import ObservationField, System
from wavegym.core.track_loss import LOST_AFTER
from wavegym.core.traits import TimedPulses, UnequalSteps
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.envs.rewards import scale_of
from wavegym.observations.scaling import LIMIT
from wavegym.observations.shortlist import Shortlist
from wavegym.registration import RECORDS, SETTINGS, TIERS, full_id

SECTIONS = ("Description", "Rewards", "Starting state", "Episode end")  # of a system's docstring
INFO = {
    "cost": "cost of the belief after the step: see Rewards",
    "saturated": "number of observation fields clipped at their bound",
}
INFO_INDEX = {"waveform": "index of the waveform transmitted; `env.unwrapped.system.actions.labels` names it"}
INFO_LOSSES = {
    "astray": "of each target present: no track is within {beyond:.4g} m of it and has it in its 99.9 % region",
    "lost": "of each target that had a track: astray in at least the last {steps} steps of its presence",
}
INFO_PER_SENSOR = {
    "waveform": "indices of the waveforms transmitted, one for each sensor; `env.unwrapped.system.actions.labels` "
    "names them, and `choices` in `summary.json` of an evaluation holds the share of each label"
}
INFO_LISTED = {"sent": "with `candidates`: the action of the rank"}
INFO_BOX = {
    "parameters": "box actions: their physical values",
    "action_clipped": "box actions: whether the action lay outside [-1, 1] and was clipped",
}
INFO_RELATIVE = {
    "reference_cost": 'with `reward="relative"`: cost of the reference policy at the same step of the same world',
}
INFO_AT_TIMES = {
    "final_obs": 'with `autoreset_mode="SameStep"`: last observation of an episode that ended in this step',
    "final_info": 'with `autoreset_mode="SameStep"`: last info of that episode',
}
EXTENT_WORLDS = 100  # in which the ranges and speeds of targets are looked up
TIMING_HEAD = (
    "pulse", "duration µs", "blind to km", "range folds at km", "range-rate folds at m/s", "duty cycle %",
    "% of a step on the air",
)  # fmt: skip
MOST_ROWS = 100  # of the table of a joint form; the order of the combinations defines a longer table
FORMS = ("library", "joint", "box")  # values of a system's parameter ``action``; a system may accept only some


def describe(id: str, /, **parameters: Any) -> str:
    """The page of the environment ``gym.make(id, **parameters)``, as Markdown.

    Raises:
        InputError: no such environment or parameter (nearest named), or a value out of range.
    """
    id = full_id(id)
    env = gym.make(id, **parameters).unwrapped
    given = "".join(f", {name}={value!r}" for name, value in parameters.items())
    assert isinstance(env.system, System)  # type: ignore[attr-defined]
    system: System = env.system  # type: ignore[attr-defined]
    observer = env.batch.episodes.observer  # type: ignore[attr-defined]
    parts = [
        f"# {id}",
        summary(type(system)),
        _tier(id),
        f'```python\nimport gymnasium as gym\nimport wavegym\n\nenv = gym.make("{id}"{given})\n'
        f'envs = gym.make_vec("{id}", num_envs=64{given})\n```',
        *(_chapter(heading, section(type(system), heading)) + _scale(heading, system) for heading in SECTIONS),
        "## Actions",
        _ranks(observer.shortlist),
        *(_actions(form, chosen) for form, chosen in _forms(system).items()),
        _timing(system),
        "## Observations",
        _observations(observer.observation_fields),
        "## Info",
        _info(env, system),
        "## Parameters",
        f'Of the system: `gym.make("{id}", name=value)`. Where the truth may differ, `truth={{"name": value}}` changes '
        "the world only. Tracker and schedulers keep their assumption.",
        _parameters(system),
        "Of every environment:",
        _settings(),
        _chapter("References", section(type(system), "References")),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def table(head: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    """A Markdown table."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def _chapter(heading: str, text: str) -> str:
    return f"## {heading}\n\n{text}" if text else ""


def _tier(id: str) -> str:
    """What the environment is for, and what sets its difficulty."""
    record = RECORDS[id]
    lines = [f"Tier *{record.tier}*: {TIERS[record.tier]}."] if record.tier else []
    for name, values in record.grades.items():
        lines.append(f"Difficulty: `{name}`, from {values[0]} (easy) to {values[-1]} (hard).")
    return " ".join(lines)


def _scale(heading: str, system: System) -> str:
    """The number of ``reward="scaled"``, after the rewards; "" elsewhere, and without a record."""
    with suppress(InputError):
        if heading == "Rewards":
            scale = f"{scale_of(system):g}, the mean cost of `myopic` with the default parameters"
            return f'\n\n`reward="scaled"` is this over {scale}.'
    return ""


def _forms(system: System) -> dict[str, System]:
    """The system in each form of its action set, the one in use first; {"": system} where there is only one."""
    current = getattr(system, "action", None)
    if current not in FORMS or not dataclasses.is_dataclass(system):
        return {"": system}
    forms = {current: system}
    for form in FORMS:
        if form != current:
            with suppress(ValueError):  # this system lacks the form; validation errors and InputErrors are ValueErrors
                forms[form] = dataclasses.replace(system, action=form)  # type: ignore[call-arg]
    return forms


def _ranks(shortlist: Shortlist | None) -> str:
    """What a rank in a short list means; "" without one."""
    if shortlist is None:
        return ""
    return (
        f"With `candidates={shortlist.count}`: `Discrete({shortlist.count})`, a rank in a list of the actions below. "
        "Rank 0 is the choice of `myopic`; others follow in the order of their expected cost one step ahead."
    )


def _actions(form: str, system: System) -> str:
    """One form of the action set."""
    actions = system.actions
    prefix = f'With `action="{form}"`: ' if form else ""
    if isinstance(actions, ParameterBox):
        rows = [(f"`{p.name}`", p.unit, f"{p.low:g}", f"{p.high:g}", p.scale) for p in actions.parameters]
        space = f"`Box(-1, 1, ({len(rows)},))`, each element scaled to its parameter's range."
        return f"{prefix}{space}\n\n" + table(("parameter", "unit", "at -1", "at +1", "scale"), rows)
    labelled = list(enumerate(actions.labels))
    head = ("index", "waveform")
    if isinstance(actions, PerSensorLibrary):
        sizes = [len(actions)] * actions.sensors
        space = f"`MultiDiscrete({sizes})`, one index per sensor, the same waveforms at each."
    elif isinstance(actions, JointLibrary):
        space = f"`Discrete({len(labelled)})`, {_combinations(actions)}"
        head = ("index", "waveforms")
        if len(labelled) > MOST_ROWS:
            return f"{prefix}{space}"
    else:
        space = f"`Discrete({len(labelled)})`."
    return f"{prefix}{space}\n\n" + table(head, labelled)


def _combinations(actions: JointLibrary) -> str:
    """The order of a joint form, and the waveforms of one sensor."""
    count, listed = len(actions.library), ", ".join(actions.library.labels)
    return (
        f"every combination of {count} waveforms at {actions.sensors} sensors, the first sensor's changing slowest. "
        f"The {count}: {listed}."
    )


def _timing(system: System) -> str:
    """Blind and ambiguous ranges and speeds of every pulse, against those of the targets."""
    if not isinstance(system, TimedPulses):
        return ""
    (nearest, slowest), (farthest, fastest) = target_extent(system)
    rows, labels = [], dict[Any, list[str]]()
    for label, timing in system.timings.items():
        labels.setdefault(timing, []).append(label)
    for timing, alike in labels.items():
        others = f" and {len(alike) - 1} more" if len(alike) > 1 else ""
        ambiguous = [
            "none" if math.isinf(value) else f"{value:.4g}"
            for value in (1e-3 * timing.unambiguous_range, timing.unambiguous_velocity)
        ]
        duty = "none" if timing.interval is None else f"{100 * timing.duty_cycle:.3g}"
        sent = f"{100 * timing.time_on_air / system.dt:.2g}"
        blind = "none" if system.bistatic else f"{1e-3 * timing.blind_range:.4g}"
        lengths = f"{1e6 * timing.duration:.4g}", blind
        rows.append((alike[0] + others, *lengths, *ambiguous, duty, sent))
    text = (
        f"In {EXTENT_WORLDS} worlds the targets are {1e-3 * nearest:.4g} to {1e-3 * farthest:.4g} km away, at "
        f"range-rates of {slowest:.4g} to {fastest:.4g} m/s. {system.duration_means} "
        "[Waveform timing](../waveform_timing.md) defines the columns."
    )
    if system.bistatic:
        text += " The receivers have their own antennas and listen while the transmitter transmits."
    if system.chooses_prf:
        text += " The PRF is chosen: a target may be ambiguous or hidden at one PRF, and clear at another."
    return f"## Timing\n\n{text}\n\n" + table(TIMING_HEAD, rows)


def target_extent(system: Any) -> Array:
    """Least and greatest range (m) and range-rate (m/s) of all targets in the first test worlds, (2, 2).

    Args:
        system: has the trait ``TimedPulses``.
    """
    ranges = system.target_ranges(draw_worlds(system, world_seeds(0, "test", EXTENT_WORLDS))).reshape(-1, 2)
    return np.stack([ranges.min(axis=0), ranges.max(axis=0)])


def _observations(fields: tuple[ObservationField, ...]) -> str:
    """Every field with its scale and its bounds in physical units."""
    rows = [
        (
            i,
            f"`{field.name}`",
            field.unit,
            f"{field.centre:g}",
            f"{field.scale:g}",
            f"{field.centre - LIMIT * field.scale:g} to {field.centre + LIMIT * field.scale:g}",
            field.meaning,
        )
        for i, field in enumerate(fields)
    ]
    text = f"`Box({-LIMIT:g}, {LIMIT:g}, ({len(rows)},), float32)`: (value - centre) / scale, clipped to the bounds."
    return f"{text}\n\n" + table(("index", "name", "unit", "centre", "scale", "bounds", "meaning"), rows)


def _info(env: Any, system: System) -> str:
    """Every key of the info of reset and step, with the shape of its value."""
    env.reset(seed=0)
    env.action_space.seed(0)
    info = env.step(env.action_space.sample())[-1]
    forms = [form.actions for form in _forms(system).values()]
    boxed, several = (any(isinstance(actions, kind) for actions in forms) for kind in (ParameterBox, PerSensorLibrary))
    relative = {} if isinstance(system, UnequalSteps) else INFO_RELATIVE
    chosen = {**INFO_INDEX, **(INFO_PER_SENSOR if several else {}), **(INFO_BOX if boxed else {})}
    chosen = INFO_LISTED if env.batch.episodes.observer.shortlist else chosen
    losses = {}
    if "astray" in info:
        losses = {key: text.format(beyond=system.lost_beyond, steps=LOST_AFTER) for key, text in INFO_LOSSES.items()}
    known = {**INFO, **chosen, **losses, **relative, **INFO_AT_TIMES}
    figures = " ".join((type(system).state_info.__doc__ or "").split())
    rows = [(f"`{key}`", _kind(value), known.pop(key, "key figure, see below")) for key, value in info.items()]
    rows += [(f"`{key}`", "", meaning) for key, meaning in known.items()]
    below = f"\n\nKey figures: {figures}" if type(system).state_info is not System.state_info else ""
    return table(("key", "type", "meaning"), rows) + below


def _kind(value: Any) -> str:
    return f"array {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__


def _parameters(system: System) -> str:
    """Every parameter with its value in this environment, its unit and its meaning."""
    if not dataclasses.is_dataclass(system):
        return "None."
    rows = [
        (
            f"`{info.name}`",
            _value(getattr(system, info.name)),
            info.unit,
            "yes" if info.truth else "",
            info.description,
        )
        for info in parameter_infos(type(system))
        if info.name not in SETTINGS
    ]
    return table(("parameter", "value", "unit", "truth may differ", "meaning"), rows)


def _settings() -> str:
    return table(("setting", "meaning"), [(f"`{name}`", meaning) for name, meaning in SETTINGS.items()])


def summary(cls: type) -> str:
    """First line of the docstring."""
    return inspect.cleandoc(cls.__doc__ or "").partition("\n")[0]


def section(cls: type, heading: str) -> str:
    """The indented text under ``heading`` in the docstring of ``cls``, or of the nearest base class that has it."""
    for base in cls.__mro__:
        match = re.search(rf"^{heading}\n((?:[ \t]+.*\n?|\n)+)", inspect.cleandoc(base.__doc__ or ""), re.MULTILINE)
        if match:
            return inspect.cleandoc(match[1]).strip()
    return ""


def _value(value: Any) -> str:
    """A parameter's value, floats to six digits."""
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, (tuple, list)):
        return f"({', '.join(_value(v) for v in value)}{',' * (len(value) == 1)})"
    return f"`{value!r}`" if isinstance(value, str) else str(value)
