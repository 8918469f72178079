"""Sessions are recorded as demonstrations, survive what happens to files, are repeated, and are cloned."""

import json
import re
import subprocess
import sys
from contextlib import closing
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from joybridge.cli import main
from joybridge.client import recording
from joybridge.client.client import Session
from joybridge.client.recording import Kind, Record, RecordingError, Writer, load_recording
from joybridge.commands.replay import FaultFound, replay
from joybridge.commands.replay import main as replay_main
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import read_rows
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.demonstrations.cloning import targets
from joybridge.demonstrations.files import load_demonstration
from joybridge.demonstrations.recorded import Demonstration, RecordedEpisodes
from joybridge.layouts import list_roles, make_acts, make_layouts
from joybridge.layouts.random_acts import obey_masks, press_at_random
from joybridge.policy.actor import Actor
from joybridge.policy.encoder import Stacks
from joybridge.policy.player import PolicyPlayer
from joybridge.ppo.cloning import add_cloning_gradient, minibatches
from joybridge.ppo.history import Window
from joybridge.ppo.loss import Actions
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.update import Learner
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.train import train
from joybridge.run.training import Audience
from joybridge.simulator import axis, behavior, branch, button, sensor, spec
from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.arena import Arena, Pressed, Settings
from tests.support.broken_servers import BrokenServer, Gauntlet, serving

pytestmark = pytest.mark.usefixtures("signals")

SMALL = PolicyConfig(
    frame_stack=2, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32, learning_rate=3e-3
)


def record(folder, address, game="hybrid", decisions=30, arenas=2, **settings):
    """Record random play and return the file."""
    rng = np.random.default_rng(0)
    with Session(address, game, arenas=arenas, seed=5, **settings) as session:
        demonstration = session.record_demonstration(folder)
        acts = make_acts(session.spec, arenas)
        for _ in range(decisions):
            for part, act, step in zip(session.spec.behaviors, acts, session.steps, strict=True):
                press_at_random(part.device, act, rng)
                obey_masks(act, step, rng)
            session.step(acts)
    return demonstration.path


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
    assert f"recorded anew: {anew}" in said.err
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
    with pytest.raises(RecordingError, match="breaks the contract"):
        load_demonstration(file, described)


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


SPEC = spec(
    type("Any", (), {"name": "any", "description": "any", "options": (), "version": ""}),
    [
        behavior(
            "any",
            sensors=[sensor("any", [1])],
            axes=[axis("x"), axis("force", 0.5, 2.0)],
            branches=[branch("gear", ["low", "middle", "high"]), button("shoot"), button("jump")],
        )
    ],
)
DEVICE = SPEC.behaviors[0].device


@pytest.mark.parametrize(
    ("layout", "says_all", "gap"),  # gap: the largest between two values of an axis, as a share of its range
    [
        ("hybrid", True, 0),
        ("beta", True, 0),
        ("threshold-0.0", True, 0),
        ("threshold-0.5", True, 0),
        ("joint-5", True, 0.25),
        ("bucket-11", False, 0.1),
        ("ordinal-7-mu", False, 0.31),
        ("multiagent", False, 0),
        ("bucket-5, shoot=hybrid", True, 0.25),
    ],
)
def test_what_a_layout_reads_it_writes(layout, says_all, gap):
    rng = np.random.default_rng(3)
    act = ActArrays(np.zeros((200, 2), np.float32), np.zeros((200, 3), np.int32))
    press_at_random(DEVICE, act, rng)
    got = ActArrays(np.zeros((200, 2), np.float32), np.zeros((200, 3), np.int32))
    for part in make_layouts(layout, DEVICE).values():
        part.write(*part.read(act), got)
    both = (act.choices[:, 1:] == 1).all(axis=1)
    assert ((got.choices == act.choices).all(axis=1) == (says_all | ~both)).all()
    moved = np.abs(got.axes - act.axes) / np.array([2.0, 1.5])
    assert moved.max() <= gap / 2 + 1e-6


# --------------------------------------------------------------------------------------------------------- cloning


def config(folder, layout="hybrid", **more):
    return Config(
        **{
            "game": "gauntlet",
            "arenas": 4,
            "total_timesteps": 256,
            "log_interval": 64,
            "policy": SMALL,
            "layout": layout,
            "demonstrations": str(folder),
        }
        | more
    )


def test_a_run_that_clones_and_is_resumed_ends_in_the_same_bits(tmp_path):
    with serving(BrokenServer(set())) as address:
        record(tmp_path / "demos", address, "gauntlet", 40)
        for cloning in ("alone", "beside_ppo"):
            remarks: list[str] = []
            whole, parts = tmp_path / f"whole-{cloning}", tmp_path / f"parts-{cloning}"
            given = config(tmp_path / "demos", cloning=cloning, layout="bucket-5")
            go_on = partial(train, audience=Audience(say=remarks.append))
            go_on(given, whole, [address], resume=False)
            go_on(given.model_copy(update={"stop_at": 128}), parts, [address], resume=False)
            record(tmp_path / "demos", address, "gauntlet", 3)
            go_on(given, parts, [address], resume=True)
            (one, _), (other, _) = load_checkpoint(whole), load_checkpoint(parts)
            assert one.keys() == other.keys()
            for name, array in one.items():
                np.testing.assert_array_equal(array, other[name], err_msg=name)
            said = "\n".join(remarks)
            assert "not learned from, because the run began without" in said
            assert re.search(r"player: \d+ decisions of \d+ episodes are cloned; axes are moved to the nearest", said)
            assert all("cloning_loss" in row for row in read_rows(whole / "metrics-judge.csv"))
        file = next((tmp_path / "demos").iterdir())
        file.write_bytes(file.read_bytes()[:-1])
        assert (
            main(
                [
                    "train",
                    str(parts / "config.yaml"),
                    "--run",
                    str(parts),
                    "--resume",
                    "total_timesteps=512",
                    "--simulator",
                    address,
                ]
            )
            == 1
        )


@pytest.mark.parametrize("layout", ["hybrid", "bucket-5", "threshold-0.0", "beta"])
def test_what_is_shown_is_learned(layout):
    shown = np.linspace(-1, 1, 200, dtype=np.float32)[:, None]
    wanted = ActArrays(np.hstack([shown, np.full_like(shown, 1.25)]), np.zeros((200, 3), np.int32))
    wanted.choices[:, 1] = shown[:, 0] > 0.2
    (role,) = list_roles(layout, SPEC)
    config = PolicyConfig(frame_stack=1, hidden_sizes=[16])
    actor = Actor(role, SPEC.behaviors[0], config, 0)
    learner = Learner("any", actor.network, branches=actor.branches, gaussians=actor.gaussians, autograd=False)
    continuous, discrete = map(torch.from_numpy, actor.layout.read(wanted))
    actions = Actions(Observations(torch.from_numpy(shown)), continuous, discrete, None)
    for _ in range(250):
        actor.network.zero_grad(set_to_none=False)
        add_cloning_gradient(actor.network, actions, 1.0)
        learner.step(1e-2)
    player = PolicyPlayer(actor, 200, 0, deterministic=True)
    step = StepArrays([shown], shown, np.zeros(200, bool), np.zeros(200, bool))
    (got,) = make_acts(SPEC, 200)
    player.begin(step)
    player.act(step, got)
    assert (got.choices == wanted.choices).mean() > 0.98
    assert np.abs(got.axes - wanted.axes).mean() < (0.2 if layout == "bucket-5" else 0.1)


def test_images_are_cloned_as_images_and_each_is_stored_once(simulator, tmp_path):
    for number in (1, 2):
        file = record(tmp_path, simulator, "gallery", 30, arenas=2)
        assert file.name == f"gallery-000{number}.demo"
    game = load_recording(file).spec
    assert game is not None
    shown = [load_demonstration(path, game) for path in sorted(tmp_path.iterdir())]
    (role,) = list_roles("hybrid", game)
    actor = Actor(role, game.behaviors[0], PolicyConfig(frame_stack=3, hidden_sizes=[8]), 0)
    actions, remark, _ = targets(actor, shown, Config(game="gallery"))
    assert remark == "visitor: 112 decisions of 16 episodes are cloned"
    assert actions is not None and len(actions) == 112
    wanted = []
    for stretch in (part for demonstration in shown for part in demonstration.stretches):
        stacks = Stacks(actor.encoder, 2, 3)
        stacks.begin(actor.see(stretch.steps[0][0].observations))
        for number in range(28):  # four episodes; the fifth is not finished
            wanted.append(deepcopy(stacks.now))
            stacks.push(actor.see(stretch.steps[number + 1][0].observations), stretch.steps[number + 1][0])
    np.testing.assert_array_equal(actions.observations.numbers, np.concatenate([one.numbers for one in wanted]))
    for image, window in enumerate(actions.observations.images):
        assert isinstance(window, Window)
        np.testing.assert_array_equal(window.gather(), np.concatenate([one.images[image] for one in wanted]))
        assert len(window.pictures) == 112 + 1  # and a black one
    some = next(minibatches(actions, 16, np.random.default_rng(0)))
    assert add_cloning_gradient(actor.network, some, 1.0) > 0


def test_a_run_clones_play_with_images(simulator, tmp_path, capsys):
    record(tmp_path / "demos", simulator, "gallery", 30)
    (tmp_path / "gallery.yaml").write_text(
        "game: gallery\narenas: 4\ntotal_timesteps: 64\ncloning: alone\n"
        "policy: {frame_stack: 2, hidden_sizes: [8], rollout_steps: 16, minibatch_size: 32}\n"
    )
    assert (
        main(
            [
                "train",
                str(tmp_path / "gallery.yaml"),
                "--run",
                str(tmp_path / "run"),
                "--simulator",
                simulator,
                "--demos",
                str(tmp_path / "demos"),
            ]
        )
        == 0
    )
    assert "visitor: 56 decisions of 8 episodes are cloned" in capsys.readouterr().out


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


def test_a_folder_without_demonstrations_is_refused_before_a_simulator_is_waited_for(tmp_path, capsys):
    (tmp_path / "hybrid.yaml").write_text("game: hybrid")
    command = ["train", str(tmp_path / "hybrid.yaml"), "--demos", str(tmp_path), "--simulator", "127.0.0.1:1"]
    assert main(command) == 1
    errors = capsys.readouterr().err
    assert f"error: demonstrations: {tmp_path} holds no file *.demo, nor a dataset of Minari; record" in errors
    assert "waiting" not in errors


def test_a_layout_that_can_say_nothing_is_named():
    nothing, nowhere = np.zeros((3, 1), np.float32), np.zeros(3, bool)
    first = StepArrays([nothing], nothing, nowhere, nowhere)
    last = replace(first, terminated=np.array([True, True, False]), ended=np.array([0, 1], np.int32))
    both = ActArrays(np.full((3, 2), 0.5, np.float32), np.array([[0, 1, 1]] * 3, np.int32))
    shown = Demonstration(Path("both.demo"), SPEC, [RecordedEpisodes([[first], [last]], [[both]], [None])], 0)
    for layout in ("hybrid", "bucket-5"):
        (role,) = list_roles(layout, SPEC)
        actor, given = Actor(role, SPEC.behaviors[0], SMALL, 0), Config(game="any", layout=layout)
        if layout == "hybrid":
            learned, remark, _ = targets(actor, [shown], given)
            assert learned is not None and len(learned) == 2 and "any: 2 decisions of 2 episodes are cloned" in remark
        else:
            with pytest.raises(ConfigError, match=r"bucket-5 can say none of the 2 decisions .* to any; choose"):
                targets(actor, [shown], given)
