"""An exported policy plays as the trainer does: as an ONNX model, and as JSON in the runtime in Python."""

import json
import sys
from itertools import islice

import numpy as np
import onnxruntime as ort
import pytest
import torch

from joybridge import cli
from joybridge.cli import main
from joybridge.client.client import describe
from joybridge.config.config import Config
from joybridge.config.errors import ExportError
from joybridge.config.policy_config import PolicyConfig
from joybridge.play import export as exporting
from joybridge.play.export import compare
from joybridge.play.playing import PlaySpec, open_play
from joybridge.policy.actor import make_actors
from joybridge.policy.document import encode, make_document
from joybridge.policy.exported import Model
from joybridge.policy.onnx_model import build_model
from joybridge.ppo.observation_tensors import Observations
from joybridge.run.folder import keep_config
from tests.support.exported_runs import (
    IMAGES,
    MEMORIES,
    POINTERS,
    RUNTIME,
    SMALL,
    Given,
    documents,
    load_runtime,
    make_run,
    pointing,
    remembering,
    seeing,
)

pytestmark = pytest.mark.usefixtures("signals")

LAYOUTS = [
    "hybrid",
    "bucket-3",
    "threshold-0.0",
    "threshold-0.5",
    "multiagent",
    "joint-3-mu",
    "ordinal-4, x=hybrid",
    "squashed, x=hybrid",
]


@pytest.fixture(scope="module")
def runtime():
    """Return the module in NumPy that the examples contain."""
    return load_runtime(RUNTIME)


def masks_keep(choices, masks):
    return all(mask[np.arange(len(mask)), choices[:, branch]].all() for branch, mask in enumerate(masks))


@pytest.mark.parametrize("deterministic", [False, True], ids=["sampled", "deterministic"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_model_and_runtime_play_as_the_trainer_does(layout, deterministic, simulator, runtime, tmp_path):
    settings = (
        {"policies": {"axes": {"sensors": ["lamps", "place"], "frame_stack": 2}}} if layout == "multiagent" else {}
    )
    run = make_run(tmp_path / "run", simulator, layout=layout, **settings)
    play_beside(run, simulator, runtime, deterministic=deterministic)


@pytest.mark.parametrize("activation", ["tanh", "relu", "elu"])
def test_each_activation_plays_as_the_trainer_does(activation, simulator, runtime, tmp_path):
    run = make_run(tmp_path / "run", simulator, policy=PolicyConfig(hidden_sizes=[8, 8], activation=activation))
    assert play_beside(run, simulator, runtime)["policies"][0]["activation"] == activation


@pytest.mark.parametrize("kind", ["bounds", "running"])
def test_scaled_observations_play_as_the_trainer_does(kind, simulator, runtime, tmp_path):
    policy = SMALL.model_copy(update={"scale_observations": kind})
    run = make_run(tmp_path / "run", simulator, layout="multiagent", policy=policy)
    assert "scaling" in play_beside(run, simulator, runtime)["policies"][1]


@pytest.mark.parametrize("images", IMAGES, ids=[one[0] for one in IMAGES])
def test_each_encoder_of_images_plays_as_the_trainer_does(images, simulator, runtime, tmp_path):
    run = make_run(tmp_path / "run", simulator, **seeing(*images))
    document = play_beside(run, simulator, runtime)
    assert [image["sensor"] for image in document["policies"][0]["images"]] == ["map", "view"]


def test_differences_between_frames_play_as_the_trainer_does(simulator, runtime, tmp_path):
    settings = seeing(*IMAGES[0])
    settings["policy"] = settings["policy"].model_copy(update={"frame_differences": True, "frame_stack": 3})
    play_beside(make_run(tmp_path / "run", simulator, **settings), simulator, runtime)


@pytest.mark.parametrize("pointer", POINTERS, ids=[f"{one[0][0]} {one[1]}" for one in POINTERS])
def test_each_map_points_as_the_trainer_does(pointer, simulator, runtime, tmp_path):
    run = make_run(tmp_path / "run", simulator, **pointing(*pointer))
    document = play_beside(run, simulator, runtime)
    (table,) = [table for table in document["policies"][0]["discrete"] if "places" in table]
    for place in table["places"]:
        place["weight"] = np.flip(place["weight"], 0)  # the comparison would notice
    with open_play(PlaySpec(run, simulator, seed=3), episodes=10) as play:
        found = compare(build_model(document).SerializeToString(), play, 0)
    assert found.different > 100


@pytest.mark.parametrize("memory", MEMORIES, ids=[" ".join([one[0], *one[2:]]) for one in MEMORIES])
def test_each_memory_plays_as_the_trainer_does(memory, simulator, runtime, tmp_path):
    run = make_run(tmp_path / "run", simulator, **remembering(*memory))
    document = play_beside(run, simulator, runtime)
    assert {policy["memory"]["kind"] for policy in document["policies"]} == {memory[0]}
    for policy in document["policies"]:
        weight = policy["memory"]["state"]["weight"]
        policy["memory"]["state"]["weight"] = -weight  # the comparison would notice
    with open_play(PlaySpec(run, simulator, seed=3), episodes=10) as play:
        found = compare(build_model(document).SerializeToString(), play, 0)
    assert found.different > 100


def play_beside(run, simulator, runtime, *, deterministic=False):
    """Let an ONNX model and the runtime in NumPy play beside the trainer, all alike; return the document."""
    with open_play(PlaySpec(run, simulator, seed=3, deterministic=deterministic), episodes=10) as play:
        document = documents(play, deterministic=deterministic)
        (run / "policy.json").write_bytes(encode(document))
        policy = runtime.Policy(run / "policy.json")
        behavior = play.spec.behaviors[0]
        model = Model(build_model(document).SerializeToString(), behavior, 10)
        state, masked, seen = policy.begin(10), 0, []
        for decision in islice(play.decisions(), 40):
            before, (theirs,) = decision.before[0], decision.acts
            assert before.masks is not None
            normal, uniform = (np.hstack(parts) for parts in zip(*[p.noise for p in play.players], strict=True))
            acts = model.act(before, normal, uniform)
            sensors = dict(zip([sensor.name for sensor in behavior.sensors], before.observations, strict=True))
            masks = dict(zip([branch.name for branch in behavior.device.branches], before.masks, strict=True))
            axes, choices, state = policy.act(sensors, state, Given(play.players), masks)
            for ours in ((acts.axes, acts.choices), (axes, choices)):
                assert ours[0].dtype == np.float32 and ours[1].dtype == np.int32
                np.testing.assert_allclose(ours[0], theirs.axes, rtol=0, atol=1e-5)
                np.testing.assert_array_equal(ours[1], theirs.choices)
                assert masks_keep(ours[1], before.masks)
            masked += sum(int((~mask).sum()) for mask in before.masks)
            seen.append(np.hstack([theirs.axes, theirs.choices]))
            model.store(decision.after[0])
            state[decision.after[0].ends] = 0
    assert masked > 50
    assert (np.concatenate(seen).std(axis=0) > 0.05).all()  # every axis and branch was moved
    return document


@pytest.mark.parametrize("behavior", [0, 1])
def test_each_behavior_of_a_game_with_turns_plays_as_the_trainer_does(behavior, simulator, tmp_path):
    run = make_run(tmp_path / "run", simulator, game="duel")
    with open_play(PlaySpec(run, simulator, seed=3), episodes=8) as play:
        found = compare(build_model(documents(play, behavior)).SerializeToString(), play, behavior)
    assert found.decisions == pytest.approx(8 * 128 * (0.7, 0.3)[behavior], rel=0.1)  # of ten decisions the judge has 3
    assert (found.different, found.forbidden) == (0, 0) and found.largest < 1e-5


def test_a_policy_that_plays_otherwise_is_not_written(simulator, tmp_path, monkeypatch, capsys):
    run = make_run(tmp_path / "run", simulator)

    def wrong(*arguments, **more):
        document = make_document(*arguments, **more)
        document["policies"][0]["layers"][-1]["bias"] += 0.1
        return document

    monkeypatch.setattr(exporting, "make_document", wrong)
    assert main(["export", str(run), str(tmp_path / "policy.onnx"), "--simulator", simulator]) == 1
    assert " of 1024 decisions and makes 0 forbidden choices, so nothing is written" in capsys.readouterr().err
    assert not (tmp_path / "policy.onnx").exists()


def test_noise_in_even_steps_gives_choices_in_proportion_to_their_probabilities(simulator, tmp_path):
    run = make_run(tmp_path / "run", simulator, layout="hybrid")
    lanes = 10_000
    with open_play(PlaySpec(run, simulator, seed=3)) as play:
        session = ort.InferenceSession(build_model(documents(play)).SerializeToString())
        before, actor = play.session.steps[0], play.players[0].actor
        assert before.masks is not None
        feeds = {
            f"sensor.{sensor.name}": np.repeat(observation, lanes, axis=0)
            for sensor, observation in zip(play.spec.behaviors[0].sensors, before.observations, strict=True)
        }
        feeds["mask.gear"] = np.repeat(before.masks[0], lanes, axis=0)
        feeds["mask.press"] = np.ones((lanes, 2), bool)
        feeds["state"] = np.zeros((lanes, 2 * actor.encoder.size), np.float32)
        feeds["normal"] = np.random.default_rng(1).standard_normal((lanes, 2), np.float32)
        feeds["uniform"] = np.repeat((np.arange(lanes, dtype=np.float32)[:, None] + 0.5) / lanes, 2, axis=1)
        axes, choices, _ = session.run(None, feeds)
        frame = np.concatenate([feeds["state"][:1], actor.encoder.frames(before.observations)], axis=1)
        outputs = actor.network(Observations(torch.from_numpy(frame)))
    logits = outputs.logits.detach().numpy()[0]
    logits[0, ~before.masks[0][0]] = -np.inf
    for branch, size in enumerate((3, 2)):
        wanted = np.exp(logits[branch, :size]) / np.exp(logits[branch, :size]).sum()
        shares = np.bincount(choices[:, branch], minlength=size) / lanes
        np.testing.assert_allclose(shares, wanted, atol=2 / lanes)
    samples = outputs.mean.detach().numpy() + np.exp(0.5 * actor.state()["log_variance"]) * feeds["normal"]
    np.testing.assert_allclose(axes[:, 0], np.clip(samples[:, 0], -3, 3) / 3, atol=1e-5)


def test_masks_hold_for_noise_at_both_ends(simulator, tmp_path):
    run = make_run(tmp_path / "run", simulator)
    with open_play(PlaySpec(run, simulator, seed=3)) as play:
        model = Model(build_model(documents(play)).SerializeToString(), play.spec.behaviors[0], 1)
        before = play.session.steps[0]
        for allowed in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1]):
            before.masks = [np.array([allowed], bool), np.array([[False, True]])]
            for uniform in (0.0, np.nextafter(np.float32(1), 0), 1.0):
                acts = model.act(before, np.zeros((1, 2), np.float32), np.full((1, 2), uniform, np.float32))
                assert masks_keep(acts.choices, before.masks)


def test_the_command_writes_the_same_bytes_again_and_names_what_is_in_the_file(
    simulator, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(exporting, "DECISIONS", 8)
    run = make_run(tmp_path / "run", simulator, layout="multiagent")
    files = [tmp_path / "new" / name for name in ("a.onnx", "b.onnx", "a.json")]
    for file in files:
        assert main(["export", str(run), str(file), "--simulator", simulator]) == 0
        assert f"{file}: " in capsys.readouterr().out
    assert files[0].read_bytes() == files[1].read_bytes()
    session = ort.InferenceSession(files[0])
    assert [(value.name, value.type, value.shape[1:]) for value in session.get_inputs()] == [
        ("sensor.place", "tensor(float)", [2]),
        ("sensor.count", "tensor(int32)", [1]),
        ("sensor.image", "tensor(uint8)", [2, 2]),
        ("sensor.lamps", "tensor(bool)", [3]),
        ("mask.gear", "tensor(bool)", [3]),
        ("mask.press", "tensor(bool)", [2]),
        ("state", "tensor(float)", [40]),
        ("normal", "tensor(float)", [2]),
        ("uniform", "tensor(float)", [2]),
    ]
    assert [value.name for value in session.get_outputs()] == ["axes", "choices", "next_state"]
    about = json.loads(session.get_modelmeta().custom_metadata_map["joybridge"])
    document = json.loads(files[2].read_bytes())
    assert about == {name: value for name, value in document.items() if name != "policies"}
    assert [axis["name"] for axis in about["axes"]] == ["x", "force"]


@pytest.mark.parametrize(
    ("settings", "more", "message"),
    [
        ({}, ["options.size=large"], "the trained network does not fit: the sensors had 30 numbers, now 48"),
        ({}, ["--behavior", "goalkeeper"], "hybrid has no behavior 'goalkeeper'; choose one with --behavior: player"),
        ({"game": "duel"}, [], "duel has several behaviors; choose one with --behavior: runner, judge"),
    ],
)
def test_what_cannot_be_exported_is_said_in_a_sentence(settings, more, message, simulator, tmp_path, capsys):
    run = make_run(tmp_path / "run", simulator, **settings)
    assert main(["export", str(run), str(tmp_path / "policy.onnx"), *more, "--simulator", simulator]) == 1
    assert f"error: {message}" in capsys.readouterr().err.replace("error: player: ", "error: ")
    assert not (tmp_path / "policy.onnx").exists()


def test_an_untrained_run_and_a_wrong_file_name_are_refused_before_a_simulator_is_waited_for(tmp_path, capsys):
    keep_config(Config(game="hybrid"), tmp_path)
    assert main(["export", str(tmp_path), "policy.onnx", "--simulator", "127.0.0.1:1"]) == 1
    assert "holds no checkpoint; train it first" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["export", str(tmp_path), "policy.pt"])
    assert "got 'policy.pt', expected a file whose name ends in .onnx or .json" in capsys.readouterr().err


def test_a_place_where_nothing_can_be_written_is_named(simulator, tmp_path, capsys):
    run = make_run(tmp_path / "run", simulator)
    assert main(["export", str(run), str(run / "config.yaml" / "policy.onnx"), "--simulator", simulator]) == 1
    assert f"error: cannot write {run / 'config.yaml'}" in capsys.readouterr().err


def test_a_checkpoint_of_another_game_is_refused(simulator, tmp_path, capsys):
    run = make_run(tmp_path / "run", simulator)
    keep_config(Config(game="ends", policy=SMALL), run)
    assert main(["export", str(run), str(tmp_path / "policy.onnx"), "--simulator", simulator]) == 1
    assert "error: player: the trained network does not fit" in capsys.readouterr().err


def test_without_onnx_the_extra_is_named(simulator, tmp_path, monkeypatch, capsys):
    run = make_run(tmp_path / "run", simulator)
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    for name in ("joybridge.play.export", "joybridge.policy.exported"):
        monkeypatch.delitem(sys.modules, name)
    assert cli.main(["export", str(run), str(tmp_path / "policy.onnx"), "--simulator", simulator]) == 2
    assert "needs the module onnxruntime; install it with `pip install 'joybridge[export]'`" in capsys.readouterr().err


def test_the_runtime_refuses_what_is_no_policy(runtime, tmp_path):
    (tmp_path / "policy.json").write_text('{"format": "joybridge.policy.v4"}')
    with pytest.raises(ValueError, match=r"is no 'joybridge\.policy\.v5'; write"):
        runtime.Policy(tmp_path / "policy.json")


def test_distributions_that_the_format_does_not_have_are_refused(simulator, tmp_path, capsys):
    run = make_run(tmp_path / "run", simulator, layout="beta, force=squashed")
    assert main(["export", str(run), str(tmp_path / "policy.onnx"), "--simulator", simulator]) == 1
    refusal = "error: player: axes are drawn from Beta, which cannot be exported; play its run with `joybridge.play."
    assert refusal in capsys.readouterr().err
    assert not (tmp_path / "policy.onnx").exists()
    assert main(["record", str(run), str(tmp_path / "a.gif"), "--seconds", "0.2", "--simulator", simulator]) == 0
    assert f"next: joybridge watch {run}\n" in capsys.readouterr().err  # no export, which would be refused


def test_a_policy_with_a_hand_is_exported_only_without_it(simulator, tmp_path, capsys):
    run = make_run(tmp_path / "run", simulator, hand={"hold": 2, "reach": 0.5})
    export = ["export", str(run), str(tmp_path / "policy.json"), "--simulator", simulator]
    assert main(export) == 1
    assert "hand.hold=2 hand.reach=0.5, and exported files have none" in capsys.readouterr().err
    assert main([*export, "hand.hold=1", "hand.reach=1"]) == 0
    assert "it plays 1,024 decisions as the trainer does" in capsys.readouterr().out


def test_a_layout_that_moves_an_axis_within_a_part_of_its_range_is_not_exported(simulator):
    spec = describe(simulator, "hybrid", {})
    actors = make_actors(Config(game="hybrid", layout="tests.support.own_layouts:narrow"), spec)
    with pytest.raises(ExportError, match=r"its layout moves 'x' within .* only, which no exported file can say"):
        make_document(actors, spec.behaviors[0], deterministic=True, about={})
