"""Checkpoints survive what may happen to files."""

import numpy as np
import pytest

from joybridge.contract.tensors import Array
from joybridge.trainer.checkpoint import has_checkpoint, load_checkpoint, save_checkpoint
from joybridge.trainer.errors import CheckpointError

ARRAYS: dict[str, Array] = {
    "a": np.arange(6, dtype=np.float32).reshape(2, 3),
    "empty": np.zeros((0, 2)),
    "one": np.array(5),
}


def test_what_is_saved_comes_back(tmp_path):
    save_checkpoint(tmp_path, ARRAYS, {"timesteps": 12, "note": [1, "x"]})
    arrays, manifest = load_checkpoint(tmp_path)
    assert (manifest["timesteps"], manifest["note"]) == (12, [1, "x"])
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], array)
        assert arrays[name].dtype == array.dtype


def test_the_newest_counts_and_the_last_two_are_kept(tmp_path):
    for timesteps in (5, 10, 99, 1000):
        save_checkpoint(tmp_path, ARRAYS, {"timesteps": timesteps})
    assert load_checkpoint(tmp_path)[1]["timesteps"] == 1000
    assert len(list((tmp_path / "checkpoints").iterdir())) == 2


def test_a_write_that_was_cut_off_is_ignored_and_then_replaced(tmp_path):
    save_checkpoint(tmp_path, ARRAYS, {"timesteps": 5})
    half = tmp_path / "checkpoints" / ".000000000009.new"
    half.mkdir()
    (half / "arrays.safetensors").write_bytes(b"half")
    assert load_checkpoint(tmp_path)[1]["timesteps"] == 5
    save_checkpoint(tmp_path, ARRAYS, {"timesteps": 9})
    assert load_checkpoint(tmp_path)[1]["timesteps"] == 9
    assert not half.exists()


@pytest.mark.parametrize("name", ["manifest.json", "arrays.safetensors"])
def test_a_damaged_one_is_named_with_what_to_do(name, tmp_path):
    folder = save_checkpoint(tmp_path, ARRAYS, {"timesteps": 5})
    (folder / name).write_bytes(b"\x00garbage")
    with pytest.raises(CheckpointError, match=r"000000000005 cannot be read .* delete it to use the one before"):
        load_checkpoint(tmp_path)


def test_a_run_without_one_says_so(tmp_path):
    assert not has_checkpoint(tmp_path)
    with pytest.raises(CheckpointError, match="holds no checkpoint"):
        load_checkpoint(tmp_path)
