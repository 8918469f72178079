"""Players of Unity ML-Agents as a game: a stand-in that does what players do, and what they should not do."""

import sys
import threading
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest

from joybridge.adapters.unity import process as unity_process
from joybridge.adapters.unity.communicator import Communicator
from joybridge.adapters.unity.forms import BehaviorForm
from joybridge.client.client import Session
from joybridge.client.errors import SimulatorError
from joybridge.client.launch import simulator_process
from joybridge.contract.codec import ActArrays
from joybridge.layouts import make_acts
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents import side_channels
from joybridge.mlagents.wire import END
from joybridge.mlagents_player.connection import connect
from joybridge.mlagents_player.connection import play as play_for_a_trainer
from joybridge.mlagents_player.player import Player
from joybridge.simulator.batched_game import GameError
from joybridge.simulator.catalog import CatalogError, load_game
from joybridge.simulator.listing import listing
from tests.support.servers import free_port
from tests.support.unity_player import DIES, HANGS, StandIn, agent, hybrid, says, vector
from tools.chaos.process import wait_until

pytestmark = pytest.mark.nightly

QUICK = "wait=1"  # seconds, for players that say nothing


def serve(script, settings=""):
    """Return the game of a stand-in, and the stand-in."""
    port = free_port()
    player = StandIn(port, script)
    return load_game(f"unity-port:{port} {settings}"), player


def play(script, settings="", arenas=1):
    """Return a session of so many arenas with a stand-in, and the stand-in."""
    game, player = serve(script, settings)
    return game({}, {}, arenas, 0, 0), player


def act(axes, choices=None):
    axes = np.array(axes, np.float32)
    return [ActArrays(axes, np.empty((len(axes), 0), np.int32) if choices is None else np.array(choices, np.int32))]


TWO = says(agent(0, 0.5), agent(1, 1.5), new=hybrid())


def test_the_spec_is_made_from_what_the_player_shows():
    first = agent(
        0,
        vector(1, 2, 3, name="speed"),
        vector(*range(12), shape=[3, 2, 2], name="map"),
        vector(*range(6), shape=[3, 2], name="speed"),
    )
    game, _ = serve([says(first, new=hybrid(2, 3, 1, 2)), HANGS], "metrics=walker/falls,score parameters.wind=[0,2,1]")
    assert listing([game.describe({})]).splitlines()[1:] == [
        "  parameter wind: 0 .. 2 (default 1)",
        "  behavior walker: 1 agent per arena",
        "    sensors: speed_0 [3], map [2, 2, 3], speed_2 [3, 2]",
        "    axes: continuous_0 -1..1, continuous_1 -1..1",
        "    branches: discrete_0 (0 | 1 | 2), discrete_2 (0 | 1)",
        "    rewards: reward (weight 1), group_reward (weight 1)",
        "    metrics: falls, score",
    ]


def test_actions_reach_the_agents_that_asked_in_their_order():
    masked = agent(4, 0.0, action_mask=bytes([1, 0, 0, 0, 0, 1]))
    script = [says(masked, agent(3, 1.0), new=hybrid(1, 3, 1, 2)), says(agent(3, 2.0), masked)]
    game, player = play([*script, says()], "areas=2", arenas=2)
    (begun,) = game.observe()
    assert begun.observations[0].tolist() == [[1.0], [0.0]]  # the agent with the lower id is the first lane
    assert [mask.tolist() for mask in begun.masks] == [[[True] * 3, [False, True, True]], [[True] * 2, [True, False]]]
    game.step(act([[0.25], [-0.5]], [[1, 1], [2, 0]]))
    game.step(act([[0.75], [-1.0]], [[0, 1], [2, 0]]))
    assert player.actions(1) == [([-0.5], [2, 0, 0]), ([0.25], [1, 0, 1])]
    assert player.actions(2) == [([0.75], [0, 0, 1]), ([-1.0], [2, 0, 0])]


def test_agents_that_come_and_go_are_lanes_that_wait():
    script = [
        TWO,
        says(agent(0, 0.6, done=True, reward=1.0), agent(1, 1.6, reward=0.5, group_reward=2.0)),
        says(agent(1, 1.7, done=True, interrupted=True, reward=3.0), agent(3, 9.0, reward=7.0)),
        says(agent(2, 0.1), agent(3, 9.1, reward=4.0)),
    ]
    game, _ = play(script, "areas=2", arenas=2)
    (begun,) = game.observe()
    assert begun.deciding is None and begun.observations[0].tolist() == [[0.5], [1.5]]
    steps = [game.step(act([[0.0], [0.0]]))[0] for _ in range(3)]
    assert [step.deciding.tolist() if step.deciding is not None else None for step in steps] == [
        [False, True],
        [False, True],
        None,
    ]
    assert [step.rewards.tolist() for step in steps] == [[[1, 0], [0.5, 2]], [[0, 0], [3, 0]], [[0, 0], [4, 0]]]
    assert [step.ended.tolist() for step in steps] == [[0], [1], []]
    assert (steps[0].terminated.tolist(), steps[1].truncated.tolist()) == ([True, False], [False, True])
    assert [step.final_observations[0].tolist() for step in steps[:2]] == [[[np.float32(0.6)]], [[np.float32(1.7)]]]
    assert steps[2].observations[0].tolist() == [[np.float32(0.1)], [np.float32(9.1)]]


def test_agents_without_a_lane_are_given_zeros(caplog):
    script = [TWO, says(agent(0, 1.0), agent(7, 2.0), agent(1, 3.0), late=[agent(0, 5.0)])]
    script[1].hello.behaviors.add(name="late", action_spec=hybrid(2, 3))
    game, player = play([*script, says()], "areas=2", arenas=2)
    game.step(act([[0.5], [0.25]]))
    (step,) = game.step(act([[0.5], [0.25]]))
    assert player.actions(2) == [([0.5], []), ([0.0], []), ([0.25], [])]
    assert player.actions(2, "late") == [([0.0, 0.0], [0])]
    assert step.deciding.tolist() == [False, False]
    assert "more than 2 agents of 'walker'" in caplog.text and "has agents of 'late', which are given" in caplog.text


def test_a_behavior_that_comes_later_is_waited_for_if_it_is_named():
    late = says(agent(0, 1.0), late=[agent(0, 5.0)])
    late.hello.behaviors.add(name="late", action_spec=hybrid(2))
    game, _ = serve([says(agent(0, 0.5), new=hybrid()), says(agent(0, 0.5)), late, HANGS], "agents=late:3")
    assert [(b.name, b.agents_per_arena) for b in game.describe({}).behaviors] == [("late", 3), ("walker", 1)]


def test_engine_and_parameters_are_told_with_the_first_reset():
    game, player = serve([TWO, TWO, says()], "areas=2 parameters.wind=[0,2,1] time_scale=3 width=64")
    session = game({}, {"wind": 0.5}, 2, 0, 0)
    session.step(act([[0], [0]]))
    told = [list(side_channels.split(step.side_channels)) for step in player.steps[:2]]
    assert [step.command for step in player.steps] == [ml.RESET, ml.RESET, ml.STEP]
    assert told[0][0] == side_channels.resolution(64, 84) and side_channels.time_scale(3.0) in told[0]
    assert [one.channel for one in told[0]] == [side_channels.ENGINE] * 5 + [side_channels.PARAMETERS]
    assert told[1] == [side_channels.parameter("wind", 0.5)]


def test_statistics_are_metrics_of_the_episodes_that_end():
    names = [("walker/falls", 1.0), ("walker/falls", 2.0), ("score", 10.0), ("unknown", 0.0)]
    script = [
        TWO,
        says(agent(0, 0.0), agent(1, 0.0), statistics=[("score", 20.0)]),
        says(agent(1, 0.0, done=True), agent(0, 0.0, done=True), agent(2, 0.0), agent(3, 0.0), statistics=names),
        says(agent(2, 0.0, done=True), agent(3, 0.0)),
    ]
    game, _ = play(script, "areas=2 metrics=walker/falls,score", arenas=2)
    steps = [game.step(act([[0.0], [0.0]]))[0] for _ in range(3)]
    assert steps[0].metrics is None
    assert (steps[1].ended.tolist(), steps[1].metrics.tolist()) == ([0, 1], [[2, 15], [1, 15]])
    assert (steps[2].ended.tolist(), steps[2].metrics.tolist()) == ([1], [[1.5, 15]])  # nothing came since


def test_arenas_that_a_session_does_not_have_are_played_with_zeros():
    game, player = serve([TWO, says(agent(0, 1.0), agent(1, 2.0)), says()], "areas=2")
    session = game({}, {}, 1, 1, 0)
    assert session.observe()[0].observations[0].tolist() == [[1.5]]
    session.step(act([[0.5]]))
    session.step(act([[-0.5]]))
    assert player.actions(1) == [([0.0], []), ([0.5], [])] and player.actions(2) == [([0.0], []), ([-0.5], [])]


def test_a_player_goes_from_session_to_session():
    game, player = serve([TWO, TWO, TWO], "areas=2 any_seed=true")
    first = game({}, {}, 2, 0, 7)
    with pytest.raises(GameError, match=r"player 0, .* is not free: another session .* set pipeline_groups=1"):
        game({}, {}, 2, 0, 0)
    with pytest.raises(GameError, match=r"player 1, for the arenas from 2 on, is not free: nobody listens"):
        game({}, {}, 2, 2, 0)
    first.close()
    game({}, {}, 2, 0, 8).reset(9, {})
    assert [step.command for step in player.steps] == [ml.RESET, ml.RESET, ml.RESET]


def test_a_seed_that_a_player_was_not_greeted_with_is_refused():
    game, player = serve([TWO, TWO, HANGS], "areas=2 seed=4")
    assert player.heard[0].from_trainer.hello.seed == 4 and player.heard[0].from_trainer.hello.num_areas == 2
    with pytest.raises(GameError, match=r"was greeted with seed 4, not 3; serve it with seed=3 or any_seed=true"):
        game({}, {}, 2, 0, 3)
    session = game({}, {}, 2, 0, 4)
    with pytest.raises(GameError, match="is seeded once, when it connects"):
        session.reset(4, {})
    session.close()
    with pytest.raises(GameError, match="is seeded once, when it connects"):
        game({}, {}, 2, 0, 4)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (HANGS, r"the player at port \d+ said nothing for 1 s"),
        (DIES, r"the player at port \d+ (has gone|said nothing for)"),
        (b"\x0a\x7f", "sent what is no message of ML-Agents"),
        (ml.Message(header=ml.Header(status=500)).SerializeToString(), r"has ended \(status 500\)"),
        (b"\0" * (2**26 + 1), "or more than 67108864 bytes at once"),
        (ml.FromPlayer(step=ml.PlayerStep(agents={"walker": b"\x0a\x7f"})), "the list of agents is damaged"),
        (ml.FromPlayer(step=ml.PlayerStep(agents={"walker": b"\x0a\x02\x0a\x7f"})), "an agent is no message"),
        (ml.FromPlayer(step=ml.PlayerStep(side_channels=b"abc")), "is not understood: .*side channel that is cut"),
        (says(agent(0, 0.0), agent(0, 0.0)), "lets an agent of 'walker' ask twice"),
        (says(agent(0, 0.0, done=True), agent(0, 0.0, done=True)), "lets an agent of 'walker' end twice"),
        (says(agent(0, 0.0, 1.0)), r"observation 0 of agent 0 has shape \[2\], expected \[1\], as at first"),
        (says(agent(0, vector(0.0), vector(0.0))), "agent 0 has 2 observations, expected 1"),
        (says(agent(0, vector(0.0, 1.0, shape=[1]))), "has 8 bytes of numbers, expected 4"),
        (says(agent(0, float("nan"))), "observation 0 of agent 0 is not finite"),
        (says(agent(0, 0.0, reward=float("inf"))), "a reward of agent 0 is not finite"),
        (says(agent(0, 0.0, action_mask=b"\1\1\0\0")), "agent 0 allows no choice of branch 0"),
        (says(agent(0, 0.0), statistics=[("score", float("nan"))]), "'score' that is not finite"),
    ],
)
def test_a_player_that_misbehaves_ends_the_session_with_a_sentence(line, text):
    first = says(agent(0, 0.5), new=hybrid(1, 2, 2))
    game, player = play([first, line], f"metrics=score {QUICK if type(line) in (object, bytes) else ''}")
    with pytest.raises(GameError, match=text):
        game.step(act([[0.0]], [[0, 0]]))
    player.over.set()


@pytest.mark.parametrize(
    ("script", "settings", "text"),
    [
        ([HANGS], QUICK, "said nothing for 1 s"),
        ([says()], "", "the player shows no agent that asks for a decision"),
        ([says(agent(0, 0.0))], "", "has agents, but the player has not announced its actions"),
        ([says(agent(0, 0.0), new=ml.ActionSpec())], "", "behavior 'walker' has no actions"),
        ([says(agent(0, 0.0), new=hybrid(0, 1))], "", "has a single choice only"),
        ([says(agent(0, 0.0), new=hybrid(-1, 2))], "", "has -1 continuous and 1 discrete actions"),
        ([says(agent(0, vector(0.0, shape=[1] * 4)), new=hybrid())], "", r"has shape \[1, 1, 1, 1\], expected 1 to 3"),
        ([says(agent(0, vector(shape=[2**30])), new=hybrid())], "", "at most 16777216 values"),
        ([says(agent(0, 0.0), new=hybrid(), name="\n")], "", "expected a printable name"),
        ([], "speed=3", "got the setting 'speed', expected one of areas, players"),
        ([], "areas=0", r"areas: got 0, expected a whole number in 1\.\.4096"),
        ([], "time_scale=fast", "time_scale: got 'fast', expected a positive number"),
        ([], "any_seed=1", "any_seed: got 1, expected true or false"),
        ([], "agents=walker", "agents: got 'walker', expected BEHAVIOR:COUNT"),
        ([], "parameters.wind=3", r"parameters.wind: got 3, expected \[LOW,HIGH,DEFAULT\]"),
        ([], "parameters.wind=[0,1,2]", "the default 2 is outside 0..1"),
    ],
)
def test_what_cannot_be_served_is_named_with_the_reason(script, settings, text):
    with pytest.raises(CatalogError, match=text):
        serve(script, settings)


@pytest.mark.parametrize("version", ["2.0.0", "0.15.0", "", "5"])
def test_another_version_is_refused_with_both_versions(version):
    port = free_port()
    player = StandIn(port, [TWO], version)
    with pytest.raises(CatalogError, match=rf"speaks version {version or 'unknown'} of .* speaks 1\.5\.0"):
        load_game(f"unity-port:{port}")
    player.join(5)
    assert player.heard[-1].header.status == END


def test_nobody_connects():
    with pytest.raises(CatalogError, match=r"the player at port \d+ said nothing for 0\.3 s"):
        load_game(f"unity-port:{free_port()} start=0.3")


def test_a_second_player_at_a_port_is_refused_and_the_first_one_plays_on():
    game, player = play([TWO, TWO], "areas=2", arenas=2)
    other = StandIn(player.port, [TWO])
    other.join(5)
    assert "another player is connected" in other.refused
    game.step(act([[0], [0]]))
    assert len(player.steps) == 2


def test_of_two_players_that_call_before_either_is_heard_the_first_one_plays():
    communicator = Communicator()
    first = StandIn(communicator.port, [TWO])
    wait_until(lambda: communicator._calls.qsize() == 1, 5)
    second = StandIn(communicator.port, [TWO])
    wait_until(lambda: communicator._calls.qsize() == 2, 5)
    assert communicator.receive(5).from_player.hello.name == "stand-in"
    communicator.answer(ml.FromTrainer())
    communicator.receive(5)
    second.join(5)
    assert [heard.header.status for heard in second.heard] == [END] and first.is_alive()
    communicator.end()


def test_a_communicator_that_is_closed_leaves_no_thread():
    before = set(threading.enumerate())  # those of other tests may end at any time
    communicator = Communicator()
    own = set(threading.enumerate()) - before
    assert own
    communicator.end()
    wait_until(lambda: not any(thread.is_alive() for thread in own), 5)


def test_a_port_that_is_in_use_is_named():
    game, player = serve([TWO, HANGS])
    with pytest.raises(CatalogError, match=f"cannot listen on port {player.port} for a player: it is in use"):
        load_game(f"unity-port:{player.port}")
    assert game.describe({})


def test_our_own_player_plays_what_the_game_played_directly_does(simulator):
    port = free_port()

    def attach():
        with (
            Session(simulator, "hybrid", arenas=3, seed=5) as played,
            connect(port, 20, lambda text: None) as exchange,
        ):
            play_for_a_trainer(exchange, "hybrid", lambda hello: Player(played, hello.seed))

    player = Thread(target=attach, daemon=True)
    player.start()
    unity: Any = load_game(f"unity-port:{port} areas=3 seed=5 metrics=player/length,player/presses")({}, {}, 3, 0, 5)
    (steps,) = unity.observe()
    ended = 0
    with Session(simulator, "hybrid", arenas=3, seed=5) as direct:
        for number in range(40):
            (ours,) = direct.steps
            for sensor, theirs in zip(ours.observations, steps.observations, strict=True):
                assert np.asarray(sensor, np.float32).reshape(3, -1).tobytes() == theirs.tobytes()
            weights = [channel.default_weight for channel in direct.spec.behaviors[0].channels]
            assert (ours.rewards @ np.array(weights, np.float32)).tobytes() == steps.rewards[:, 0].tobytes()
            assert (ours.terminated.tolist(), ours.truncated.tolist(), ours.ended.tolist()) == (
                steps.terminated.tolist(),
                steps.truncated.tolist(),
                steps.ended.tolist(),
            )
            if len(ours.ended):
                ended += len(ours.ended)
                assert repr(ours.metrics) == repr(steps.metrics)
            allowed, also = (one.masks or [np.ones((3, 3), bool)] for one in (ours, steps))
            assert np.array_equal(allowed[0], also[0])
            (chosen,) = make_acts(direct.spec, 3)
            chosen.axes[:] = [0.5, 0.875]  # of the force, 0.5 to 2, a quarter
            chosen.choices[:, 0] = allowed[0].argmax(1) if number % 2 else 2 - allowed[0][:, ::-1].argmax(1)
            direct.step([chosen])
            (steps,) = unity.step([ActArrays(np.array([[0.5, -0.5]] * 3, np.float32), chosen.choices)])
    assert ended
    for communicator in unity.source._communicators:
        communicator.end()
    player.join(10)
    assert not player.is_alive()


def test_a_session_that_ends_gives_its_player_back():
    port = free_port()
    player = StandIn(port, [TWO] * 6)
    with simulator_process([f"unity-port:{port} areas=2 any_seed=true"]) as server:
        for transport in ("grpc", "local"):
            with Session(server, "unity", arenas=2, seed=3, transport=transport) as session:
                (step,) = session.step(make_acts(session.spec, 2))
                assert step.observations[0].tolist() == [[0.5], [1.5]]
                with pytest.raises(SimulatorError, match=r"player 0, .* is not free: another"):
                    Session(server, "unity", arenas=2, seed=3)
    player.join(10)  # it hears of the end of the server
    assert player.heard[-1].header.status == END
    assert [step.command for step in player.steps[:-1]] == [ml.RESET, ml.STEP, ml.RESET, ml.STEP]


BUILD = """#!/bin/sh
exec {} -P {} "$@"
"""


@pytest.fixture
def build(tmp_path):
    """Yield the path of a build."""
    path = tmp_path / "walk.x86_64"
    path.write_text(BUILD.format(sys.executable, Path(__file__).parent / "support/unity_build.py"))
    path.chmod(0o755)
    return path.with_suffix("")


def test_a_build_is_started_for_every_player_and_seed(build, monkeypatch):
    monkeypatch.setattr(unity_process, "ENDING_SECONDS", 60.0)
    game = load_game(f"unity:{build} areas=2 args='--agents 2'")
    assert (game.name, game.describe({}).max_arenas) == ("walk", 32)
    session: Any = game({}, {}, 3, 1, 7)
    first = session.observe()[0].observations[0]
    assert first[:, 1].tolist() == [1, 0, 1]  # arenas 1, 2 and 3 are in players 0 and 1
    assert first[0, 0] == 7 and first[1, 0] == first[2, 0] != 7  # their seeds
    session.step(act([[0.5]] * 3))
    session.reset(7, {})
    assert session.observe()[0].observations[0].tobytes() == first.tobytes()
    other = game({}, {}, 1, 1, 7)
    processes = [agents.player.process._process for agents in session._agents]
    processes[1].kill()
    with pytest.raises(GameError, match=r"has ended with exit status -9|has gone"):
        session.step(act([[0.5]] * 3))
    session.close()
    assert [process.wait(60) for process in processes] == [0, -9]
    (step,) = other.step(act([[0.5]]))  # another session is not affected
    assert step.observations[0].tolist() == [[7, 1, 1]]
    other.close()


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("nowhere", "there is no file 'nowhere'; expected the path of a build"),
        (__file__, "cannot be started: .*Permission denied"),
        ("/bin/false", "has ended with exit status 1; see its log"),
    ],
)
def test_a_build_that_does_not_start_is_named(place, text):
    with pytest.raises(CatalogError, match=text):
        load_game(f"unity:{place}")


def test_after_a_player_has_failed_another_one_is_waited_for():
    game, player = serve([TWO, HANGS], f"areas=2 {QUICK}")
    session = game({}, {}, 2, 0, 0)
    with pytest.raises(GameError, match="said nothing"):
        session.step(act([[0.0], [0.0]]))
    session.close()
    second = StandIn(player.port, [TWO, HANGS])
    (communicator,) = game.source._communicators
    assert wait_until(lambda: not communicator._calls.empty())  # it waits before the session begins
    game({}, {}, 2, 0, 9)
    assert second.heard[0].from_trainer.hello.seed == 9  # it had not been greeted yet
    player.over.set()
    second.over.set()


def test_sensors_are_numbered_so_that_no_two_have_one_name():
    first = agent(0, *(vector(1, name=name) for name in ("a", "a", "a_1", "a", "a_3")))
    form = BehaviorForm(ml.BehaviorParameters(name="walker", action_spec=hybrid(1)), first, 1, [])
    assert [one.name for one in form.sensors] == ["a_0", "a_6", "a_1", "a_8", "a_3"]
