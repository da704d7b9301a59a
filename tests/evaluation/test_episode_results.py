"""Results are what was played, from memory, from episodes.csv or from a compressed table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.evaluation import compare
from wavegym.evaluation.report import TABLE, compressed, episodes, read_results
from wavegym.schedulers import Fixed


def test_a_file_holds_every_figure(tmp_path: Path) -> None:
    comparison = compare("tests/Measured-v0", {"learner": [Fixed(0), Fixed(1)]}, worlds=6, jobs=1, progress=False)
    file, table = tmp_path / "episodes.csv", tmp_path / f"learner{TABLE}"
    file.write_text(episodes(comparison))
    table.write_bytes(compressed(comparison.by_policy()))
    assert compressed(read_results(file)) == compressed(read_results(table)) == table.read_bytes()
    read = read_results(table)
    assert list(read) == ["myopic", "learner"]
    for name, results in read.items():
        own = comparison.results(name)
        for field, values in results._asdict().items():
            np.testing.assert_array_equal(values, getattr(own, field), err_msg=field)
    assert read["learner"].cost.shape == (2, 6)
    np.testing.assert_array_equal(read["myopic"].squared_error, read["myopic"].gospa ** 2)


def test_an_older_file_lacks_what_was_not_recorded(tmp_path: Path) -> None:
    file = tmp_path / "episodes.csv"
    file.write_text("policy,member,world,seed,steps,cost,rmse,nees,lost\nmyopic,0,0,7,5,2.0,3.0,4.0,\n")
    results = read_results(file)["myopic"]
    assert (results.cost.item(), results.squared_error.item(), results.nees.item()) == (2.0, 9.0, 4.0)
    assert np.isnan([results.believed_rmse, results.gospa, results.lost]).all()


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.csv is missing, expected it from `make headroom`"):
        read_results(tmp_path / "none.csv")
