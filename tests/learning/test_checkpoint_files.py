from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.learning.checkpoints import HEADER, load_checkpoint, save_checkpoint


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_last_two_are_kept_and_the_last_is_loaded(tmp_path: Path) -> None:
    assert load_checkpoint(tmp_path) is None
    for steps in (0, 900, 1000, 20000):
        save_checkpoint(tmp_path, steps, b"state at %d" % steps)
    assert names(tmp_path) == ["step-000000001000.ckpt", "step-000000020000.ckpt"]
    assert load_checkpoint(tmp_path) == (20000, b"state at 20000")


def test_half_written_files_of_a_killed_run_are_cleared_away(tmp_path: Path) -> None:
    (tmp_path / ".step-000000000005.ckpt.4711.part").write_bytes(b"half")
    save_checkpoint(tmp_path, 5, b"whole")
    assert names(tmp_path) == ["step-000000000005.ckpt"]


@given(content=st.binary(max_size=300), cut=st.floats(0, 1, exclude_max=True), flip=st.floats(0, 1, exclude_max=True))
def test_every_cut_and_every_changed_byte_is_noticed(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, cut: float, flip: float
) -> None:
    folder = tmp_path_factory.mktemp("torn")
    save_checkpoint(folder, 1, b"earlier")
    save_checkpoint(folder, 2, content)
    path = folder / "step-000000000002.ckpt"
    whole = path.read_bytes()
    assert load_checkpoint(folder) == (2, content)
    path.write_bytes(whole[: int(cut * len(whole))])
    assert load_checkpoint(folder) == (1, b"earlier")
    changed = bytearray(whole)
    changed[int(flip * len(whole))] ^= 1
    path.write_bytes(bytes(changed))
    assert load_checkpoint(folder) == (1, b"earlier")
    path.write_bytes(whole + b"\0")
    assert load_checkpoint(folder) == (1, b"earlier")


def test_a_torn_one_is_named_and_none_is_deleted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_checkpoint(tmp_path, 1, b"earlier")
    save_checkpoint(tmp_path, 2, b"later")
    (tmp_path / "step-000000000002.ckpt").write_bytes(b"")
    assert load_checkpoint(tmp_path) == (1, b"earlier")
    assert "step-000000000002.ckpt is torn" in capsys.readouterr().err
    first = tmp_path / "step-000000000001.ckpt"
    first.write_bytes(first.read_bytes()[:HEADER])
    with pytest.raises(InputError, match="none of the 2 checkpoints"):
        load_checkpoint(tmp_path)
    assert names(tmp_path) == ["step-000000000001.ckpt", "step-000000000002.ckpt"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_leaves_the_earlier_ones(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, 1, b"one")
    save_checkpoint(tmp_path, 2, b"two")
    (tmp_path / f".step-000000000003.ckpt.{os.getpid()}.part").symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left"):
        save_checkpoint(tmp_path, 3, b"three")
    assert names(tmp_path) == ["step-000000000001.ckpt", "step-000000000002.ckpt"]
    assert load_checkpoint(tmp_path) == (2, b"two")
