"""Our games under a trainer of ML-Agents: the messages of the player, against a session of the same seed."""

import struct
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import grpc
import numpy as np
import pytest

from joybridge.client.client import Session
from joybridge.config.errors import ConfigError
from joybridge.contract.spec import SpecError
from joybridge.layouts import make_acts
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents import side_channels
from joybridge.mlagents.side_channels import Payload
from joybridge.mlagents.wire import END, FAILED, FINE, METHOD, SERVICE, CommunicatorError, check_version
from joybridge.mlagents_player.command import main
from joybridge.mlagents_player.connection import connect, play
from joybridge.mlagents_player.player import Player
from joybridge.mlagents_player.records import AgentRecords
from joybridge.simulator import behavior, sensor

pytestmark = pytest.mark.nightly

RESET = ml.TrainerStep(command=ml.RESET)


def session(simulator, game, arenas=2, **settings):
    return Session(simulator, game, arenas=arenas, seed=5, **settings)


def agents(answer, name):
    return ml.AgentList.FromString(answer.step.agents.get(name, b"")).agents


def asking(answer, name):
    return [agent for agent in agents(answer, name) if not agent.done]


def values(agents, index):
    return np.array([np.frombuffer(agent.observations[index].floats.data, "<f4") for agent in agents])


def actions(continuous=(), discrete=(), count=1, name="player", **fields):
    action = ml.Action(continuous=np.array(continuous, "<f4").tobytes(), discrete=discrete)
    data = ml.ActionList(actions=[action] * count).SerializeToString()
    return ml.TrainerStep(actions={name: data}, **fields)


def same(sent, observations):
    """Return whether agents see what the sensors of some lanes show, to the bit."""
    return all(
        values(sent, index).tobytes() == np.asarray(sensor, np.float32).reshape(len(sent), -1).tobytes()
        for index, sensor in enumerate(observations)
    )


def test_agents_see_and_earn_what_the_lanes_of_a_session_do(simulator):
    with session(simulator, "hybrid") as ours, session(simulator, "hybrid") as other:
        player = Player(ours, 5)
        answer = player.answer(RESET)
        (announced,) = answer.hello.behaviors
        assert announced.name == "player"
        assert announced.action_spec == ml.ActionSpec(continuous_actions=2, discrete_actions=2, branch_sizes=[3, 2])
        assert [(list(o.shape), o.name) for o in asking(answer, "player")[0].observations] == [
            ([2], "place"),
            ([1], "count"),
            ([4], "image"),
            ([3], "lamps"),
        ]
        ids, ends = {0, 1}, 0
        for _ in range(12):
            (act,) = make_acts(other.spec, 2)
            allowed = other.steps[0].masks[0] if other.steps[0].masks else np.ones((2, 3), bool)
            asked = asking(answer, "player")
            assert same(asked, other.steps[0].observations)
            assert [np.frombuffer(a.action_mask, bool)[:3].tolist() for a in asked if a.action_mask] == (
                (~allowed).tolist() if other.steps[0].masks else []
            )
            act.axes[:] = [-0.25, 0.875]  # of the force, 0.5 to 2, a quarter
            act.choices[:, 0] = gear = int(allowed.all(0).argmax())
            (step,) = other.step([act])
            answer = player.answer(actions([-0.25, -0.5], [gear, 0], 2))
            done = [agent for agent in agents(answer, "player") if agent.done]
            assert len(done) == len(step.ended)
            if done:
                assert same(done, step.final_observations)
                assert [a.interrupted for a in done] == step.truncated[step.ended].tolist()
                assert {a.id for a in done} <= ids
                ids = {a.id for a in asking(answer, "player")}
                assert ids.isdisjoint(a.id for a in done)
                ends += 1
            earned = step.rewards @ np.array([1, 0.5], np.float32)
            assert [agent.reward for agent in done] == earned[step.ended].tolist()
            earned[step.ended] = 0
            assert [agent.reward for agent in asking(answer, "player")] == earned.tolist()
        assert ends


def test_agents_that_wait_are_not_asked(simulator):
    with session(simulator, "noughts", arenas=1) as ours:
        player = Player(ours, 5)
        answer, seen = player.answer(RESET), []
        for _ in range(9):
            (one,) = asking(answer, "player")
            seen.append(one.id)
            free = [place for place, taken in enumerate(one.action_mask) if not taken]
            answer = player.answer(actions([], free[:1]))
            if ended := [agent for agent in agents(answer, "player") if agent.done]:
                break
        assert seen[0] == seen[2] != seen[1] == seen[3]
        assert {agent.id for agent in ended} == set(seen) and sum(agent.reward for agent in ended) == 0


def test_metrics_of_ended_episodes_are_statistics(simulator):
    with session(simulator, "hybrid", arenas=1, parameters={"drift": 0.0}) as ours:
        player = Player(ours, 5)
        player.answer(RESET)
        sent = [player.answer(actions([0, 0], [0, 1])).step.side_channels for _ in range(9)]
        assert sent[:8] == [b""] * 8
        payloads = [side_channels.read_statistic(one.data) for one in side_channels.split(sent[8])]
        assert payloads == [("player/length", 9.0, 0), ("player/presses", 9.0, 0)]


def parameters(name="drift", value=0.3, **step):
    payloads = [side_channels.time_scale(20.0), side_channels.parameter(name, value)]
    return {"side_channels": side_channels.join(payloads), **step}


def test_environment_parameters_begin_new_episodes(simulator):
    with (
        session(simulator, "hybrid") as ours,
        session(simulator, "hybrid", parameters={"drift": 0.3}) as wanted,
    ):
        player = Player(ours, 5)
        answer = player.answer(ml.TrainerStep(**parameters(), command=ml.RESET))
        assert same(asking(answer, "player"), wanted.steps[0].observations)
        assert not [agent for agent in agents(answer, "player") if agent.done]
        answer = player.answer(actions([0, 0], [0, 0], 2, **parameters(value=2.0)))
        done, asked = ([a for a in agents(answer, "player") if a.done is ended] for ended in (True, False))
        assert [(a.id, a.interrupted) for a in done] == [(0, True), (1, True)] and len(asked) == 2


@pytest.mark.parametrize(
    ("channel", "error", "text"),
    [
        (side_channels.parameter("wind", 1.0), SpecError, "unknown parameter 'wind', expected one of drift"),
        (side_channels.parameter("drift", 3.0), SpecError, "'drift'.* 3"),
        (
            Payload(side_channels.PARAMETERS, struct.pack("<i1sii", 1, b"d", 1, 0)),
            CommunicatorError,
            "the environment parameter 'd' is a sampler",
        ),
        (Payload(side_channels.PARAMETERS, b"\x09\x00\x00\x00drift"), CommunicatorError, "side channel that is cut"),
        (Payload(side_channels.PARAMETERS, b"\x09"), CommunicatorError, "side channel that is cut"),
    ],
)
def test_a_parameter_that_the_game_cannot_take_is_refused(channel, error, text, simulator):
    with session(simulator, "hybrid") as ours, pytest.raises(error, match=text):
        Player(ours, 5).answer(ml.TrainerStep(command=ml.RESET, side_channels=side_channels.join([channel])))


@pytest.mark.parametrize("cut", [3, 19, 23])
def test_side_channels_that_are_cut_are_refused(cut):
    data = side_channels.join([side_channels.parameter("x", 0.5)])
    assert side_channels.read_parameter(next(side_channels.split(data)).data) == ("x", 0.5)
    with pytest.raises(CommunicatorError, match="cut or damaged"):
        list(side_channels.split(data[:cut]))


def test_side_channels_without_end_are_refused():
    with pytest.raises(CommunicatorError, match="cut or damaged"):
        list(side_channels.split(bytes(50_000_000)))


@pytest.mark.parametrize(
    ("step", "text"),
    [
        (actions([0, 0], [0, 0], 1), "sent 1 actions with 2 continuous and 2 discrete values together, expected 2"),
        (actions([0], [0, 0], 2), "sent 2 actions with 2 continuous"),
        (actions([0, 0], [0], 2), "4 continuous and 2 discrete"),
        (actions([0, 0], [3, 0], 2), r"the choices \[3, 0\] to \[3, 0\], expected one below \[3, 2\]"),
        (actions([0, 0], [0, -1], 2), "expected one below"),
        (ml.TrainerStep(), "sent 0 actions"),
        (ml.TrainerStep(actions={"player": b"\x0a\x05\x32\x03abc"}), "sent no list of actions"),
        (ml.TrainerStep(actions={"player": b"\x0a\x7f"}), "sent no list of actions"),
    ],
)
def test_actions_that_do_not_fit_are_refused(step, text, simulator):
    with session(simulator, "hybrid") as ours:
        player = Player(ours, 5)
        player.answer(RESET)
        with pytest.raises(CommunicatorError, match=text):
            player.answer(step)


def test_a_choice_that_is_masked_becomes_the_first_allowed_one(simulator, capsys):
    with session(simulator, "noughts", arenas=1) as ours:
        player = Player(ours, 5)
        player.answer(RESET)
        for _ in range(4):
            answer = player.answer(actions([], [0]))
        (one,) = asking(answer, "player")
        assert list(one.action_mask[:5]) == [1, 1, 1, 1, 0]
    assert capsys.readouterr().err.count("each becomes the first allowed one") == 1


def test_images_are_sent_channels_first_from_0_to_1():
    spec = behavior("eye", sensors=[sensor("view", [2, 3, 3], dtype="uint8"), sensor("map", [2, 2])])
    view = np.arange(36, dtype=np.uint8).reshape(2, 2, 3, 3)
    data = AgentRecords(spec).pack([view, np.ones((2, 2, 2), np.float32)], np.zeros(2), np.array([200, 2**31 - 1]))
    sent = ml.AgentList.FromString(data).agents
    assert [agent.id for agent in sent] == [200, 2**31 - 1]
    image, vector = sent[1].observations
    assert (list(image.shape), list(image.dimension_properties), list(vector.shape)) == ([3, 2, 3], [1, 2, 2], [4])
    assert same(sent, [view.transpose(0, 3, 1, 2) / np.float32(255), np.ones((2, 4))])


def test_more_than_a_trainer_can_take_is_refused_before_it_begins(simulator):
    with session(simulator, "hybrid") as ours:
        ours.arenas = 100_000
        with pytest.raises(ConfigError, match=r"takes at most 4194304; use at most \d+ arenas"):
            Player(ours, 5)


class Trainer:
    """The trainer's end of the calls: answers what `replies` say, then ends."""

    def __init__(self, *replies, version="1.0.0"):
        hello = ml.TrainerHello(seed=-1, communication_version=version, num_areas=2)
        first = ml.Message(header=ml.Header(status=FINE), from_trainer=ml.FromTrainer(hello=hello))
        steps = [
            ml.Message(header=ml.Header(status=FINE), from_trainer=ml.FromTrainer(step=reply)) for reply in replies
        ]
        self.replies, self.heard = [first, *steps], []

    def __call__(self, message, timeout=None):
        self.heard.append(message)
        return self.replies.pop(0) if self.replies else ml.Message(header=ml.Header(status=END))


def test_a_player_says_who_it_is_and_plays_until_the_trainer_ends(simulator):
    with session(simulator, "hybrid") as ours:
        trainer = Trainer(RESET, actions([0, 0], [0, 0], 2))
        assert play(trainer, "hybrid", lambda hello: Player(ours, hello.num_areas + 3)) == 2
    assert [message.header.status for message in trainer.heard] == [FINE] * 4
    hello = trainer.heard[0].from_player.hello
    assert (hello.name, hello.communication_version, hello.capabilities.hybrid_actions) == ("hybrid", "1.5.0", True)


def test_another_version_is_refused_with_both_versions(simulator):
    trainer = Trainer(version="2.0.0")
    with pytest.raises(CommunicatorError, match=r"speaks version 2\.0\.0 of .* joybridge .* speaks 1\.5\.0"):
        play(trainer, "hybrid", lambda hello: pytest.fail("it has begun"))
    assert trainer.heard[-1].header.status == FAILED
    with pytest.raises(CommunicatorError, match="the trainer refused version"):
        play(lambda message: ml.Message(header=ml.Header(status=END)), "hybrid", lambda hello: pytest.fail("begun"))
    check_version("1.99.0", "the trainer")
    with pytest.raises(CommunicatorError, match=r"speaks version \\x1b\]0;x{26} of"):
        check_version("\x1b]0;" + "x" * 1000, "the trainer")


def test_a_trainer_hears_that_the_player_has_failed(simulator):
    with session(simulator, "hybrid") as ours:
        trainer = Trainer(RESET, ml.TrainerStep())
        with pytest.raises(CommunicatorError, match="sent 0 actions"):
            play(trainer, "hybrid", lambda hello: Player(ours, 5))
    assert [message.header.status for message in trainer.heard] == [FINE, FINE, FINE, FAILED]


@contextmanager
def listening(answer):
    """Listen as a trainer that answers each message with answer(message); yield gRPC's server and its port."""
    handler = grpc.unary_unary_rpc_method_handler(
        lambda message, context: answer(message), ml.Message.FromString, ml.Message.SerializeToString
    )
    with ThreadPoolExecutor(1) as pool:
        server = grpc.server(pool)
        server.add_generic_rpc_handlers([grpc.method_handlers_generic_handler(SERVICE, {METHOD: handler})])
        port = server.add_insecure_port("127.0.0.1:0")
        server.start()
        try:
            yield server, port
        finally:
            server.stop(None).wait()


def test_the_command_plays_over_grpc(simulator, signals, monkeypatch, capsys):
    trainer = Trainer(RESET, actions([0, 0], [0, 0], 2))
    with listening(trainer) as (_, port):
        started = ["-nographics", "-batchmode", "--mlagents-port", str(port), "-logFile", "player.log"]  # by a trainer
        assert main(["mlagents", "hybrid", "--simulator", simulator, "options.size=large", *started]) == 0
    assert len(asking_last(trainer)) == 2 and list(asking_last(trainer)[0].observations[2].shape) == [10]
    assert "the trainer has ended after 2 steps of hybrid" in capsys.readouterr().err


def test_a_trainer_whose_end_overtakes_its_last_answer_has_ended(simulator, signals, capsys):
    trainer = Trainer(RESET, actions([0, 0], [0, 0], 2))

    def answer(message):
        reply = trainer(message)
        if reply.header.status == END:
            server.stop(None)  # cancels the call that this answers
        return reply

    with listening(answer) as (server, port):
        assert main(["mlagents", "hybrid", "--simulator", simulator, "--port", str(port)]) == 0
    assert "the trainer has ended after 2 steps of hybrid" in capsys.readouterr().err


def test_a_trainer_that_fails_is_lost(simulator, signals, capsys):
    with listening(lambda message: None) as (_, port):
        assert main(["mlagents", "hybrid", "--simulator", simulator, "--port", str(port)]) == 1
    assert f"error: lost the trainer at 127.0.0.1:{port}: " in capsys.readouterr().err


def asking_last(trainer):
    return asking(trainer.heard[-1].from_player, "player")


def test_a_trainer_that_is_not_there_is_an_error(capsys):
    with pytest.raises(CommunicatorError, match=r"no trainer of ML-Agents at .* after 0\.1 s"), connect(1, 0.1, print):
        pass
    assert "waiting up to 0.1 s for a trainer" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--port", "0"], "argument --port/--mlagents-port: got '0', expected an integer in 1..65535"),
        (["--arenas", "0"], "argument --arenas: got '0', expected an integer of at least 1"),
        (["--wait", "nan"], "argument --wait: got 'nan', expected a positive number"),
        (["--token-file", "x"], "--tls-ca and --token-file belong to a running simulator"),
    ],
)
def test_wrong_options_are_refused(arguments, text, capsys):
    with pytest.raises(SystemExit):
        main(["mlagents", "archer", *arguments])
    assert text in capsys.readouterr().err


def test_a_wrong_setting_of_the_game_is_refused(simulator, signals, capsys):
    assert main(["mlagents", "hybrid", "--simulator", simulator, "parameters.drift=9"]) == 1
    assert "parameters.drift: got 9, expected 0..2" in capsys.readouterr().err
