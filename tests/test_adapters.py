"""Environments of Gymnasium and PettingZoo as games."""

import sys
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import ClassVar

import gymnasium
import numpy as np
import pygame
import pytest
from gymnasium import spaces

from joybridge.adapters.display import Display
from joybridge.adapters.spaces import AgentSpaces
from joybridge.cli import main
from joybridge.contract.codec import ActArrays
from joybridge.simulator.batched_game import ArenaError, GameError
from joybridge.simulator.catalog import CatalogError, load_game, load_games
from joybridge.simulator.game_adapter import batched
from joybridge.simulator.listing import listing
from joybridge.simulator.timestep_arrays import _cast
from joybridge.v1 import bridge_pb2 as pb
from tests.support.games import Hybrid

HERE = "tests.support.environments"
MIXED = f"gym:{HERE}:Mixed-v0"


def play(place, arenas=1, first_arena=0, seed=1):
    return load_game(place)({}, {}, arenas, first_arena, seed)


def mixed_act(arenas=1, levers=(0.5, 0.8), whole=3.4):
    return [
        ActArrays(np.array([[*levers, whole]] * arenas, np.float32), np.array([[2, 0, 1, 1, 3]] * arenas, np.int32))
    ]


def turn(*choices):
    return [ActArrays(np.empty((len(choices), 0), np.float32), np.array(choices, np.int32)[:, None])]


def test_the_spec_is_made_from_the_spaces():
    game = load_game(MIXED)
    assert listing([game.describe({})]).splitlines() == [
        f"Mixed-v0: {HERE}:Mixed-v0, an environment of Gymnasium.",
        "  time: a decision every 50 ms",
        "  behavior agent: 1 agent per arena",
        "    sensors: arm.speed [2], image [2, 3, 3] uint8, lamps [3] bool, pair[0] [3], pair[1] [5]",
        "    axes: levers[0] -1..1, levers[1] 0.1..0.8, pair[1] -5..5",
        "    branches: gear (-1 | 0 | 1), keys[0] (released | pressed), keys[1] (released | pressed), "
        "pair[0][0] (0 | 1),",
        "        pair[0][1] (0 | 1 | 2 | 3)",
        "    rewards: reward (weight 1)",
        "    metrics: height",
    ]
    spec = game.describe({})
    assert (list(spec.behaviors[0].sensors[0].low), list(spec.behaviors[0].sensors[0].high)) == ([-1.0], [np.inf])
    assert (spec.tick_seconds, spec.picture.width, spec.picture.height) == (0.05, 6, 4)


@pytest.mark.parametrize(
    ("shape", "dtype", "high", "color"),
    [
        ((16, 20, 3), np.uint8, 255, pb.COLOR_RGB),
        ((16, 20, 1), np.uint8, 255, pb.COLOR_GRAY),
        ((20, 16), np.uint8, 255, pb.COLOR_GRAY),
        ((15, 20, 3), np.uint8, 255, None),  # a small grid, as of MiniGrid
        ((16, 20, 4), np.uint8, 255, None),  # frames
        ((16, 20, 3), np.uint8, 10, None),
        ((16, 20, 3), np.float32, 255, None),
        ((400,), np.uint8, 255, None),
    ],
)
def test_a_box_that_is_a_picture_is_an_image(shape, dtype, high, color):
    space = spaces.Dict({"camera": spaces.Box(0, high, shape, dtype)})
    (sensor,) = AgentSpaces(space, spaces.Discrete(2)).sensors
    assert (sensor.image.color if sensor.HasField("image") else None) == color


def test_actions_arrive_in_the_form_of_the_action_space():
    game = play(MIXED)
    game.step(mixed_act())
    last = game.games[0].env.unwrapped.last
    assert last["gear"] == 1 and last["keys"].tolist() == [0, 1]
    assert last["levers"].tolist() == [0.5, 0.8]  # 0.8 of 32 bits is above the bound of 64 bits
    assert last["pair"][0].tolist() == [1, 3] and last["pair"][1] == 3


def test_discrete_observations_are_one_at_the_value():
    speed, image, lamps, one, several = play(MIXED).step(mixed_act())[0].observations
    assert speed.dtype == np.float32 and image.max() == 1 and lamps.tolist() == [[True, False, True]]
    assert one.tolist() == [[0, 1, 0]]
    assert several.tolist() == [[0, 1, 0, 1, 0]]


def test_an_episode_that_is_terminated_and_truncated_at_once_is_terminated():
    game = play(MIXED, arenas=2)
    for _ in range(3):
        step = game.step(mixed_act(2))[0]
    assert step.terminated.all() and not step.truncated.any() and step.rewards.tolist() == [[0.5], [0.5]]
    assert step.final_observations[1].max() == 3 and step.observations[1].max() == 0
    assert step.metrics.tolist() == [[30.0], [30.0]]
    assert game.draw(1).max() == 100  # the picture is of the new episode


@pytest.mark.parametrize("where", ["info", "parts", "observation", "method"])
def test_masks_are_found_where_environments_have_them(where):
    game = play(f"gym:{HERE}:Masked-v0 where={where}")
    for step in (
        game.observe()[0],
        game.step([ActArrays(np.empty((1, 0), np.float32), np.zeros((1, 2), np.int32))])[0],
    ):
        assert [mask.tolist() for mask in step.masks] == [[[True, False]], [[True, False, True]]]
    assert len(game.spec.behaviors[0].sensors) == 1


def test_options_of_reset_that_the_metadata_names_are_parameters():
    game = load_game(f"gym:{HERE}:Windy-v0")
    assert [(each.name, each.low, each.high, each.default_value) for each in game.describe({}).parameters] == [
        ("wind", 0.0, 2.0, 1.0)
    ]
    played = game({}, {"wind": 0.5}, 2, 0, 1)
    assert played.observe()[0].observations[0].tolist() == [[0.5], [0.5]]
    played.reset(7, {"wind": 1.5})
    (step,) = played.step(turn(0, 0))
    assert step.rewards.tolist() == [[1.5], [1.5]]
    plain = play(f"gym:{HERE}:Windy-v0 parameters={{}}")
    assert not plain.spec.parameters and plain.observe()[0].observations[0].tolist() == [[-1.0]]
    wrong = r"metadata\[\"parameters\"\] is \{'wind': 3\}, expected \{\"NAME\": \(LOW, HIGH, DEFAULT\)\}"
    with pytest.raises(CatalogError, match=wrong):
        load_game(f"""gym:{HERE}:Windy-v0 'parameters={{"wind": 3}}'""")
    with pytest.raises(CatalogError, match=r"got the argument wind=2, .* give it as parameters.wind=2 where"):
        load_game(f"gym:{HERE}:Windy-v0 wind=2")


def test_the_metadata_of_a_wrapper_names_its_own_parameters():
    gymnasium.register("Repeated-v0", lambda: Repeats(gymnasium.make("CartPole-v1")))
    try:
        (repeats,) = load_game("gym:Repeated-v0").describe({}).parameters
    finally:
        gymnasium.registry.pop("Repeated-v0")
    assert (repeats.name, repeats.low, repeats.high) == ("repeats", 1, 8)


class Repeats(gymnasium.Wrapper):  # type: ignore[misc]
    metadata: ClassVar = {"render_modes": ["rgb_array"], "parameters": {"repeats": (1, 8, 1)}}


@pytest.mark.parametrize(
    ("values", "dtype", "kept"),
    [
        ([0.7, 1.0], np.uint8, "got 0.7 of float64, expected a value of uint8"),
        ([300, 1], np.uint8, "got 300 of int64, expected a value of uint8"),
        ([2, 0], np.bool_, "got 2 of int64, expected a value of bool"),
        ([np.nan, 0], np.int32, "got nan of float64, expected a value of int32"),
        ([1.0, 255.0], np.uint8, [1, 255]),
        ([True, False], np.uint8, [1, 0]),
        ([0.1, 1e300], np.float32, [np.float32(0.1), np.inf]),
    ],
)
def test_values_become_those_of_the_sensor_or_are_refused(values, dtype, kept):
    if isinstance(kept, str):
        with pytest.raises(ValueError, match=kept):
            _cast(np.array(values), dtype)
    else:
        with np.errstate(over="ignore"):
            assert _cast(np.array(values), dtype).tolist() == kept


def test_an_arena_plays_the_same_whatever_the_number_of_arenas():
    many, alone = play(MIXED, arenas=3), play(MIXED, first_arena=2)
    other = play(MIXED, first_arena=2, seed=2)
    for _ in range(7):
        speeds = [game.step(mixed_act(game.arenas))[0].observations[0][-1].tolist() for game in (many, alone, other)]
        assert speeds[0] == speeds[1] != speeds[2]


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ("raises", "arena 0: RuntimeError: the arm is stuck"),
        ("nan", "arena 0: agent: sensor 'arm.speed' is .*nan.*, expected finite numbers"),
        ("shape", r"arena 0: agent: sensor 'arm.speed' has shape \[1\], expected \[2\]"),
        ("value", r"arena 0: ValueError: pair\[0\] is 9, expected 1..3"),
        ("rewards", r"arena 0: ValueError: the reward is array\(\[0.5, 0.5\]\), expected a number"),
        ("reward", r"arena 0: agent: a reward is \[nan\], expected finite numbers"),
    ],
)
def test_an_environment_that_misbehaves_is_an_error_with_the_place(fault, text):
    game = play(f"{MIXED} fault={fault}")
    game.step(mixed_act())
    with pytest.raises(GameError, match=text):
        game.step(mixed_act())


def test_environments_are_closed_also_when_the_games_begin_anew(tmp_path):
    game = play(f"gym:{HERE}:Holding-v0 folder={tmp_path}", arenas=2)
    first = [one.env.unwrapped.process for one in game.games]
    game.reset(7, {})
    second = [one.env.unwrapped.process for one in game.games]
    assert all(process.returncode is not None for process in first)
    assert all(process.returncode is None for process in second)
    game.close()
    assert all(process.returncode is not None for process in second)


def test_pygame_stays_for_the_arenas_of_others():
    one, other = (play("gym:CartPole-v1 render_mode=rgb_array") for _ in range(2))
    picture = one.draw(0), other.draw(0)
    one.close()
    assert pygame.display.get_init() and np.array_equal(other.draw(0), picture[1])
    other.close()


def test_one_game_that_cannot_be_closed_leaves_the_others_closed():
    closed = []

    class Closing(Hybrid):
        def close(self):
            closed.append(self)
            if len(closed) == 2:
                raise OSError("it is stuck")

    game = batched(Closing)({"size": "small", "masks": "on"}, {}, 3, 0, 1)
    with pytest.raises(OSError, match="it is stuck"):
        game.close()
    assert len(closed) == 3


@pytest.mark.parametrize(
    ("place", "text"),
    [
        (f"gym:{HERE}:Spaces-v0 kind=unbounded", r"action\[0\] lies in -inf..3, but an axis needs finite bounds"),
        (f"gym:{HERE}:Spaces-v0 kind=text", "words is Text, expected Box, Discrete, MultiDiscrete, MultiBinary"),
        (f"gym:{HERE}:Spaces-v0 kind=empty", r"observation has the shape \(2, 0\), so no number; leave it out"),
        (f"gym:{HERE}:Masked-v0 where=short", "the action mask has 4 flags, expected 5, one per choice"),
        ("gym:Nowhere-v0", "--gym 'Nowhere-v0' does not work: NameNotFound"),
        ("gym:CartPole-v1 fast", "got the argument 'fast', expected KEY=VALUE"),
        ("pettingzoo:nowhere", "No module named 'nowhere'"),
        ("pettingzoo:json", "the module json has no parallel_env or env; name the class or function that makes an env"),
        ("pettingzoo:json:Nowhere", "the module json has no Nowhere; name the class or function"),
    ],
)
def test_an_environment_that_cannot_be_served_is_named_with_the_reason(place, text):
    with pytest.raises(CatalogError, match=text):
        load_game(place)


def test_a_missing_library_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "joybridge.adapters.gymnasium", raising=False)
    with pytest.raises(CatalogError, match=r"needs the module gymnasium; .*joybridge\[gym\]"):
        load_game("gym:CartPole-v1")


def test_agents_that_come_and_go_are_lanes_that_wait():
    assert load_game("pettingzoo:tests.support.leaving_agents:Leaving").name == "Leaving"
    game = play("pettingzoo:tests.support.leaving_agents")
    assert [(b.name, b.agents_per_arena) for b in game.spec.behaviors] == [("runner", 2), ("judge", 1)]
    runners, judge = game.observe()
    assert runners.deciding.tolist() == [True, False] and judge.deciding is None
    act = [ActArrays(np.zeros((2, 1), np.float32), np.empty((2, 0), np.int32)), *turn(0)]
    deciding, rewards = [], []
    for _ in range(4):
        runners, judge = game.step(act)
        deciding.append(runners.deciding.tolist())
        rewards.append(runners.rewards[:, 0].tolist())
    assert deciding == [[True, False], [False, True], [False, True], [True, False]]  # the last: a new episode
    assert rewards == [[1, 0], [0, 2], [0, 3], [2, 4]]
    assert (runners.terminated.tolist(), runners.truncated.tolist()) == ([True, False], [False, True])
    assert judge.truncated.tolist() == [True]
    assert runners.final_observations[0][:, 0].tolist() == [2, 14]


def test_an_agent_whose_observation_is_missing_is_named():
    with pytest.raises(ArenaError, match=r"no observation of judge, which is .*; it returned those of runner_0"):
        play("pettingzoo:tests.support.leaving_agents:Hiding")


@pytest.mark.filterwarnings("ignore:The old environment creation API:DeprecationWarning")
def test_turns_of_pettingzoo_are_waiting_and_deciding_lanes():
    game = play("pettingzoo:pettingzoo.classic.tictactoe_v3")
    step = game.observe()[0]
    for move in (0, 3, 1, 4):
        assert step.deciding.tolist() == ([True, False] if move in (0, 1) else [False, True])
        assert step.masks is not None and step.masks[0][step.deciding][0, move]
        step = game.step(turn(move, move))[0]
        assert not step.masks[0][step.deciding][0, move]
    step = game.step(turn(2, 2))[0]
    assert step.terminated.tolist() == [True, True]
    assert step.rewards[:, 0].tolist() == [1.0, -1.0]


def test_environments_find_the_display_that_they_share_as_they_left_it():
    games = {size: load_game(f"gym:{HERE}:Painted-v0 size={size}") for size in (4, 6)}

    def played(size):
        game = games[size]({}, {}, 2, 0, size)
        clocks = [game.step(turn(0, 1))[0].observations[0][:, 0] for _ in range(50)]
        for arena, clock in enumerate(clocks[-1]):
            color = [*int(clock).to_bytes(3, "big")]
            assert game.draw(arena).tolist() == [[color] * size] * size
        return clocks

    with ThreadPoolExecutor(2) as sessions:
        for clocks in sessions.map(played, games):
            assert (np.diff(clocks, axis=0) == 1.0).all()


def test_an_environment_that_hangs_stops_no_other_that_draws_nothing(monkeypatch):
    monkeypatch.setattr("joybridge.adapters.display._surface", lambda: None)
    with Display().own():
        assert not Display._lock.locked()


@pytest.mark.slow
def test_a_policy_is_trained_on_cartpole(tmp_path, capsys, signals):
    small = ["arenas=4", "policy.rollout_steps=8", "total_timesteps=256", "log_interval=128", "policy.epochs=1"]
    run = str(tmp_path / "run")
    assert main(["train", "gym/cartpole", "--gym", "CartPole-v1 max_episode_steps=20", "--run", run, *small]) == 0
    assert "next: joybridge evaluate" in capsys.readouterr().err


def test_the_catalog_offers_adapted_environments_beside_the_games():
    games = load_games(["gym:CartPole-v1 max_episode_steps=50"])
    assert {"orchard", "CartPole-v1"} <= set(games)
    assert games["CartPole-v1"].describe({}).max_episode_decisions == 50


def test_a_package_with_an_entry_point_registers_its_environments(monkeypatch):
    def register():
        gymnasium.register("joybridge_tests/Late-v0", lambda **_: gymnasium.make("CartPole-v1").unwrapped)

    point = SimpleNamespace(load=lambda: register)
    monkeypatch.setattr("joybridge.adapters.gymnasium.entry_points", lambda group, name: [point])
    assert load_game("gym:joybridge_tests/Late-v0").name == "joybridge_tests/Late-v0"
