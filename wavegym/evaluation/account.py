"""What a policy's episodes cost by belief, and how large the errors were in truth."""

from __future__ import annotations

import csv
import lzma
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.evaluation.files import csv_text
from wavegym.evaluation.play import Played


class Account(NamedTuple):
    """The figures of every episode of a policy, (member, world) each; NaN where the system has no such metric."""

    cost: Array  # by belief, mean per step
    rmse: Array  # root mean square position error over steps and the targets present, m
    believed_rmse: Array  # the same by belief, m
    gospa: Array  # root mean square GOSPA distance over steps, m
    nees: Array  # mean over steps and the targets present
    lost: Array  # tracks lost when the episode ended
    outside: Array  # share of decisions on observations outside the range of the policy's training

    @property
    def in_gospa(self) -> bool:
        """Whether the error by truth is the GOSPA distance, as in systems that report it."""
        return not np.isnan(self.gospa).all()

    @property
    def squared_error(self) -> Array:
        """The error by truth, m^2 per step: of the GOSPA distance where it is reported, else of the position."""
        return np.square(self.gospa if self.in_gospa else self.rmse)


BY_EPISODE = Account._fields  # columns of episodes.csv
TABLE = ".csv.xz"  # suffix of the suite's own results


def account_of(members: Sequence[Played]) -> Account:
    """The account of a policy's members on the same worlds."""
    by_episode = [by_world(member) for member in members]
    return Account(*(np.stack(values) for values in zip(*by_episode, strict=True)))


def by_world(played: Played) -> list[Array]:
    """One member's figures in the order of ``BY_EPISODE``, (world,) each."""
    return [played.episode_cost(), *(getattr(played, name) for name in BY_EPISODE[1:])]


def compressed(accounts: Mapping[str, Account]) -> bytes:
    """A file ``TABLE`` with every digit of the accounts, by policy; the same accounts give the same bytes."""
    rows = (
        [name, member, *("" if np.isnan(value) else value for value in values)]
        for name, account in accounts.items()
        for member, table in enumerate(np.stack(account, axis=2).tolist())
        for values in table
    )
    return lzma.compress(csv_text(("policy", "member", *BY_EPISODE), rows).encode(), preset=9)


def read_accounts(file: Path) -> dict[str, Account]:
    """The accounts by policy in an episodes.csv or a file ``TABLE``. A column that the file lacks is NaN.

    Raises:
        InputError: the file is missing.
    """
    if not file.exists():
        raise InputError(f"{file} is missing, expected it from `make headroom` or `python -m agents.leaderboard`")
    rows: dict[str, dict[int, list[list[float]]]] = {}
    opened = lzma.open if file.suffix == ".xz" else open
    with opened(file, "rt", newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            members = rows.setdefault(row["policy"], {})
            members.setdefault(int(row["member"]), []).append([float(row.get(key) or "nan") for key in BY_EPISODE])
    values = {name: np.array([members[m] for m in sorted(members)]) for name, members in rows.items()}
    return {name: Account(*np.moveaxis(table, 2, 0)) for name, table in values.items()}
