"""Servers whose spec, or first step, is wrong."""

from joybridge.simulator import session as sessions
from joybridge.v1 import bridge_pb2 as pb
from tests.support.broken_servers.gauntlet import Gauntlet
from tests.support.broken_servers.serving import Honest, broken, change, floats


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
