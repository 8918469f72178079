"""Input tapes: a program plays as on a tape, or the frame is named where it does not."""

import io
import json
import shutil
import zipfile
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from PIL import Image

from joybridge.adapters import tapes
from joybridge.adapters.pygame_programs.tape import read_tape
from joybridge.adapters.tapes import TapeError, record, replay
from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import choose_options
from joybridge.simulator.catalog import load_game
from tests.support.command_line import joybridge
from tests.support.servers import ROOT

CATCHING = ROOT / "tests/support/pygame_programs/catch.py"
DECISIONS = 30


@pytest.fixture(scope="module")
def tape(tmp_path_factory):
    """Yield a tape, and a copy of the program that it is of."""
    folder = tmp_path_factory.mktemp("tapes")
    program = folder / "catch.py"
    program.write_text(CATCHING.read_text())
    assert record(str(program), folder / "catch.tape", seed=3, decisions=DECISIONS) == 4 * DECISIONS
    return folder / "catch.tape", program


def changed(tape, tmp_path, old, new):
    """Return the path of a copy of the program in which a text is replaced."""
    source = tape[1].read_text()
    assert old in source
    path = tmp_path / "catch.py"
    path.write_text(source.replace(old, new))
    return str(path)


def test_a_program_that_has_not_changed_plays_as_on_the_tape(tape):
    done = joybridge("tape", "replay", str(tape[0]))
    assert done == (0, f"{4 * DECISIONS} frames are as on the tape\n", "")


def test_a_frame_that_differs_is_named_and_shown_beside_what_was_expected(tape, tmp_path):
    program = changed(
        tape, tmp_path, "        screen.fill((20, 20, 40))", "        screen.fill((20, 20, n // 50 + 40))"
    )
    source = (tmp_path / "catch.py").read_text().replace("    while lives", "    n = 0\n    while lives")
    (tmp_path / "catch.py").write_text(source.replace("        screen.fill", "        n += 1\n        screen.fill"))
    with pytest.raises(TapeError, match=r"frame 48 is not as on the tape: .*catch-frame-48.png has") as found:
        replay(tape[0], program, tmp_path)
    assert str(tmp_path) in str(found.value)
    both = np.asarray(Image.open(tmp_path / "catch-frame-48.png"))
    expected, came, differs = both[:, :320], both[:, 324:644], both[:, 648:968]
    assert expected[0, 0].tolist() == [20, 20, 40] and came[0, 0].tolist() == [20, 20, 41]
    assert differs[0, 0].tolist() == [255, 0, 0]
    same = (expected == came).all(axis=2)
    assert same.any() and np.array_equal(differs[same], came[same] // 4)
    assert str(found.value).endswith("; if the change is meant, record the tape again")


def test_a_tape_of_another_pygame_or_of_a_program_elsewhere_says_so(tape, tmp_path, monkeypatch):
    program = changed(tape, tmp_path, "screen.fill((20, 20, 40))", "screen.fill((20, 20, 41))")
    monkeypatch.setattr(tapes, "pygame_version", lambda: "pygame 9.9")
    with pytest.raises(TapeError, match=r"; it was recorded with pygame\S* [\d.]+, and this is pygame 9\.9$"):
        replay(tape[0], program, tmp_path)
    moved = tmp_path / "moved.tape"
    shutil.copy(tape[0], moved)
    tape[1].rename(tmp_path / "elsewhere.py")
    try:
        with pytest.raises(TapeError, match=r"there is no file .*; that is how the tape names its program; --program"):
            replay(moved)
        assert replay(moved, str(tmp_path / "elsewhere.py")) == 4 * DECISIONS
    finally:
        (tmp_path / "elsewhere.py").rename(tape[1])


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("while lives > 0", "while lives > 19", "the episode ends earlier or later than on the tape|is over"),
        ("score += 10", "score += 1 / 0", "after frame .* the program has failed: ZeroDivisionError"),
        ("pygame.K_LEFT", "pygame.K_UP", "the program is played with .* key_UP, the tape with .* key_LEFT"),
    ],
)
def test_a_program_that_ends_fails_or_reads_other_keys_is_not_as_on_the_tape(tape, tmp_path, old, new, what):
    with pytest.raises(TapeError, match=what):
        replay(tape[0], changed(tape, tmp_path, old, new))


def test_whatever_is_played_is_on_tapes_if_they_are_wanted(tmp_path):
    game: Any = load_game(f"pygame:{CATCHING} tapes={tmp_path} max_decisions=5")
    options = choose_options(game.options, {"decision_interval": "2"}, game.name)
    with closing(game(options, {}, 1, 0, 7)) as playing:
        for choice in (0, 1) * 4:
            act = ActArrays(np.full((1, 2), choice / 2, np.float32), np.full((1, 3), choice, np.int32))
            (step,) = playing.step([act])
        assert not step.truncated[0]
    game.processes.end()
    assert sorted(replay(path) for path in tmp_path.glob("catch-*.tape")) == [6, 10]


def saved(array):
    """Return the bytes of a file that holds an array."""
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def test_a_file_that_is_no_tape_is_refused(tmp_path):
    (tmp_path / "wrong.tape").write_text("nothing")
    done = joybridge("tape", "replay", str(tmp_path / "wrong.tape"))
    assert done.status == 1 and "is not a tape" in done.errors
    note = {"format": 2, "program": "p", "options": {}, "seed": 0, "device": [], "pygame": ""}
    for wrong in ({"format": 2}, note | {"seed": "x"}, note):
        with zipfile.ZipFile(tmp_path / "wrong.tape", "w") as archive:
            archive.writestr("tape.json", json.dumps(wrong))
            for name, array in {"acts": np.zeros((2, 1), np.uint8), "hashes": np.zeros(3, np.uint64)}.items():
                archive.writestr(f"{name}.npy", saved(array))
            archive.writestr("ends.npy", saved(np.array([3], np.int32)))
        with pytest.raises(TapeError, match=r"wrong\.tape is not a tape"):
            replay(tmp_path / "wrong.tape")
    with pytest.raises(TapeError, match=r"cannot read .*No such file"):
        replay(tmp_path / "none.tape")


def test_a_command_records_a_tape_with_settings_before_or_behind_its_options(tmp_path):
    path, other = tmp_path / "catch.tape", tmp_path / "other.tape"
    done = joybridge("tape", "record", str(CATCHING), str(path), "keys=LEFT", "--decisions", "3")
    assert done.output == f"{path}: 3 decisions, 12 frames\nnext: joybridge tape replay {path}\n"
    assert replay(path) == 12
    assert joybridge("tape", "record", str(CATCHING), str(other), "--decisions", "3", "keys=LEFT").status == 0
    assert read_tape(other).note == read_tape(path).note and replay(other) == 12
    for words in (
        ["record", str(CATCHING), str(path), "--decision", "3", "LEFT"],
        ["record", str(CATCHING), str(path), "--decisions", "0"],
        ["record", str(CATCHING), str(path), "--seed", "-1"],
        ["replay", str(path), "keys=LEFT"],
    ):
        with pytest.raises(SystemExit):
            joybridge("tape", *words)


def test_a_program_elsewhere_has_the_settings_of_the_tape_unless_it_brings_others(tmp_path):
    path = tmp_path / "catch.tape"
    joybridge("tape", "record", str(CATCHING), str(path), "keys=LEFT", "--decisions", "3")
    elsewhere = shutil.copy(CATCHING, tmp_path / "elsewhere.py")
    assert replay(path, str(elsewhere)) == 12
    with pytest.raises(TapeError, match=r"the program is played with .*, the tape with "):
        replay(path, f"{elsewhere} keys=LEFT,RIGHT")


@pytest.mark.parametrize("before", [b"an older tape", None])
def test_a_program_that_fails_leaves_the_tape_that_was_there(tape, tmp_path, before):
    program = changed(tape, tmp_path, "score += 10", "score += 1 / 0")
    path = tmp_path / "good.tape"
    if before:
        path.write_bytes(before)
    done = joybridge("tape", "record", program, str(path), "keys=LEFT", "--decisions", "300", "--seed", "3")
    held = "holds the tape that it held before" if before else "is not written"
    assert done.status == 1 and f"error: {path} {held}: after " in done.errors, done.errors
    assert "ZeroDivisionError" in done.errors
    assert (path.read_bytes() if before else path.exists()) == (before or False)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["catch.py", *(["good.tape"] if before else [])]
