"""The connection of a player to a trainer of ML-Agents: the handshake, and step by step until the trainer's end."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import grpc

from joybridge.contract.versions import own_version
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents.wire import (
    ANY_LENGTH,
    FAILED,
    FINE,
    METHOD,
    SERVICE,
    VERSION,
    CommunicatorError,
    capabilities,
    check_version,
)
from joybridge.mlagents_player.player import Player

FAREWELL_SECONDS = 5.0  # to tell the trainer that the player has failed
OFTEN = [("grpc.initial_reconnect_backoff_ms", 100), ("grpc.max_reconnect_backoff_ms", 1000)]

Exchange = Callable[..., ml.Message]  # of a message and, optionally, a timeout, for the answer


@contextmanager
def connect(port: int, seconds: float, say: Callable[[str], None]) -> Iterator[Exchange]:
    """Connect to the trainer at a port of this machine and yield the call of it. Raises CommunicatorError.

    seconds: how long to wait for the trainer.
    """
    address = f"127.0.0.1:{port}"
    with grpc.insecure_channel(address, [*ANY_LENGTH, *OFTEN]) as channel:
        say(f"waiting up to {seconds:g} s for a trainer of ML-Agents at {address}")
        try:
            grpc.channel_ready_future(channel).result(seconds)
        except grpc.FutureTimeoutError:
            raise CommunicatorError(
                f"no trainer of ML-Agents at {address} after {seconds:g} s; start one, for example with "
                "mlagents-learn, or give its port with --port"
            ) from None
        call = channel.unary_unary(f"/{SERVICE}/{METHOD}", ml.Message.SerializeToString, ml.Message.FromString)
        try:
            yield call
        except grpc.RpcError as error:
            raise CommunicatorError(
                f"lost the trainer at {address}: {error.details()} ({error.code().name}); start both again"
            ) from error


def play(exchange: Exchange, game: str, begin: Callable[[ml.TrainerHello], Player]) -> int:
    """Play until the trainer ends it; return the number of steps. begin: makes the player that the trainer wants.

    Where the player fails or is interrupted, the trainer is told, which would otherwise wait for its next answer.
    Raises JoybridgeError and grpc.RpcError.
    """
    reply = exchange(_from_player(ml.FromPlayer(hello=hello(game))))
    if reply.header.status != FINE:
        raise CommunicatorError(
            f"the trainer refused version {VERSION} of ML-Agents' communicator; it prints its own: use another release"
        )
    steps = 0
    try:
        check_version(reply.from_trainer.hello.communication_version, "the trainer")
        player = begin(reply.from_trainer.hello)
        reply = exchange(ml.Message(header=ml.Header(status=FINE)))
        while reply.header.status == FINE and reply.from_trainer.step.command != ml.QUIT:
            reply = exchange(_from_player(player.answer(reply.from_trainer.step)))
            steps += 1
    except BaseException as error:
        if _has_stopped(error):
            return steps + 1  # the steps so far and the one whose answer was overtaken
        with suppress(grpc.RpcError):
            exchange(ml.Message(header=ml.Header(status=FAILED)), timeout=FAREWELL_SECONDS)
        raise
    return steps


def _has_stopped(error: BaseException) -> bool:
    """Return whether the trainer stopped its server, as it does when it ends.

    ML-Agents sends its last answer and stops its server at once, so its end can overtake the answer. A trainer that was
    killed stops nothing: gRPC says "Socket closed" of it.
    """
    return isinstance(error, grpc.RpcError) and error.details() == "Cancelling all calls"


def hello(game: str) -> ml.PlayerHello:
    """Return what the player says about itself."""
    return ml.PlayerHello(
        name=game,
        communication_version=VERSION,
        package_version=own_version().product.removeprefix("joybridge "),
        capabilities=capabilities(),
    )


def _from_player(content: ml.FromPlayer) -> ml.Message:
    return ml.Message(header=ml.Header(status=FINE), from_player=content)
