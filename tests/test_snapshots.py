"""Snapshots: a session goes on from one to the same bytes, and one that does not fit is refused."""

from typing import ClassVar

import grpc
import numpy as np
import pytest
from grpc import StatusCode

from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.simulator import option, parameter
from joybridge.simulator.session import Refusal, Session
from joybridge.v1 import bridge_pb2 as pb
from tests.support.wire import SAVE, Player, Stream, reset, start

PAPER = ["beastly_rivals", "beastly_rivals_full", "shooting_birds"]  # the built-in games that save their state
LARGEST_SEED = 2**64 - 1


@pytest.mark.parametrize("game", PAPER)
def test_a_session_goes_on_from_a_snapshot_to_the_same_bytes(simulator, game):
    how = {"options": {"rules": "corrected"}, "seed": LARGEST_SEED, "first_arena": 7}
    with Player(simulator, game, 3, **how) as player:
        player.play(20)
        snapshot, now, random = player.save(), player.step, player.random
        size = player.spec.snapshot_bytes_per_arena
        assert sum(map(len, snapshot.parts.values())) <= 3 * size
        states = [generator.bit_generator.state for generator in random]
        wanted = player.play(20)
        assert player.save() != snapshot
    with Player(simulator, game, 3, **how, snapshot=snapshot) as player:
        for generator, state in zip(player.random, states, strict=True):
            generator.bit_generator.state = state
        assert observed(player.step) == observed(now)
        assert player.save() == snapshot
        assert player.play(20) == wanted


def observed(step):
    return [[tensor.data for tensor in part.observations] for part in step.behaviors]


@pytest.fixture(scope="module", params=PAPER)
def saved(request, simulator):
    """Return a game and a snapshot of two arenas of it, seed 1."""
    with Player(simulator, request.param) as player:
        player.play(3)
        return request.param, player.save()


def damaged(snapshot, name, data):
    copy = pb.Snapshot()
    copy.CopyFrom(snapshot)
    copy.parts[name] = data
    return copy


class Weathered(ShootingBirds):
    """Shooting Birds with one more option and one more parameter."""

    options: ClassVar = [*ShootingBirds.options, option("weather", ["fine", "rain"])]

    @classmethod
    def describe(cls, options):
        spec = super().describe(options)
        spec.parameters.append(parameter("wind", 0.0, 9.0, 3.0))
        return spec

    def reset(self, seed, parameters):
        super().reset(seed, {name: value for name, value in parameters.items() if name != "wind"})


def test_a_snapshot_fits_the_same_game_with_a_new_option_and_a_new_parameter_as_long_as_they_are_as_by_default():
    first = Session({"shooting_birds": ShootingBirds})
    first.answer(start("shooting_birds"))
    snapshot = first.answer(SAVE).snapshot

    def follow(**how):
        return Session({"shooting_birds": Weathered}).answer(start("shooting_birds", snapshot=snapshot, **how))

    assert follow().started.spec.options[-1].name == "weather"
    assert follow(options={"weather": "fine"}, parameters={"wind": 3.0}).HasField("started")
    for other in ({"options": {"weather": "rain"}}, {"parameters": {"wind": 4.0}}):
        with pytest.raises(Refusal, match="snapshot is from a session with another Start"):
            follow(**other)


def test_garbage_in_a_snapshot_is_refused_or_played_and_never_brings_the_server_down(simulator, saved):
    game, snapshot = saved
    random = np.random.default_rng(3)
    outcomes = set()
    for name in sorted(snapshot.parts):
        length = len(snapshot.parts[name])
        for data in (b"\0" * length, b"\xff" * length, b"\x7f" * length, *(random.bytes(length) for _ in range(3))):
            request = start(game, snapshot=damaged(snapshot, name, data))
            with Stream(simulator) as stream:
                try:
                    stream.ask(request)
                except grpc.RpcError as error:
                    outcomes.add(error.code())
                    text = error.details()
                    assert text.startswith("snapshot")
                else:
                    outcomes.add(StatusCode.OK)
                    stream.ask(reset())
                    stream.ask(SAVE)
    assert StatusCode.INVALID_ARGUMENT in outcomes
    assert outcomes <= {StatusCode.INVALID_ARGUMENT, StatusCode.OK}
