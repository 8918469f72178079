"""A run plays in a program of one's own as it plays at a simulator, which this program does not need."""

import re
import subprocess
import sys
from itertools import islice

import numpy as np
import pytest

from joybridge.config.config import Config, HandConfig
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import MemoryConfig, PolicyConfig
from joybridge.contract.tensors import TensorError
from joybridge.play.agent import load
from joybridge.play.playing import PlaySpec, open_play
from joybridge.run.folder import SPEC
from joybridge.run.train import train
from joybridge.run.training import Audience

SMALL = PolicyConfig(frame_stack=3, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32)
REMEMBERING = SMALL.model_copy(update={"memory": MemoryConfig(kind="lstm", size=6)})
SEEN = {"place": [0.5, -1.0], "count": [3], "image": np.zeros((2, 2)), "lamps": [True, False, False]}


@pytest.fixture(scope="module")
def trained(simulator, tmp_path_factory):
    """Return a function that trains a run for a moment, once for the same settings."""
    runs = {}

    def short(**settings):
        key = repr(settings)
        if key not in runs:
            runs[key] = tmp_path_factory.mktemp("agent") / "run"
            config = Config(**({"arenas": 2, "total_timesteps": 64, "log_interval": 64, "policy": SMALL} | settings))
            train(config, runs[key], [simulator], resume=False, audience=Audience(say=lambda text: None))
        return runs[key]

    return short


@pytest.mark.parametrize(
    "settings",
    [
        {"game": "hybrid"},
        {"game": "hybrid", "layout": "multiagent", "hand": HandConfig(delay=2, change=0.2, noise=0.1)},
        {"game": "duel", "layout": "bucket-5"},
        {"game": "hybrid", "policy": REMEMBERING},
    ],
    ids=["one policy", "two policies and a hand", "two behaviors", "memory"],
)
def test_an_agent_does_what_the_run_does_at_a_simulator(settings, trained, simulator):
    run = trained(**settings)
    with open_play(PlaySpec(run, simulator, seed=1, deterministic=settings["game"] == "duel")) as play:
        for index, behavior in enumerate(play.spec.behaviors):
            agent = load(run, behavior.name, deterministic=settings["game"] == "duel")
            sensors, branches = ([one.name for one in part] for part in (behavior.sensors, behavior.device.branches))
            episodes = 0
            for decision in islice(play.decisions(), 40 * (index + 1)):
                before, act, after = decision.before[index], decision.acts[index], decision.after[index]
                if before.deciding is None or before.deciding[0]:
                    seen = {name: values[0] for name, values in zip(sensors, before.observations, strict=True)}
                    masks = dict(zip(branches, (mask[0] for mask in before.masks or ()), strict=False))
                    action = agent.act(seen, masks)
                    assert list(action.values()) == [*act.axes[0].tolist(), *act.choices[0].tolist()]
                    assert {type(value) for value in action.values()} <= {float, int}
                if after.terminated[0] or after.truncated[0]:
                    agent.begin()
                    episodes += 1
            assert episodes > 2
            if len(play.spec.behaviors) > 1:
                return  # the other one would have to begin with this session


@pytest.mark.parametrize("policy", [SMALL, REMEMBERING], ids=["frames", "memory"])
def test_a_session_that_has_begun_before_leaves_no_trace(policy, trained):
    agent = load(trained(game="hybrid", policy=policy), deterministic=True)
    first = agent.act(SEEN)
    assert agent.act({**SEEN, "place": [3.0, 3.0]}) != first
    agent.begin()
    assert agent.act(SEEN) == first


def test_samples_depend_on_the_seed_alone(trained):
    run = trained(game="hybrid")
    drawn = [[agent.act(SEEN) for _ in range(5)] for agent in (load(run), load(run), load(run, seed=2))]
    assert drawn[0] == drawn[1] != drawn[2]


def test_an_agent_needs_no_simulator_and_loads_none(trained):
    program = f"""
import sys
from joybridge.play.agent import load
agent = load({str(trained(game="hybrid"))!r})
print(agent.act({{"place": [0, 0], "count": [1], "image": [[0, 0]] * 2, "lamps": [1, 0, 0]}}))
print(any(name.startswith(("joybridge.simulator", "joybridge.games", "pygame")) for name in sys.modules))
"""
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert re.match(r"\{'x': -?\d.*, 'force': .*, 'gear': \d, 'press': \d\}\nFalse\n$", printed)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"place": [1.0]}, "observation: sensor 'place' has shape [1], expected [2]"),
        ({"place": [1.0, np.nan]}, "observation: sensor 'place' is [1.0, nan], expected finite numbers"),
        ({"place": [1.0, 1e300]}, "observation: sensor 'place' is [1.0, inf], expected finite numbers"),
        ({"place": ["a", 1.0]}, "observation: sensor 'place' is no float32: could not convert"),
        (
            {"image": np.full((2, 2), 300).tolist()},
            "observation: sensor 'image' has 300 of int64, expected values of uint8",
        ),
        ({"image": np.full((2, 2), 0.5)}, "observation: sensor 'image' has 0.5 of float64, expected values of uint8"),
        ({"image": np.full((2, 2), -1)}, "observation: sensor 'image' has -1 of int64, expected values of uint8"),
        ({"smell": [1.0]}, "expected place, count, image, lamps"),
    ],
)
def test_an_observation_that_the_game_does_not_have_is_named(change, message, trained):
    agent = load(trained(game="hybrid"))
    with pytest.raises(TensorError, match=re.escape(message)):
        agent.act(SEEN | change)


def test_the_value_of_an_only_sensor_needs_no_name(trained):
    run = trained(game="brittle")
    name = load(run).behavior.sensors[0].name
    agents = [load(run, deterministic=True) for _ in range(2)]
    assert agents[0].act(np.ones(2, np.float32)) == agents[1].act({name: [1.0, 1.0]})
    with pytest.raises(TensorError, match="a value of type list, expected a dict with the values of place, count, im"):
        load(trained(game="hybrid")).act([0.5, -1.0])


def test_a_sensor_that_no_policy_sees_may_be_left_out(trained):
    agent = load(trained(game="hybrid", policy=SMALL.model_copy(update={"sensors": ["place", "lamps"]})))
    seen = {name: SEEN[name] for name in ("place", "lamps")}
    with pytest.raises(TensorError, match="got the sensors place, expected place, lamps"):
        agent.act({"place": SEEN["place"]})
    assert agent.act(seen) and agent.act(SEEN)


@pytest.mark.parametrize(
    ("masks", "message"),
    [
        ({"gear": [True, False]}, "masks: 'gear' has shape [2], expected [3]"),
        ({"gear": [False] * 3}, "masks: 'gear' allows none of its 3 choices, expected at least one"),
        ({"clutch": [True]}, "masks: there is no branch 'clutch', expected gear, press"),
    ],
)
def test_a_mask_that_the_game_does_not_have_is_named(masks, message, trained):
    agent = load(trained(game="hybrid"))
    with pytest.raises(TensorError, match=re.escape(message)):
        agent.act(SEEN, masks)


def test_a_mask_is_obeyed(trained):
    agent = load(trained(game="hybrid"))
    assert {agent.act(SEEN, {"gear": [False, True, False]})["gear"] for _ in range(20)} == {1}


def test_a_folder_that_does_not_exist_is_said_not_to(tmp_path):
    with pytest.raises(ConfigError, match="nothing is not the folder of a run: there is no such folder"):
        load(tmp_path / "nothing")


def test_what_cannot_be_loaded_is_named(trained, tmp_path):
    with pytest.raises(ConfigError, match=r"duel has several behaviors; choose one with load\(run, behavior\): runner"):
        load(trained(game="duel", layout="bucket-5"))
    with pytest.raises(ConfigError, match="duel has no behavior 'jury'"):
        load(trained(game="duel", layout="bucket-5"), "jury")
    with pytest.raises(ConfigError, match=r"has no spec.json, .* continue the run with `joybridge train"):
        load(tmp_path)
    for text in ("{", '{"name": 7}', "{}", "[" * 10_000, '{"unknown": 1}'):
        (tmp_path / SPEC).write_text(text)
        with pytest.raises(ConfigError, match=r"spec.json cannot be read: .* writes it again"):
            load(tmp_path)
