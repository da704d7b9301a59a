"""Exported paths against what the comparison and the system report of the same worlds."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from wavegym.cli.main import main
from wavegym.core.errors import InputError
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.evaluation import compare, make_task
from wavegym.evaluation.trajectories import write_trajectories

ID = "wavegym/BeamAllocation-v0"
HORIZON = 6
SETTINGS = {"horizon": HORIZON, "lifetime": HORIZON}


def rows(file):
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paths")
    write_trajectories(folder, ID, {"random": None}, 2, worlds=5, **SETTINGS)
    return rows(folder / "trajectories.csv"), rows(folder / "measurements.csv")


def numbers(row, kind):
    return np.array([float(row[f"{kind}_{name}"]) for name in ("x", "y", "xdot", "ydot")])


def test_the_rows_are_those_of_every_step_and_target(written):
    paths, _ = written
    keys = {(row["policy"], int(row["world"]), int(row["step"]), int(row["target"])) for row in paths}
    assert keys == {
        (policy, world, step, target)
        for policy in ("myopic", "random")
        for world in range(2)
        for step in range(HORIZON + 1)
        for target in range(3)
    }
    assert len(paths) == len(keys)
    assert {float(row["time_s"]) - int(row["step"]) for row in paths} == {0.0}


def test_true_paths_are_the_worlds_and_one_for_all_policies(written):
    system = make_task(ID, SETTINGS).system
    truth, _ = system.initial(draw_worlds(system, world_seeds(0, "test", 2)))
    for row in written[0]:
        path = truth.path[int(row["world"]), int(row["target"]), int(row["step"])]
        np.testing.assert_array_equal(numbers(row, "true"), path)


def test_errors_are_those_of_the_comparison(written):
    played = compare(ID, {"random": None}, worlds=5, jobs=1, **SETTINGS).played
    for policy in ("myopic", "random"):
        for world in range(2):
            errors = [
                np.sum((numbers(row, "true") - numbers(row, "estimated"))[:2] ** 2)
                for row in written[0]
                if (row["policy"], row["world"]) == (policy, str(world)) and row["step"] != "0"
            ]
            assert np.sqrt(np.mean(errors)) == pytest.approx(played[policy][0].rmse[world], rel=1e-9)


def test_measurements_are_returns_near_the_targets(written):
    system, (paths, measured) = make_task(ID, SETTINGS).system, written
    present = {
        (row["policy"], row["world"], row["step"], *row["index"].split())
        for row in measured
        if row["field"] == "present" and row["value"] == "True"
    }
    assert present
    true = {(row["policy"], row["world"], row["step"], row["target"]): numbers(row, "true") for row in paths}
    near = 0
    for row in measured:
        sensor, number, quantity = (*row["index"].split(), "", "", "")[:3]
        key = (row["policy"], row["world"], row["step"])
        if row["field"] != "z" or quantity != "0" or (*key, sensor, number) not in present:
            continue
        ranges = [np.linalg.norm(true[*key, str(t)][:2] - system.sensors[int(sensor)]) for t in range(3)]
        near += min(abs(float(row["value"]) - np.array(ranges))) < 200.0
    assert near > 0.5 * len(present)


@pytest.mark.slow
def test_the_command_writes_them_on_request(tmp_path, capsys):
    given = ["KershawEvans-v0", "--policies", "random", "--worlds", "2", "--jobs", "1", "--set", "horizon=3"]
    assert main(["evaluate", *given, "--out", str(tmp_path / "a")]) == 0
    assert not (tmp_path / "a" / "trajectories.csv").exists()
    assert main(["evaluate", *given, "--trajectories", "2", "--out", str(tmp_path / "b")]) == 0
    assert "trajectories.csv, measurements.csv" in capsys.readouterr().out
    assert len(rows(tmp_path / "b" / "trajectories.csv")) == 2 * 2 * 4
    assert main(["evaluate", *given, "--trajectories", "3", "--out", str(tmp_path / "c")]) == 2
    assert "trajectories is 3, expected at most 2 worlds (nearest: 2)" in capsys.readouterr().err


def test_an_environment_without_an_estimate_for_each_target(tmp_path):
    with pytest.raises(InputError, match="expected an environment with one estimate for each target"):
        write_trajectories(tmp_path, "wavegym/Urban-v0", {"random": None}, 1, horizon=3)
