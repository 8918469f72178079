"""Files that somebody else may have laid: what is read of them, and what is written through them."""

import os
import resource

import pytest

from joybridge.config.files import write_atomically
from joybridge.contract.files import read_file


@pytest.mark.promise("X6")
def test_a_large_file_of_holes_is_not_read(tmp_path):
    hollow = tmp_path / "hollow"
    with hollow.open("wb") as file:
        file.write(b"a beginning")
        file.truncate(2**30)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(OSError, match="1,073,741,824 bytes, almost all of them holes"):
        read_file(hollow, 2**32)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kilobytes


def test_a_large_file_of_bytes_is_read(tmp_path):
    data = os.urandom(2**20) * 80
    (tmp_path / "full").write_bytes(data)
    assert read_file(tmp_path / "full", 2**32) == data


def test_nothing_is_written_through_a_link_under_the_temporary_name(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / ".policy.json.new").symlink_to(victim)
    write_atomically(tmp_path / "policy.json", b"new")
    assert victim.read_text() == "mine"
    assert (tmp_path / "policy.json").read_bytes() == b"new" and not (tmp_path / "policy.json").is_symlink()
