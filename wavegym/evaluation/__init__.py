"""Evaluation: policies compared on the same worlds, with intervals.

    >>> from wavegym.evaluation import compare, summarise
    >>> parameters = {"horizon": 5}
    >>> comparison = compare("KershawEvansPosition-v0", {"random": None, "lookahead:2": None}, worlds=20, **parameters)
    >>> list(summarise(comparison)["policies"])
    ['myopic', 'random', 'lookahead:2']

``write_report(comparison, folder)`` writes the summary, the episodes, a table and a picture. A policy of your own is
compared as ``{"mine": policy}``: a Policy, a function of the observation, or a model with ``predict`` (see
``as_policy``). A list of policies stands for the training runs of one agent.
"""

from __future__ import annotations

from wavegym.core.worlds import draw_worlds, training_seeds, world_seeds
from wavegym.evaluation.adapters import Factory, as_policy
from wavegym.evaluation.comparison import Comparison, compare
from wavegym.evaluation.play import Task, make_task
from wavegym.evaluation.report import write_report
from wavegym.evaluation.summary import summarise
from wavegym.registration import full_id

__all__ = [
    "Comparison",
    "Factory",
    "Task",
    "as_policy",
    "compare",
    "draw_worlds",
    "full_id",
    "make_task",
    "summarise",
    "training_seeds",
    "world_seeds",
    "write_report",
]
