"""What `joybridge doctor` looks at, in the order of repair: what comes first is needed by what follows.

A Look is a function that returns what it saw in one sentence, or raises Violation.
"""

import socket
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

import grpc
import numpy as np

from joybridge.conformance.client import MIN_WAIT, OPEN, SERVICE, Client, Status, Stream
from joybridge.conformance.expectations import TimedOut, Violation, expect
from joybridge.conformance.recording import Player, act_request, valid_act
from joybridge.conformance.spec_expectations import expect_bounds
from joybridge.conformance.step_expectations import VALID
from joybridge.conformance.subject import Subject
from joybridge.contract.credentials import Credentials
from joybridge.contract.limits import element_count, request_bytes
from joybridge.contract.versions import OLDEST_REVISION, client_version, mismatch, own_version
from joybridge.v1 import bridge_pb2 as pb

SECONDS = 4.5  # for everything
CONNECT_SECONDS = 2.0
CHECKED = 10  # steps of a game whose content is checked
TIMED = 100  # steps of a game that are timed, or as many as fit into TIMED_SECONDS
TIMED_SECONDS = 0.3

Look = Callable[[], str]
HINTS = {
    grpc.StatusCode.UNAUTHENTICATED: "a response: give the server's token with --token-file",
    grpc.StatusCode.UNAVAILABLE: f"a server of {SERVICE}: another program may listen there, or TLS is missing or wrong "
    "(--tls-ca)",
}


@dataclass(frozen=True)
class Finding:
    """What one look has found."""

    about: str  # "port", "calls", "versions", "health", "spec", "config", "steps", "latency" or "sizes"
    ok: bool | None  # None: it could not be examined
    text: str


@dataclass(frozen=True)
class Settings:
    """How a game is played: the keys of a configuration, or the defaults."""

    options: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    arenas: int = 2
    check: Callable[[pb.GameSpec], str] | None = None  # returns what the configuration has; raises Violation


def examine(
    address: str, games: Sequence[str] = (), settings: Settings | None = None, credentials: Credentials = OPEN
) -> Iterator[Finding]:
    """Yield findings about the server, then about each game, by default all. Ends early if nothing can follow."""
    settings = settings or Settings()
    until = time.monotonic() + SECONDS
    port = _look("port", lambda: _port(address))
    yield port
    if not port.ok:
        return
    with Client(address, SECONDS, credentials) as client:

        def look(about: str, run: Look) -> Finding:
            client.seconds = round(max(until - time.monotonic(), 0.1), 1)
            return _look(about, run, hurried=not games and client.seconds < SECONDS / 2)

        listed: list[pb.GameSummary] = []
        calls = look("calls", lambda: _calls(client, listed))
        yield calls
        if not calls.ok:
            return
        yield look("versions", lambda: _versions(client))
        yield look("health", lambda: _health(client))
        waiting = [*games] or [summary.name for summary in listed]
        while waiting and time.monotonic() < until:
            yield from _game(Subject(client, waiting.pop(0), settings.options), settings, look)
        if waiting:
            yield Finding("steps", None, f"{', '.join(waiting)}: no time was left; name a game with --game")


def _look(about: str, run: Look, *, hurried: bool = False) -> Finding:
    """Return what a look finds. hurried: games before have left little time, so a time-out says nothing."""
    try:
        return Finding(about, True, run())
    except TimedOut as error:
        if hurried:
            return Finding(about, None, f"{error.got}, and little time was left; name a game with --game")
        text = f"{error.got}: the server hangs, is busy or compiles the game; look at its log, and try again"
        return Finding(about, False, text)
    except Violation as error:
        return Finding(about, False, " ".join(f"{error.got}; expected {error.expected}".split()))  # one line


def _port(address: str) -> str:
    begin = time.perf_counter()
    try:
        if address.startswith("unix:"):
            with socket.socket(socket.AF_UNIX) as probe:
                probe.settimeout(CONNECT_SECONDS)
                probe.connect(address.removeprefix("unix:"))
        else:
            host, _, port = address.rpartition(":")
            socket.create_connection((host.strip("[]"), int(port)), CONNECT_SECONDS).close()
    except (socket.gaierror, UnicodeError) as error:  # UnicodeError: no name of a host can be written so
        why = getattr(error, "strerror", error)
        raise Violation(f"the name in {address} has no address ({why})", "a name or number") from error
    except TimeoutError as error:
        text = f"{address} did not answer within {CONNECT_SECONDS:g} s"
        raise Violation(text, "a connection: is the host up, and is there a firewall?") from error
    except OSError as error:
        wanted = "a server; start one, with a game of your own as in `joybridge serve --game MODULE:CLASS`"
        raise Violation(f"nothing listens at {address} ({error.strerror})", wanted) from error
    return f"{address} accepts connections, after {1000 * (time.perf_counter() - begin):.1f} ms"


def _calls(client: Client, listed: list[pb.GameSummary]) -> str:
    games = client.try_list_games()
    if isinstance(games, Status):
        raise Violation(f"ListGames failed with {games}", HINTS.get(games.code, f"a server of {SERVICE}"))
    expect(games, "ListGames returns no games", "at least one")
    listed += games
    return f"ListGames returns {', '.join(game.name for game in games)}"


def _versions(client: Client) -> str:
    client_needs, own = client_version(), own_version()
    server = client.call(f"/{SERVICE}/ListGames", pb.ListGamesRequest(version=client_needs), pb.ListGamesResponse)
    if isinstance(server, Status):
        raise Violation(f"ListGames with the version of this client failed with {server}", "a response")
    text = mismatch(client_needs, server.version)
    expect(not text, text, f"revision {OLDEST_REVISION} or newer")
    theirs = server.version
    return f"the server is {theirs.product}, revision {theirs.revision}; this is {own.product}, revision {own.revision}"


def _health(client: Client) -> str:
    for service in ("", SERVICE):
        client.expect_serving(service)
    return "SERVING"


def _game(subject: Subject, settings: Settings, look: Callable[[str, Look], Finding]) -> Iterator[Finding]:
    """Yield findings about one game. Ends early if nothing can follow."""
    played: list[Player] = []
    with ExitStack() as stack:
        looks: dict[str, Look] = {
            "spec": lambda: _spec(subject),
            "config": lambda: settings.check(subject.spec) if settings.check else "",
            "steps": lambda: _steps(subject, settings, stack.enter_context(Stream(subject.client)), played),
            "latency": lambda: _latency(played[0]),
            "sizes": lambda: _sizes(played[0]),
        }
        for about, run in looks.items():
            if about != "config" or settings.check:
                finding = look(about, run)
                yield replace(finding, text=f"{subject.game}: {finding.text}")
                if not finding.ok:
                    return


def _spec(subject: Subject) -> str:
    spec = subject.spec
    expect_bounds(spec)
    behaviors = [
        f"{behavior.name} observes {_observed(behavior)} (sensors: {len(behavior.sensors)}, "
        f"axes: {len(behavior.device.axes)}, branches: {len(behavior.device.branches)})"
        for behavior in spec.behaviors
    ]
    unsaid = [sensor.name for behavior in spec.behaviors for sensor in behavior.sensors if _like_an_image(sensor)]
    hint = f"; say that {' and '.join(unsaid)} is an image, so that policies see it with convolutions" if unsaid else ""
    return f"{'; '.join(behaviors)}; up to {spec.max_arenas} arenas{hint}"


def _observed(behavior: pb.Behavior) -> str:
    """Return what a behavior observes in words: its numbers, and its images apart."""
    images = [
        f"{each.name}, an image of {each.shape[1]}x{each.shape[0]} {pb.Color.Name(each.image.color)[6:].lower()}"
        for each in behavior.sensors
        if each.HasField("image")
    ]
    numbers = sum(element_count(sensor) for sensor in behavior.sensors if not sensor.HasField("image"))
    return " and ".join([*images, *([f"{numbers} numbers"] if numbers or not images else [])])


def _like_an_image(sensor: pb.Sensor) -> bool:
    """Whether a sensor has the type and shape of an image, and is not said to be one."""
    shape = sensor.shape
    return not sensor.HasField("image") and sensor.dtype == pb.DTYPE_UINT8 and len(shape) == 3 and shape[2] in {1, 3}


def _steps(subject: Subject, settings: Settings, stream: Stream, played: list[Player]) -> str:
    arenas = settings.arenas
    player = subject.player(stream, arenas, parameters=settings.parameters)
    played.append(player)
    recording = player.recording
    until = time.monotonic() + subject.client.seconds
    for index in range(CHECKED + 1):
        last = "Start" if index == 0 else f"decision {index}"
        expect(recording.end is None, f"{recording.end} in response to {last}", "a Step")
        views = recording.views(index)
        expect(len(views) == len(subject.spec.behaviors), f"{len(views)} behaviors in a Step", "all of the spec")
        for view in views:
            for expectation in VALID:
                expectation(view)
        if (left := until - time.monotonic()) < MIN_WAIT and index:
            return f"{index} steps of {arenas} arenas are valid; they are slow, so there was no time for more"
        if index < CHECKED:
            stream.receiver.seconds = round(max(left, MIN_WAIT), 1)
            player.decide()
    return f"{CHECKED} steps of {arenas} arenas are valid"


def _latency(player: Player) -> str:
    """Play on and time each step: from the request to the response."""
    recording = player.recording
    times: list[float] = []  # ms
    until = time.monotonic() + TIMED_SECONDS
    while len(times) < TIMED and (not times or time.monotonic() < until):
        request = act_request(valid_act(recording.views(len(recording.steps) - 1), player.generators))
        begin = time.perf_counter()
        player.send(request)
        times.append(1000 * (time.perf_counter() - begin))
        expect(recording.end is None, f"{recording.end} after {len(recording.steps)} responses", "a Step")
    half, most = np.percentile(times, [50, 99])
    return (
        f"a step takes {half:.2f} ms (p50), {most:.2f} ms (p99), in {len(times)} steps of {recording.arenas} arenas: "
        f"about {1000 * recording.arenas / half:,.0f} decisions/s without learning"
    )


def _sizes(player: Player) -> str:
    recording = player.recording
    spec, act, step = recording.spec, recording.requests[-1], recording.steps[-1]
    return (
        f"for {recording.arenas} arenas an Act has {act.ByteSize()} bytes and a Step {step.ByteSize()}; the spec has "
        f"{spec.ByteSize()}; the largest request that the server must accept has {request_bytes(spec, spec.max_arenas)}"
    )
