"""An exported policy plays as the trainer does: as an ONNX model, and as JSON in the runtimes of the examples."""

import importlib.util
import json
import math
import shutil
import subprocess
import sys
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import onnxruntime as ort
import pytest
import torch

from joybridge import cli
from joybridge.cli import main
from joybridge.client.client import describe
from joybridge.config.config import Config
from joybridge.config.policy_config import MemoryConfig, PolicyConfig
from joybridge.play import export as exporting
from joybridge.play.export import compare
from joybridge.play.playing import PlaySpec, open_play
from joybridge.policy.actor import SCALING, make_actors
from joybridge.policy.document import decode, encode, make_document
from joybridge.policy.exported import Model
from joybridge.policy.onnx_model import build_model
from joybridge.ppo.fast.kernels import Noise
from joybridge.ppo.observation_tensors import Observations
from joybridge.run.checkpoint import Manifest, save_checkpoint
from joybridge.run.folder import keep_config
from tests.support.cpp_player import build_player

pytestmark = pytest.mark.usefixtures("signals")

EXAMPLES = Path(__file__).parents[1] / "proto" / "examples"
CPP = ("policy", "network", "recurrent", "convolutions", "json")
RUNTIME = EXAMPLES / "python" / "policy.py"
IMAGES = [  # encoder, pixels, frames, activation, one convolution for actor and critic
    ("windows", "20", 2, "relu", True),
    ("simple", "9", 3, "swish", False),
    ("nature", "36", 1, "elu", True),
    ("impala", "9", 2, "tanh", False),
    ("auto", "20", 1, "swish", False),
]
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
SMALL = PolicyConfig(frame_stack=3, hidden_sizes=[8, 8])
POINTERS = [  # images, layout
    (IMAGES[0], "map-5x4"),
    (IMAGES[1], "map-4x4, gear=threshold-0.0"),
    (IMAGES[2], "map-3x2, gear=ordinal-3"),
    (IMAGES[3], "map-4x3"),
]
MEMORIES = [  # kind, body of actor and critic, layout, what they see
    ("gru", True, "bucket-3", "numbers"),
    ("lstm", False, "hybrid", "numbers"),
    ("lstm", True, "multiagent", "numbers"),
    ("gru", False, "threshold-0.5", "images"),
    ("lstm", False, "joint-3", "images"),
]


def make_run(folder: Path, simulator: str, **settings) -> Path:
    """Return a run whose networks have large random weights: its actions depend on all that they observe."""
    config = Config(**({"game": "hybrid", "policy": SMALL} | settings))
    rng, arrays = np.random.default_rng(8), {}
    for actor in make_actors(config, describe(simulator, config.game, config.options)):
        for name, array in actor.state().items():
            inputs = math.prod(array.shape[1:])  # with many, smaller weights, so that axes are not all at their bounds
            width = min(0.7, (1.0 if actor.network.encoders else 4.0) / math.sqrt(inputs))
            if actor.network.pointers:  # so that the likeliest cell is not always the same
                width /= 3
            drawn = rng.normal(0.0, width, array.shape).astype(np.float32)
            if name.startswith(SCALING):
                drawn = rng.uniform(0.5, 2.0, array.shape).astype(np.float32)
            arrays[f"{actor.name}/policy/network.{name}"] = drawn
    keep_config(config, folder)
    save_checkpoint(folder, arrays, Manifest(timesteps=64))
    return folder


@pytest.fixture(scope="module")
def runtime():
    """Return the module in NumPy that the examples contain."""
    return load_runtime(RUNTIME)


def load_runtime(path):
    """Return the module in a file."""
    spec = importlib.util.spec_from_file_location("policy", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Given:
    """Random numbers that somebody else has drawn, in place of a generator."""

    def __init__(self, players):
        noise = [player.noise for player in players]
        self._normal, self._uniform = iter([n.normal for n in noise]), iter([n.uniform for n in noise])

    def standard_normal(self, shape, dtype):
        return next(self._normal)

    def random(self, shape, dtype):
        return next(self._uniform)


def documents(play, index=0, deterministic=False):
    actors = [player.actor for player in play.players if player.actor.behavior == index]
    return decode(encode(make_document(actors, play.spec.behaviors[index], deterministic=deterministic, about={})))


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


def seeing(encoder, pixels, frames, activation, shared):
    """Return the settings of a run in the gallery."""
    policy = PolicyConfig(
        image_encoder=encoder,
        frame_stack=frames,
        activation=activation,
        shared_encoder=shared,
        hidden_sizes=[8],
        scale_observations="running",
    )
    return {"game": "gallery", "options": {"pixels": pixels}, "policy": policy}


@pytest.mark.parametrize("images", IMAGES, ids=[one[0] for one in IMAGES])
def test_each_encoder_of_images_plays_as_the_trainer_does(images, simulator, runtime, tmp_path):
    run = make_run(tmp_path / "run", simulator, **seeing(*images))
    document = play_beside(run, simulator, runtime)
    assert [image["sensor"] for image in document["policies"][0]["images"]] == ["map", "view"]


def pointing(images, layout):
    """Return the settings of a run whose policies point into the images of the gallery."""
    return seeing(*images) | {"layout": layout}


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


def remembering(kind, shared, layout, seen):
    """Return the settings of a run whose policies have a memory."""
    settings = seeing("simple", "9", 2, "relu", True) if seen == "images" else {"policy": SMALL}
    memory = {"memory": MemoryConfig(kind=kind, size=6), "shared_body": shared}
    return settings | {"layout": layout, "policy": settings["policy"].model_copy(update=memory)}


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
            state[decision.after[0].terminated | decision.after[0].truncated] = 0
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


PLAY_ALL = """
import { readFileSync } from "node:fs";
import { Policy } from "POLICY";
const [policyFile, decisionsFile] = process.argv.slice(1);
const policy = new Policy(JSON.parse(readFileSync(policyFile, "utf8")));
let state = policy.begin();
for (const { sensors, masks, normal, uniform, waits, ends } of JSON.parse(readFileSync(decisionsFile, "utf8"))) {
  if (waits) {
    state = policy.watch(sensors, state);
    continue;
  }
  const action = policy.act(sensors, state, masks, { normal: () => normal.shift(), uniform: () => uniform.shift() });
  state = ends ? policy.begin() : action.state;
  console.log([...action.axes, ...action.choices].join(" "));
}
"""


@pytest.mark.parametrize(
    "path", ["python/policy.py", "javascript/policy.mjs", *(f"cpp/src/{name}.hpp" for name in CPP)]
)
def test_a_file_of_a_runtime_has_less_than_300_lines(path):
    assert len((EXAMPLES / path).read_text().splitlines()) < 300


@pytest.fixture(scope="module")
def players(tmp_path_factory):
    """Return the commands that play with a runtime, by its language, for all that are installed."""
    commands = {}
    if shutil.which("node"):
        program = PLAY_ALL.replace("POLICY", (EXAMPLES / "javascript" / "policy.mjs").as_uri())
        commands["javascript"] = ["node", "--input-type=module", "-e", program]
    if shutil.which("c++"):
        commands["c++"] = [build_player(tmp_path_factory.mktemp("cpp"))]
    return commands


@pytest.mark.parametrize(
    ("layout", "deterministic", "changed"),
    [
        ("threshold-0.5", True, {}),
        ("multiagent", False, {"activation": "tanh", "scale_observations": "running"}),
        ("joint-3", False, {"activation": "relu"}),
        ("bucket-3", False, {"activation": "elu"}),
        ("squashed", False, {"scale_observations": "bounds"}),
    ],
)
def test_the_runtimes_in_other_languages_play_as_the_trainer_does(
    layout, deterministic, changed, simulator, players, tmp_path
):
    policy = SMALL.model_copy(update=changed)
    run = make_run(tmp_path / "run", simulator, layout=layout, policy=policy)
    play_elsewhere(run, simulator, players, 100, deterministic=deterministic)


@pytest.mark.parametrize("images", IMAGES, ids=[one[0] for one in IMAGES])
def test_the_runtimes_in_other_languages_see_images_as_the_trainer_does(images, simulator, players, tmp_path):
    run = make_run(tmp_path / "run", simulator, **seeing(*images))
    play_elsewhere(run, simulator, players, 30)


@pytest.mark.parametrize("pointer", POINTERS, ids=[f"{one[0][0]} {one[1]}" for one in POINTERS])
def test_the_runtimes_in_other_languages_point_as_the_trainer_does(pointer, simulator, players, tmp_path):
    run = make_run(tmp_path / "run", simulator, **pointing(*pointer))
    play_elsewhere(run, simulator, players, 40)


@pytest.mark.parametrize("memory", MEMORIES, ids=[" ".join([one[0], *one[2:]]) for one in MEMORIES])
def test_the_runtimes_in_other_languages_remember_as_the_trainer_does(memory, simulator, players, tmp_path):
    run = make_run(tmp_path / "run", simulator, **remembering(*memory))
    play_elsewhere(run, simulator, players, 60)


@pytest.mark.parametrize("kind", ["gru", "lstm"])
@pytest.mark.parametrize("behavior", [0, 1])
def test_the_runtimes_remember_nothing_of_observations_with_which_they_wait(
    behavior, kind, simulator, players, runtime, tmp_path
):
    policy = SMALL.model_copy(update={"memory": MemoryConfig(kind=kind, size=6)})
    run = make_run(tmp_path / "run", simulator, game="duel", policy=policy)
    decisions, wanted = play_elsewhere(run, simulator, players, 60, index=behavior)
    assert len(wanted) < len(decisions) if behavior else len(wanted) == len(decisions)  # the judge begins with waiting
    policy = runtime.Policy(run / "policy.json")
    state, given = policy.begin(1), iter(wanted)
    for decision in decisions:
        sensors = {name: np.array([values]) for name, values in decision["sensors"].items()}
        if decision["waits"]:
            state = policy.watch(sensors, state)
            continue
        noise = Noise(np.array([decision["normal"]], np.float32), np.array([decision["uniform"]], np.float32))
        axes, choices, state = policy.act(sensors, state, Given([SimpleNamespace(noise=noise)]))
        np.testing.assert_allclose([*axes[0], *choices[0]], next(given), rtol=0, atol=1e-5)
        state[:] *= not decision["ends"]
    with open_play(PlaySpec(run, simulator, seed=3), episodes=8) as play:
        found = compare(build_model(documents(play, behavior)).SerializeToString(), play, behavior)
    assert (found.different, found.forbidden) == (0, 0) and found.largest < 1e-5


def play_elsewhere(run, simulator, players, count, *, index=0, deterministic=False):
    """Let the runtimes in other languages make the decisions of the trainer, all alike; return both, of one agent."""
    if not players:
        pytest.skip("install Node.js or a C++ compiler to play a policy there")
    decisions, wanted = [], []
    with open_play(PlaySpec(run, simulator, seed=3, deterministic=deterministic)) as play:
        (run / "policy.json").write_bytes(encode(documents(play, index, deterministic=deterministic)))
        behavior = play.spec.behaviors[index]
        acting, first = [player for player in play.players if player.actor.behavior == index], True
        for decision in islice(play.decisions(), count):
            before, after, act = decision.before[index], decision.after[index], decision.acts[index]
            names = [sensor.name for sensor in behavior.sensors]
            branches = [branch.name for branch in behavior.device.branches]
            observed = zip(names, before.observations, strict=True)
            waits, ends = before.deciding is not None and not before.deciding[0], after.terminated | after.truncated
            if first or not waits:
                decisions.append(
                    {
                        "sensors": {name: array[0].astype(float).ravel().tolist() for name, array in observed},
                        "masks": {
                            n: m[0].astype(int).tolist() for n, m in zip(branches, before.masks or (), strict=False)
                        },
                        "normal": [float(x) for player in acting for x in player.noise.normal[0]],
                        "uniform": [float(x) for player in acting for x in player.noise.uniform[0]],
                        "waits": int(waits),
                        "ends": int(ends[0]),
                    }
                )
            if not waits:
                wanted.append([*act.axes[0], *act.choices[0]])
            elif ends[0]:
                decisions[-1]["ends"] = 1  # it ended while it waited
            first = bool(ends[0])
    (run / "decisions.json").write_text(json.dumps(decisions))
    for language, command in players.items():
        files = [str(run / "policy.json"), str(run / "decisions.json")]
        result = subprocess.run([*command, *files], capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stderr
        played = [[float(number) for number in line.split()] for line in result.stdout.splitlines()]
        np.testing.assert_allclose(played, wanted, rtol=0, atol=1e-5, err_msg=language)
    return decisions, wanted


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ('{"format": "joybridge.policy.v4"}', "write it with `joybridge export RUN policy.json`"),
        ('{"format": "joybridge.policy.v5", "policies": [{"layers": [', ""),
        ('{"format": ]', ""),
    ],
)
def test_the_runtimes_in_other_languages_refuse_what_is_no_policy(file, message, players, tmp_path):
    (tmp_path / "policy.json").write_text(file)
    (tmp_path / "decisions.json").write_text("[]")
    for command in players.values():
        files = [str(tmp_path / "policy.json"), str(tmp_path / "decisions.json")]
        result = subprocess.run([*command, *files], capture_output=True, text=True, check=False)
        assert result.returncode == 1 and result.stderr and message in result.stderr


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
