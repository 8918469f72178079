"""Servers that break the contract in one way each, and a game on which every rule can be tried.

BROKEN lists them, each with exactly the checks that must fail.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import grpc
import numpy as np
from grpc_health.v1 import health, health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha import reflection

from joybridge.conformance.client import OPEN
from joybridge.contract.codec import ActArrays, StepArrays, pack
from joybridge.contract.credentials import AUTHORIZATION, NO_COMPRESSION, Credentials, bearer
from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.contract.versions import own_version
from joybridge.simulator import (
    BatchedGame,
    axis,
    behavior,
    branch,
    button,
    channel,
    check_range,
    draw_parameters,
    image,
    option,
    parameter,
    sensor,
    spec,
)
from joybridge.simulator import session as sessions
from joybridge.simulator.session import Refusal, Session
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

SERVICE = "joybridge.v1.SimulatorService"
LENGTH, PRESSES, GEAR, DRAWS = range(4)  # columns of Gauntlet.counts
LONGEST = 9


class Gauntlet(BatchedGame):
    """Well-behaved, with all that a game can have: three devices, masks, lanes that wait, pictures, snapshots."""

    name = "gauntlet"
    description = "Move a point, change gears, and be judged every other time."

    options = (option("size", ["small", "large"]),)

    @classmethod
    def describe(cls, options):
        sensors = [
            sensor("place", [2], -9.0, 9.0),
            sensor("count", [1], dtype="int32"),
            image("image", 2, 2 if options["size"] == "small" else 5),
            sensor("lamps", [3], dtype="bool"),
        ]
        player = behavior(
            "player",
            sensors=sensors,
            axes=[axis("x", kind="velocity", way="right"), axis("force", 0.5, 2.0, only_with=("gear", "high"))],
            branches=[branch("gear", ["low", "middle", "high"], keys=["1", "", "3"]), button("press", key="space")],
            channels=[channel("gain"), channel("cost", 0.5)],
            metrics=["length", "presses"],
        )
        judge = behavior("judge", sensors=[sensor("lead", [1])], branches=[button("verdict")], agents=2)
        runner = behavior(
            "runner",
            sensors=[sensor("track", [1])],
            axes=[axis("pace")],
            metrics=["pace"],
            scripts={"walker": "a quarter of the way", "sprinter": "all of it"},
        )
        return spec(
            cls,
            [player, judge, runner],
            parameters=[parameter("drift", 0.0, 2.0, 1.0)],
            tick_seconds=0.05,
            decision_interval=2,
            max_episode_decisions=LONGEST,
            max_arenas=16,
            snapshot_bytes_per_arena=96,
            picture=(8, 6),
            parameters_per_episode=True,
        )

    def __init__(self, options, parameters, arenas, first_arena, seed):
        self.cells = 2 if options["size"] == "small" else 5
        self.arenas, self.first_arena = arenas, first_arena
        self.drift = np.ones(arenas)
        self.parameters = self.describe(options).parameters
        self.reset(seed, parameters)

    def reset(self, seed, parameters):
        self.drift[:] = parameters.get("drift", self.drift)
        if seed is not None:
            self.seed = seed
            self.episodes = np.zeros(self.arenas, np.int64)
            self.counts = np.zeros((self.arenas, 4), np.int64)
        self.place = np.zeros((self.arenas, 2))
        self.earned = np.zeros((self.arenas, 2), np.float32)
        for arena in range(self.arenas):
            self.begin(arena)

    def begin(self, arena):
        self.drift[arena] = self.drawn(arena).get("drift", self.drift[arena])
        self.episodes[arena] += 1
        self.counts[arena, :DRAWS] = 0
        self.place[arena] = self.draws(arena)

    def drawn(self, arena):
        """Return the parameters of the next episode that are drawn."""
        if not self.distributions:
            return {}
        key = np.array([self.seed, self.first_arena + arena], np.uint64)
        return draw_parameters(self.distributions, self.parameters, key, self.episodes[arena])

    def draws(self, arena):
        """Return two random numbers that depend on the seed, the arena and how many there were before."""
        self.counts[arena, DRAWS] += 1
        return np.random.default_rng([self.seed, self.first_arena + arena, self.counts[arena, DRAWS]]).normal(size=2)

    def observe(self):
        return [self.part(index, None) for index in range(3)]

    def step(self, acts):
        player, judge, runner = acts
        self.tick_pictures = [] if self.drawn_by_tick is None else [self.draw(self.drawn_by_tick)]
        if runner.scripts is not None:
            paces = np.choose(runner.scripts, [runner.axes[:, 0], 0.25, 1.0])
            runner = ActArrays(paces[:, None].astype(np.float32), runner.choices)
        self.counts[:, LENGTH] += 1
        self.counts[:, PRESSES] += player.choices[:, 1]
        self.counts[:, GEAR] = player.choices[:, 0]
        moves = np.stack([self.draws(arena) for arena in range(self.arenas)])
        self.place += moves * self.drift[:, None] + player.axes[:, :1] * self.force(player) + runner.axes
        self.place = np.clip(self.place, -9.0, 9.0)
        self.earned += judge.choices.reshape(self.arenas, 2)
        far = np.abs(self.place).max(axis=1) > 5.0
        late = ~far & (self.counts[:, LENGTH] == self.longest)
        ended = np.flatnonzero(far | late)
        last = [self.observations(index) for index in range(3)]
        rewards = [
            np.stack([self.place[:, 0], -0.25 * player.choices[:, 1]], axis=1).astype(np.float32),
            self.earned.reshape(-1, 1).copy(),
            self.place[:, 1:].astype(np.float32),
        ]
        metrics = [self.counts[ended, :2].astype(np.float32), None, runner.axes[ended]]
        self.played = self.drift[ended, None].astype(np.float32)
        for arena in ended:
            self.begin(arena)
        due = (far | late) | self.judging()
        rewards[1][~np.repeat(due, 2)] = 0.0
        self.earned[due] = 0.0
        return [self.part(index, (rewards[index], far, late, ended, last[index], metrics[index])) for index in range(3)]

    longest = LONGEST

    def force(self, player):
        return np.where(player.choices[:, :1] == 2, player.axes[:, 1:], 1.0)

    def judging(self):
        return self.counts[:, LENGTH] % 2 == 1

    def observations(self, index):
        gears = self.counts[:, GEAR : GEAR + 1]
        if index == 1:
            return [np.repeat(self.place[:, :1], 2, axis=0).astype(np.float32)]
        if index == 2:
            return [self.place[:, 1:].astype(np.float32)]
        picture = np.broadcast_to(gears.astype(np.uint8)[:, :, None, None], (self.arenas, 2, self.cells, 1))
        return [self.place.astype(np.float32), self.counts[:, :1].astype(np.int32), picture, gears == np.arange(3)]

    def part(self, index, happened):
        agents = 2 if index == 1 else 1
        lanes = self.arenas * agents
        step = StepArrays(
            self.observations(index),
            np.zeros((lanes, 2 if index == 0 else 1), np.float32),
            np.zeros(lanes, bool),
            np.zeros(lanes, bool),
        )
        if index == 0:
            gear = self.counts[:, GEAR : GEAR + 1]
            step.masks = [abs(np.arange(3) - gear) <= 1, np.ones((lanes, 2), bool)]
        if index == 1:
            step.deciding = np.repeat(self.judging(), 2)
        if happened:
            rewards, far, late, ended, last, metrics = happened
            step.rewards = rewards
            step.terminated, step.truncated = np.repeat(far, agents), np.repeat(late, agents)
            step.ended = (ended[:, None] * agents + np.arange(agents)).reshape(-1).astype(np.int32)
            if len(ended):
                step.final_observations, step.metrics = [values[step.ended] for values in last], metrics
                if self.distributions:
                    step.parameters = np.repeat(self.played, agents, axis=0)
        return step

    def draw(self, arena):
        picture = np.zeros((6, 8, 3), np.uint8)
        picture[:] = self.counts[arena, :3]
        picture[0, 0] = list(np.float32(self.place[arena, 0]).tobytes()[:3])
        return picture

    def save(self):
        of_episodes = {"seed": np.array([self.seed], np.uint64), "drift": self.drift, "episodes": self.episodes}
        return {"place": self.place, "counts": self.counts, "earned": self.earned, **of_episodes}

    def restore(self, state):
        self.check(state)
        self.place, self.counts, self.earned = (state[name].copy() for name in ("place", "counts", "earned"))
        self.seed, self.drift, self.episodes = int(state["seed"][0]), state["drift"].copy(), state["episodes"].copy()

    def check(self, state):
        """Raise ValueError for numbers that no session has saved."""
        for name, low, high in (
            ("place", -9, 9),
            ("counts", 0, 2**40),
            ("earned", 0, LONGEST),
            ("drift", 0, 2),
            ("episodes", 0, 2**40),
        ):
            check_range(name, state[name], low, high)


# ----------------------------------------------------------------------------------------------------- the server


class Service(rpc.SimulatorServiceServicer):  # type: ignore[misc]
    """Answers the calls with a session, which knows all the rules."""

    def __init__(self, broken):
        self.games = {Gauntlet.name: broken.game}
        self.session = broken.session

    def ListGames(self, request, context):
        try:
            self.session.look(request)
            games = [pb.GameSummary(name=Gauntlet.name, description=Gauntlet.description)]
            return pb.ListGamesResponse(games=games, version=self.session.version())
        except Refusal as refusal:
            return context.abort_with_status(refusal.status())

    def DescribeGame(self, request, context):
        try:
            self.session.look(request)
            spec = self.session.describe(self.games, request.game, request.options)
            return pb.DescribeGameResponse(spec=spec, version=self.session.version())
        except Refusal as refusal:
            return context.abort_with_status(refusal.status())

    def Play(self, requests, context):
        session = self.session(self.games)
        try:
            for request in requests:
                yield session.answer(request)
        except Refusal as refusal:
            context.abort_with_status(refusal.status())


class Honest(Session):
    """A session like any other, with places for what is to be broken."""

    @staticmethod
    def look(request):
        sessions.check_version(request.version)

    @staticmethod
    def version():
        return own_version()

    @staticmethod
    def describe(games, name, options):
        return sessions.describe(games, name, options)

    def answer(self, request):
        response = super().answer(self.request(request))
        kind = response.WhichOneof("response")
        if kind == "snapshot":
            self.saved(response.snapshot)
        else:
            first = kind == "started"
            step = response.started.step if first else response.step
            self.every(step)
            (self.first if first else self.reset if request.HasField("reset") else self.later)(step)
        return response

    def request(self, request):
        return request

    def saved(self, snapshot):
        """Change a snapshot."""

    def every(self, step):
        """Change any step."""

    def first(self, step):
        """Change the step in Started."""

    def reset(self, step):
        """Change the step after a Reset."""

    def later(self, step):
        """Change the step after an Act."""


@dataclass
class BrokenServer:
    """A server with a fault, and the checks that find it: those that fail and those that warn."""

    checks: set[str]
    warned: set[str] = field(default_factory=set)
    game: type[BatchedGame] = Gauntlet
    session: type[Honest] = Honest
    health: tuple[str, ...] = ("", SERVICE)
    reflection: tuple[str, ...] = (SERVICE, reflection.SERVICE_NAME)
    service: type[Service] = Service
    options: list[Any] = field(default_factory=list)
    admits: Callable[[str, str], bool] = lambda method, authorization: True
    credentials: Credentials = OPEN  # of the clients that it should admit


class TokenInterceptor(grpc.ServerInterceptor):  # type: ignore[misc]
    """Refuses the calls that `admits(method, authorization)` does not admit."""

    def __init__(self, admits):
        self.admits = admits

    def intercept_service(self, continuation, call):
        authorization = dict(call.invocation_metadata).get(AUTHORIZATION, "")
        return continuation(call) if self.admits(call.method, authorization) else REFUSAL


def _refuse(requests, context):
    context.abort(grpc.StatusCode.UNAUTHENTICATED, "give the token")


REFUSAL = grpc.stream_stream_rpc_method_handler(_refuse)


class Threads(ThreadPoolExecutor):
    """Threads of a server that is not waited for: a call that comes while it stops finds them gone, and is dropped."""

    def submit(self, *call, **keywords) -> Future[Any]:
        try:
            return super().submit(*call, **keywords)
        except RuntimeError:
            dropped: Future[Any] = Future()
            dropped.cancel()
            return dropped


@contextmanager
def serving(broken) -> Iterator[str]:
    """Serve in threads of this process and yield the address."""
    with Threads(32) as threads:
        options = [*broken.options, ("grpc.so_reuseport", 0), NO_COMPRESSION]  # the first of a name counts
        server = grpc.server(threads, options=options, interceptors=[TokenInterceptor(broken.admits)])
        rpc.add_SimulatorServiceServicer_to_server(broken.service(broken), server)
        if broken.health:
            servicer = health.HealthServicer()
            health_pb2_grpc.add_HealthServicer_to_server(servicer, server)
            for name in broken.health:
                servicer.set(name, health_pb2.HealthCheckResponse.SERVING)
        if broken.reflection:
            reflection.enable_server_reflection(broken.reflection, server)
        port = server.add_insecure_port("127.0.0.1:0")
        server.start()
        try:
            yield f"127.0.0.1:{port}"
        finally:
            server.stop(0)  # and no waiting for it: calls that were broken off may keep it for ever


BROKEN: dict[str, BrokenServer] = {}


def broken(*checks, **fields):
    """Keep a class as a broken server: a session, a game or a service, by its name."""

    def keep(kind):
        part = "game" if issubclass(kind, Gauntlet) else "session" if issubclass(kind, Honest) else "service"
        BROKEN[kind.__name__] = BrokenServer(set(checks), **{part: kind}, **fields)
        return kind

    return keep


def change(tensor, array):
    """Put an array in the place of a tensor."""
    tensor.CopyFrom(pack(np.ascontiguousarray(array)))


def read(tensor):
    return np.frombuffer(tensor.data, NUMPY_TYPES[tensor.dtype]).reshape(tensor.shape).copy()


def floats(tensor):
    return np.frombuffer(tensor.data, "<f4").reshape(tensor.shape).copy()


BROKEN["NoHealth"] = BrokenServer({"health_of_the_server_is_serving", "health_of_the_service_is_serving"}, health=())
BROKEN["HealthOfTheServerOnly"] = BrokenServer({"health_of_the_service_is_serving"}, health=("",))
BROKEN["NoReflection"] = BrokenServer(
    {
        "reflection_lists_the_service",
        "reflection_has_every_method",
        "reflection_has_every_field",
    },
    reflection=(),
)
BROKEN["ReflectionOfNothing"] = BrokenServer({"reflection_lists_the_service"}, reflection=(reflection.SERVICE_NAME,))
BROKEN["NoLimitOfMessages"] = BrokenServer(
    set(), warned={"oversized_message_is_refused"}, options=[("grpc.max_receive_message_length", -1)]
)

# -------------------------------------------------------------------------------------------------------- security

HEALTH = "/grpc.health.v1.Health/"
RIGHT = bearer("0123456789-secret")
PROTECTED = BrokenServer(
    set(),
    admits=lambda method, sent: sent == RIGHT or method.startswith(HEALTH),
    credentials=Credentials(token="0123456789-secret"),
)
WITHOUT, ANOTHER = "calls_without_the_token_are_unauthenticated", "calls_with_another_token_are_unauthenticated"
BROKEN |= {
    "AnyToken": replace(
        PROTECTED, checks={ANOTHER}, admits=lambda method, sent: sent != "" or method.startswith(HEALTH)
    ),
    "BeginningOfTheToken": replace(
        PROTECTED, checks={ANOTHER}, admits=lambda method, sent: sent.startswith(RIGHT) or method.startswith(HEALTH)
    ),
    "PlayIsOpen": replace(
        PROTECTED,
        checks={WITHOUT, ANOTHER},
        admits=lambda method, sent: sent == RIGHT or method.endswith("/Play") or method.startswith(HEALTH),
    ),
    "ReflectionIsOpen": replace(
        PROTECTED,
        checks={WITHOUT, ANOTHER},
        admits=lambda method, sent: sent == RIGHT or method.startswith(("/grpc.reflection", HEALTH)),
    ),
    "HealthNeedsTheToken": replace(
        PROTECTED, checks={"health_needs_no_token"}, admits=lambda method, sent: sent == RIGHT
    ),
    "UnpacksMessages": BrokenServer(
        set(), warned={"compressed_messages_are_refused"}, options=[("grpc.compression_enabled_algorithms_bitset", 7)]
    ),
}

# ------------------------------------------------------------------------------------------------ specs and starts


@broken(
    "spec_is_the_same_on_every_call",
    "explicit_default_choices_give_the_same_spec",
    "spec_of_every_choice_is_the_same_on_every_call",
    "started_has_the_spec_of_describe",
    "started_has_the_spec_of_describe_for_every_choice",
)
class ChangingSpec(Gauntlet):
    times = 0

    @classmethod
    def describe(cls, options):
        ChangingSpec.times += 1
        spec = super().describe(options)
        spec.tick_seconds = ChangingSpec.times
        return spec


@broken("started_has_the_spec_of_describe", "started_has_the_spec_of_describe_for_every_choice")
class OtherSpecInStarted(Honest):
    def answer(self, request):
        response = super().answer(request)
        if response.HasField("started"):
            response.started.spec.max_arenas += 1
        return response


@broken("spec_is_within_all_bounds", "parameter_default_is_in_range", "every_choice_has_a_valid_spec")
class DefaultOutOfRange(Honest):
    @staticmethod
    def describe(games, name, options):
        spec = sessions.describe(games, name, options)
        spec.parameters[0].default_value = 3.0
        return spec


@broken("sensor_bounds_match_the_shape")
class BoundsOfAnotherShape(Honest):
    @staticmethod
    def describe(games, name, options):
        spec = sessions.describe(games, name, options)
        spec.behaviors[0].sensors[0].low.extend([-9.0, -9.0])
        return spec


@broken("images_have_the_shape_of_their_color")
class GrayImageIsRGB(Honest):
    @staticmethod
    def describe(games, name, options):
        spec = sessions.describe(games, name, options)
        spec.behaviors[0].sensors[2].image.color = pb.COLOR_RGB
        return spec


@broken("conditions_of_axes_name_a_choice")
class ConditionOnNothing(Honest):
    @staticmethod
    def describe(games, name, options):
        spec = sessions.describe(games, name, options)
        spec.behaviors[0].device.axes[1].only_with.choice = "reverse"
        return spec


@broken("keys_are_one_per_choice", "spec_is_within_all_bounds", "every_choice_has_a_valid_spec")
class OneKeyForTwoChoices(Honest):
    @staticmethod
    def describe(games, name, options):
        spec = sessions.describe(games, name, options)
        spec.behaviors[0].device.branches[0].keys[1] = "Digit1"
        return spec


@broken("first_observations_match_the_sensors")
class FirstShapeWrong(Honest):
    def first(self, step):
        change(step.behaviors[0].observations[0], floats(step.behaviors[0].observations[0]).reshape(-1))


@broken("first_rewards_are_zero")
class PaidAtTheStart(Honest):
    def first(self, step):
        change(step.behaviors[0].rewards, floats(step.behaviors[0].rewards) + 1)


# -------------------------------------------------------------------------------------------- options, parameters


@broken("unknown_option_is_refused_by_describe", "unknown_option_is_refused_by_start")
class AnyOption(Honest):
    @staticmethod
    def forget(options):
        for name in options.keys() - {"size"}:
            del options[name]

    @staticmethod
    def look(request):
        Honest.look(request)
        if isinstance(request, pb.DescribeGameRequest):
            AnyOption.forget(request.options)

    def request(self, request):
        if request.HasField("start"):
            self.forget(request.start.options)
        return request


@broken(
    "parameter_above_high_is_refused_by_start",
    "parameter_below_low_is_refused_by_start",
    "infinite_parameter_is_refused_by_start",
)
class ClipsParameters(Honest):
    def request(self, request):
        if "drift" in request.start.parameters and not np.isnan(request.start.parameters["drift"]):
            request.start.parameters["drift"] = min(max(request.start.parameters["drift"], 0.0), 2.0)
        return request


@broken(warned={"parameters_have_an_effect"})
class ParametersDoNothing(Gauntlet):
    def step(self, acts):
        self.drift, drift = np.ones(self.arenas), self.drift
        steps = super().step(acts)
        self.drift = drift
        return steps


@broken("parameter_set_by_reset_acts_as_in_start")
class ResetForgetsParameters(Gauntlet):
    def reset(self, seed, parameters):
        super().reset(seed, parameters if not hasattr(self, "seed") else {})


# --------------------------------------------------------------------------------------------------- distributions


@broken("distributions_are_refused_without_the_flag")
class IgnoresDistributions(Honest):
    @staticmethod
    def describe(games, name, options):
        spec = sessions.describe(games, name, options)
        spec.parameters_per_episode = False
        return spec

    def request(self, request):
        for part in (request.start, request.act, request.reset):
            if part.distributions:
                part.ClearField("distributions")
        return request

    def answer(self, request):
        response = super().answer(request)
        if response.HasField("started"):
            response.started.spec.parameters_per_episode = False
        return response


@broken("values_do_not_depend_on_the_number_of_arenas")
class DrawsByPosition(Gauntlet):
    def drawn(self, arena):
        return draw_parameters(
            self.distributions, self.parameters, np.array([self.seed, arena], np.uint64), self.episodes[arena]
        )


@broken("every_episode_of_every_arena_draws_anew")
class DrawsOnce(Gauntlet):
    def drawn(self, arena):
        return draw_parameters(self.distributions, self.parameters, np.array([self.seed, 0], np.uint64), 0)


@broken("distributions_of_act_hold_from_the_next_episode_on")
class ChangesRunningEpisodes(Gauntlet):
    def step(self, acts):
        if self.distributions:
            self.drift = np.array([self.drawn(arena)["drift"] for arena in range(self.arenas)])
        return super().step(acts)


@broken("session_from_a_snapshot_draws_the_same_values")
class ForgetsEpisodes(Gauntlet):
    def restore(self, state):
        super().restore(state)
        self.episodes[:] = 1


@broken(
    "parameters_of_ended_episodes_are_reported",
    "drawn_values_are_in_the_interval",
    "every_episode_of_every_arena_draws_anew",
)
class ReportsNoParameters(Honest):
    def later(self, step):
        for part in step.behaviors:
            part.ended.ClearField("parameters") if part.HasField("ended") else None


# ----------------------------------------------------------------------------------------------------------- order


@broken("act_before_start_is_refused", "reset_before_start_is_refused", "save_before_start_is_refused")
class WrongStatusBeforeStart(Honest):
    def answer(self, request):
        if self.game is None and request.WhichOneof("request") in ("act", "reset", "save"):
            raise Refusal(pb.REASON_UNKNOWN_REQUEST, "start comes first")
        return super().answer(request)


@broken("second_start_is_refused", "start_after_act_and_reset_is_refused")
class StartsAgain(Honest):
    def answer(self, request):
        if request.HasField("start"):
            self.game = None
        return super().answer(request)


@broken(
    "unknown_field_of_start_is_ignored",
    "unknown_field_of_act_is_ignored",
    "unknown_field_of_describe_is_ignored",
)
class RefusesWhatItDoesNotKnow(Honest):
    @staticmethod
    def look(request):
        Honest.look(request)
        known = type(request)()
        known.CopyFrom(request)
        known.DiscardUnknownFields()
        if known.ByteSize() != request.ByteSize():
            raise Refusal(pb.REASON_MALFORMED_MESSAGE, "a field is unknown")

    def request(self, request):
        kind = request.WhichOneof("request")
        if kind in ("start", "act"):
            part = getattr(request, kind)
            size = part.ByteSize()
            part.DiscardUnknownFields()
            if part.ByteSize() != size:
                raise Refusal(pb.REASON_MALFORMED_MESSAGE, "a field is unknown")
        return request


@broken("every_response_states_product_and_revision", "all_responses_state_the_same_version")
class StatesNoVersion(Honest):
    @staticmethod
    def version():
        return None


@broken("client_that_needs_a_newer_revision_is_refused")
class ServesEveryRevision(Honest):
    @staticmethod
    def look(request):
        pass

    def request(self, request):
        if request.HasField("start"):
            request.start.ClearField("version")
        return request


@broken("client_of_the_same_revision_is_served")
class ServesOnlyWhoStatesNoRevision(Honest):
    @staticmethod
    def look(request):
        if request.version.revision:
            client = request.version
            raise Refusal(
                pb.REASON_OLD_SERVER,
                f"{client.product} {client.revision} is not {own_version().product} {own_version().revision}",
            )


@broken("unknown_game_is_not_found_by_describe", "empty_game_name_is_not_found_by_describe")
class UnknownGameIsInvalid(Honest):
    @staticmethod
    def describe(games, name, options):
        if name not in games:
            raise Refusal(pb.REASON_UNKNOWN_OPTION, f"no game {name}")
        return sessions.describe(games, name, options)


# --------------------------------------------------------------------------------------------------------- actions


def acts(request):
    return [act for act in request.act.behaviors if act.axes.dtype == pb.DTYPE_FLOAT32 and act.axes.data]


@broken("axis_without_its_choice_has_no_effect")
class EveryAxisCounts(Gauntlet):
    def force(self, player):
        return player.axes[:, 1:]


@broken("nan_axis_is_refused", "infinite_axis_is_refused")
class NotANumberIsZero(Honest):
    def request(self, request):
        for act in acts(request):
            if len(act.axes.data) == 4 * np.prod(act.axes.shape):
                change(act.axes, np.where(np.isfinite(floats(act.axes)), floats(act.axes), np.float32(0.5)))
        return request


@broken(
    "axis_above_high_is_refused",
    "axis_below_low_is_refused",
    "axis_far_out_of_range_is_refused",
    "invalid_action_in_the_last_lane_is_refused",
)
class ClipsAxes(Honest):
    def request(self, request):
        for act in acts(request):
            shape = list(act.axes.shape)
            if len(shape) == 2 and shape[1] <= 2 and len(act.axes.data) == 4 * np.prod(shape):
                values = floats(act.axes)
                low = np.array([-1.0, 0.5][: shape[1]], np.float32)
                high = np.array([1.0, 2.0][: shape[1]], np.float32)
                change(act.axes, np.where(np.isfinite(values), np.clip(values, low, high), values))
        return request


@broken("masked_choice_is_refused")
class ForgetsItsMasks(Honest):
    def _unpack(self, act):
        for previous in self.previous:
            previous.masks = None
        return super()._unpack(act)


@broken("choices_of_another_dtype_are_refused")
class AnyDtypeOfChoices(Honest):
    def request(self, request):
        for act in request.act.behaviors:
            if act.choices.dtype == pb.DTYPE_FLOAT32:
                act.choices.dtype = pb.DTYPE_INT32
                act.choices.data = np.frombuffer(act.choices.data, "<f4").astype("<i4").tobytes()
        return request


@broken("extra_behavior_is_refused")
class IgnoresExtraBehaviors(Honest):
    def request(self, request):
        if request.HasField("act"):
            del request.act.behaviors[3:]
        return request


@broken(
    "actions_of_lanes_that_a_script_plays_are_ignored",
    "script_after_the_last_is_refused",
    "negative_script_is_refused",
    "scripts_with_an_extra_lane_are_refused",
    "scripts_of_another_dtype_are_refused",
)
class KnowsNoScripts(Honest):
    def request(self, request):
        for act in request.act.behaviors:
            act.ClearField("scripts")
        return request


@broken("scripts_of_0_leave_all_lanes_to_the_client")
class CountsScriptsFrom0(Gauntlet):
    def step(self, acts):
        for act in acts:
            if act.scripts is not None:
                act.scripts = np.minimum(act.scripts + 1, 2)
        return super().step(acts)


# ----------------------------------------------------------------------------------------------------------- seeds


@broken(
    "different_seeds_give_different_episodes", "high_bits_of_a_seed_are_used", "largest_seeds_give_different_episodes"
)
class IgnoresTheSeed(Gauntlet):
    def reset(self, seed, parameters):
        super().reset(None if seed is None else 7, parameters)


@broken("high_bits_of_a_seed_are_used")
class HalfASeed(Gauntlet):
    def reset(self, seed, parameters):
        super().reset(None if seed is None else seed % 2**32, parameters)


@broken("largest_seeds_give_different_episodes")
class SeedIsADouble(Gauntlet):
    def reset(self, seed, parameters):
        super().reset(None if seed is None else int(float(seed)), parameters)


@broken(
    "arena_does_not_depend_on_the_number_of_arenas",
    "first_arena_selects_the_arena_numbers",
    "arena_numbers_may_exceed_32_bits",
)
class SeedsDependOnTheArenas(Gauntlet):
    def draws(self, arena):
        self.counts[arena, DRAWS] += 1
        key = [self.seed, self.first_arena + arena, self.arenas, self.counts[arena, DRAWS]]
        return np.random.default_rng(key).normal(size=2)


@broken("first_arena_selects_the_arena_numbers")
class IgnoresFirstArena(Gauntlet):
    def __init__(self, options, parameters, arenas, first_arena, seed):
        super().__init__(options, parameters, arenas, 0, seed)


@broken("seed_and_arena_are_two_numbers")
class SeedPlusArena(Gauntlet):
    def draws(self, arena):
        self.counts[arena, DRAWS] += 1
        key = [self.seed + self.first_arena + int(arena), self.counts[arena, DRAWS]]
        return np.random.default_rng(key).normal(size=2)


@broken("arena_numbers_do_not_wrap_around")
class ArenasOf32Bits(Gauntlet):
    def draws(self, arena):
        self.counts[arena, DRAWS] += 1
        key = [self.seed, (self.first_arena + arena) % 2**32, self.counts[arena, DRAWS]]
        return np.random.default_rng(key).normal(size=2)


@broken("reset_without_seed_begins_different_episodes")
class ResetsToTheBeginning(Gauntlet):
    def reset(self, seed, parameters):
        super().reset(self.seed if seed is None else seed, parameters)


# ----------------------------------------------------------------------------------------------------------- steps


@broken("observations_match_the_sensors")
class WrongShape(Honest):
    def later(self, step):
        change(step.behaviors[0].observations[0], floats(step.behaviors[0].observations[0]).reshape(-1))


@broken("observations_are_in_bounds")
class OutOfBounds(Honest):
    def later(self, step):
        change(step.behaviors[0].observations[0], floats(step.behaviors[0].observations[0]) + 19)


@broken("rewards_are_finite")
class RewardIsNotANumber(Honest):
    def later(self, step):
        change(step.behaviors[2].rewards, floats(step.behaviors[2].rewards) * np.float32(np.nan))


@broken("rewards_of_skipped_lanes_are_zero")
class PaysWhoWaits(Honest):
    def later(self, step):
        change(step.behaviors[1].rewards, floats(step.behaviors[1].rewards) + 1)


@broken("no_lane_is_terminated_and_truncated")
class BothEnds(Honest):
    def later(self, step):
        for part in step.behaviors:
            part.truncated.data = bytes(a | b for a, b in zip(part.truncated.data, part.terminated.data, strict=True))
            part.terminated.CopyFrom(part.truncated)


@broken("final_observations_have_a_row_per_ended_lane")
class NoFinalObservation(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.HasField("ended"):
                part.ended.ClearField("final_observations")


@broken("ended_lanes_match_the_flags")
class EndsInAnotherOrder(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.HasField("ended"):
                change(part.ended.lanes, np.frombuffer(part.ended.lanes.data, "<i4")[::-1] + 1)


@broken("interrupted_has_a_flag_per_ended_lane")
class InterruptsWhatIsNotTruncated(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.HasField("ended"):
                part.ended.interrupted.CopyFrom(pack(np.ones(len(of_ended_lanes(part)), bool)))


@broken("interrupted_has_a_flag_per_ended_lane")
class FailsWithinTheKit(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.HasField("ended"):
                truncated = np.frombuffer(part.truncated.data, bool)[of_ended_lanes(part)]
                part.ended.interrupted.CopyFrom(pack(truncated))


@broken("metrics_have_a_row_per_ended_lane")
class NoMetrics(Honest):
    def later(self, step):
        for part in step.behaviors:
            part.ended.ClearField("metrics") if part.HasField("ended") else None


@broken("episodes_are_not_longer_than_max_episode_decisions")
class EpisodesTooLong(Gauntlet):
    longest = LONGEST + 1


@broken("episodes_are_not_longer_than_max_episode_decisions")
class EpisodesTooLongForThoseWhoIdle(EpisodesTooLong):
    """Random actions end an episode early: only who never presses the button plays for long."""

    def step(self, acts):
        self.place[acts[0].choices[:, 1] == 1] = 9.0
        return super().step(acts)


def of_ended_lanes(part):
    """Return the rows of the ended lanes of a BehaviorStep."""
    return np.frombuffer(part.ended.lanes.data, "<i4")


@broken("final_observations_belong_to_the_old_episode")
class ObservesAfterTheReset(Honest):
    def later(self, step):
        for part in step.behaviors:
            for final, new in zip(part.ended.final_observations, part.observations, strict=False):
                change(final, read(new)[of_ended_lanes(part)])


@broken("final_observations_belong_to_the_old_episode")
class ObservesBeforeTheReset(Honest):
    def later(self, step):
        for part in step.behaviors:
            for final, new in zip(part.ended.final_observations, part.observations, strict=False):
                values = read(new)
                values[of_ended_lanes(part)] = read(final)
                change(new, values)


@broken(warned={"metrics_belong_to_the_old_episode"})
class MetricsOfTheNewEpisode(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.ended.HasField("metrics"):
                change(part.ended.metrics, np.zeros_like(read(part.ended.metrics)))


@broken("every_choice_plays_by_the_rules")
class NotANumberInLargeOnly(Gauntlet):
    def part(self, index, happened):
        part = super().part(index, happened)
        if self.cells == 5:
            part.rewards[:] = np.nan
        return part


@broken("every_choice_plays_by_the_rules")
class RandomInLargeOnly(Gauntlet):
    def draws(self, arena):
        return np.random.default_rng().normal(size=2) if self.cells == 5 else super().draws(arena)


@broken("first_masks_are_valid", "masks_are_valid")
class AllowsNothing(Honest):
    def every(self, step):
        mask = step.behaviors[0].masks[1]
        mask.data = bytes(len(mask.data))


# ------------------------------------------------------------------------------------------ pictures and snapshots


@broken("pictures_have_the_size_of_the_spec")
class PicturesOnTheirSide(Honest):
    def later(self, step):
        for picture in step.pictures:
            picture.shape[:2] = reversed(picture.shape[:2])


@broken("pictures_of_ticks_have_the_size_of_the_spec")
class PicturesOfTooManyTicks(Honest):
    def later(self, step):
        step.tick_pictures.extend(2 * list(step.tick_pictures))


@broken("pictures_of_ticks_have_the_size_of_the_spec")
class TicksInGray(Honest):
    def later(self, step):
        for picture in step.tick_pictures:
            picture.shape[2], picture.data = 1, picture.data[::3]


@broken("drawing_does_not_change_the_episode")
class TicksAreReal(Gauntlet):
    def step(self, acts):
        if self.drawn_by_tick is not None:
            self.draws(self.drawn_by_tick)
        return super().step(acts)


@broken("pictures_are_in_the_order_of_draw")
class PicturesInOrderOfArenas(Honest):
    def request(self, request):
        if request.HasField("act"):
            request.act.draw[:] = sorted(request.act.draw)
        return request


@broken("unknown_arena_in_draw_is_refused")
class DrawsAnyArena(Honest):
    def request(self, request):
        if request.HasField("act"):
            request.act.draw[:] = [arena % 2 for arena in request.act.draw]
        return request


@broken("drawing_does_not_change_the_episode")
class DrawingDraws(Gauntlet):
    def draw(self, arena):
        picture = super().draw(arena)
        self.draws(arena)
        return picture


@broken("session_continues_from_a_snapshot", "snapshot_includes_seed_and_parameters_of_reset")
class SnapshotForgets(Gauntlet):
    def restore(self, state):
        super().restore(state)
        self.counts[:, DRAWS] = 0


@broken("snapshot_includes_seed_and_parameters_of_reset")
class SnapshotForgetsTheSeed(Gauntlet):
    def restore(self, state):
        seed = self.seed
        super().restore(state)
        self.seed = seed


@broken("snapshot_includes_seed_and_parameters_of_reset")
class SnapshotForgetsParameters(Gauntlet):
    def restore(self, state):
        drift = self.drift
        super().restore(state)
        self.drift = drift


@broken("values_of_a_snapshot_are_checked")
class RestoresAnything(Gauntlet):
    def check(self, state):
        pass


@broken("snapshot_with_another_seed_is_refused")
class SnapshotOfAnySeed(Honest):
    def request(self, request):
        if request.start.HasField("snapshot"):
            request.start.seed = 1
        return request


@broken("snapshot_is_not_larger_than_the_spec_says")
class LargeSnapshots(Gauntlet):
    def save(self):
        return {**super().save(), "padding": np.zeros(1000, np.uint8)}


# ------------------------------------------------------------------------------------------- sessions and limits


@broken(
    "parallel_sessions_are_independent",
    "reset_does_not_affect_other_sessions",
    "cancelled_session_does_not_affect_others",
    "lost_connection_does_not_affect_other_sessions",
)
class SessionsShareTheirSeed(Gauntlet):
    newest = 0

    def reset(self, seed, parameters):
        SessionsShareTheirSeed.newest = self.newest if seed is None else seed
        super().reset(seed, parameters)

    def draws(self, arena):
        self.seed = self.newest
        return super().draws(arena)


class Leaks(Service):
    """Counts every session for ever."""

    most = 12

    def __init__(self, broken):
        super().__init__(broken)
        self.open = 0

    def Play(self, requests, context):
        if self.open == self.most:
            context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, f"{self.most} sessions are open")
        self.open += 1
        yield from super().Play(requests, context)


class AnswersTwice(Service):
    """Sends the response to every Act twice."""

    def Play(self, requests, context):
        for response in super().Play(requests, context):
            yield response
            if response.HasField("step"):
                yield response


@broken("zero_arenas_are_refused")
class NoArenasIsOne(Honest):
    def request(self, request):
        if request.HasField("start"):
            request.start.arenas = request.start.arenas or 1
        return request


@broken("more_than_max_arenas_are_refused", "largest_number_of_arenas_is_refused")
class TooManyArenasAreInvalid(Honest):
    def answer(self, request):
        if request.start.arenas > 16:
            raise Refusal(pb.REASON_NO_ARENAS, "too many arenas")
        return super().answer(request)
