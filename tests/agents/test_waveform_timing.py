"""The page on waveform timing holds the tables that its command makes."""

from __future__ import annotations

import re

import pytest

from agents import waveform_timing as page
from wavegym.sensors import EclipsedPulse
from wavegym.waveforms import PulseTiming


def test_the_committed_tables_are_those_of_the_command():
    text = page.PAGE.read_text(encoding="utf-8")
    assert text.partition(page.START)[2].partition(page.END)[0].strip() == page.tables()


def test_the_known_figures_stand_in_the_tables():
    """99 % of a Gaussian pulse in 3.64 k, -60 dB in 7.43 k; 1 kHz: 150 km and +-7.5 m/s."""
    joined = re.sub(" +", " ", page.tables())
    assert "| 99 % of the energy | 3.643 | 54.6 km |" in joined
    assert "| above -60 dB | 7.434 | 111.4 km | 1.000 | 15.0 km |" in joined
    assert "| 1 kHz | 100 us | 14.99 km | 149.90 km | +-7.5 m/s |" in joined


def test_names_on_the_page_exist():
    text = page.PAGE.read_text(encoding="utf-8")
    names = set(re.findall(r"\| `(?:PulseTiming\.)?(\w+)`", text))
    assert {"duty_cycle", "blind_range", "range_blind_zones"} <= names
    for name in names - {"transmitted_interval", "time_left"}:
        assert hasattr(PulseTiming, name), name
    assert hasattr(EclipsedPulse, "visible_share")


def test_the_command_draws_the_picture(monkeypatch: pytest.MonkeyPatch, tmp_path):
    copy = tmp_path / "page.md"
    copy.write_text(f"# Page\n\n{page.START}\n{page.END}\n")
    monkeypatch.setattr(page, "PAGE", copy)
    monkeypatch.setattr(page, "PICTURE", tmp_path / "picture.png")
    monkeypatch.setattr("sys.argv", ["waveform_timing"])
    page.main()
    assert "### What a cut leaves" in copy.read_text()
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
