"""The spec of a game: it is well-formed and the same on every call. Its behaviors are in `behaviors`."""

from collections.abc import Callable, Iterator
from math import isfinite
from typing import Any

from joybridge.conformance.client import Status
from joybridge.conformance.expectations import Violation, expect, expect_equal, skip_unless
from joybridge.conformance.registry import check, table
from joybridge.conformance.spec_expectations import expect_bounds, expect_each, expect_unique_names, names_of, parts_of
from joybridge.conformance.subject import Subject
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
    expect_bounds(subject.spec)


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
        expect_bounds(spec, f"with {chosen}: ")


@check("GameSpec")
def spec_of_every_choice_is_the_same_on_every_call(subject: Subject) -> None:
    """Two calls with the same options return the same spec, whatever the calls between them."""
    for chosen, spec in list(_specs_of_choices(subject)):
        _expect_same_spec(subject.client.describe(subject.game, chosen), spec)


SETTINGS = (  # name, section, rule, field of GameSpec, what of it must be the same
    ("options_do_not_depend_on_choices", "GameSpec", "A spec has all options, whatever the choices.", "options", list),
    (
        "parameters_do_not_depend_on_choices",
        "GameSpec",
        "A spec has all parameters, whatever the choices.",
        "parameters",
        lambda parameters: sorted(names_of(parameters)),
    ),
)


@table(SETTINGS)
def _is_the_same_with_every_choice(subject: Subject, field: str, part: Callable[[Any], object]) -> None:
    for chosen, spec in _specs_of_choices(subject):
        got, expected = getattr(spec, field), getattr(subject.spec, field)
        expect(part(got) == part(expected), f"with {chosen}: {field} {names_of(got)}", f"the same {names_of(expected)}")


NAMED = (  # name, section, rule, field of GameSpec
    ("option_names_are_unique", "Option", "A name identifies one option.", "options"),
    ("parameter_names_are_unique", "Parameter", "A name identifies one parameter.", "parameters"),
)
PARTS = (  # name, section, rule; of each part of a kind: the fields that are shown, what holds, what is expected
    ("option_default_is_one_of_its_choices", "Option", "default_choice is one of choices.",
     "options", ["default_choice", "choices"], lambda o: o.default_choice in o.choices, "one of its choices"),
    ("option_choices_are_unique", "Option", "A name identifies one choice of an option.",
     "options", ["choices"], lambda o: len(set(o.choices)) == len(o.choices) >= 1, "one or more unique names"),
    ("parameter_default_is_in_range", "Parameter", "default_value is in low..high, inclusive; NaN is not.",
     "parameters", ["default_value", "low", "high"], lambda p: p.low <= p.default_value <= p.high, "low..high"),
    ("decision_interval_is_at_least_one", "GameSpec", "decision_interval is at least 1 tick.",
     "spec", ["decision_interval"], lambda s: s.decision_interval >= 1, "at least 1"),
    ("tick_seconds_is_not_negative", "GameSpec",
     "tick_seconds is the game time of one tick, or 0 if the game has no clock.",
     "spec", ["tick_seconds"], lambda s: isfinite(s.tick_seconds) and s.tick_seconds >= 0,
     "a finite number, at least 0"),
    ("max_arenas_is_at_least_one", "GameSpec",
     "max_arenas is the largest number of arenas of one session, and a session has at least 1.",
     "spec", ["max_arenas"], lambda s: s.max_arenas >= 1, "at least 1"),
    ("picture_size_is_at_least_one_pixel", "PictureSize",
     "The width and height of a picture are in pixels; a game without pictures has no picture field.",
     "pictures", ["width", "height"], lambda p: p.width >= 1 and p.height >= 1, "at least 1 x 1"),
)  # fmt: skip


@table(NAMED)
def _names_are_unique(subject: Subject, kind: str) -> None:
    expect_unique_names(parts_of(subject.spec, kind), kind)


@table(PARTS)
def _each_part_holds(
    subject: Subject, kind: str, fields: list[str], holds: Callable[[Any], object], expected: str
) -> None:
    expect_each(subject.spec, kind, fields, holds, expected)


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
    fields = [field.name for field in pb.GameSpec.DESCRIPTOR.fields]
    different = [name for name in fields if getattr(got, name) != getattr(expected, name)]
    expect(not different, f"a different {' and '.join(different)}", "the same spec")
