"""Options and parameters: valid names and values are accepted, all others are refused."""

import math
import time
from collections.abc import Iterator

from joybridge.conformance.client import Status, Stream
from joybridge.conformance.expectations import Suspicion, Violation, skip_unless
from joybridge.conformance.recording import Player, Recording, expect_same_recording, reset_request, step_bytes
from joybridge.conformance.registry import check
from joybridge.conformance.subject import (
    INVALID_ARGUMENT,
    LONG_SECONDS,
    SEED,
    SHORT,
    Subject,
    expect_error,
)
from joybridge.v1 import bridge_pb2 as pb

UNKNOWN = "no_such_name"
PLAY = 300  # decisions after which a parameter should have had an effect


@check("DescribeGame")
def unknown_option_is_refused_by_describe(subject: Subject) -> None:
    """DescribeGame with an unknown option is INVALID_ARGUMENT."""
    _expect_no_spec(subject, {UNKNOWN: "on"}, UNKNOWN)


@check("DescribeGame")
def unknown_choice_is_refused_by_describe(subject: Subject) -> None:
    """DescribeGame with a choice that the option does not have is INVALID_ARGUMENT."""
    for option in _options(subject):
        _expect_no_spec(subject, {option.name: UNKNOWN}, option.name)


@check("Start")
def unknown_option_is_refused_by_start(subject: Subject) -> None:
    """Start with an unknown option is INVALID_ARGUMENT."""
    subject.expect_refused(subject.start(options={UNKNOWN: "on"}), words=[UNKNOWN])


@check("Start")
def unknown_choice_is_refused_by_start(subject: Subject) -> None:
    """Start with a choice that the option does not have is INVALID_ARGUMENT."""
    for option in _options(subject):
        subject.expect_refused(subject.start(options={option.name: UNKNOWN}), words=[option.name])


@check("Option")
def empty_choice_is_refused(subject: Subject) -> None:
    """An option that is present has the choice that it names; an empty name is not the default."""
    for option in _options(subject):
        if "" not in option.choices:
            subject.expect_refused(subject.start(options={option.name: ""}), words=[option.name])


@check("Start")
def explicit_default_choices_change_nothing(subject: Subject) -> None:
    """An option that is left out has its default choice."""
    defaults = {option.name: option.default_choice for option in _options(subject)}
    expect_same_recording(subject.record(options=defaults), subject.short_session, "with the default choices")


@check("Start")
def unknown_parameter_is_refused_by_start(subject: Subject) -> None:
    """Start with an unknown parameter is INVALID_ARGUMENT."""
    subject.expect_refused(subject.start(parameters={UNKNOWN: 1.0}), words=[UNKNOWN])


@check("Parameter")
def parameter_above_high_is_refused_by_start(subject: Subject) -> None:
    """The value of a parameter is at most high."""
    for p in _parameters(subject):
        subject.expect_refused(subject.start(parameters={p.name: math.nextafter(p.high, math.inf)}), words=[p.name])


@check("Parameter")
def parameter_below_low_is_refused_by_start(subject: Subject) -> None:
    """The value of a parameter is at least low."""
    for p in _parameters(subject):
        subject.expect_refused(subject.start(parameters={p.name: math.nextafter(p.low, -math.inf)}), words=[p.name])


@check("Parameter")
def nan_parameter_is_refused_by_start(subject: Subject) -> None:
    """NaN is in no range."""
    for p in _parameters(subject):
        subject.expect_refused(subject.start(parameters={p.name: math.nan}), words=[p.name])


@check("Parameter")
def infinite_parameter_is_refused_by_start(subject: Subject) -> None:
    """Infinity is outside of every finite range."""
    for p in _parameters(subject):
        for value in (math.inf, -math.inf):
            if not p.low <= value <= p.high:
                subject.expect_refused(subject.start(parameters={p.name: value}), words=[p.name])


@check("Parameter")
def parameter_at_low_or_high_is_accepted(subject: Subject) -> None:
    """Low and high are inclusive."""
    for p in _parameters(subject):
        for value in (p.low, p.high):
            if math.isfinite(value):
                subject.expect_answered(subject.start(parameters={p.name: value}))


@check("Parameter")
def parameters_have_an_effect(subject: Subject) -> None:
    """A parameter is a number of the game: a session with its low value differs from one with its high value."""
    for p in _parameters(subject):
        if p.low < p.high and (same := _same_steps(subject, p)):
            raise Suspicion(f"the same {same} steps with {p.name!r} {p.low:g} and {p.high:g}", "different episodes")


@check("Start")
def explicit_default_parameters_change_nothing(subject: Subject) -> None:
    """A parameter that is left out has its default value."""
    defaults = {p.name: p.default_value for p in _parameters(subject)}
    expect_same_recording(subject.record(parameters=defaults), subject.short_session, "with the default parameters")


@check("Reset")
def unknown_parameter_is_refused_by_reset(subject: Subject) -> None:
    """Reset with an unknown parameter is INVALID_ARGUMENT."""
    subject.expect_refused(subject.start(), reset_request(parameters={UNKNOWN: 1.0}), words=[UNKNOWN])


@check("Reset")
def parameter_out_of_range_is_refused_by_reset(subject: Subject) -> None:
    """The value of a parameter is in low..high at every Reset."""
    for p in _parameters(subject):
        for value in (math.nextafter(p.low, -math.inf), math.nextafter(p.high, math.inf)):
            subject.expect_refused(subject.start(), reset_request(parameters={p.name: value}), words=[p.name])


@check("Reset")
def nan_parameter_is_refused_by_reset(subject: Subject) -> None:
    """NaN is in no range."""
    for p in _parameters(subject):
        subject.expect_refused(subject.start(), reset_request(parameters={p.name: math.nan}), words=[p.name])


@check("Reset")
def parameter_set_by_reset_acts_as_in_start(subject: Subject) -> None:
    """A Reset with a seed and parameters begins what a new session with them would play."""
    other = _other_parameters(subject)
    got = subject.record(2 * SHORT + 1, resets={SHORT: reset_request(SEED, other)})
    got.steps = got.steps[SHORT + 1 :]
    expect_same_recording(got, subject.record(parameters=other), f"after a Reset with {other}")


@check("Reset")
def parameter_omitted_by_reset_keeps_its_value(subject: Subject) -> None:
    """A parameter that is left out of Reset.parameters keeps its value."""
    other = _other_parameters(subject)
    got = subject.record(2 * SHORT + 1, resets={SHORT: reset_request(SEED)}, parameters=other)
    got.steps = got.steps[SHORT + 1 :]
    expect_same_recording(got, subject.record(parameters=other), f"after Start with {other} and Reset without it")


def _options(subject: Subject) -> Iterator[pb.Option]:
    skip_unless(subject.spec.options, "the game has no options")
    yield from subject.spec.options


def _parameters(subject: Subject) -> Iterator[pb.Parameter]:
    skip_unless(subject.spec.parameters, "the game has no parameters")
    yield from subject.spec.parameters


def _same_steps(subject: Subject, parameter: pb.Parameter) -> int:
    """Return how many steps with the low and the high value of a parameter are the same, or 0 if one differs."""
    with Stream(subject.client) as one, Stream(subject.client) as other:
        low, high = (
            Player(stream, Recording(subject.spec, subject.arenas), subject.start(parameters={parameter.name: value}))
            for stream, value in ((one, parameter.low), (other, parameter.high))
        )
        until = time.monotonic() + LONG_SECONDS
        for _ in range(min(subject.spec.max_episode_decisions or PLAY, PLAY) + 1):
            if low.recording.end or high.recording.end or time.monotonic() > until:
                break
            if step_bytes(low.recording.steps[-1]) != step_bytes(high.recording.steps[-1]):
                return 0
            low.decide()
            high.decide()
        return len(low.recording.steps)


def _other_parameters(subject: Subject) -> dict[str, float]:
    """Return a value for each parameter: low or high, whichever is not its default."""
    return {p.name: p.low if p.default_value != p.low else p.high for p in _parameters(subject)}


def _expect_no_spec(subject: Subject, options: dict[str, str], word: str) -> None:
    answer = subject.client.try_describe(subject.game, options)
    if not isinstance(answer, Status):
        raise Violation(f"a spec for {options}", "INVALID_ARGUMENT")
    expect_error(answer, [INVALID_ARGUMENT], [word])
