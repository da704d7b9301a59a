"""The built wheel does all its work outside the repository, without torch."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path
from typing import NamedTuple

import pytest

import wavegym

ROOT = Path(__file__).parents[1]
REFUSE = """import os, sys

class WithoutTorch:
    def find_spec(self, name, path=None, target=None):
        if name in ("torch", "stable_baselines3", "sb3_contrib"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

if not os.environ.get("WITH_TORCH"):
    sys.meta_path.insert(0, WithoutTorch())
"""

pytestmark = pytest.mark.slow


class Installed(NamedTuple):
    """A virtual environment with the wheel, and a folder to work in."""

    wheel: Path
    scripts: Path
    folder: Path

    def run(self, *command: str, **variables: str) -> subprocess.CompletedProcess[str]:
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | variables
        program = str(self.scripts / command[0])
        return subprocess.run(
            [program, *command[1:]], cwd=self.folder, env=environment, capture_output=True, text=True, check=False
        )

    def python(self, code: str) -> str:
        done = self.run("python", "-c", code)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The wheel in a fresh virtual environment that borrows the packages of this one; nothing is downloaded."""
    folder = tmp_path_factory.mktemp("installed")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder / "dist")]
    subprocess.run([*build, str(source(folder))], check=True, capture_output=True)
    (wheel,) = (folder / "dist").glob("*.whl")
    venv.create(folder / "venv", with_pip=False)
    scripts = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    paths = [path for path in sys.path if path.endswith("site-packages")]
    (site,) = (folder / "venv").rglob("site-packages")
    pip = [sys.executable, "-m", "pip", "--python", str(scripts / "python"), "install", "--no-deps", "--no-index"]
    subprocess.run([*pip, str(wheel)], check=True, capture_output=True)
    # A .pth file adds folders to the path, but does not read the .pth files in them: an editable wavegym stays out.
    (site / "borrowed.pth").write_text("\n".join(paths))
    (site / "sitecustomize.py").write_text(REFUSE)
    (folder / "elsewhere").mkdir()
    return Installed(wheel, scripts, folder / "elsewhere")


def tracked() -> list[str]:
    """The files of the repository that git tracks."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return listed.rstrip("\0").split("\0")


def source(folder: Path) -> Path:
    """A copy of the files that git tracks, because the build writes files beside them."""
    copy = folder / "source"
    for name in tracked():
        if name.startswith("wavegym/") or "/" not in name:
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            (copy / name).write_bytes((ROOT / name).read_bytes())
    return copy


def test_the_wheel_holds_every_file_of_the_package_and_nothing_else(installed: Installed) -> None:
    with zipfile.ZipFile(installed.wheel) as wheel:
        packed = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert packed == {name for name in tracked() if name.startswith("wavegym/")}
    assert any(name.endswith("policy.npz") for name in packed)


def test_the_library_is_the_installed_one_and_brings_no_other_package(installed: Installed) -> None:
    code = (
        "import wavegym, importlib.util as u; print(wavegym.__file__, u.find_spec('agents'), u.find_spec('research'))"
    )
    file, agents, research = installed.python(code).split()
    assert Path(file).is_relative_to(installed.scripts.parent)
    assert (agents, research) == ("None", "None")


def test_the_command_lists_the_environments(installed: Installed) -> None:
    for command in (["wavegym", "list"], ["python", "-m", "wavegym", "list"]):
        done = installed.run(*command)
        assert done.returncode == 0, done.stderr
        assert done.stdout.split() == [id for id in wavegym.list_envs() if id.startswith("wavegym/")]


def test_agents_and_settings_are_found(installed: Installed) -> None:
    code = (
        "import wavegym; from wavegym.learning.settings import load_settings;"
        "wavegym.load_agent('RfEoFar-v0', 'ppo');"
        "print(load_settings('wavegym/RfEo-v0', 'ppo').teacher)"
    )
    assert installed.python(code) == "lookahead:10"


def test_training_without_torch_names_the_extra(installed: Installed) -> None:
    done = installed.run("wavegym", "train", "KershawEvans-v0", "--algo", "ppo", "--out", "run")
    assert done.returncode == 2
    assert "pip install 'wavegym[agents]'" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_with_torch_an_agent_is_trained_and_then_compared_without(installed: Installed) -> None:
    """With the published agent, and with myopic."""
    small = ["--steps", "300", "--setting", "num_envs=8", "n_steps=10", "batch_size=16", "n_epochs=2"]
    train = ["train", "KershawEvansPosition-v0", "--algo", "ppo", "--out", "runs/small", "--quiet", *small]
    done = installed.run("wavegym", *train, WITH_TORCH="1")
    assert done.returncode == 0, done.stderr
    evaluate = ["evaluate", "KershawEvansPosition-v0", "--policies", "runs/small,ppo", "--worlds", "8", "--out", "out"]
    done = installed.run("wavegym", *evaluate)
    assert done.returncode == 0, done.stderr
    summary = json.loads((installed.folder / "out" / "summary.json").read_text())
    assert list(summary["policies"]) == ["myopic", "small", "ppo"]
    assert (installed.folder / "out" / "report.html").exists()
