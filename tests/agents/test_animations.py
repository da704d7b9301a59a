"""An animated picture of an episode: its frames, its end, its file."""

from __future__ import annotations

import pytest
from PIL import Image

from agents import animations
from agents.animations import LAST_MS, WIDTH, frames, write

FRAMES = 10


@pytest.mark.slow
def test_an_episode_becomes_an_animated_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(animations, "FRAMES", FRAMES)
    pictures = frames("wavegym/KershawEvans-v0")
    assert FRAMES // 2 <= len(pictures) <= FRAMES + 1
    file = tmp_path / "episode.webp"
    write(pictures[-3:], file)
    with Image.open(file) as read:
        assert (read.n_frames, read.width) == (3, WIDTH)
        read.seek(2)
        read.load()
        assert read.info["duration"] == LAST_MS
