"""The files of a report; results are what was played, from memory, episodes.csv or a compressed table."""

from __future__ import annotations

import csv
import errno
import json
import os
import resource
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.evaluation import compare, make_task, summarise, write_report
from wavegym.evaluation.play import play
from wavegym.evaluation.report import TABLE, compressed, episodes, read_results
from wavegym.schedulers import Fixed

FILES = ["comparison.png", "episodes.csv", "report.html", "summary.json", "table.md"]


@pytest.fixture(scope="module")
def comparison():
    policies = {"random": None, "learner": [Fixed(0), Fixed(10), Fixed(20)]}
    return compare("KershawEvansPosition-v0", policies, worlds=25, seed=4, jobs=1, horizon=5)


@pytest.fixture(scope="module")
def folder(comparison, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    write_report(comparison, folder)
    return folder


@pytest.fixture(scope="module")
def rows(folder):
    with (folder / "episodes.csv").open() as file:
        return list(csv.DictReader(file))


def column(rows, policy, key):
    return np.array([float(row[key]) for row in rows if row["policy"] == policy])


def test_the_summary_has_the_agreed_form(folder):
    summary = json.loads((folder / "summary.json").read_text())
    assert list(summary) == [
        *("env", "parameters", "worlds", "seed", "versions", "in_gospa", "nees_dimension", "policies", "reversals")
    ]
    assert (summary["env"], summary["worlds"], summary["seed"]) == ("wavegym/KershawEvansPosition-v0", 25, 4)
    assert summary["parameters"] == {"horizon": 5}
    assert {"python", "wavegym", "numpy", "scipy", "gymnasium", "numba"} <= set(summary["versions"])
    assert list(summary["policies"]) == ["myopic", "random", "learner"]
    for policy in summary["policies"].values():
        assert list(policy) == [
            *(
                "cost",
                "vs_myopic",
                "score",
                "truth",
                "nees",
                "true_over_believed",
                "lost",
                "collisions",
                "share",
                "rmse",
            ),
            "us_per_decision",
        ]
        assert list(policy["truth"]) == [
            *("mean", "ci", "root", "percent", "percent_ci", "geometric_percent", "geometric_ci")
        ]
        assert list(policy["nees"]) == ["mean", "ci", "flag", "steps_outside"]
        assert list(policy["cost"]) == ["mean", "ci", "iqm", "median"]
        assert list(policy["vs_myopic"]) == ["percent", "ci", "geometric_percent", "geometric_ci"]
        assert sorted(policy["rmse"]) == ["ci", "mean", "median"]
        assert policy["lost"] is None
        assert policy["us_per_decision"] > 0
        low, high = policy["cost"]["ci"]
        assert low < policy["cost"]["mean"] < high


def test_the_summary_follows_from_the_episodes(folder, rows):
    policies = json.loads((folder / "summary.json").read_text())["policies"]
    myopic = column(rows, "myopic", "cost")
    for name, policy in policies.items():
        cost, rmse = column(rows, name, "cost"), column(rows, name, "rmse")
        middle = np.sort(cost)[len(cost) // 4 : len(cost) - len(cost) // 4]
        ratios = cost / np.tile(myopic, len(cost) // len(myopic))
        assert policy["cost"]["mean"] == pytest.approx(cost.mean(), rel=1e-12)
        assert policy["cost"]["median"] == pytest.approx(np.median(cost), rel=1e-12)
        assert policy["cost"]["iqm"] == pytest.approx(middle.mean(), rel=1e-12)
        assert policy["vs_myopic"]["percent"] == pytest.approx(100 * (cost.mean() / myopic.mean() - 1), abs=1e-9)
        geometric = 100 * (np.exp(np.log(ratios).mean()) - 1)
        assert policy["vs_myopic"]["geometric_percent"] == pytest.approx(geometric, abs=1e-9)
        assert policy["rmse"]["mean"] == pytest.approx(rmse.mean(), rel=1e-12)
        truth, true_myopic = policy["truth"], column(rows, "myopic", "rmse") ** 2
        ratios = rmse**2 / np.tile(true_myopic, len(cost) // len(myopic))
        assert truth["mean"] == pytest.approx((rmse**2).mean(), rel=1e-12)
        assert truth["root"] == pytest.approx(np.sqrt((rmse**2).mean()), rel=1e-12)
        assert truth["percent"] == pytest.approx(100 * ((rmse**2).mean() / true_myopic.mean() - 1), abs=1e-9)
        assert truth["geometric_percent"] == pytest.approx(100 * np.expm1(np.log(ratios).mean()), abs=1e-9)
        assert policy["nees"]["mean"] == pytest.approx(column(rows, name, "nees").mean(), rel=1e-12)
    assert (policies["random"]["score"], policies["myopic"]["score"]) == (0.0, 1.0)


def test_every_episode_is_there_and_can_be_played_again(rows):
    assert len(rows) == 25 * 5
    assert list(rows[0])[:5] == ["policy", "member", "world", "seed", "steps"]
    row = rows[-1]
    assert (row["policy"], row["member"], row["world"], row["lost"]) == ("learner", "2", "24", "")
    task = make_task("KershawEvansPosition-v0", {"horizon": 5})
    again = play(task, Fixed(20), [int(row["seed"])])
    assert float(row["cost"]) == again.episode_cost()[0]
    assert (row["favourite"], row["favourite_share"]) == (task.system.actions.labels[20], "1.0")


def test_what_a_system_does_not_measure_is_null_and_empty(tmp_path):
    table = write_report(compare("tests/Uneven-v0", {"fixed:1": None}, worlds=1, jobs=1), tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    fixed = summary["policies"]["fixed:1"]
    assert fixed["cost"]["ci"] is None  # one world
    assert fixed["vs_myopic"] == {"percent": 100.0, "ci": None, "geometric_percent": 100.0, "geometric_ci": None}
    assert fixed["score"] is None
    assert fixed["rmse"] == {"mean": None, "ci": None, "median": None}
    assert fixed["nees"] == {"mean": None, "ci": None, "flag": "", "steps_outside": None}
    assert "RMS error" not in table
    assert "Consistency" not in table
    last = (tmp_path / "episodes.csv").read_text().splitlines()[-1]
    assert last.endswith(",,,,,,gain 2,1.0")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("worlds", [1, 4])
@pytest.mark.parametrize("price", [0.0, -1.0])
def test_costs_that_allow_no_ratio_still_make_a_report(tmp_path, price, worlds):
    policies = {"fixed:1": None, "fixed:0": None}
    write_report(compare("tests/Hopeless-v0", policies, worlds=worlds, jobs=1, price=price), tmp_path)
    fixed = json.loads((tmp_path / "summary.json").read_text())["policies"]["fixed:1"]
    assert fixed["vs_myopic"]["geometric_percent"] is None
    assert fixed["cost"]["mean"] == 2.0 * price
    assert sorted(os.listdir(tmp_path)) == FILES


def test_lost_tracks_are_counted():
    summary = summarise(compare("tests/Measured-v0", {}, worlds=30, jobs=1))
    assert 1.0 < summary["policies"]["myopic"]["lost"] < 2.0  # one at least, two in episodes of 3 steps and more


def test_the_table_is_markdown_with_the_cheapest_first(folder, comparison):
    lines = (folder / "table.md").read_text().splitlines()
    assert lines[0] == "wavegym/KershawEvansPosition-v0, horizon=5: 25 worlds, seed 4"
    tables = "\n".join(lines).split("\n\n")[2::2]
    titles = "Cost by belief:", "Error by truth, of the position:", "Consistency of the tracker (expected NEES: 2):"
    assert tuple(lines[2::8][:3]) == titles
    for table in tables:
        cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
        assert {len(row) for row in cells} == {len(cells[0])}
        assert len({len(line) for line in table.splitlines()}) == 1  # aligned
        names = [row[0] for row in cells[2:]]
        assert names == sorted(names, key=lambda name: comparison.cost(name).mean())


@pytest.mark.slow
def test_the_picture_shows_every_policy_in_its_own_colour(folder):
    pixels = matplotlib.image.imread(folder / "comparison.png")[..., :3]
    assert min(pixels.shape[:2]) > 500
    drawn = {tuple(p) for p in np.round(255 * pixels.reshape(-1, 3)).astype(int)}
    blue, orange, green = (31, 119, 180), (255, 127, 14), (44, 160, 44)  # the first three of the palette
    assert {blue, orange, green} <= drawn


def test_a_second_report_takes_the_place_of_the_first(folder, comparison):
    write_report(comparison, folder)
    assert sorted(os.listdir(folder)) == FILES


@pytest.mark.slow
def test_a_full_disk_leaves_the_earlier_files_as_they_were(folder, comparison):
    before = {name: (folder / name).read_bytes() for name in FILES}
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, limit[1]))  # the kernel's refusal, as at the end of a disk
    try:
        with pytest.raises(OSError, match=r"episodes\.csv") as caught:
            write_report(comparison, folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert caught.value.errno == errno.EFBIG
    assert {name: (folder / name).read_bytes() for name in sorted(os.listdir(folder))} == before


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


def test_a_difference_has_the_same_interval_in_the_summary_and_in_the_comparison():
    comparison = compare("KershawEvans-v0", ["random"], worlds=8, jobs=1, progress=False, horizon=4)
    told = summarise(comparison)["policies"]["random"]["vs_myopic"]
    assert (told["geometric_percent"], tuple(told["geometric_ci"])) == comparison.against("random")
