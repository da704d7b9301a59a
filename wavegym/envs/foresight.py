"""The part of the conformance check that looks at a system's own promises: what planners and masks lean on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wavegym.systems import trees
from wavegym.systems.contract import System

Array = NDArray[Any]

WORLDS = 3


def foresight_defect(system: System, seed: int = 0) -> str | None:
    """What is wrong with ``imagine``, ``cost`` or ``mask``, in words; None where nothing is.

    A system without ``imagine`` (NotImplementedError) cannot be planned for, which is no defect.
    """
    generators = [np.random.default_rng([seed, i]) for i in range(WORLDS)]
    public = system.begin(trees.stack([system.draw_world(rng) for rng in generators])).public
    before, candidates = trees.copied(public), system.candidates()
    count = len(candidates)
    forms = {
        "(env,)": (candidates[np.arange(WORLDS) % count], (WORLDS,)),
        "(1, candidate)": (candidates[None], (WORLDS, count)),
        "(env, candidate)": (np.repeat(candidates[None], WORLDS, axis=0), (WORLDS, count)),
    }
    for form, (actions, shape) in forms.items():
        try:
            imagined = system.imagine(public, actions)
        except NotImplementedError:
            break
        defect = _imagined_defect(system, public, imagined, shape)
        if defect:
            return f"imagine() with actions {form}: {defect}"
    if not _same(before, public):
        return "imagine() changed the public state that it was given"
    return _mask_defect(system, public, count)


def _imagined_defect(system: System, public: Any, imagined: Any, shape: tuple[int, ...]) -> str | None:
    for name, leaf in imagined._asdict().items():
        if isinstance(leaf, np.ndarray) and leaf.shape[: len(shape)] != shape:
            return f"{name} has shape {leaf.shape}, expected {shape} and its own axes"
    later = public.step.reshape(-1, *[1] * (len(shape) - 1)) + 1
    if not (imagined.step == later).all():
        return "step is not one later"
    cost = np.asarray(system.cost(imagined))
    if cost.shape != shape:
        return f"cost() returned shape {cost.shape}, expected {shape}"
    return None if np.isfinite(cost).all() else "cost() is not finite"


def _mask_defect(system: System, public: Any, count: int) -> str | None:
    if type(system).mask is System.mask:
        return None
    mask = system.mask(public)
    if mask.shape != (WORLDS, count) or mask.dtype != np.bool_:
        return f"mask() returned shape {mask.shape} of {mask.dtype}, expected ({WORLDS}, {count}) of bool"
    return None if mask.any(axis=1).all() else "mask() allows nothing"


def _same(a: Any, b: Any) -> bool:
    leaves: list[bool] = []
    trees.tree_map(lambda x, y: leaves.append(np.array_equal(x, y, equal_nan=x.dtype.kind == "f")), a, b)
    return all(leaves)
