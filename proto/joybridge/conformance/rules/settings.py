"""Options and parameters: valid names and values are accepted, all others are refused."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

from joybridge.conformance.client import Stream
from joybridge.conformance.expectations import Suspicion
from joybridge.conformance.recording import expect_same_recording, reset_request, step_bytes
from joybridge.conformance.registry import check, table
from joybridge.conformance.spec_expectations import parts_of
from joybridge.conformance.subject import INVALID_ARGUMENT, LONG_SECONDS, SEED, Subject
from joybridge.v1 import bridge_pb2 as pb

UNKNOWN = "no_such_name"
PLAY = 300  # decisions after which a parameter should have had an effect


def _outside(p: pb.Parameter) -> list[float]:
    return [math.nextafter(p.low, -math.inf), math.nextafter(p.high, math.inf)]


def _infinite(p: pb.Parameter) -> list[float]:
    return [value for value in (math.inf, -math.inf) if not p.low <= value <= p.high]


UNKNOWN_NAMES = (  # name, section, rule, the message, its field
    ("unknown_option_is_refused_by_describe", "DescribeGame",
     "DescribeGame with an unknown option is INVALID_ARGUMENT.", "DescribeGame", "options"),
    ("unknown_option_is_refused_by_start", "Start",
     "Start with an unknown option is INVALID_ARGUMENT.", "Start", "options"),
    ("unknown_parameter_is_refused_by_start", "Start",
     "Start with an unknown parameter is INVALID_ARGUMENT.", "Start", "parameters"),
    ("unknown_parameter_is_refused_by_reset", "Reset",
     "Reset with an unknown parameter is INVALID_ARGUMENT.", "Reset", "parameters"),
)  # fmt: skip
INVALID = (  # name, section, rule, the message, its field, the values of one option or parameter that are invalid
    ("unknown_choice_is_refused_by_describe", "DescribeGame",
     "DescribeGame with a choice that the option does not have is INVALID_ARGUMENT.",
     "DescribeGame", "options", lambda o: [UNKNOWN]),
    ("unknown_choice_is_refused_by_start", "Start",
     "Start with a choice that the option does not have is INVALID_ARGUMENT.", "Start", "options", lambda o: [UNKNOWN]),
    ("empty_choice_is_refused", "Option",
     "An option that is present has the choice that it names; an empty name is not the default.",
     "Start", "options", lambda o: [] if "" in o.choices else [""]),
    ("parameter_above_high_is_refused_by_start", "Parameter", "The value of a parameter is at most high.",
     "Start", "parameters", lambda p: _outside(p)[1:]),
    ("parameter_below_low_is_refused_by_start", "Parameter", "The value of a parameter is at least low.",
     "Start", "parameters", lambda p: _outside(p)[:1]),
    ("nan_parameter_is_refused_by_start", "Parameter", "NaN is in no range.",
     "Start", "parameters", lambda p: [math.nan]),
    ("infinite_parameter_is_refused_by_start", "Parameter", "Infinity is outside of every finite range.",
     "Start", "parameters", _infinite),
    ("parameter_out_of_range_is_refused_by_reset", "Reset",
     "The value of a parameter is in low..high at every Reset.", "Reset", "parameters", _outside),
    ("nan_parameter_is_refused_by_reset", "Reset", "NaN is in no range.", "Reset", "parameters", lambda p: [math.nan]),
)  # fmt: skip


@table(UNKNOWN_NAMES)
def _unknown_name_is_refused(subject: Subject, message: str, field: str) -> None:
    _expect_refused(subject, message, field, UNKNOWN, "on" if field == "options" else 1.0)


@table(INVALID)
def _value_is_refused(subject: Subject, message: str, field: str, values: Callable[[Any], list[Any]]) -> None:
    for part in parts_of(subject.spec, field):
        for value in values(part):
            _expect_refused(subject, message, field, part.name, value)


def _expect_refused(subject: Subject, message: str, field: str, name: str, value: Any) -> None:
    """Raise Violation unless a message with one option or parameter is refused with a text that has its name."""
    if message == "DescribeGame":
        subject.expect_no_spec(subject.game, {name: value}, INVALID_ARGUMENT, [name])
    elif message == "Start":
        fields: dict[str, Any] = {field: {name: value}}
        subject.expect_refused(subject.start(**fields), words=[name])
    else:
        subject.expect_refused(subject.start(), reset_request(parameters={name: value}), words=[name])


@check("Start")
def explicit_default_choices_change_nothing(subject: Subject) -> None:
    """An option that is left out has its default choice."""
    defaults = {option.name: option.default_choice for option in parts_of(subject.spec, "options")}
    expect_same_recording(subject.record(options=defaults), subject.short_session, "with the default choices")


@check("Parameter")
def parameter_at_low_or_high_is_accepted(subject: Subject) -> None:
    """Low and high are inclusive."""
    for p in parts_of(subject.spec, "parameters"):
        for value in (p.low, p.high):
            if math.isfinite(value):
                subject.expect_answered(subject.start(parameters={p.name: value}))


@check("Parameter")
def parameters_have_an_effect(subject: Subject) -> None:
    """A parameter is a number of the game: with some options, its low and its high value give different sessions."""
    for p in parts_of(subject.spec, "parameters"):
        if p.low < p.high and all(same := _same_steps(each, p) for each in _with_each_choice(subject)):
            got = f"the same {same} steps of random play with {p.name!r} {p.low:g} and {p.high:g}"
            raise Suspicion(got, "different episodes, unless random play does not come to where it counts")


@check("Start")
def explicit_default_parameters_change_nothing(subject: Subject) -> None:
    """A parameter that is left out has its default value."""
    defaults = {p.name: p.default_value for p in parts_of(subject.spec, "parameters")}
    expect_same_recording(subject.record(parameters=defaults), subject.short_session, "with the default parameters")


@check("Reset")
def parameter_set_by_reset_acts_as_in_start(subject: Subject) -> None:
    """A Reset with a seed and parameters begins what a new session with them would play."""
    parts_of(subject.spec, "parameters")
    other = subject.other_parameters()
    got = subject.record_reset(reset_request(SEED, other))
    expect_same_recording(got, subject.record(parameters=other), f"after a Reset with {other}")


@check("Reset")
def parameter_omitted_by_reset_keeps_its_value(subject: Subject) -> None:
    """A parameter that is left out of Reset.parameters keeps its value."""
    parts_of(subject.spec, "parameters")
    other = subject.other_parameters()
    got = subject.record_reset(reset_request(SEED), parameters=other)
    expect_same_recording(got, subject.record(parameters=other), f"after Start with {other} and Reset without it")


def _with_each_choice(subject: Subject) -> Iterator[Subject]:
    """Yield the game as it is, then with each other choice of one option."""
    yield subject
    for option in subject.spec.options:
        for choice in option.choices:
            if choice != subject.options.get(option.name, option.default_choice):
                yield Subject(subject.client, subject.game, subject.options | {option.name: choice})


def _same_steps(subject: Subject, parameter: pb.Parameter) -> int:
    """Return how many steps with the low and the high value of a parameter are the same, or 0 if one differs."""
    with Stream(subject.client) as one, Stream(subject.client) as other:
        low = subject.player(one, parameters={parameter.name: parameter.low})
        high = subject.player(other, parameters={parameter.name: parameter.high})
        until = time.monotonic() + LONG_SECONDS
        for _ in range(min(subject.spec.max_episode_decisions or PLAY, PLAY) + 1):
            if low.recording.end or high.recording.end or time.monotonic() > until:
                break
            if step_bytes(low.recording.steps[-1]) != step_bytes(high.recording.steps[-1]):
                return 0
            low.decide()
            high.decide()
        return len(low.recording.steps)
