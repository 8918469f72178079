"""Parameters per episode: distributions are drawn from as the contract says, or refused."""

import math
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from itertools import islice

import numpy as np

from joybridge.conformance.client import Stream
from joybridge.conformance.expectations import Violation, expect, skip_unless
from joybridge.conformance.recording import (
    Recording,
    act_request,
    expect_same_bytes,
    expect_same_recording,
    reset_request,
    step_bytes,
)
from joybridge.conformance.registry import check, table
from joybridge.conformance.step_expectations import expect_tensor
from joybridge.conformance.step_view import StepView, arena_rows, read_tensor
from joybridge.conformance.subject import FAILED_PRECONDITION, SEED, SHORT, Subject, only
from joybridge.contract.limits import MAX_VALUES
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

UNKNOWN = "no_such_name"
OF_A_BATCH = 4  # arenas


def _uniform(low: float, high: float) -> pb.Distribution:
    return pb.Distribution(uniform=pb.Interval(low=low, high=high))


def _out_of_range(p: pb.Parameter) -> list[pb.Distribution]:
    below, above = math.nextafter(p.low, -math.inf), math.nextafter(p.high, math.inf)
    return [only(below), only(above), only(math.nan), _uniform(below, p.high), _uniform(p.low, above)]


def _impossible(p: pb.Parameter) -> list[pb.Distribution]:
    choices = [pb.Distribution(choice=pb.Values(values=[p.low] * count)) for count in (0, MAX_VALUES + 1)]
    logarithm = pb.Distribution(log_uniform=pb.Interval(low=max(p.low, 0.0), high=p.high))
    intervals = [_uniform(p.high, p.low), _uniform(p.low, math.nan), *[logarithm] * (p.low <= 0 < p.high)]
    return [pb.Distribution(), *intervals, *choices]


INVALID = (  # name, section, rule, how many of Start, Reset and Act, what is refused for each parameter
    (
        "numbers_of_a_distribution_are_in_the_range_of_the_parameter",
        "Distribution",
        "All numbers of a distribution are within low .. high of its parameter, and numbers.",
        3,
        _out_of_range,
    ),
    (
        "distribution_that_cannot_be_drawn_from_is_refused",
        "Distribution",
        "A distribution is of one kind; low is below high, and above 0 for a logarithm; a choice has 1 to 100 values.",
        1,
        _impossible,
    ),
)


@check("PARAMETERS PER EPISODE")
def distributions_are_refused_without_the_flag(subject: Subject) -> None:
    """Without parameters_per_episode, distributions are refused with FAILED_PRECONDITION, in every message."""
    skip_unless(not subject.spec.parameters_per_episode, "the game has parameters_per_episode")
    name, value = next(((p.name, p.default_value) for p in subject.spec.parameters), (UNKNOWN, 0.0))
    for requests in _messages(subject, {name: only(value)}):
        subject.expect_refused(*requests, codes=[FAILED_PRECONDITION], words=[name])


@check("PARAMETERS PER EPISODE")
def distribution_of_an_unknown_parameter_is_refused(subject: Subject) -> None:
    """A distribution of an unknown parameter is INVALID_ARGUMENT, in every message."""
    _require_flag(subject)
    for requests in _messages(subject, {UNKNOWN: only(1.0)}):
        subject.expect_refused(*requests, words=[UNKNOWN])


@table(INVALID)
def _distribution_is_refused(
    subject: Subject, messages: int, invalid: Callable[[pb.Parameter], list[pb.Distribution]]
) -> None:
    for p in _parameters(subject):
        for distribution in invalid(p):
            for requests in islice(_messages(subject, {p.name: distribution}), messages):
                subject.expect_refused(*requests, words=[p.name])


@check("PARAMETERS PER EPISODE")
def value_and_distribution_together_are_refused(subject: Subject) -> None:
    """One message does not give both a value and a distribution of one parameter."""
    for p in _parameters(subject):
        values, distributions = {p.name: p.low}, {p.name: only(p.low)}
        start = subject.start(parameters=values, distributions=distributions)
        subject.expect_refused(start, words=[p.name])
        subject.expect_refused(subject.start(), reset_request(None, values, distributions), words=[p.name])


@check("Distribution")
def choice_of_one_value_plays_as_this_value(subject: Subject) -> None:
    """A choice of one value plays as the parameter with this value does."""
    for p in _parameters(subject):
        for value in (p.low, p.high):
            got = subject.record(4 * SHORT, distributions={p.name: only(value)})
            _expect_same_play(got, subject.record(4 * SHORT, parameters={p.name: value}), f"with {p.name!r} {value:g}")


@check("Ended")
def parameters_of_ended_episodes_are_reported(subject: Subject) -> None:
    """Ended.parameters is FLOAT32 [ended, parameters] while a parameter has a distribution, and else absent."""
    _require_flag(subject)
    for view in _ends(subject.drawn_session):
        shape = int(view.ended.sum()), len(subject.spec.parameters)
        expect_tensor(view.message.ended.parameters, pb.DTYPE_FLOAT32, shape, f"ended.parameters of {view.where}")
    for view in subject.long_session.later:
        got = f"ended.parameters of {view.where} in a session without distributions"
        expect(not view.message.ended.HasField("parameters"), got, "no such field")


@check("Distribution")
def drawn_values_are_in_the_interval(subject: Subject) -> None:
    """The values of a uniform distribution are within its interval, compared as 32-bit floats."""
    for values in _drawn(subject).values():
        for p, column in zip(subject.spec.parameters, values.T, strict=True):
            outside = column[~((column >= np.float32(p.low)) & (column <= np.float32(p.high)))]
            expect(not outside.size, f"{p.name!r} of {outside[:1]}", f"{p.low:g} to {p.high:g}")


@check("PARAMETERS PER EPISODE")
def every_episode_of_every_arena_draws_anew(subject: Subject) -> None:
    """Each episode of each arena draws a value of its own."""
    drawn = np.concatenate(list(_drawn(subject).values()))
    skip_unless(len(drawn) > 1, "only one episode ended")
    for p, column in zip(subject.spec.parameters, drawn.T, strict=True):
        if p.low < p.high:
            got = f"{p.name!r} of {column[0]:g} in all {len(column)} episodes"
            expect(len(np.unique(column)) > 1, got, "different values")


@check("DETERMINISM")
def values_do_not_depend_on_the_number_of_arenas(subject: Subject) -> None:
    """The values that an arena draws depend on its number and the seed, not on the other arenas of the session."""
    _require_flag(subject)
    skip_unless(subject.spec.max_arenas >= OF_A_BATCH, f"max_arenas is {subject.spec.max_arenas}")
    resets = {index: reset_request() for index in range(SHORT, 4 * SHORT, SHORT)}  # so that episodes begin
    batch = subject.record(4 * SHORT, OF_A_BATCH, resets=resets, distributions=subject.uniform())
    for first, arenas in ((0, 1), (1, 1), (2, 2)):
        part = subject.record(4 * SHORT, arenas, resets, first_arena=first, distributions=subject.uniform())
        for step, (one, all_) in enumerate(zip(part.steps, batch.steps, strict=True)):
            rows, wanted = arena_rows(one, subject.spec, arenas), arena_rows(all_, subject.spec, OF_A_BATCH)
            got = f"different bytes in step {step} of arenas {first} to {first + arenas - 1}, played alone"
            expect(rows == wanted[first : first + arenas], got, "those of the larger session")


@check("DETERMINISM")
def same_seed_draws_the_same_values(subject: Subject) -> None:
    """The values depend on the seed: a second session, and a Reset with the seed, draw them again."""
    _require_flag(subject)
    first = subject.record(distributions=subject.uniform())
    expect_same_recording(subject.record(distributions=subject.uniform()), first, "of a second session")
    again = subject.record_reset(reset_request(SEED), distributions=subject.uniform())
    expect_same_recording(again, first, "after a Reset with the seed")


@check("PARAMETERS PER EPISODE")
def distributions_of_act_hold_from_the_next_episode_on(subject: Subject) -> None:
    """Act.distributions change no running episode; later ones draw from them."""
    values = _others(subject)
    with Stream(subject.client) as stream, Stream(subject.client) as other:
        changed, plain = (subject.player(one, 1) for one in (stream, other))
        for decision in range(SHORT):
            changed.decide({name: only(value) for name, value in values.items()} if decision == 0 else None)
            plain.decide()
            if any(view.ended.any() for view in plain.recording.views(len(plain.recording.steps) - 1)):
                break  # the next episode has begun
            _expect_same_play(changed.recording, plain.recording, "after Act.distributions, in the running episode")
        changed.begin(reset_request(SEED))
        plain.begin(reset_request(SEED, values))
        for _ in range(SHORT):
            changed.decide()
            plain.decide()
    begun = -SHORT - 1
    changed.recording.steps, plain.recording.steps = changed.recording.steps[begun:], plain.recording.steps[begun:]
    _expect_same_play(changed.recording, plain.recording, f"in the episode after Act.distributions of {values}")


@check("PARAMETERS PER EPISODE")
def value_in_reset_ends_the_distribution(subject: Subject) -> None:
    """A value in Reset.parameters ends the distribution of its parameter."""
    values = _others(subject)
    got = subject.record_reset(reset_request(SEED, values), distributions=subject.uniform())
    expect_same_recording(got, subject.record(parameters=values), f"after a Reset with {values}")


@check("Snapshot")
def session_from_a_snapshot_draws_the_same_values(subject: Subject) -> None:
    """A session that continues from a snapshot with the same distributions draws what the saved one draws."""
    _require_flag(subject)
    skip_unless(subject.spec.snapshot_bytes_per_arena, "the game has no snapshots")
    with Stream(subject.client) as stream, Stream(subject.client) as other:
        saved = subject.player(stream, distributions=subject.uniform())
        saved.send(reset_request())
        for _ in range(SHORT):
            saved.decide()
        expect(not saved.recording.end, f"{saved.recording.end} before the Save", "a session")
        saved.save()
        before = len(saved.recording.steps)
        player = subject.player(other, distributions=subject.uniform(), snapshot=saved.recording.snapshot)
        player.generators = deepcopy(saved.generators)
        for one in (saved, player):
            for _ in range(SHORT):
                one.decide()
            one.send(reset_request())
            for _ in range(SHORT):
                one.decide()
    got = player.recording
    expect(got.end is None, f"{got.end} after {len(got.steps)} responses", "a session from the snapshot")
    expect_same_bytes(got.step_bytes[1:], saved.recording.step_bytes[before:], "after the snapshot")


def _require_flag(subject: Subject) -> None:
    skip_unless(subject.spec.parameters_per_episode, "the game does not draw parameters per episode")
    skip_unless(subject.spec.parameters, "the game has no parameters")


def _parameters(subject: Subject) -> Iterator[pb.Parameter]:
    _require_flag(subject)
    yield from subject.spec.parameters


def _others(subject: Subject) -> dict[str, float]:
    """Return a value for each parameter: low or high, whichever is not its default."""
    _require_flag(subject)
    return subject.other_parameters()


def _messages(subject: Subject, distributions: Mapping[str, pb.Distribution]) -> Iterator[list[pb.PlayRequest]]:
    """Yield the requests of three streams, the last of each with these distributions: Start, Reset and Act."""
    yield [subject.start(distributions=distributions)]
    yield [subject.start(), reset_request(distributions=distributions)]
    before, act, _ = subject.acting(0)
    yield [*before, act_request(pb.Act(behaviors=act.behaviors, distributions=distributions))]


def _ends(recording: Recording) -> Iterator[StepView]:
    """Yield the views in which an episode ended. Raises NotApplicable if there are none."""
    expect(recording.steps, f"{recording.end} in response to Start with distributions", "Started")
    views = [view for view in recording.later if view.ended.any()]
    skip_unless(views, "no episode ended in the long session")
    yield from views


def _drawn(subject: Subject) -> dict[str, Array]:
    """Return the parameters of all episodes that ended in the drawn session, [ended, parameters], per behavior."""
    _require_flag(subject)
    rows: dict[str, list[Array]] = {}
    for view in _ends(subject.drawn_session):
        shape = int(view.ended.sum()), len(subject.spec.parameters)
        values = read_tensor(view.message.ended.parameters, pb.DTYPE_FLOAT32, shape)
        if values is None:
            raise Violation(f"malformed ended.parameters of {view.where}", f"FLOAT32 {list(shape)}")
        rows.setdefault(view.behavior.name, []).append(values)
    return {name: np.concatenate(values) for name, values in rows.items()}


def _expect_same_play(got: Recording, expected: Recording, when: str) -> None:
    """Raise Violation unless two recordings are the same but for the parameters that they report."""
    expect(got.end is None, f"{got.end} {when}", "a session")
    expect_same_bytes([_unreported(s) for s in got.steps], [_unreported(s) for s in expected.steps], when)


def _unreported(step: pb.Step) -> bytes:
    copied = pb.Step()
    copied.CopyFrom(step)
    for behavior in copied.behaviors:
        if behavior.HasField("ended"):
            behavior.ended.ClearField("parameters")
    return step_bytes(copied)
