"""Demonstrations are learned from: what a layout reads of them, and policies that clone them."""

import re
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from joybridge.cli import main
from joybridge.client.recording import load_recording
from joybridge.config.config import Config, make_config
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import read_rows
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.demonstrations.cloning import targets
from joybridge.demonstrations.files import load_demonstration
from joybridge.demonstrations.recorded import Demonstration, RecordedEpisodes
from joybridge.demonstrations.supervised import show
from joybridge.layouts import list_roles, make_acts, make_layouts
from joybridge.layouts.random_acts import press_at_random
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
from tests.support.broken_servers import BrokenServer, serving
from tests.support.demonstrated import SMALL, record

pytestmark = pytest.mark.usefixtures("signals")


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


def test_a_folder_without_demonstrations_is_refused_before_a_simulator_is_waited_for(tmp_path, capsys):
    (tmp_path / "hybrid.yaml").write_text("game: hybrid")
    command = ["train", str(tmp_path / "hybrid.yaml"), "--demos", str(tmp_path), "--simulator", "127.0.0.1:1"]
    assert main(command) == 1
    errors = capsys.readouterr().err
    assert f"error: demonstrations: {tmp_path} holds no file *.demo, nor a dataset of Minari; record" in errors
    assert "waiting" not in errors


@pytest.mark.parametrize("seed", range(6))
def test_only_episodes_that_are_demonstrated_are_held_out_and_counted(seed):
    """Of ten episodes four are demonstrated: others hold the seats of the rest."""
    nothing, nowhere = np.zeros((10, 1), np.float32), np.zeros(10, bool)
    first = StepArrays([nothing], nothing, nowhere, nowhere)
    paid = np.arange(10, dtype=np.float32)[:, None]
    last = replace(first, rewards=paid, terminated=~nowhere, ended=np.arange(10, dtype=np.int32))
    last = replace(last, final_observations=[nothing], metrics=np.zeros((10, 0), np.float32))
    act = ActArrays(np.full((10, 2), 0.5, np.float32), np.array([[0, 1, 1]] * 10, np.int32))
    stretch = RecordedEpisodes([[first], [last]], [[act]], [[[1, 3, 4, 8]]])
    (role,) = list_roles("hybrid", SPEC)
    actor = Actor(role, SPEC.behaviors[0], SMALL, 0)
    shown = show(actor, [Demonstration(Path("x.demo"), SPEC, [stretch], 0)], Config(game="any", seed=seed))
    assert shown and (len(shown.learned), shown.held_out and len(shown.held_out)) == (3, 1)
    assert (
        "3 decisions of 3 episodes are cloned; 1 decisions of 1 other is held out; an episode earned 4" in shown.remark
    )


def test_demonstrations_are_not_cloned_with_a_delay():
    (role,) = list_roles("hybrid", SPEC)
    late = make_config({"game": "any", "curriculum": [{"hand": {"delay": 2}}]})
    with pytest.raises(ConfigError, match=r"hand.delay: demonstrations show what the device got"):
        targets(Actor(role, SPEC.behaviors[0], SMALL, 0), [], late)


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
            learned, remark, unsaid = targets(actor, [shown], given)
            assert learned is None and unsaid == 2
            assert re.search(r"bucket-5 can say none of the 2 decisions .* to any; choose", remark)
