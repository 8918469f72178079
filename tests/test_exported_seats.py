"""Exported policies in seats: they play as the run does, in training too, and what does not fit is refused by name."""

import json
import shutil
from contextlib import closing
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper

from joybridge.cli import main
from joybridge.client.client import Session, describe
from joybridge.config.config import Config, OpponentsConfig
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.gym import BridgeEnv
from joybridge.layouts import make_acts
from joybridge.policy.actor import trained_actors
from joybridge.policy.document import FORMAT
from joybridge.policy.exported import load_exported
from joybridge.policy.player import PolicyPlayer
from joybridge.policy.table import Table
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.others import load_other
from joybridge.run.train import train

pytestmark = pytest.mark.usefixtures("signals")

SMALL = PolicyConfig(frame_stack=3, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=64)
NOUGHTS = Config(game="noughts", arenas=4, total_timesteps=320, log_interval=320, policy=SMALL)


@pytest.fixture(scope="module")
def run(simulator, tmp_path_factory) -> Path:
    """Return a run whose policy is exported beside it, as policy.json and policy.onnx, without chance."""
    folder: Path = tmp_path_factory.mktemp("seats") / "run"
    train(NOUGHTS, folder, [simulator], resume=False)
    for suffix in ("json", "onnx"):
        file = str(folder.parent / f"policy.{suffix}")
        assert main(["export", str(folder), file, "--deterministic", "--simulator", simulator]) == 0
    return folder


@pytest.mark.parametrize("suffix", ["json", "onnx"])
def test_an_exported_policy_plays_in_its_seats_as_the_run_does(run, suffix, simulator):
    with Session(simulator, "noughts", arenas=5, seed=3, options={}) as session:
        actors = trained_actors(NOUGHTS, session.spec, load_checkpoint(run)[0])
        tables = [Table(session.spec, 5, 1) for _ in range(2)]
        tables[0].join(1, actors)
        tables[1].join(1, load_other(str(run.parent / f"policy.{suffix}"), "noughts", session.spec))
        tables[0].players[1][0].deterministic = True  # type: ignore[attr-defined]
        for table in tables:
            for arena in range(5):
                table.seats.begin(arena, [1, 1])
            table.begin(session.steps)
        for number in range(60):
            if number == 41:  # in the middle of matches
                session.reset(8, {})
                for table in tables:
                    table.begin(session.steps)
            acts = [make_acts(session.spec, 5) for _ in tables]
            for table, own in zip(tables, acts, strict=True):
                table.act(session.steps, own)
            held = tables[0].seats.holders(0) == 1
            deciding = session.steps[0].deciding
            assert deciding is not None
            assert (acts[0][0].choices[held & deciding] == acts[1][0].choices[held & deciding]).all()
            masks = session.steps[0].masks
            assert masks is not None
            acts[0][0].choices[~held & deciding, 0] = masks[0][~held & deciding].argmax(axis=1)
            steps = session.step(acts[0])
            for table in tables:
                for result in table.seats.finish(steps):
                    table.seats.deal(result.arena, [[1, 0], [0, 1]][number % 2])
                table.sit(steps)
    assert isinstance(tables[0].players[1][0], PolicyPlayer)


def test_others_sample_after_a_reset_with_a_seed_as_in_a_new_environment(run, simulator):
    def played(env, **seed):
        observation, info = env.reset(**seed)
        seen = [observation]
        for _ in range(30):
            observation, _, terminated, truncated, info = env.step([info["action_mask"].argmax()])
            if terminated or truncated:
                observation, info = env.reset()
            seen.append(observation)
        return np.array(seen)

    def made(seed):
        return closing(BridgeEnv("noughts", others=[str(run)], simulator=simulator, seed=seed))

    with made(1) as env, made(5) as new:
        first = played(env)
        again = [played(env, seed=5) for _ in range(2)]
        expected = played(new)
    assert not np.array_equal(first, expected)
    for seen in again:
        np.testing.assert_array_equal(seen, expected)


def test_an_exported_policy_is_an_opponent_and_the_checkpoint_keeps_it(run, simulator, tmp_path):
    file = tmp_path / "policy.json"
    shutil.copy(run.parent / "policy.json", file)
    opponents = OpponentsConfig(shares={str(file): 1})
    config = NOUGHTS.model_copy(update={"opponents": opponents})
    train(config.model_copy(update={"stop_at": 160}), tmp_path / "run", [simulator], resume=False)
    arrays, _ = load_checkpoint(tmp_path / "run")
    assert arrays["league/policies.1.player.file"].tobytes() == file.read_bytes()
    shutil.copy(run.parent / "policy.onnx", tmp_path / "other.onnx")
    file.write_bytes(file.read_bytes().replace(b'"timesteps"', b'"changed"  '))  # it plays on as it was
    train(config, tmp_path / "run", [simulator], resume=True)
    arrays, manifest = load_checkpoint(tmp_path / "run")
    assert manifest.timesteps >= 320 and b'"timesteps"' in arrays["league/policies.1.player.file"].tobytes()
    command = ["evaluate", str(run), "--episodes", "10", "--others", str(file), "--simulator", simulator]
    assert main(command) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: "{", "is no exported policy: JSONDecodeError"),
        (lambda text: "[" * 100_000, "is no exported policy"),
        (lambda text: text.replace(FORMAT, "joybridge.policy.v3"), "its format is joybridge.policy.v3"),
        (lambda text: text.replace('"behavior": "player"', '"behavior": "judge"'), "it plays judge, and the game has"),
        (lambda text: text.replace('"own"', '"mine"'), "the sensor mine is not the same"),
        (lambda text: text.replace('"a1"', '"z9"'), "and other choices or ranges"),
        (lambda text: json.dumps(json.loads(text) | {"policies": []}), "policy"),
        (lambda text: json.dumps(json.loads(text) | {"game": 5}), "is no exported policy: ValidationError"),
        (lambda text: text.replace('"axes"', '"ax"'), "is no exported policy"),
    ],
)
def test_a_file_that_does_not_fit_is_refused_in_a_sentence(change, message, run, simulator, tmp_path):
    file = tmp_path / "policy.json"
    file.write_text(change((run.parent / "policy.json").read_text()))
    with pytest.raises(ConfigError, match=message) as caught:
        load_exported(file, describe(simulator, "noughts", {}))
    assert str(file) in str(caught.value) and "\n" not in str(caught.value)


def test_a_model_with_parts_of_its_own_is_refused(run, simulator, tmp_path):
    spec = describe(simulator, "noughts", {})
    model = onnx.load(run.parent / "policy.onnx")
    for wrong, message in (
        (helper.make_node("Loop", ["a", "b"], ["c"]), "it has the operator Loop"),
        (helper.make_node("Add", ["a", "b"], ["c"], domain="com.evil"), "it needs something outside itself"),
    ):
        other = onnx.ModelProto()
        other.CopyFrom(model)
        other.graph.node.append(wrong)
        (tmp_path / "policy.onnx").write_bytes(other.SerializeToString())
        with pytest.raises(ConfigError, match=message):
            load_exported(tmp_path / "policy.onnx", spec)
    other = onnx.ModelProto()
    other.CopyFrom(model)
    other.graph.initializer[0].data_location = onnx.TensorProto.EXTERNAL
    other.graph.initializer[0].external_data.add(key="location", value="/etc/passwd")
    sparse = onnx.ModelProto()
    sparse.CopyFrom(model)
    sparse.graph.sparse_initializer.add()
    for wrong in (other, sparse):
        (tmp_path / "policy.onnx").write_bytes(wrong.SerializeToString())
        with pytest.raises(ConfigError, match="it needs something outside itself"):
            load_exported(tmp_path / "policy.onnx", spec)


def test_a_file_cannot_hold_the_seats_of_several_behaviors(run, simulator):
    spec = describe(simulator, "ferry", {})
    with pytest.raises(ConfigError, match="plays one behavior, and who holds seats plays all"):
        load_other(str(run.parent / "policy.json"), "ferry", spec)


def test_a_policy_that_does_what_nobody_may_is_damaged(run, simulator):
    spec = describe(simulator, "noughts", {})
    exported = load_exported(run.parent / "policy.json", spec)
    with Session(simulator, "noughts", arenas=2, seed=3, options={}) as session:
        player, (act,) = exported.seat(4), make_acts(session.spec, 2)
        player.rng = np.random.default_rng(1)
        (step,) = session.steps
        assert step.masks is not None
        nothing = step.masks[0] & False
        nothing[:, 0] = True
        player._model.act = lambda *_: type(act)(act.axes[:1], np.full((1, 1), 5, np.int32))  # type: ignore[method-assign]
        step.masks = [nothing]
        with pytest.raises(ConfigError, match="does what its device or a mask forbids"):
            player.act(step, act, np.array([0]))
