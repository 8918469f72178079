"""The spec of a game: it is well-formed and the same on every call. Its behaviors are in `behaviors`."""

import math
from collections.abc import Iterator

from joybridge.conformance.client import Status
from joybridge.conformance.expectations import Violation, expect, expect_equal, skip_unless
from joybridge.conformance.names import expect_unique_names, names_of
from joybridge.conformance.registry import check
from joybridge.conformance.subject import Subject
from joybridge.contract.spec import SpecError, check_spec
from joybridge.v1 import bridge_pb2 as pb


@check("GameSpec")
def spec_is_the_same_on_every_call(subject: Subject) -> None:
    """Two calls with the same options return the same spec."""
    first = subject.client.describe(subject.game)
    for _ in range(2):
        _expect_same_spec(subject.client.describe(subject.game), first)


@check("BOUNDS")
def spec_is_within_all_bounds(subject: Subject) -> None:
    """Names, descriptions, labels, lists and numbers of a spec are within the bounds that the manual states."""
    try:
        check_spec(subject.spec)
    except SpecError as error:
        raise Violation(str(error), "a spec within the bounds") from error


@check("GameSpec")
def spec_has_the_name_of_the_game(subject: Subject) -> None:
    """DescribeGame returns the spec of the game with the given name."""
    expect_equal(subject.spec.name, subject.game, "name")


@check("DescribeGameRequest")
def explicit_default_choices_give_the_same_spec(subject: Subject) -> None:
    """An option that is left out has its default choice."""
    skip_unless(subject.spec.options, "the game has no options")
    defaults = {option.name: option.default_choice for option in subject.spec.options}
    _expect_same_spec(subject.client.describe(subject.game, defaults), subject.spec)


@check("DescribeGame")
def every_choice_has_a_valid_spec(subject: Subject) -> None:
    """The spec is well-formed with every choice of every option."""
    for chosen, spec in _specs_of_choices(subject):
        expect_equal(spec.name, subject.game, f"with {chosen}: name")
        try:
            check_spec(spec)
        except SpecError as error:
            raise Violation(f"with {chosen}: {error}", "a well-formed spec") from error


@check("GameSpec")
def spec_of_every_choice_is_the_same_on_every_call(subject: Subject) -> None:
    """Two calls with the same options return the same spec, whatever the calls between them."""
    for chosen, spec in list(_specs_of_choices(subject)):
        _expect_same_spec(subject.client.describe(subject.game, chosen), spec)


@check("GameSpec")
def options_do_not_depend_on_choices(subject: Subject) -> None:
    """A spec has all options, whatever the choices."""
    for chosen, spec in _specs_of_choices(subject):
        same = list(spec.options) == list(subject.spec.options)
        expect(same, f"with {chosen}: options {names_of(spec.options)}", f"the same {names_of(subject.spec.options)}")


@check("GameSpec")
def parameters_do_not_depend_on_choices(subject: Subject) -> None:
    """A spec has all parameters, whatever the choices."""
    for chosen, spec in _specs_of_choices(subject):
        got, expected = names_of(spec.parameters), names_of(subject.spec.parameters)
        expect(sorted(got) == sorted(expected), f"with {chosen}: parameters {got}", f"the same {expected}")


@check("Option")
def option_names_are_unique(subject: Subject) -> None:
    """A name identifies one option."""
    skip_unless(subject.spec.options, "the game has no options")
    expect_unique_names(subject.spec.options, "options")


@check("Option")
def option_default_is_one_of_its_choices(subject: Subject) -> None:
    """default_choice is one of choices."""
    skip_unless(subject.spec.options, "the game has no options")
    for option in subject.spec.options:
        expect(option.default_choice in option.choices, f"{option.default_choice!r}", f"one of {list(option.choices)}")


@check("Option")
def option_choices_are_unique(subject: Subject) -> None:
    """A name identifies one choice of an option."""
    skip_unless(subject.spec.options, "the game has no options")
    for option in subject.spec.options:
        choices = list(option.choices)
        unique = len(set(choices)) == len(choices) >= 1
        expect(unique, f"choices {choices} of option {option.name!r}", "one or more unique names")


@check("Parameter")
def parameter_names_are_unique(subject: Subject) -> None:
    """A name identifies one parameter."""
    skip_unless(subject.spec.parameters, "the game has no parameters")
    expect_unique_names(subject.spec.parameters, "parameters")


@check("Parameter")
def parameter_default_is_in_range(subject: Subject) -> None:
    """default_value is in low..high, inclusive; NaN is not."""
    skip_unless(subject.spec.parameters, "the game has no parameters")
    for p in subject.spec.parameters:
        expect(p.low <= p.default_value <= p.high, f"{p.default_value} of {p.name!r}", f"{p.low}..{p.high}")


@check("GameSpec")
def decision_interval_is_at_least_one(subject: Subject) -> None:
    """decision_interval is at least 1 tick."""
    expect(subject.spec.decision_interval >= 1, "decision_interval 0", "at least 1")


@check("GameSpec")
def tick_seconds_is_not_negative(subject: Subject) -> None:
    """tick_seconds is the game time of one tick, or 0 if the game has no clock."""
    seconds = subject.spec.tick_seconds
    expect(math.isfinite(seconds) and seconds >= 0, f"tick_seconds {seconds}", "a finite number, at least 0")


@check("GameSpec")
def max_arenas_is_at_least_one(subject: Subject) -> None:
    """max_arenas is the largest number of arenas of one session, and a session has at least 1."""
    expect(subject.spec.max_arenas >= 1, "max_arenas 0", "at least 1")


@check("PictureSize")
def picture_size_is_at_least_one_pixel(subject: Subject) -> None:
    """The width and height of a picture are in pixels; a game without pictures has no picture field."""
    skip_unless(subject.spec.HasField("picture"), "the game has no pictures")
    size = subject.spec.picture
    expect(size.width >= 1 and size.height >= 1, f"{size.width} x {size.height}", "at least 1 x 1")


def _specs_of_choices(subject: Subject) -> Iterator[tuple[dict[str, str], pb.GameSpec]]:
    """Yield the spec with each choice of each option, the other options at their defaults."""
    skip_unless(subject.spec.options, "the game has no options")
    for option in subject.spec.options:
        for choice in option.choices:
            chosen = {option.name: choice}
            answer = subject.client.try_describe(subject.game, chosen)
            if isinstance(answer, Status):
                raise Violation(f"{answer} with {chosen}", "a spec")
            yield chosen, answer


def _expect_same_spec(got: pb.GameSpec, expected: pb.GameSpec) -> None:
    different = [field.name for field in pb.GameSpec.DESCRIPTOR.fields
                 if getattr(got, field.name) != getattr(expected, field.name)]  # fmt: skip
    expect(not different, f"a different {' and '.join(different)}", "the same spec")
