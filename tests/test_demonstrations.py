"""Sessions are recorded as demonstrations, survive what happens to files, and are repeated."""

import json
import re
import resource
import signal
import subprocess
import sys
from contextlib import closing

import numpy as np
import pytest

from joybridge.cli import main
from joybridge.client import demonstration_log, recording
from joybridge.client.client import Session
from joybridge.client.recording import Kind, Record, RecordingError, Writer, load_recording
from joybridge.commands.replay import FaultFound, replay
from joybridge.commands.replay import main as replay_main
from joybridge.config.config import Config
from joybridge.config.errors import StorageError
from joybridge.demonstrations.cloning import targets
from joybridge.demonstrations.files import chosen_demonstrations, load_demonstration
from joybridge.demonstrations.recorded import load_recorded
from joybridge.layouts import list_roles, make_acts
from joybridge.policy.actor import Actor
from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.arena import Arena, Pressed, Settings
from tests.support.broken_servers import BrokenServer, Gauntlet, serving
from tests.support.demonstrated import SMALL, record

pytestmark = pytest.mark.usefixtures("signals")


@pytest.fixture(scope="module")
def demos(simulator, tmp_path_factory):
    folder = tmp_path_factory.mktemp("demonstrations")
    record(folder, simulator)
    return folder


@pytest.fixture(scope="module")
def described(simulator):
    with Session(simulator, "hybrid", arenas=1, seed=0) as session:
        return session.spec


# ----------------------------------------------------------------------------------------------------------- files


def test_a_demonstration_is_repeated_to_the_same_bytes(demos, simulator, capsys):
    file = demos / "hybrid-0001.demo"
    assert replay(simulator, load_recording(file)) == 30
    assert replay_main(["replay", str(file), "--simulator", simulator]) == 0
    assert capsys.readouterr().out == "30 steps are as they were recorded, and none fails\n"
    assert record(demos / "again", simulator).read_bytes() == file.read_bytes()


def test_what_was_played_by_numbers_is_recorded_anew_as_images_show_it(simulator, tmp_path, capsys):
    file = record(tmp_path, simulator, "shooting_birds")
    images = {"observation": "fovea+wide"}
    again = ["replay", str(file), "--simulator", simulator, "--demos", str(tmp_path / "anew")]
    assert replay_main([*again, "options.observation=fovea+wide"]) == 0
    said = capsys.readouterr()
    assert said.out == "30 steps are paid and end as they were recorded, and none fails\n"
    anew = tmp_path / "anew" / "shooting_birds-0001.demo"
    assert f"recorded again: {anew}" in said.err
    seen = record(tmp_path / "seen", simulator, "shooting_birds", options=images)
    assert anew.read_bytes() == seen.read_bytes()
    assert replay_main([*again, "parameters.bird_speed=2"]) == 1
    assert "replay changes options only; leave it out" in capsys.readouterr().err


def test_an_option_that_changes_more_than_what_is_observed_is_named(tmp_path):
    class Generous(Gauntlet):
        def step(self, acts):
            steps = super().step(acts)
            steps[0].rewards[:] += self.cells == 5
            return steps

    with serving(BrokenServer(set(), game=Generous)) as address:
        played = load_recording(record(tmp_path, address, "gauntlet"))
        with pytest.raises(FaultFound, match=r"step 1 has other rewards or ends .* so options\.size=large"):
            replay(address, played, options={"size": "large"})


@pytest.mark.promise("D3")
def test_another_game_under_the_same_name_is_noticed(tmp_path):
    class Other(Gauntlet):
        def step(self, acts):
            self.place += 0.001 * (self.counts[:, :1] == 2)
            return super().step(acts)

    with serving(BrokenServer(set())) as address:
        recording = load_recording(record(tmp_path, address, "gauntlet"))
    with serving(BrokenServer(set(), game=Other)) as address, pytest.raises(FaultFound, match="step 3 has other bytes"):
        replay(address, recording)


def test_a_file_that_was_cut_off_anywhere_loses_only_its_end(demos, described, tmp_path):
    data = (demos / "hybrid-0001.demo").read_bytes()
    whole = load_recording(demos / "hybrid-0001.demo")
    assert whole.cut == 0
    file, known = tmp_path / "cut.demo", []
    for size in np.linspace(len(data) // 3, len(data) - 1, 60).astype(int):
        file.write_bytes(data[:size])
        recording = load_recording(file)
        known.append(len(recording.exchanges))
        assert recording.exchanges[:-1] == whole.exchanges[: known[-1] - 1]
        left_out = load_demonstration(file, described).remark()
        assert not recording.cut or f"the last {recording.cut} bytes, which were not written" in left_out
    assert known == sorted(known) and len(set(known)) > 10


def test_a_file_that_was_changed_anywhere_is_refused(demos, tmp_path):
    data = (demos / "hybrid-0001.demo").read_bytes()
    file = tmp_path / "changed.demo"
    for place in np.random.default_rng(1).integers(0, len(data), 60):
        file.write_bytes(data[:place] + bytes([data[place] ^ 4]) + data[place + 1 :])
        with pytest.raises(RecordingError, match=re.escape(str(file))):
            load_recording(file)


def test_a_program_that_is_killed_loses_no_step(tmp_path, simulator, described):
    program = f"""
import os, signal
from pathlib import Path
from joybridge.client.client import Session
from joybridge.layouts import make_acts
session = Session({simulator!r}, "hybrid", arenas=1, seed=5)
session.record_demonstration(Path({str(tmp_path)!r}))
for _ in range(12):
    session.step(make_acts(session.spec, 1))
os.kill(os.getpid(), signal.SIGKILL)
"""
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == -9
    demonstration = load_demonstration(tmp_path / "hybrid-0001.demo", described)
    (stretch,) = demonstration.stretches
    finished, begun = demonstration.episodes(0)
    assert len(stretch.acts) == 12 and finished >= 1 and begun == 1
    assert "left out: 1 unfinished episode" in demonstration.remark()


def test_what_a_person_holds_is_demonstrated_and_what_chance_plays_is_not(tmp_path, simulator):
    with closing(Arena(simulator, "ferry", Settings(3, {}, {}), 30.0, tmp_path)) as arena:
        for seats in ([1], [1], [1], range(3)):
            arena.play(dict.fromkeys(seats, Pressed([[0.5], []], [[], [1]])))
        described = arena.spec
    (stretch,) = load_demonstration(tmp_path / "ferry-0001.demo", described).stretches
    held = [[stretch.demonstrated(number, index).tolist() for index in (0, 1)] for number in range(4)]
    assert held == [[[False], [True, False]]] * 3 + [[[True], [True, True]]]
    assert all(act[1].choices[0, 0] == 1 for act in stretch.acts)


def test_decisions_are_discarded_and_resets_between_them_are_not_counted(tmp_path, simulator):
    with Session(simulator, "hybrid", arenas=1, seed=5) as session:
        demonstration, acts = session.record_demonstration(tmp_path), make_acts(session.spec, 1)
        for decisions in (3, 2):
            for _ in range(decisions):
                session.step(acts)
            session.reset(seed=2)
        demonstration.discard(5)
        spec = session.spec
    stretches = load_demonstration(tmp_path / "hybrid-0001.demo", spec).stretches
    assert not any(part.demonstrated(at, 0).any() for part in stretches for at in range(len(part.acts)))


def test_a_demonstration_ends_before_it_is_too_large_to_be_read(tmp_path, simulator, monkeypatch):
    monkeypatch.setattr(demonstration_log, "MAX_FILE_BYTES", 20_000)
    with pytest.raises(StorageError, match="a demonstration has at most 20,000 bytes"):
        record(tmp_path, simulator, decisions=1000)
    file = tmp_path / "hybrid-0001.demo"
    assert file.stat().st_size <= 20_000 and load_recording(file).exchanges


def test_a_program_says_by_an_array_whose_decisions_are_demonstrated(tmp_path, simulator):
    with Session(simulator, "hybrid", arenas=2, seed=5) as session:
        demonstration, acts = session.record_demonstration(tmp_path), make_acts(session.spec, 2)
        for pressed in ([True, False], [False, True]):
            demonstration.hold([np.flatnonzero(pressed)])
            session.step(acts)
        described = session.spec
    (stretch,) = load_demonstration(tmp_path / "hybrid-0001.demo", described).stretches
    assert [stretch.demonstrated(number, 0).tolist() for number in (0, 1)] == [[True, False], [False, True]]


def test_nobody_learns_from_an_episode_that_is_discarded_while_it_is_played_or_after_its_end(tmp_path, simulator):
    with closing(Arena(simulator, "hybrid", Settings(3, {}, {}), 30.0, tmp_path)) as arena:
        lengths, discarded = [0], []
        while len(lengths) < 6:
            arena.play({0: Pressed([[0.5, 0.5]], [[0, 0]])}, draw=False)
            lengths[-1] += 1
            over = bool(arena.scores.ended)
            if len(lengths) == 2 and lengths[-1] == 1 and not over:
                arena.discard()  # the second, while it is played
            if over and len(lengths) == 4:
                arena.discard()  # the fourth, which has just ended
            discarded.append((len(lengths), arena.discarded))
            lengths += [0] * over
        arena.discard()  # the fifth, after which nothing is played
        described = arena.spec
    (stretch,) = load_demonstration(tmp_path / "hybrid-0001.demo", described).stretches
    episodes = np.repeat(np.arange(1, 6), lengths[:5])
    shown = [bool(stretch.demonstrated(number, 0)[0]) for number in range(len(stretch.acts))]
    assert min(lengths[:5]) > 1
    assert shown == [number in (1, 3) for number in episodes]
    assert [said for number, said in discarded if number == 2] == [True] * lengths[1]
    assert not any(said for number, said in discarded if number in (1, 3, 5))


def test_a_game_may_pay_other_rewards_than_when_it_was_recorded(tmp_path, simulator):
    with Session(simulator, "hybrid", arenas=2, seed=1) as session:
        session.record_demonstration(tmp_path)
        for _ in range(100):
            session.step(make_acts(session.spec, 2))
        described, now = session.spec, pb.GameSpec()
    now.CopyFrom(described)
    (file,) = tmp_path.iterdir()
    (before,) = load_demonstration(file, described).stretches
    own = [channel.name for channel in described.behaviors[0].channels]
    now.behaviors[0].channels.insert(0, pb.RewardChannel(name="lives", default_weight=-1.0))
    (after,) = load_demonstration(file, now).stretches
    for (one,), (other,) in zip(before.steps, after.steps, strict=True):
        assert other.rewards.shape == (2, 1 + len(own)) and not other.rewards[:, 0].any()
        np.testing.assert_array_equal(other.rewards[:, 1:], one.rewards)
    (role,) = list_roles("hybrid", now)
    actor = Actor(role, now.behaviors[0], SMALL.model_copy(update={"remember_acts": 1}), 0)
    learned = targets(actor, [load_demonstration(file, now)], Config(game="hybrid")).actions
    assert learned is not None and len(learned)


def test_what_was_played_with_parameters_that_are_drawn_can_be_learned_from(tmp_path, simulator):
    size = pb.Distribution(uniform=pb.Interval(low=0.5, high=2.0))
    file = record(tmp_path, simulator, "archer", decisions=400, distributions={"size": size})
    demonstration = load_recorded(file, None)
    ends = [steps[0].parameters for stretch in demonstration.stretches for steps in stretch.steps]
    assert any(values is not None and values.shape[1] == 1 for values in ends)


@pytest.mark.parametrize("lane", [0.5, 1.0, True, "0", None, -1, 2])
def test_lanes_that_are_no_lanes_are_refused(lane, tmp_path, simulator):
    with Session(simulator, "hybrid", arenas=2, seed=1) as session:
        session.record_demonstration(tmp_path)
        session.step(make_acts(session.spec, 2))
        described = session.spec
    (file,) = tmp_path.iterdir()
    first, *records = _records(file)
    writer = Writer(json.loads(first))
    file.write_bytes(writer.first_line + writer.encode([Record(Kind.HELD, json.dumps([[lane]]).encode()), *records]))
    with pytest.raises(RecordingError, match=r"is no recorded session|breaks the contract"):
        load_demonstration(file, described)


@pytest.mark.parametrize("held", [{}, {"": 1}, [], [1], [{}], "", 0, False])
def test_lanes_that_are_no_lists_are_refused(held, tmp_path, demos, described):
    first, *records = _records(demos / "hybrid-0001.demo")
    file, writer = tmp_path / "held.demo", Writer(json.loads(first))
    file.write_bytes(writer.first_line + writer.encode([Record(Kind.HELD, json.dumps(held).encode()), *records]))
    with pytest.raises(RecordingError, match=r"held\.demo (is no recorded session|breaks the contract)"):
        load_demonstration(file, described)


def test_decisions_that_are_discarded_again_and_again_are_read_as_quickly_as_others(tmp_path, demos):
    first, *records = _records(demos / "hybrid-0001.demo")
    file, writer = tmp_path / "discarded.demo", Writer(json.loads(first))
    discards = [Record(Kind.DISCARDED, recording.COUNT.pack(count)) for count in (2, 1, 2**32 - 1)]
    file.write_bytes(writer.first_line + writer.encode([*records, discards[1], *discards[:1], *records[1:3]]))
    held = [exchange.held for exchange in load_recording(file).exchanges]
    assert held[-3:-1] == [[[]]] * 2 and held[-1] is None and not any(held[:-3])
    writer = Writer(json.loads(first))
    file.write_bytes(writer.first_line + writer.encode([*records, *[discards[2]] * 100_000]))
    assert all(exchange.held == [[]] for exchange in load_recording(file).exchanges)


@pytest.mark.parametrize("asked", [pb.PlayRequest(), pb.PlayRequest(act=pb.Act())], ids=["nothing", "an empty act"])
@pytest.mark.promise("X6")
def test_requests_that_ask_nothing_are_damage_because_a_small_file_holds_very_many(asked, tmp_path, demos):
    first, *records = _records(demos / "hybrid-0001.demo")
    file, writer = tmp_path / "hollow.demo", Writer(json.loads(first))
    hollow = [Record(Kind.REQUEST, asked.SerializeToString())] * 1000
    file.write_bytes(writer.first_line + writer.encode([*records, *hollow]))
    with pytest.raises(RecordingError, match=r"hollow\.demo is no recorded session \(an empty request\)"):
        load_recording(file)


def _records(file):
    """Return the first line of a file, and its records."""
    data = file.read_bytes()
    end = data.index(b"\n") + 1
    return data[:end], *recording._read(file, data, end)[0]


def test_a_second_session_makes_another_file(demos, simulator):
    assert record(demos / "two", simulator, decisions=2).name == "hybrid-0001.demo"
    assert record(demos / "two", simulator, decisions=2).name == "hybrid-0002.demo"
    assert record(demos / "two", simulator, decisions=0) is None


# --------------------------------------------------------------------------------------------------------- layouts


# --------------------------------------------------------------------------------------------------------- cloning


def test_a_trained_policy_is_recorded_and_cloned(demos, simulator, tmp_path, capsys):
    file = tmp_path / "hybrid.yaml"
    file.write_text(
        "game: hybrid\nlayout: bucket-5\narenas: 4\ntotal_timesteps: 64\nlog_interval: 64\n"
        "policy: {frame_stack: 1, hidden_sizes: [8], rollout_steps: 16, minibatch_size: 32}\n"
    )
    run, more = tmp_path / "run", ["--simulator", simulator]
    assert main(["train", str(file), "--run", str(run), "--demos", str(demos), *more]) == 0
    assert "decisions of" in capsys.readouterr().out
    assert main(["evaluate", str(run), "--episodes", "4", "--demos", str(tmp_path / "new"), *more]) == 0
    assert replay(simulator, load_recording(tmp_path / "new" / "hybrid-0001.demo")) > 4


@pytest.mark.parametrize(
    ("game", "options", "message"),
    [
        ("duel", {}, "is a demonstration of duel, expected hybrid; name another folder"),
        ("hybrid", {"size": "large"}, r"was recorded with other sensors of player: .* now .*; train with the options"),
    ],
)
def test_demonstrations_of_another_game_or_spec_are_named(game, options, message, described, simulator, tmp_path):
    file = record(tmp_path, simulator, game, options=options)
    with pytest.raises(RecordingError, match=f"^{re.escape(str(file))} {message}"):
        load_demonstration(file, described)


def test_a_full_disk_costs_what_could_not_be_written_and_no_more(tmp_path, simulator):
    with Session(simulator, "archer", arenas=1, seed=5) as session:
        session.record_demonstration(tmp_path)
        acts = make_acts(session.spec, 1)
        session.step(acts)
        (file,) = tmp_path.glob("*.demo")
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (file.stat().st_size + 100, limits[1]))
        try:
            with pytest.raises(StorageError, match="cannot write"):
                session.step(acts)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
            signal.signal(signal.SIGXFSZ, before)
        assert len(load_recording(file).exchanges) == 2
        session.step(acts)  # there is room again
    assert len(load_recording(file).exchanges) == 4


def test_a_demonstration_that_cannot_be_read_is_named_and_not_the_note_of_the_run(tmp_path):
    (tmp_path / "folder.demo").mkdir()
    with pytest.raises(RecordingError, match=r"folder\.demo cannot be read .*; move it elsewhere"):
        chosen_demonstrations(tmp_path, tmp_path / "run", resumed=False)
