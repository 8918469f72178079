"""Servers that break rules of options, parameters and distributions."""

import numpy as np

from joybridge.simulator import draw_parameters
from joybridge.simulator import session as sessions
from joybridge.v1 import bridge_pb2 as pb
from tests.support.broken_servers.gauntlet import Gauntlet
from tests.support.broken_servers.serving import Honest, broken


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
