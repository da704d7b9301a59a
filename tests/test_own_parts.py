"""The example package registers a scheduler, a reward and a chirp law; commands and functions know them by name.

It is found through PYTHONPATH alone, in processes of its own: nothing of it is installed here.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "own_parts"
HOW_TO = ROOT / "docs" / "how_to"
QUICK = ["--worlds", "3", "--jobs", "1"]


def run(*command: str, path: Path = EXAMPLE) -> subprocess.CompletedProcess[str]:
    """A command of somebody who has the example on the path."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(path)])}
    return subprocess.run([sys.executable, *command], env=env, cwd=ROOT, capture_output=True, text=True, check=False)


def evaluated(out: Path, *arguments: str, path: Path = EXAMPLE) -> dict:
    done = run("evaluate.py", *arguments, *QUICK, "--out", str(out), path=path)
    assert done.returncode == 0, done.stderr
    return json.loads((out / "summary.json").read_text())


@pytest.mark.slow
def test_evaluate_knows_the_scheduler_and_the_chirp_law(tmp_path: Path) -> None:
    laws = ["laws=('cubic:0.5','lfm')", "horizon=4", "action=joint"]
    given = ["AgileClutter-v0", "--import", "own_parts", "--policies", "first-good,rollout:1@first-good"]
    summary = evaluated(tmp_path, *given, "--set", *laws)
    assert list(summary["policies"]) == ["myopic", "first-good", "rollout:1@first-good"]
    labels = {label for row in summary["policies"]["myopic"]["choices"] for label in row}
    assert any("CUBIC0.5" in label for label in labels)


@pytest.mark.slow
def test_a_chirp_law_reaches_other_processes(tmp_path: Path) -> None:
    laws = ["laws=('cubic',)", "horizon=2", "action=joint"]
    given = ["AgileClutter-v0", "--import", "own_parts", "--policies", "random", "--set", *laws]
    done = run("evaluate.py", *given, "--worlds", "60", "--jobs", "2", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "summary.json").read_text())["worlds"] == 60


@pytest.mark.slow
def test_train_knows_the_reward(tmp_path: Path) -> None:
    small = ["num_envs=8", "n_steps=8", "batch_size=16", "n_epochs=1", "reward=worst-target"]
    given = ["--algo", "ppo", "--steps", "64", "--import", "own_parts", "--setting", *small, "--quiet"]
    done = run("train.py", "KershawEvansPosition-v0", *given, "--out", str(tmp_path / "run"))
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "run" / "run.json").read_text())["settings"]["reward"] == "worst-target"


@pytest.mark.slow
def test_an_installed_package_needs_no_import(tmp_path: Path) -> None:
    """Its entry points, as pip would write them."""
    (tmp_path / "own_parts").symlink_to(EXAMPLE / "own_parts")
    about = tmp_path / "own_parts-0.1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: own-parts\nVersion: 0.1.0\n")
    groups = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"]
    lines = [
        f"[{group}]\n" + "".join(f"{name} = {at}\n" for name, at in each.items()) for group, each in groups.items()
    ]
    (about / "entry_points.txt").write_text("\n".join(lines))
    given = ["KershawEvansPosition-v0", "--policies", "first-good", "--set", "horizon=4"]
    assert "first-good" in evaluated(tmp_path / "out", *given, path=tmp_path)["policies"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--policies", "first-good"], "policy is 'first-good', expected one of"),
        (["--import", "own_part"], "package is 'own_part', expected an importable one"),
        (["--import", "own_parts", "--policies", "first-goot"], "did you mean 'first-good'"),
    ],
)
def test_what_is_not_known_is_one_line(tmp_path: Path, arguments: list[str], words: str) -> None:
    done = run("evaluate.py", "KershawEvansPosition-v0", *arguments, *QUICK, "--out", str(tmp_path))
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert words in line


def test_the_pages_show_the_code_that_is_tested() -> None:
    """Every Python block that names its file is that file, whole or from its first definition on."""
    shown = 0
    for page in HOW_TO.glob("own_*.md"):
        for name, code in re.findall(r"```python\n# (examples/\S+\.py)\n(.*?)```", page.read_text(), flags=re.DOTALL):
            assert code.strip() in (ROOT / name).read_text(), f"{page.name}: {name}"
            shown += 1
    assert shown >= 4


@pytest.mark.slow
def test_the_code_of_the_page_on_policies_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n(?!# examples)(.*?)```", (HOW_TO / "own_policy.md").read_text(), flags=re.DOTALL)
    script = tmp_path / "page.py"
    script.write_text("\n".join(block.replace("worlds=200", "worlds=3, jobs=1") for block in blocks))
    done = run(str(script))
    assert done.returncode == 0, done.stderr
