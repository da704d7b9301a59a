"""Monte-Carlo tree search over choices and their outcomes (Kocsis & Szepesvari 2006), the base policy at the leaves."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.schedulers.myopic import impossible
from wavegym.schedulers.planners.base import Planner
from wavegym.schedulers.rollout import allowed

EXPLORATION = 2.0  # standard deviations of the root's returns: less commits to one choice before others are tried
LINE = 4  # choices of the principal variation
TRIED = 8  # visits of a node from which on its choice belongs to the principal variation


@dataclass
class _Node:
    """A history of choices and outcomes: a node of the tree."""

    permitted: Array  # (option,) bool
    visits: Array = field(init=False)
    total: Array = field(init=False)
    children: dict[tuple[int, bytes], _Node] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.visits, self.total = np.zeros(len(self.permitted), np.int64), np.zeros(len(self.permitted))

    def option(self, own: int, spread: float) -> int:
        """The base's own choice first, then each untried one, then the one with the least lower confidence bound."""
        if not self.visits[own]:
            return own
        untried = self.permitted & (self.visits == 0)
        if untried.any():
            return int(untried.argmax())
        bound = self.total / np.maximum(self.visits, 1)
        bound = bound - spread * np.sqrt(np.log(self.visits.sum()) / np.maximum(self.visits, 1))
        return int(np.where(self.permitted, bound, np.inf).argmin())


def _line(root: _Node, options: Array) -> Array:
    """The principal variation, (LINE,): the choices visited most, after the outcomes seen most; -1 where it ends."""
    line, node = np.full(LINE, -1), root
    for t in range(LINE):
        if t and node.visits.sum() < TRIED:
            break
        option = int(node.visits.argmax())
        line[t] = options[option]
        below = [child for (choice, _), child in node.children.items() if choice == option]
        if not below:
            break
        node = max(below, key=lambda child: int(child.visits.sum()))
    return line


class MonteCarloTree(Planner):
    """Monte-Carlo tree search: each of ``simulations`` futures descends by confidence bounds and adds one node.

    A node is a history of choices and detections; below the tree the base policy chooses. The most visited choices
    along the tree are then compared with the base in fresh futures that both share: the first choice alone, and all of
    them as a plan. Actions must be indices.

    Args:
        base, depth, futures, errors: see ``Planner``.
        simulations: futures simulated for one decision.
        exploration: width of the confidence bound, in standard deviations of the returns.
    """

    def __init__(
        self, base: Policy, simulations: int, depth: int = 20, exploration: float = EXPLORATION, **settings: Any
    ) -> None:
        super().__init__(base, depth, **settings)
        self.simulations, self.exploration = check_int("simulations", simulations, 1), exploration

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError for actions that are no indices."""
        if system.candidates().ndim > 1:
            raise impossible("mcts", system, "its actions are no single indices")
        super().begin(system, num_envs, rng)

    def improved(self, belief: Any, own: Array, mask: Array | None, prepared: Array | None, rows: Array) -> Array:
        """See ``Planner``."""
        options, permitted = self.options(belief, mask)
        roots = [_Node(row) for row in permitted]
        returns: list[Array] = []
        for _ in range(self.simulations):
            spread = np.std(returns, axis=0) if len(returns) > 1 else np.zeros(len(roots))
            returns.append(self._simulate(belief, options, prepared, roots, self.exploration * spread))
        lines = np.stack([_line(root, own) for root, own in zip(roots, options, strict=True)])
        first = np.where(np.arange(LINE) == 0, lines, -1)
        may = np.take_along_axis(permitted, (options == lines[:, :1]).argmax(axis=1)[:, None], axis=1)
        return self.chosen(belief, own, np.stack([first, lines], axis=1), np.repeat(may, 2, axis=1), prepared)

    def _simulate(
        self, belief: Any, options: Array, prepared: Array | None, roots: list[_Node], spread: Array
    ) -> Array:
        """Summed costs (env,) of one future of every environment; adds their nodes and returns to the trees."""
        system, base, draws = self.system, self.futures.base, self.futures.draw(len(roots), 1)
        here, total = belief, np.zeros(len(roots))
        nodes: list[_Node | None] = list(roots)
        paths: list[list[tuple[_Node, int, float]]] = [[] for _ in roots]
        for t in range(self.futures.depth):
            over = system.terminal(here)
            if over.all():
                break
            mask = allowed(system, here)
            action = base.choose(here, mask, prepared)
            inside = [e for e, node in enumerate(nodes) if node is not None and not over[e]]
            picked = {e: self._picked(nodes[e], options[e], action[e], spread[e]) for e in inside}
            for e, option in picked.items():
                node = nodes[e]
                assert node is not None
                action[e] = options[e, option]
                paths[e].append((node, option, total[e]))
            following = system.predict(here, action, None if draws is None else draws[t, :, 0])
            here = trees.merged(following, over, here)
            total = total + np.where(over, 0.0, system.cost(here))
            self._descend(here, options, nodes, picked)
        for e, path in enumerate(paths):
            for node, option, before in path:
                node.visits[option] += 1
                node.total[option] += total[e] - before
        return total

    def _picked(self, node: _Node | None, options: Array, own: Array, spread: float) -> int:
        assert node is not None
        same = np.flatnonzero(options == own)
        return node.option(int(same[0]) if same.size else int(node.permitted.argmax()), float(spread))

    def _descend(self, here: Any, options: Array, nodes: list[_Node | None], picked: dict[int, int]) -> None:
        """Go from each node to the child of its choice and outcome; a new child ends the descent."""
        mask = allowed(self.system, here) if picked else None
        seen = [here.covariance] if hasattr(here, "covariance") else [leaf for leaf in here if leaf is not None]
        for e, option in picked.items():
            node = nodes[e]
            assert node is not None
            key = (option, b"".join(leaf[e].tobytes() for leaf in seen))
            if key in node.children:
                nodes[e] = node.children[key]
                continue
            permitted = np.ones(len(options[e]), np.bool_)
            if mask is not None:
                permitted = mask[e, options[e]]
            node.children[key], nodes[e] = _Node(permitted), None
