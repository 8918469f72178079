"""The runtimes of the examples in other languages than Python play an exported policy as the trainer does."""

import json
import shutil
import subprocess
from itertools import islice
from types import SimpleNamespace

import numpy as np
import pytest

from joybridge.config.policy_config import MemoryConfig
from joybridge.play.export import compare
from joybridge.play.playing import PlaySpec, open_play
from joybridge.policy.document import encode
from joybridge.policy.onnx_model import build_model
from joybridge.ppo.fast.kernels import Noise
from tests.support.cpp_player import build_player
from tests.support.exported_runs import (
    EXAMPLES,
    IMAGES,
    MEMORIES,
    PLAY_ALL,
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

CPP = ("policy", "network", "recurrent", "convolutions", "json")


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
    behavior, kind, simulator, players, tmp_path
):
    policy = SMALL.model_copy(update={"memory": MemoryConfig(kind=kind, size=6)})
    run = make_run(tmp_path / "run", simulator, game="duel", policy=policy)
    decisions, wanted = play_elsewhere(run, simulator, players, 60, index=behavior)
    assert len(wanted) < len(decisions) if behavior else len(wanted) == len(decisions)  # the judge begins with waiting
    policy = load_runtime(RUNTIME).Policy(run / "policy.json")
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
            waits, ends = before.deciding is not None and not before.deciding[0], after.ends
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


def _vast(document):
    """The product of the sides is 1,200 in 64 bits, as many as the image has."""
    (image,) = (each for each in document["policies"][0]["images"] if each["shape"] == [20, 20, 3])
    image["shape"] = [4213528, 2588957, 3382042]


def _growing(document):
    """A picture of 20 x 20 pixels becomes 400 of 220 x 220."""
    image = document["policies"][0]["images"][0]
    step = image["steps"][0] | {"size": [1, 1], "stride": 1, "padding": 100}
    channels = step["weight"].shape[1]
    step |= {"weight": np.ones((400, channels, 1, 1), np.float32), "bias": np.ones(400, np.float32)}
    image["steps"][0] = step


def _unbounded(document):
    network = document["policies"][0]
    network["deviations"] = np.full_like(network["deviations"], np.nan)


def _crossed(document):
    document["axes"][0] |= {"low": 1.0, "high": -1.0}


@pytest.mark.parametrize("damage", [_vast, _growing, _unbounded, _crossed])
def test_the_runtimes_refuse_what_would_take_memory_or_give_no_number(damage, simulator, players, tmp_path):
    settings = seeing(*IMAGES[0]) | {"layout": "hybrid"}
    run = make_run(tmp_path / "run", simulator, **settings)
    play_elsewhere(run, simulator, players, 1)
    with open_play(PlaySpec(run, simulator, seed=3)) as play:
        document = documents(play, 0)
    damage(document)
    (run / "policy.json").write_bytes(encode(document))
    files = [str(run / "policy.json"), str(run / "decisions.json")]
    for language, command in players.items():
        result = subprocess.run([*command, *files], capture_output=True, text=True, check=False, timeout=60)
        assert result.returncode == 1 and result.stderr and not result.stdout, language
        assert "Sanitizer" not in result.stderr and "runtime error" not in result.stderr, result.stderr
    (decision,) = json.loads((run / "decisions.json").read_text())
    sensors = {name: np.array([values]) for name, values in decision["sensors"].items()}
    with pytest.raises(ValueError, match=r"damaged|reshape"):
        _act(run / "policy.json", sensors)


def _act(file, sensors):
    policy = load_runtime(RUNTIME).Policy(file)
    policy.act(sensors, policy.begin(1), np.random.default_rng(0))


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
