"""The part of the conformance check that calls a system's functions, on which planners and masks rely."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.system import System
from wavegym.testing.shortcut_check import shortcut_defect

WORLDS = 3
FEW = 1000  # candidates tried, evenly spaced


def prediction_defect(system: System, seed: int = 0) -> str | None:
    """The first defect of ``predict``, ``cost``, ``mask``, ``state_info`` or a shortcut, or None.

    A system without ``predict`` (NotImplementedError) has no planners; this is not a defect.
    """
    generators = [np.random.default_rng([seed, i]) for i in range(WORLDS)]
    state = system.initial(trees.stack([system.draw_world(rng) for rng in generators]))
    for name, figure in system.state_info(state).items():
        if not np.isfinite(figure).all():
            return f"state_info()[{name!r}] is not finite, expected 0 where a target is absent, and the key 'present'"
    belief = state.belief
    before, everything = trees.copied(belief), system.candidates()
    candidates = everything[:: -(-len(everything) // FEW)]
    count = len(candidates)
    forms = {
        "(env,)": (candidates[np.arange(WORLDS) % count], (WORLDS,)),
        "(1, candidate)": (candidates[None], (WORLDS, count)),
        "(env, candidate)": (np.repeat(candidates[None], WORLDS, axis=0), (WORLDS, count)),
    }
    for form, (actions, shape) in forms.items():
        try:
            predicted = system.predict(belief, actions)
        except NotImplementedError:
            break
        defect = _predicted_defect(system, belief, predicted, shape)
        if defect:
            return f"predict() with actions {form}: {defect}"
    if not _same(before, belief):
        return "predict() changed the belief that it was given"
    defect = _mask_defect(system, belief, len(everything))  # before anything plays allowed actions
    return defect or shortcut_defect(system, seed)


def _predicted_defect(system: System, belief: Any, predicted: Any, shape: tuple[int, ...]) -> str | None:
    for name, leaf in predicted._asdict().items():
        if isinstance(leaf, np.ndarray) and leaf.shape[: len(shape)] != shape:
            return f"{name} has shape {leaf.shape}, expected {shape} and its own axes"
    later = belief.step.reshape(-1, *[1] * (len(shape) - 1)) + 1
    if not (predicted.step == later).all():
        return "step is not one later"
    for name in ("cost", "trace"):
        value = np.asarray(getattr(system, name)(predicted))
        if value.shape != shape:
            return f"{name}() returned shape {value.shape}, expected {shape}"
        if not np.isfinite(value).all():
            return f"{name}() is not finite"
    return None


def _mask_defect(system: System, belief: Any, count: int) -> str | None:
    if type(system).mask is System.mask:
        return None
    mask = system.mask(belief)
    if mask.shape != (WORLDS, count) or mask.dtype != np.bool_:
        return f"mask() returned shape {mask.shape} of {mask.dtype}, expected ({WORLDS}, {count}) of bool"
    return None if mask.any(axis=1).all() else "mask() allows nothing"


def _same(a: Any, b: Any) -> bool:
    leaves: list[bool] = []
    trees.tree_map(lambda x, y: leaves.append(np.array_equal(x, y, equal_nan=x.dtype.kind == "f")), a, b)
    return all(leaves)
