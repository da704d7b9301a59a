"""Stone Soup finds the package as its plugin, by the entry point that pyproject.toml declares."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.mark.slow
@pytest.mark.parametrize("group", ["stonesoup.plugins", "no.plugins"])
def test_stone_soup_loads_the_plugin(group, tmp_path):
    """A process that finds the metadata of an installation; without the group there is no such plugin."""
    info = tmp_path / "guest-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: guest\nVersion: 1.0\n")
    lines = [f"{name} = {place}" for name, place in PROJECT["entry-points"]["stonesoup.plugins"].items()]
    (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines]) + "\n")
    code = "from stonesoup.plugins.wavegym import WaveformRadar; print(WaveformRadar.__module__)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    command = [sys.executable, "-c", BLIND + code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if group == "stonesoup.plugins":
        assert done.stdout.strip() == "wavegym.integrations.stonesoup.sensor", done.stderr
    else:
        assert "No module named 'stonesoup.plugins.wavegym'" in done.stderr


# The installed wavegym may have its own entry point: only the metadata of the test counts.
BLIND = """
import importlib.metadata as m
found = m.entry_points
m.entry_points = lambda **given: [e for e in found(**given) if e.dist.name == "guest"]
"""


def test_the_extra_asks_for_stone_soup():
    assert PROJECT["optional-dependencies"]["stonesoup"] == ["stonesoup>=1.9"]


def test_without_stone_soup_the_extra_is_named():
    code = "import sys; sys.modules['stonesoup'] = None; import wavegym.integrations.stonesoup"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert "pip install 'wavegym[stonesoup]'" in done.stderr.splitlines()[-1]
