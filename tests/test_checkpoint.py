"""Checkpoints survive what may happen to files."""

import errno
import json
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from joybridge.config.config import Config
from joybridge.config.errors import CheckpointError, StorageError
from joybridge.contract.tensors import Array
from joybridge.run import checkpoint
from joybridge.run.checkpoint import (
    ARRAYS,
    MANIFEST,
    SUMS,
    Manifest,
    checkpoints,
    has_checkpoint,
    load_checkpoint,
    read_checkpoint,
    save_checkpoint,
)
from joybridge.run.run_state import RunState
from joybridge.run.saving import Saver
from joybridge.run.trained import find_trained

SOME: dict[str, Array] = {
    "a": np.arange(6, dtype=np.float32).reshape(2, 3),
    "empty": np.zeros((0, 2)),
    "one": np.array(5),
}


def keep(run: Path, *timesteps: int, **more) -> Path:
    """Save checkpoints of so many timesteps; return the folder of the last."""
    return [save_checkpoint(run, SOME, Manifest(timesteps=count), **more) for count in timesteps][-1]


def newest(run: Path) -> int:
    return load_checkpoint(run)[1].timesteps


def test_what_is_saved_comes_back(tmp_path):
    save_checkpoint(tmp_path, SOME, Manifest(timesteps=12, snapshots=[["x", "y"], []]))
    arrays, manifest = load_checkpoint(tmp_path)
    assert (manifest.timesteps, manifest.snapshots) == (12, [["x", "y"], []])
    for name, array in SOME.items():
        np.testing.assert_array_equal(arrays[name], array)
        assert arrays[name].dtype == array.dtype


def test_its_hashes_can_be_checked_with_sha256sum(tmp_path):
    folder = keep(tmp_path, 5)
    assert subprocess.run(["sha256sum", "--check", "--strict", SUMS], cwd=folder, check=False).returncode == 0


@pytest.mark.parametrize(
    ("number", "kept"), [(1, [1000]), (2, [99, 1000]), (4, [5, 10, 99, 1000]), (9, [5, 10, 99, 1000])]
)
def test_the_newest_counts_and_as_many_as_wanted_are_kept(number, kept, tmp_path):
    keep(tmp_path, 5, 10, 99, 1000, keep=number)
    assert newest(tmp_path) == 1000
    assert [int(path.name) for path in checkpoints(tmp_path)] == kept
    assert len(list((tmp_path / "checkpoints").iterdir())) == len(kept)


def test_a_write_that_was_cut_off_is_ignored_and_then_replaced(tmp_path):
    keep(tmp_path, 5)
    half = tmp_path / "checkpoints" / ".new"
    half.mkdir()
    (half / ARRAYS).write_bytes(b"half")
    assert newest(tmp_path) == 5
    keep(tmp_path, 9)
    assert newest(tmp_path) == 9
    assert not half.exists()


@pytest.mark.promise("C2")
def test_every_flipped_byte_and_every_cut_is_noticed(tmp_path):
    folder = keep(tmp_path, 5)
    tries = 0
    for name in (ARRAYS, MANIFEST, SUMS):
        whole = (folder / name).read_bytes()
        flipped = [whole[:i] + bytes([whole[i] ^ 1 << i % 8]) + whole[i + 1 :] for i in range(len(whole))]
        for damaged in [*flipped, *(whole[:length] for length in range(0, len(whole), 9)), whole + b"\n"]:
            (folder / name).write_bytes(damaged)
            with pytest.raises(CheckpointError):
                read_checkpoint(folder)
            tries += 1
        (folder / name).write_bytes(whole)
    assert tries > 500
    assert newest(tmp_path) == 5


@pytest.mark.parametrize("name", [ARRAYS, MANIFEST, SUMS])
def test_the_checkpoint_before_a_damaged_one_is_used_and_said(name, tmp_path, caplog):
    keep(tmp_path, 3)
    path = keep(tmp_path, 5) / name
    path.write_bytes(path.read_bytes()[:-2] + b"x}")
    assert newest(tmp_path) == newest(tmp_path) == 3
    assert [record.message.partition("000000000005 ")[2].partition(" ")[0] for record in caplog.records] in (
        ["is"],
        ["cannot"],
    )
    assert "using the checkpoint before it, of 3 timesteps" in caplog.text
    path.unlink()
    assert newest(tmp_path) == 3


def test_arrays_of_another_checkpoint_are_noticed(tmp_path):
    keep(tmp_path, 3)
    other = save_checkpoint(tmp_path / "other", {"a": SOME["a"] + 1}, Manifest(timesteps=5))
    folder = save_checkpoint(tmp_path, {"a": SOME["a"]}, Manifest(timesteps=5))
    (folder / ARRAYS).write_bytes((other / ARRAYS).read_bytes())
    assert newest(tmp_path) == 3


def test_a_damaged_checkpoint_is_replaced_when_the_run_gets_there_again(tmp_path):
    keep(tmp_path, 3)
    (keep(tmp_path, 5) / ARRAYS).write_bytes(b"")
    assert newest(tmp_path) == 3
    keep(tmp_path, 5)
    assert newest(tmp_path) == 5
    assert len(list((tmp_path / "checkpoints").iterdir())) == 2


@pytest.mark.parametrize("name", [MANIFEST, ARRAYS, SUMS])
def test_if_none_is_whole_the_newest_is_named_with_the_reason(name, tmp_path):
    keep(tmp_path, 4)
    keep(tmp_path, 5)
    for folder in checkpoints(tmp_path):
        (folder / name).write_bytes(b"\x00garbage")
    with pytest.raises(
        CheckpointError, match=r"000000000005 (cannot be read|is damaged): .*neither can the 1 before it"
    ):
        load_checkpoint(tmp_path)


def test_a_run_without_one_says_so(tmp_path):
    assert not has_checkpoint(tmp_path)
    with pytest.raises(CheckpointError, match="holds no checkpoint"):
        load_checkpoint(tmp_path)


def test_one_of_another_format_names_both(tmp_path):
    folder = keep(tmp_path, 5)
    (folder / MANIFEST).write_text('{"format": 3, "timesteps": 5, "snapshots": null}')
    with pytest.raises(CheckpointError, match="has format 3, expected 4; use the version of joybridge that wrote it"):
        load_checkpoint(tmp_path)


def test_what_the_run_did_not_write_is_neither_loaded_nor_deleted(tmp_path):
    folder = keep(tmp_path, 100).parent
    foreign = [
        "000000000100-best",
        "000000000999-copy",
        "2024-notes",
        "2025-notes",
        "000000000001",
        "202401010000",
        "7",
    ]
    for name in foreign:
        (folder / name).mkdir()
        (folder / name / "mine.txt").write_text("mine")
    (folder / "000000000002").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").mkdir()
    keep(tmp_path, 200, 300, 400)
    assert newest(tmp_path) == 400
    own = {"000000000300", "000000000400"}
    assert {path.name for path in folder.iterdir()} == {*own, *foreign, "000000000002"}
    for name in foreign:
        assert (folder / name / "mine.txt").read_text() == "mine"


def test_a_copy_under_another_number_is_neither_loaded_nor_deleted(tmp_path):
    folder = keep(tmp_path, 100)
    for number in (50, 999):
        shutil.copytree(folder, folder.with_name(f"{number:012d}"))
    assert newest(tmp_path) == 100
    keep(tmp_path, 200, 300, keep=1)
    assert [int(path.name) for path in checkpoints(tmp_path)] == [50, 300, 999]


def seal(folder: Path, arrays: bytes, manifest: bytes) -> None:
    """Make the files of a checkpoint with hashes that match."""
    for name, data in ((ARRAYS, arrays), (MANIFEST, manifest), (SUMS, checkpoint._sums(arrays, manifest))):
        (folder / name).unlink()
        (folder / name).write_bytes(data)


def header(arrays: dict[str, object]) -> bytes:
    text = json.dumps(arrays).encode()
    return len(text).to_bytes(8, "little") + text


def manifest(**fields: object) -> bytes:
    return json.dumps({"format": 4, "timesteps": 5, "snapshots": None, "arrays_bytes": 10**6, **fields}).encode()


BF16 = header({"a": {"dtype": "BF16", "shape": [1], "data_offsets": [0, 2]}}) + b"12"
HUGE = header({"a": {"dtype": "F32", "shape": [2**40], "data_offsets": [0, 2**42]}})
HOSTILE = {
    "a list": (b"", b"[]"),
    "a number": (b"", b"7"),
    "null": (b"", b"null"),
    "nothing": (b"", b""),
    "not text": (b"", b"\xff\xfe"),
    "very deep": (b"", b"[" * 500_000),
    "very deep inside": (b"", manifest().replace(b"null", b"[" * 100_000 + b"]" * 100_000)),
    "many digits": (b"", manifest().replace(b": 5,", b": " + b"5" * 5000 + b",")),
    "many digits of format": (b"", manifest().replace(b": 4,", b": " + b"4" * 5000 + b",")),
    "words as timesteps": (b"", manifest(timesteps="five")),
    "no timesteps": (b"", manifest(timesteps=None)),
    "negative timesteps": (b"", manifest(timesteps=-5)),
    "a fraction": (b"", manifest(timesteps=5.5)),
    "snapshots that are numbers": (b"", manifest(snapshots=[[1]])),
    "an unknown key": (b"", manifest(code="x")),
    "very many bytes": (b"", manifest(arrays_bytes=2**62)),
    "no arrays": (b"", manifest()),
    "a pickle": (b"\x80\x04N.", manifest()),
    "a zip": (b"PK\x03\x04" + bytes(100), manifest()),
    "a very long header": ((2**63 - 1).to_bytes(8, "little"), manifest()),
    "more arrays than bytes": (HUGE, manifest()),
    "a type that NumPy does not have": (BF16, manifest()),
}


@pytest.mark.parametrize(("arrays", "text"), HOSTILE.values(), ids=HOSTILE)
@pytest.mark.promise("X3")
def test_a_checkpoint_of_a_stranger_is_refused_in_a_sentence(arrays, text, tmp_path):
    seal(keep(tmp_path, 5), arrays, text)
    with pytest.raises(CheckpointError, match=r"000000000005 cannot be read: \S") as caught:
        load_checkpoint(tmp_path)
    assert len(str(caught.value)) < 500 and str(caught.value).isprintable()


@pytest.mark.parametrize("name", [MANIFEST, ARRAYS, SUMS])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "hole", "link to itself"])
def test_what_is_no_regular_file_of_reasonable_size_is_not_read(kind, name, tmp_path):
    path = keep(tmp_path, 5) / name
    path.unlink()
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "device":
            path.symlink_to("/dev/zero")
        case "folder":
            path.mkdir()
        case "hole":
            path.touch()
            os.truncate(path, 2**40)
        case _:
            path.symlink_to(path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(CheckpointError, match=rf"cannot be read: {name}: "):
        load_checkpoint(tmp_path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kilobytes


# Saving


def folder_of(run: Path) -> list[tuple[str, bytes]]:
    return sorted((str(path.relative_to(run)), path.read_bytes()) for path in run.rglob("*") if path.is_file())


@pytest.mark.parametrize("call", ["mkdir", "write", "fsync", "rename"])
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES])
@pytest.mark.promise("F6")
def test_what_cannot_be_written_is_said_and_leaves_nothing_behind(call, number, tmp_path, monkeypatch):
    keep(tmp_path, 3)
    before = folder_of(tmp_path)

    def fail(*args, **kwargs):
        raise OSError(number, os.strerror(number), "the disk")

    if call == "mkdir":
        monkeypatch.setattr(Path, "mkdir", fail)
    elif call == "write":
        monkeypatch.setattr(checkpoint, "write_synced", fail)
    elif call == "fsync":
        monkeypatch.setattr(os, "fsync", fail)
    else:
        monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(StorageError, match=rf"cannot write the disk: {os.strerror(number)}; make room or give write"):
        keep(tmp_path, 5)
    monkeypatch.undo()
    assert folder_of(tmp_path) == before
    assert not (tmp_path / "checkpoints/.new").exists()
    assert newest(tmp_path) == 3


@pytest.mark.promise("C1")
def test_a_kill_at_any_line_of_saving_leaves_a_checkpoint_that_can_be_loaded(tmp_path, monkeypatch):
    """What a kill leaves on the disk is what there is before the line; nothing cleans up."""
    monkeypatch.setattr(os, "fsync", lambda _: None)  # which takes most of the time
    keep(tmp_path / "run", 1, 2)
    points = 0
    shapes = set()

    def stop(frame, event, argument):
        nonlocal points
        if "checkpoint.py" in frame.f_code.co_filename or "files.py" in frame.f_code.co_filename:
            if event == "line":
                points += 1
                copy = tmp_path / "killed"
                shutil.rmtree(copy, ignore_errors=True)
                shutil.copytree(tmp_path / "run", copy)
                assert newest(copy) in (2, 3)
                keep(copy, 4)
                assert newest(copy) == 4
                names = {path.name for path in (copy / "checkpoints").iterdir()}
                assert names in ({"000000000002", "000000000004"}, {"000000000003", "000000000004"}), names
                shapes.add(tuple(sorted(names)))
            return stop
        return None

    previous = sys.gettrace()  # that of coverage
    sys.settrace(stop)
    try:
        keep(tmp_path / "run", 3)
    finally:
        sys.settrace(previous)
    assert points > 40
    assert len(shapes) == 2


def test_policies_of_a_run_are_found_although_its_newest_checkpoint_is_damaged(tmp_path):
    keep(tmp_path, 3, 4, keep=9)
    (keep(tmp_path, 5, keep=9) / MANIFEST).write_bytes(b"{")
    assert [found.timesteps for found in find_trained(tmp_path, 9)] == [3, 4]


def test_what_could_not_be_read_again_is_not_saved_and_costs_no_older_checkpoint(tmp_path):
    keep(tmp_path, 3)
    with pytest.raises(StorageError, match=r"manifest.json has .* bytes, expected at most 1,048,576"):
        save_checkpoint(tmp_path, SOME, Manifest(timesteps=5, snapshots=[["x" * 2**20]]), keep=1)
    assert newest(tmp_path) == 3 and len(checkpoints(tmp_path)) == 1


def test_the_best_state_is_saved_first_and_the_last_one_even_if_there_is_no_room_for_the_best(tmp_path, monkeypatch):
    saved: list[str] = []

    def refuse(state, run):
        saved.append("best")
        raise StorageError("no room")

    monkeypatch.setattr(RunState, "save_as_best", refuse)
    monkeypatch.setattr(RunState, "save", lambda state, run, keep: saved.append("last"))
    saver = Saver(tmp_path, Config(game="archer", checkpoint_interval=1), RunState())
    with pytest.raises(StorageError, match="no room"):
        saver.take(RunState(timesteps=5, score=1.0))
    assert saved == ["best", "last"]
