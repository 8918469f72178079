"""Specs are well-formed, and the same whenever they are asked for."""

import math
from collections.abc import Iterable, Iterator

from joybridge.conformance.registry import check, expect, expect_equal, needs
from joybridge.conformance.subject import Subject
from joybridge.conformance.wire import Ended
from joybridge.contract.spec import SpecError, check_spec, element_count
from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.v1 import bridge_pb2 as pb


@check("ListGames", once=True)
def a_server_lists_its_games(subject: Subject) -> None:
    """ListGames answers with the games this server runs."""
    expect(subject.server.list_games(), "an empty list", "at least one game")


@check("GameSummary", once=True)
def listed_games_have_different_names(subject: Subject) -> None:
    """A name is what DescribeGame and Start are given, so it stands for one game."""
    _expect_names(subject.server.list_games(), "games")


@check("GameSummary", once=True)
def listed_games_are_described_in_a_sentence(subject: Subject) -> None:
    """The description of a listed game is one sentence."""
    for game in subject.server.list_games():
        expect(game.description.strip(), f"no description of {game.name!r}", "one sentence")


@check("ListGames", once=True)
def every_listed_game_can_be_described(subject: Subject) -> None:
    """The names that ListGames gives are what DescribeGame is given."""
    for game in subject.server.list_games():
        subject.server.describe(game.name)


@check("GameSpec")
def two_descriptions_of_a_game_are_equal(subject: Subject) -> None:
    """Two calls with the same options give the same spec."""
    first = subject.server.describe(subject.game)
    for _ in range(2):
        _expect_spec(subject.server.describe(subject.game), first)


@check("GameSpec")
def a_description_is_of_the_game_that_was_asked_for(subject: Subject) -> None:
    """DescribeGame tells everything about one game by its name."""
    expect_equal(subject.spec.name, subject.game, "name")


@check("DescribeGameRequest")
def default_choices_spelled_out_describe_the_same_game(subject: Subject) -> None:
    """An option left out has its default."""
    needs(subject.spec.options, "the game has no options")
    defaults = {option.name: option.default_choice for option in subject.spec.options}
    _expect_spec(subject.server.describe(subject.game, defaults), subject.spec)


@check("DescribeGame")
def every_choice_of_every_option_can_be_described(subject: Subject) -> None:
    """Every choice of an option has a well-formed spec."""
    for chosen, spec in _choices(subject):
        expect_equal(spec.name, subject.game, f"under {chosen}: name")
        try:
            check_spec(spec)
        except SpecError as error:
            expect(False, f"under {chosen}: {error}", "a well-formed spec")


@check("GameSpec")
def every_choice_is_described_the_same_twice(subject: Subject) -> None:
    """Two calls with the same options give the same spec, whatever was asked for between them."""
    for chosen, spec in list(_choices(subject)):
        _expect_spec(subject.server.describe(subject.game, chosen), spec)


@check("GameSpec")
def options_stand_in_every_description(subject: Subject) -> None:
    """A spec has all options, whatever was chosen."""
    for chosen, spec in _choices(subject):
        same = list(spec.options) == list(subject.spec.options)
        expect(same, f"under {chosen}: options {_names(spec.options)}", f"{_names(subject.spec.options)} as ever")


@check("GameSpec")
def parameters_stand_in_every_description(subject: Subject) -> None:
    """A spec has all parameters, whatever was chosen."""
    for chosen, spec in _choices(subject):
        came, wanted = _names(spec.parameters), _names(subject.spec.parameters)
        expect(sorted(came) == sorted(wanted), f"under {chosen}: parameters {came}", f"{wanted} as ever")


@check("Option")
def options_have_different_names(subject: Subject) -> None:
    """An option is chosen by its name."""
    needs(subject.spec.options, "the game has no options")
    _expect_names(subject.spec.options, "options")


@check("Option")
def the_default_of_an_option_is_one_of_its_choices(subject: Subject) -> None:
    """default_choice is one of choices."""
    needs(subject.spec.options, "the game has no options")
    for option in subject.spec.options:
        expect(option.default_choice in option.choices, f"{option.default_choice!r}", f"one of {list(option.choices)}")


@check("Option")
def the_choices_of_an_option_differ(subject: Subject) -> None:
    """An option is given a choice by its name."""
    needs(subject.spec.options, "the game has no options")
    for option in subject.spec.options:
        came = list(option.choices)
        expect(len(set(came)) == len(came) >= 1, f"{came} of option {option.name!r}", "different choices")


@check("Parameter")
def parameters_have_different_names(subject: Subject) -> None:
    """A parameter is set by its name."""
    needs(subject.spec.parameters, "the game has no parameters")
    _expect_names(subject.spec.parameters, "parameters")


@check("Parameter")
def the_default_of_a_parameter_lies_in_its_range(subject: Subject) -> None:
    """A parameter's value lies in low..high, inclusive, and so does its default; NaN does not."""
    needs(subject.spec.parameters, "the game has no parameters")
    for p in subject.spec.parameters:
        expect(p.low <= p.default_value <= p.high, f"{p.default_value} of {p.name!r}", f"{p.low}..{p.high}")


@check("GameSpec")
def a_decision_takes_at_least_one_tick(subject: Subject) -> None:
    """decision_interval is at least 1."""
    expect(subject.spec.decision_interval >= 1, "a decision_interval of 0", "at least 1")


@check("GameSpec")
def a_tick_takes_no_negative_time(subject: Subject) -> None:
    """tick_seconds is the game time of one tick; 0 where the game has no clock."""
    seconds = subject.spec.tick_seconds
    expect(math.isfinite(seconds) and seconds >= 0, f"tick_seconds {seconds}", "a finite number, at least 0")


@check("GameSpec")
def a_session_may_have_at_least_one_arena(subject: Subject) -> None:
    """max_arenas is the most arenas one session may ask for, and a session asks for 1 or more."""
    expect(subject.spec.max_arenas >= 1, "max_arenas 0", "at least 1")


@check("PictureSize")
def a_picture_has_a_size(subject: Subject) -> None:
    """Width and height of a picture are in pixels; without a picture the field is absent."""
    needs(subject.spec.HasField("picture"), "the game cannot be drawn")
    size = subject.spec.picture
    expect(size.width >= 1 and size.height >= 1, f"{size.width} by {size.height}", "at least 1 by 1")


@check("GameSpec")
def behaviors_are_at_least_one_and_have_different_names(subject: Subject) -> None:
    """A game has at least one behavior, each with a name."""
    expect(subject.spec.behaviors, "no behaviors", "at least one")
    _expect_names(subject.spec.behaviors, "behaviors")


@check("Behavior")
def every_behavior_has_agents(subject: Subject) -> None:
    """agents_per_arena is at least 1."""
    for behavior in subject.spec.behaviors:
        expect(behavior.agents_per_arena >= 1, f"{behavior.name}: 0 agents_per_arena", "at least 1")


@check("Behavior")
def every_behavior_senses_something(subject: Subject) -> None:
    """A behavior has at least one sensor, each with a name of its own."""
    for behavior in subject.spec.behaviors:
        expect(behavior.sensors, f"{behavior.name}: no sensors", "at least one")
        _expect_names(behavior.sensors, f"sensors of {behavior.name}")


@check("Device")
def every_device_has_an_axis_or_a_branch(subject: Subject) -> None:
    """A device has at least one of either, axes or branches, each with a name of its own."""
    for behavior in subject.spec.behaviors:
        device = behavior.device
        expect(len(device.axes) + len(device.branches), f"{behavior.name}: an empty device", "an axis or a branch")
        _expect_names(device.axes, f"axes of {behavior.name}")
        _expect_names(device.branches, f"branches of {behavior.name}")


@check("Behavior")
def every_behavior_is_paid(subject: Subject) -> None:
    """A behavior has at least one reward channel, each with a name of its own."""
    for behavior in subject.spec.behaviors:
        expect(behavior.channels, f"{behavior.name}: no channels", "at least one")
        _expect_names(behavior.channels, f"channels of {behavior.name}")


@check("RewardChannel")
def default_weights_are_finite(subject: Subject) -> None:
    """The reward of an experiment is the sum of channel * weight."""
    for behavior in subject.spec.behaviors:
        for channel in behavior.channels:
            expect(math.isfinite(channel.default_weight), f"{channel.default_weight}", "a finite default_weight")


@check("Metric")
def metrics_have_different_names(subject: Subject) -> None:
    """A metric is known by its name."""
    needs(any(behavior.metrics for behavior in subject.spec.behaviors), "the game has no metrics")
    for behavior in subject.spec.behaviors:
        _expect_names(behavior.metrics, f"metrics of {behavior.name}")


@check("Axis")
def every_axis_has_a_finite_range(subject: Subject) -> None:
    """The value of an action lies in [low, high]."""
    needs(any(behavior.device.axes for behavior in subject.spec.behaviors), "the game has no axes")
    for behavior in subject.spec.behaviors:
        for axis in behavior.device.axes:
            holds = math.isfinite(axis.low) and math.isfinite(axis.high) and axis.low < axis.high
            expect(holds, f"{axis.low}..{axis.high} of {axis.name!r}", "finite numbers, low below high")


@check("Branch")
def every_branch_has_at_least_two_choices(subject: Subject) -> None:
    """A branch is one choice of at least two, with a label per choice."""
    needs(any(behavior.device.branches for behavior in subject.spec.behaviors), "the game has no branches")
    for behavior in subject.spec.behaviors:
        for branch in behavior.device.branches:
            came = list(branch.choices)
            expect(
                len(set(came)) == len(came) >= 2, f"{came} of branch {branch.name!r}", "two different labels or more"
            )


@check("Dtype")
def every_sensor_has_a_valid_dtype(subject: Subject) -> None:
    """DTYPE_UNSPECIFIED is never valid."""
    for sensor in _sensors(subject):
        expect(sensor.dtype in NUMPY_TYPES, f"dtype {sensor.dtype} of {sensor.name!r}", "a dtype of the contract")


@check("Sensor")
def every_size_of_a_sensor_is_at_least_one(subject: Subject) -> None:
    """A sensor's shape is without the lanes, every size at least 1."""
    for sensor in _sensors(subject):
        holds = sensor.shape and min(sensor.shape) >= 1
        expect(holds, f"shape {list(sensor.shape)} of {sensor.name!r}", "one size or more, each at least 1")


@check("Sensor")
def the_elements_of_a_sensor_are_all_named_or_none(subject: Subject) -> None:
    """Elements say what each element means; the list may be empty."""
    for sensor in _sensors(subject):
        count = element_count(sensor)
        expect(
            len(sensor.elements) in (0, count), f"{len(sensor.elements)} elements of {sensor.name!r}", f"0 or {count}"
        )


@check("Sensor")
def the_bounds_of_a_sensor_are_none_or_one_or_one_each(subject: Subject) -> None:
    """A bound is given per element, or one for all, or not at all."""
    for sensor in _sensors(subject):
        count = element_count(sensor)
        for bounds in (sensor.low, sensor.high):
            expect(len(bounds) in (0, 1, count), f"{len(bounds)} bounds of {sensor.name!r}", f"0, 1 or {count}")


@check("Sensor")
def no_sensor_has_its_low_above_its_high(subject: Subject) -> None:
    """Low is the smallest value and high the largest."""
    for sensor in _sensors(subject):
        count = max(len(sensor.low), len(sensor.high))
        if sensor.low and sensor.high and {len(sensor.low), len(sensor.high)} <= {1, count}:
            lows, highs = ([*bounds] * (count // len(bounds)) for bounds in (sensor.low, sensor.high))
            holds = all(low <= high for low, high in zip(lows, highs, strict=True))
            expect(holds, f"low {lows} and high {highs} of {sensor.name!r}", "no low above its high")


def _choices(subject: Subject) -> Iterator[tuple[dict[str, str], pb.GameSpec]]:
    """Yield the specs with one option changed at a time."""
    needs(subject.spec.options, "the game has no options")
    for option in subject.spec.options:
        for choice in option.choices:
            chosen = {option.name: choice}
            answer = subject.server.try_describe(subject.game, chosen)
            if isinstance(answer, Ended):
                expect(False, f"{answer} for {chosen}", "a spec")
            else:
                yield chosen, answer


def _sensors(subject: Subject) -> Iterator[pb.Sensor]:
    for behavior in subject.spec.behaviors:
        yield from behavior.sensors


def _names(things: Iterable[pb.Option | pb.Parameter]) -> list[str]:
    return [thing.name for thing in things]


def _expect_names(things: Iterable[object], what: str) -> None:
    names = [str(getattr(thing, "name", "")) for thing in things]
    expect(all(names) and len(set(names)) == len(names), f"{what} {names}", "names that differ and are not empty")


def _expect_spec(came: pb.GameSpec, wanted: pb.GameSpec) -> None:
    differing = [field.name for field in pb.GameSpec.DESCRIPTOR.fields
                 if getattr(came, field.name) != getattr(wanted, field.name)]  # fmt: skip
    expect(not differing, f"another {' and '.join(differing)}", "the same spec")
