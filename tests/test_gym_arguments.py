"""Names, arguments, simulators and errors of environments."""

import gc
import inspect
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.spaces import Box

import joybridge.gym
from joybridge.client.client import SimulatorError, SimulatorLost, describe
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.games import BUILT_IN
from joybridge.gym import BridgeEnv, BridgeParallelEnv, BridgeVectorEnv
from joybridge.gym.registration import GAMES, environment_id
from tests.support.gym_games import Brief, Chase

IDS = {environment_id(game): game for game in BUILT_IN}


# ---------------------------------------------------------------------------------------------- names


def test_the_built_in_games_are_registered():
    """In a fresh interpreter, without torch, each environment with a simulator of its own."""
    script = """
import os
import sys
from pathlib import Path
from typing import Any
import gymnasium
one = gymnasium.make("joybridge.gym:joybridge/ShootingBirds-v0")
many = gymnasium.make_vec("joybridge/BeastlyRivals-v0", num_envs=4, layout="hybrid")
assert many.num_envs == 4 and many.unwrapped.game_spec.name == "beastly_rivals"
assert one.unwrapped.game_spec.name == "shooting_birds"
for env in (one, many):
    env.reset(seed=1)
    env.step(env.action_space.sample())
assert not {"torch", "pydantic", "joybridge.simulator"} & set(sys.modules)
print(Path(f"/proc/self/task/{os.getpid()}/children").read_text())
"""  # which ends without closing them
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stderr) == (0, "")
    simulators = done.stdout.split()
    assert len(simulators) == 2 and not any(Path(f"/proc/{simulator}").exists() for simulator in simulators)


def test_every_built_in_game_is_registered(gym_simulator):
    assert sorted(GAMES) == sorted(BUILT_IN)
    for name, game in IDS.items():
        agents = sum(behavior.agents_per_arena for behavior in describe(gym_simulator, game, {}).behaviors)
        if agents == 1:
            env = gymnasium.make(name, simulator=gym_simulator)
            envs = gymnasium.make_vec(name, num_envs=3, simulator=gym_simulator)
            assert envs.num_envs == 3 and envs.spec.id == env.spec.id == name
            env.close()
            envs.close()
        else:
            with pytest.raises(ValueError, match=rf"{game} .* has {agents} agents .*BridgeParallelEnv"):
                gymnasium.make(name, simulator=gym_simulator)


def test_what_is_public_is_documented():
    public = {name for name, value in vars(joybridge.gym).items() if name[0] != "_" and not inspect.ismodule(value)}
    assert set(joybridge.gym.__all__) == public
    for name in joybridge.gym.__all__:
        assert name in joybridge.gym.__doc__ and getattr(joybridge.gym, name).__doc__


# ---------------------------------------------------------------------------------------------- arguments


@pytest.mark.parametrize("kind", [BridgeEnv, BridgeParallelEnv, BridgeVectorEnv])
def test_defaults_are_those_of_a_training_configuration(kind):
    fields = Config.model_fields | PolicyConfig.model_fields
    defaults = {name: p.default for name, p in inspect.signature(kind).parameters.items() if name in fields}
    assert {"layout", "frame_stack", "seed", "options", "parameters", "sensors", "reward_weights"} <= set(defaults)
    for name, default in defaults.items():
        if name not in ("game", "games"):  # here, games are served beside those of the server
            assert default == (fields[name].default or None if default is None else fields[name].default), name


@pytest.mark.parametrize("kind", [BridgeEnv, BridgeParallelEnv, BridgeVectorEnv])
def test_a_misspelled_argument_is_pythons_type_error(kind):
    with pytest.raises(TypeError, match=rf"{kind.__name__}\.__init__\(\) got an unexpected keyword argument 'layuot'"):
        kind("shooting_birds", layuot="hybrid")


def test_the_environments_have_the_same_arguments():
    one, several, many = (
        list(inspect.signature(kind).parameters) for kind in (BridgeEnv, BridgeParallelEnv, BridgeVectorEnv)
    )
    assert one == several == [name for name in many if name != "arenas"]


def test_only_the_chosen_sensors_are_observed(make):
    envs, chosen = (make(BridgeVectorEnv, "brief", 2, frame_stack=2, sensors=s) for s in (None, ["noise"]))
    assert chosen.single_observation_space == Box(-1.0, np.inf, (4,))
    assert np.array_equal(chosen.reset(seed=1)[0], envs.reset(seed=1)[0][:, [1, 2, 4, 5]])
    env = make(BridgeParallelEnv, "brief", layout="multiagent", frame_stack=1, sensors={"axes": ["clock"]})
    assert {name: len(observation) for name, observation in env.reset()[0].items()} == {"axes": 1, "buttons": 3}


# ------------------------------------------------------------------------------------------ own games


@pytest.mark.parametrize("game", [Brief, "tests.support.gym_games:Brief"])
def test_an_own_game_is_played_in_one_line(game):
    env = BridgeEnv(game)
    assert env.game_spec.name == "brief" and env.reset()[0] in env.observation_space
    env.close()


def test_an_environment_of_gymnasium_gets_the_layouts_and_parameters_of_a_game():
    envs = BridgeVectorEnv(
        "gym:tests.support.environments:Windy-v0", arenas=2, layout="hybrid", frame_stack=1, parameters={"wind": 1.5}
    )
    assert (envs.game_spec.name, envs.reset(seed=0)[0].tolist()) == ("Windy-v0", [[1.5], [1.5]])
    envs.close()


@pytest.mark.parametrize("games", [Chase, "tests.support.gym_games:Chase", [Chase, "tests.support.gym_games:Turns"]])
def test_further_games_are_offered_by_name(games):
    env = BridgeParallelEnv("chase", games=games)
    assert env.possible_agents == ["hunter", "runner_0", "runner_1"]
    env.close()


def test_a_game_is_imported_from_where_this_process_imports(tmp_path, monkeypatch):
    source = (Path(__file__).parent / "support/gym_games.py").read_text()
    (tmp_path / "elsewhere_games.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    env = BridgeEnv("elsewhere_games:Brief")
    assert env.game_spec.name == "brief"
    env.close()


class NotAGame:
    """Has no name."""


class Outer:
    """Holds a game that has no place of its own."""

    class Inner(Brief):
        """A class within a class."""


@pytest.mark.parametrize(
    ("game", "text"),
    [
        (Outer.Inner, r"cannot import the game class .*test_gym_arguments\.Outer\.Inner: move it to the top level"),
        (type("Made", (Brief,), {"__module__": "__main__"}), r"cannot import the game class __main__\.Made: move it"),
        (NotAGame, "NotAGame.* is not a subclass of joybridge.simulator.Game or BatchedGame"),
        ("tests.support.gym_games:Breif", "'tests.support.gym_games:Breif' cannot be imported .*has no attribute"),
        ("nowhere:Brief", "'nowhere:Brief' cannot be imported .*expected a game's name or MODULE:CLASS"),
        (Brief(), "game is <.*Brief object .*, expected a name, a game class or 'MODULE:CLASS'"),
    ],
)
def test_a_class_that_the_simulator_cannot_import_is_an_error(game, text):
    with pytest.raises(ConfigError, match=text):
        BridgeEnv(game)


def test_a_running_simulator_gets_no_further_games(gym_simulator):
    with pytest.raises(ConfigError, match=r"start that with `joybridge serve --game tests\.support\.gym_games:Brief`"):
        BridgeEnv(Brief, simulator=gym_simulator)


def test_the_reason_of_a_failed_start_is_raised():
    with pytest.raises(SimulatorLost, match=r"did not start: game 'nowhere:Game' cannot be imported \(No module"):
        BridgeEnv("game", games="nowhere:Game")


def test_without_the_extra_a_sentence_says_how_to_install_it(tmp_path, monkeypatch):
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['numba'] = None")  # it cannot be found
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SimulatorLost, match=r"needs the module numba; install it with `pip install 'joybridge\[sim"):
        BridgeEnv(Brief)


# ------------------------------------------------------------------------------------ simulators and errors


def simulators(monkeypatch):
    """Return the list of simulator processes that are started from now on."""
    started = []

    start = subprocess.Popen

    def recorded(*arguments, **settings):
        started.append(start(*arguments, **settings))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", recorded)
    return started


def test_closing_or_collecting_an_environment_ends_its_simulator(monkeypatch):
    started = simulators(monkeypatch)
    envs = BridgeVectorEnv("shooting_birds", 2)
    assert started[0].poll() is None
    envs.close()
    envs.close()
    assert started[0].returncode == 0 and envs.closed
    with pytest.raises(ClosedEnvironmentError):
        envs.reset()
    env = BridgeEnv("shooting_birds")
    assert started[1].poll() is None
    del env
    gc.collect()
    assert started[1].returncode == 0


def test_a_failed_start_leaves_no_simulator(monkeypatch):
    started = simulators(monkeypatch)
    with pytest.raises(ValueError, match="unknown layout 'buckets'") as kept:
        BridgeVectorEnv("shooting_birds", layout="buckets")
    assert started[0].returncode is not None and kept


@pytest.mark.parametrize(
    ("kind", "game", "settings", "text"),
    [
        (BridgeVectorEnv, "chase", {}, r"has 2 agents \(hunter, runner\).*use joybridge.gym.BridgePar"),
        (BridgeVectorEnv, "brief", {"layout": "multiagent"}, r"has 2 agents \(axes, buttons\)"),
        (BridgeEnv, "turns", {}, r"has 2 agents \(player_0, player_1\).*use joybridge.gym.BridgePar"),
        (BridgeEnv, "brief", {"layout": "hybrids"}, "unknown layout 'hybrids', expected hybrid,"),
        (BridgeEnv, "brief", {"frame_stack": 0}, "frame_stack is 0, expected an integer of at least 1"),
        (BridgeEnv, "brief", {"frame_stack": 1.5}, "frame_stack is 1.5, expected an integer"),
        (BridgeEnv, "brief", {"layout": 3}, "layout is 3, expected the name of one"),
        (BridgeEnv, "brief", {"options": {"size": 6}}, "options.size is 6, expected one of its choices, in quotes"),
        (BridgeEnv, "brief", {"reward_weights": {"press": "x"}}, "'press'] is 'x', expected a finite number"),
        (BridgeEnv, "brief", {"reward_weights": {"press": float("nan")}}, "'press'] is nan, expected a finite number"),
        (BridgeEnv, "brief", {"others": "x"}, "others is 'x', expected a list of names"),
        (BridgeEnv, "brief", {"sensors": "x"}, "sensors is 'x', expected a list of names"),
        (BridgeEnv, "brief", {"forbidden": "ignore"}, "forbidden is 'ignore', expected one of error, first_allowed"),
        (BridgeEnv, "brief", {"seed": [1]}, r"seed is \[1\], expected one int"),
        (BridgeVectorEnv, "brief", {"arenas": 0}, "arenas is 0, expected an integer of at least 1"),
        (BridgeEnv, "brief", {"render_mode": "human"}, "render_mode is 'human', expected None or 'rgb_array'"),
        (BridgeEnv, "brief", {"reward_weights": {"pres": 1}}, "reward_weights: the game has no 'pres'; it has lever"),
        (BridgeEnv, "brief", {"sensors": ["clok"]}, "player: sensors: the game has no 'clok'; it has clock, noise"),
        (BridgeEnv, "brief", {"sensors": []}, "player: sensors is empty, expected at least one"),
        (BridgeParallelEnv, "chase", {"sensors": {"runner": []}}, "no agent 'runner'; there are hunter"),
        (BridgeVectorEnv, "turns", {"render_mode": "rgb_array"}, "turns cannot be drawn"),
        (BridgeVectorEnv, "brief", {"arenas": 65, "render_mode": "rgb_array"}, "65 arenas, at most 64 can be drawn"),
        (BridgeParallelEnv, "chase", {"reward_weights": {"runner": {}}}, "no agent 'runner'; there are hunter"),
    ],
)
def test_wrong_arguments_are_named(make, kind, game, settings, text):
    with pytest.raises(ValueError, match=text):
        make(kind, game, **settings)


def test_a_refusal_of_the_simulator_is_raised(make):
    with pytest.raises(SimulatorError, match="no game named 'chess'"):
        make(BridgeVectorEnv, "chess")
    with pytest.raises(SimulatorError, match=r"brief: arenas is 1025, expected 1\.\.1024"):
        make(BridgeVectorEnv, "brief", 1025)
    with pytest.raises(SimulatorLost, match=r"lost the simulator at 127\.0\.0\.1:1"):
        BridgeVectorEnv("brief", simulator="127.0.0.1:1")


@pytest.mark.parametrize(
    ("layout", "actions", "text"),
    [
        ("bucket-11", np.zeros((2, 2), int), r"actions: int64 of shape \[2, 2\], expected integers of \[2, 3\]"),
        ("bucket-11", np.zeros((2, 3)), "actions: float64 of shape"),
        ("bucket-11", [[0, 0, 0], [0, 0, 2]], r"actions: 2 at \[1, 2\], expected 0..1"),
        ("bucket-11", [[-1, 0, 0], [0, 0, 0]], r"actions: -1 at \[0, 0\], expected 0..10"),
        ("threshold-0.5", np.full((2, 3), np.nan), r"actions: nan at \[0, 0\], expected a finite number"),
        ("hybrid", np.zeros((2, 3)), r"actions\['continuous'\] is missing"),
        ("hybrid", {"continuous": np.zeros((2, 1)), "discrete": [0, 0]}, r"actions\['discrete'\]: int64 of"),
    ],
)
def test_wrong_actions_are_named_and_the_environment_goes_on(make, layout, actions, text):
    envs = make(BridgeVectorEnv, "brief", 2, layout=layout)
    with pytest.raises(ResetNeeded):
        envs.step(envs.action_space.sample())
    envs.reset()
    with pytest.raises(ValueError, match=text):
        envs.step(actions)
    envs.step(envs.action_space.sample())


def test_the_spec_of_the_game_is_an_attribute(gym_simulator, make):
    assert make(BridgeEnv, "brief").game_spec == describe(gym_simulator, "brief", {})
