"""What led to a fault is recorded and repeated, on the same simulator or another one."""

import json
import zlib

import numpy as np
import pytest

from joybridge.client import fault_log
from joybridge.client.client import Session
from joybridge.client.errors import SimulatorError, SimulatorLost
from joybridge.client.recording import CHECK, ENTRY_HEADER, RecordingError, load_recording
from joybridge.commands.replay import FaultFound, main, replay
from joybridge.contract.codec import ActArrays
from tests.support.broken_servers import BROKEN, BrokenServer, Gauntlet, serving

HONEST = BrokenServer(set())


class Differs(Gauntlet):
    """Another game from the third decision on."""

    def step(self, acts):
        self.place += 0.001 * (self.counts[:, :1] == 2)
        return super().step(acts)


def presses(lanes=2, branches=1):
    return [ActArrays(np.empty((lanes, 0), np.float32), np.ones((lanes, branches), np.int32))]


def gauntlet_acts(number):
    """Return valid actions for two arenas of `gauntlet`, which depend on the number of the decision."""
    return [
        ActArrays(np.array([[np.sin(number), 1.0]] * 2, np.float32), np.array([[0, number % 2]] * 2, np.int32)),
        ActArrays(np.empty((4, 0), np.float32), np.zeros((4, 1), np.int32)),
        ActArrays(np.full((2, 1), 0.5, np.float32), np.empty((2, 0), np.int32)),
    ]


def lost_session(folder, decisions, *, saved_after=None):
    """Record a session of `gauntlet` whose server goes away after some decisions, and return what is recorded."""
    with serving(HONEST) as address:
        session = Session(address, "gauntlet", arenas=2, seed=3, first_arena=5, options={"size": "large"}, timeout=2.0)
        session.record_faults(folder)
        for number in range(decisions):
            if number == saved_after:
                session.save()
            session.step(gauntlet_acts(number))
            if number == 1 and saved_after is None:
                session.reset(seed=9, parameters={"drift": 0.5})
    with session, pytest.raises(SimulatorLost):
        session.step(gauntlet_acts(decisions))
    return load_recording(folder / "gauntlet-5-6.fault")


@pytest.mark.promise("O2")
def test_a_game_that_fails_fails_again_in_the_same_step(simulator, tmp_path, caplog, capsys):
    with Session(simulator, "raises", arenas=2, seed=0) as session:
        session.record_faults(tmp_path / "faults")
        session.step(presses())
        session.send(presses())
        session.receive()
        with pytest.raises(SimulatorError, match="ZeroDivisionError"):
            session.step(presses())
    file = tmp_path / "faults" / "raises-0-1.fault"
    assert f"`joybridge replay {file}` repeats it" in caplog.text
    assert main(["replay", str(file), "--simulator", simulator]) == 1
    said = capsys.readouterr().err
    assert "the fault was: error from the simulator" in said
    assert "error: step 3 fails: error from the simulator" in said and "ZeroDivisionError" in said


def test_a_lost_session_is_repeated_to_its_end(tmp_path, capsys):
    recording = lost_session(tmp_path, 6)
    with serving(HONEST) as address:
        assert replay(address, recording) == 7  # with the decision that was not answered
        assert main(["replay", str(tmp_path / "gauntlet-5-6.fault"), "--simulator", address]) == 0
    assert "7 steps are as they were recorded, and none fails" in capsys.readouterr().out


def test_a_recording_begins_with_the_last_snapshot(tmp_path):
    recording = lost_session(tmp_path, 6, saved_after=4)
    assert len(recording.exchanges) == 4 and recording.start.HasField("snapshot")
    with serving(HONEST) as address:
        assert replay(address, recording) == 3


def test_the_first_step_with_other_bytes_is_named(tmp_path):
    recording = lost_session(tmp_path, 6, saved_after=0)
    with (
        serving(BrokenServer(set(), game=Differs)) as address,
        pytest.raises(FaultFound, match="step 3 has other bytes than were recorded"),
    ):
        replay(address, recording)


def test_a_step_that_breaks_the_contract_is_recorded(tmp_path):
    with serving(BROKEN["RewardIsNotANumber"]) as address:
        with Session(address, "gauntlet", arenas=2, seed=3) as session:
            session.record_faults(tmp_path)
            with pytest.raises(SimulatorError, match="expected finite numbers"):
                session.step(gauntlet_acts(0))
        with pytest.raises(FaultFound, match=r"step 1 fails: .* expected finite numbers"):
            replay(address, load_recording(tmp_path / "gauntlet-0-1.fault"))


def test_a_log_that_is_too_long_is_given_up(simulator, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(fault_log, "MAX_LOG_BYTES", 0)
    with Session(simulator, "raises", arenas=2, seed=0) as session:
        session.record_faults(tmp_path)
        for _ in range(2):
            session.step(presses())
        with pytest.raises(SimulatorError):
            session.step(presses())
    assert not list(tmp_path.iterdir()) and "the fault is not recorded: the session is longer" in caplog.text


def test_a_folder_that_cannot_be_written_hides_no_error(simulator, tmp_path, caplog):
    (tmp_path / "faults").write_text("a file")
    with Session(simulator, "raises", arenas=2, seed=0) as session:
        session.record_faults(tmp_path / "faults")
        for _ in range(2):
            session.step(presses())
        with pytest.raises(SimulatorError, match="ZeroDivisionError"):
            session.step(presses())
    assert "the fault is not recorded: cannot write" in caplog.text


def header(**fields):
    return json.dumps({"format": 2, "error": "", "server": ""} | fields).encode() + b"\n"


def file_of(*records, **fields):
    """Return a file with these records, each a kind and a body, whose checksums are right."""
    line = header(**fields)
    data, check = line, zlib.crc32(line)
    for kind, body in records:
        head = ENTRY_HEADER.pack(kind, len(body))
        of_head = zlib.crc32(head, check)
        check = zlib.crc32(body, of_head)
        data += head + CHECK.pack(of_head) + body + CHECK.pack(check)
    return data


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xfe\n",
        b"[1]\n",
        b"{}\n",
        b"null\n",
        header(),
        header() + b"Q" * 20,
        file_of((b"?", b"")),
        file_of((b"Q", b"\xff\xff")),
        file_of((b"Q", b"")),
        file_of((b"S", b"")),
        file_of((b"Q", b"\x0a\x00"), (b"Q", b"\x12\x00")),
        file_of((b"H", b"[")),
        file_of((b"D", b"")),
        header(format=1),
        b"[" * 100_000,
    ],
)
def test_what_is_no_recorded_fault_is_refused_in_one_sentence(tmp_path, content, capsys):
    file = tmp_path / "strange"
    file.write_bytes(content)
    with pytest.raises(RecordingError, match=str(file)):
        load_recording(file)
    assert main(["replay", str(file)]) == 1
    assert capsys.readouterr().err.startswith(f"error: {file} ")


def test_training_records_the_faults_of_its_sessions_if_asked_to(simulator, tmp_path):
    from joybridge.config.config import load_config
    from joybridge.run.train import train

    file = tmp_path / "raises.yaml"
    file.write_text("game: raises\nlayout: hybrid\narenas: 4\npipeline_groups: 2\n")
    config = load_config(file, ["total_timesteps=1000", "policy.rollout_steps=50"])
    for record_faults in (False, True):
        with pytest.raises(SimulatorError, match="ZeroDivisionError"):
            train(config, tmp_path / "run", [simulator], resume=False, record_faults=record_faults)
        assert (tmp_path / "run" / "faults" / "raises-0-1.fault").exists() == record_faults
