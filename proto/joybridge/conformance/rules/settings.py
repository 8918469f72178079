"""Options and parameters: what is offered is taken, and nothing else."""

import math
from collections.abc import Iterator

from joybridge.conformance.registry import Broken, check, needs
from joybridge.conformance.subject import FEW, INVALID, SEED, Subject, expect_refusal, expect_same, reset_request
from joybridge.conformance.wire import Ended
from joybridge.v1 import bridge_pb2 as pb

NOWHERE = "no_such_name"


@check("DescribeGame")
def an_unknown_option_is_refused_by_describe(subject: Subject) -> None:
    """DescribeGame answers INVALID_ARGUMENT for an unknown option."""
    _expect_no_description(subject, {NOWHERE: "on"}, NOWHERE)


@check("DescribeGame")
def an_unknown_choice_is_refused_by_describe(subject: Subject) -> None:
    """DescribeGame answers INVALID_ARGUMENT for a choice that the option does not have."""
    for option in _options(subject):
        _expect_no_description(subject, {option.name: NOWHERE}, option.name)


@check("Start")
def an_unknown_option_is_refused_by_start(subject: Subject) -> None:
    """The content of a message is wrong: an option that the game does not have."""
    subject.refused(subject.start(options={NOWHERE: "on"}), words=[NOWHERE])


@check("Start")
def an_unknown_choice_is_refused_by_start(subject: Subject) -> None:
    """The content of a message is wrong: a choice that the option does not have."""
    for option in _options(subject):
        subject.refused(subject.start(options={option.name: NOWHERE}), words=[option.name])


@check("Option")
def an_empty_choice_is_not_the_default(subject: Subject) -> None:
    """An option left out has its default; one that is there has the choice that it names."""
    for option in _options(subject):
        if "" not in option.choices:
            subject.refused(subject.start(options={option.name: ""}), words=[option.name])


@check("Start")
def default_choices_spelled_out_play_the_same(subject: Subject) -> None:
    """An option left out has its default."""
    defaults = {option.name: option.default_choice for option in _options(subject)}
    expect_same(subject.record(options=defaults), subject.brief, "with the default choices")


@check("Start")
def an_unknown_parameter_is_refused_by_start(subject: Subject) -> None:
    """The content of a message is wrong: a parameter that the game does not have."""
    subject.refused(subject.start(parameters={NOWHERE: 1.0}), words=[NOWHERE])


@check("Parameter")
def a_parameter_above_its_range_is_refused_by_start(subject: Subject) -> None:
    """The largest value of a parameter is high."""
    for p in _parameters(subject):
        subject.refused(subject.start(parameters={p.name: math.nextafter(p.high, math.inf)}), words=[p.name])


@check("Parameter")
def a_parameter_below_its_range_is_refused_by_start(subject: Subject) -> None:
    """The smallest value of a parameter is low."""
    for p in _parameters(subject):
        subject.refused(subject.start(parameters={p.name: math.nextafter(p.low, -math.inf)}), words=[p.name])


@check("Parameter")
def a_parameter_that_is_nan_is_refused_by_start(subject: Subject) -> None:
    """NaN lies in no range."""
    for p in _parameters(subject):
        subject.refused(subject.start(parameters={p.name: math.nan}), words=[p.name])


@check("Parameter")
def a_parameter_that_is_infinite_is_refused_by_start(subject: Subject) -> None:
    """Infinity lies in no range that ends."""
    for p in _parameters(subject):
        for value in (math.inf, -math.inf):
            if not p.low <= value <= p.high:
                subject.refused(subject.start(parameters={p.name: value}), words=[p.name])


@check("Parameter")
def a_parameter_may_be_at_either_end_of_its_range(subject: Subject) -> None:
    """Low and high are inclusive."""
    for p in _parameters(subject):
        for value in (p.low, p.high):
            if math.isfinite(value):
                subject.answered(subject.start(parameters={p.name: value}))


@check("Start")
def default_parameters_spelled_out_play_the_same(subject: Subject) -> None:
    """A parameter left out has its default."""
    defaults = {p.name: p.default_value for p in _parameters(subject)}
    expect_same(subject.record(parameters=defaults), subject.brief, "with the default parameters")


@check("Reset")
def an_unknown_parameter_is_refused_by_reset(subject: Subject) -> None:
    """The content of a message is wrong: a parameter that the game does not have."""
    subject.refused(subject.start(), reset_request(parameters={NOWHERE: 1.0}), words=[NOWHERE])


@check("Reset")
def a_parameter_out_of_its_range_is_refused_by_reset(subject: Subject) -> None:
    """A parameter's value lies in low..high at any Reset, too."""
    for p in _parameters(subject):
        for value in (math.nextafter(p.low, -math.inf), math.nextafter(p.high, math.inf)):
            subject.refused(subject.start(), reset_request(parameters={p.name: value}), words=[p.name])


@check("Reset")
def a_parameter_that_is_nan_is_refused_by_reset(subject: Subject) -> None:
    """NaN lies in no range."""
    for p in _parameters(subject):
        subject.refused(subject.start(), reset_request(parameters={p.name: math.nan}), words=[p.name])


@check("Reset")
def a_parameter_set_by_reset_plays_as_if_set_by_start(subject: Subject) -> None:
    """With a seed, what follows is what a new session with that seed, and these parameters, would play."""
    other = _other_parameters(subject)
    wanted = subject.record(parameters=other)
    came = subject.record(2 * FEW + 1, resets={FEW: reset_request(SEED, other)})
    came.steps = came.steps[FEW + 1 :]
    expect_same(came, wanted, f"after a reset with {other}")


@check("Reset")
def a_parameter_left_out_of_a_reset_keeps_its_value(subject: Subject) -> None:
    """What is left out of Reset.parameters keeps its value."""
    other = _other_parameters(subject)
    wanted = subject.record(parameters=other)
    came = subject.record(2 * FEW + 1, resets={FEW: reset_request(SEED)}, parameters=other)
    came.steps = came.steps[FEW + 1 :]
    expect_same(came, wanted, f"after a start with {other} and a reset without")


def _options(subject: Subject) -> Iterator[pb.Option]:
    needs(subject.spec.options, "the game has no options")
    yield from subject.spec.options


def _parameters(subject: Subject) -> Iterator[pb.Parameter]:
    needs(subject.spec.parameters, "the game has no parameters")
    yield from subject.spec.parameters


def _other_parameters(subject: Subject) -> dict[str, float]:
    """Return a value for each parameter that is not its default, where it has another."""
    return {p.name: p.low if p.default_value != p.low else p.high for p in _parameters(subject)}


def _expect_no_description(subject: Subject, options: dict[str, str], word: str) -> None:
    answer = subject.server.try_describe(subject.game, options)
    if not isinstance(answer, Ended):
        raise Broken(f"a spec for {options}", "a refusal with INVALID_ARGUMENT")
    expect_refusal(answer, [INVALID], [word])
