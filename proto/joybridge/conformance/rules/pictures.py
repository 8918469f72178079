"""Pictures: their size and order, and invalid requests to draw."""

from collections.abc import Callable, Sequence

from joybridge.conformance.expectations import Violation, expect, skip_unless
from joybridge.conformance.recording import act_request, step_bytes
from joybridge.conformance.registry import check, table
from joybridge.conformance.step_expectations import expect_tensor
from joybridge.conformance.subject import FAILED_PRECONDITION, INVALID_ARGUMENT, Subject
from joybridge.contract.limits import MAX_PICTURES, max_pictures
from joybridge.v1 import bridge_pb2 as pb


@check("Step")
def pictures_have_the_size_of_the_spec(subject: Subject) -> None:
    """Pictures are UINT8 [height, width, 3]."""
    size = _size(subject)
    for picture in _draw(subject, [0, subject.arenas - 1]):
        expect_tensor(picture, pb.DTYPE_UINT8, size, "a picture")


@check("Step")
def every_entry_of_draw_gives_a_picture(subject: Subject) -> None:
    """A step has one picture per entry of Act.draw, also if an arena is listed twice."""
    last = subject.arenas - 1
    for draw in ([0], [last], [0, last], [last, last, 0]):
        got = len(_draw(subject, draw))
        expect(got == len(draw), f"{got} pictures for draw {draw}", len(draw))


@check("Step")
def pictures_are_in_the_order_of_draw(subject: Subject) -> None:
    """Pictures are in the order of Act.draw."""
    skip_unless(subject.arenas > 1, "max_arenas is 1")
    forward, backward = _draw(subject, [0, 1]), _draw(subject, [1, 0])
    reversed_ = forward[:1] == backward[1:] and forward[1:] == backward[:1]
    expect(reversed_, "pictures in another order", "those of arenas 1, 0 for draw [1, 0]")


@check("DETERMINISM")
def pictures_are_deterministic(subject: Subject) -> None:
    """The same seed and actions give the same bytes, including pictures."""
    both = [0, subject.arenas - 1]
    same = _draw(subject, both) == _draw(subject, both)
    expect(same, "different pictures in a second session", "the same bytes")


@check("Step")
def pictures_of_ticks_have_the_size_of_the_spec(subject: Subject) -> None:
    """The ticks before the last have at most decision_interval - 1 pictures, UINT8 [height, width, 3] each."""
    size, most = _size(subject), subject.spec.decision_interval - 1
    skip_unless(most < max_pictures(subject.spec), "a decision has too many ticks for pictures of all")
    pictures = subject.expect_answered(*_requests(subject, [0], ticks=True))[-1].step.tick_pictures
    expect(len(pictures) <= most, f"{len(pictures)} tick_pictures", f"at most {most}")
    for picture in pictures:
        expect_tensor(picture, pb.DTYPE_UINT8, size, "a picture of a tick")


@check("Act")
def drawing_does_not_change_the_episode(subject: Subject) -> None:
    """Act.draw and Act.draw_ticks request pictures and have no other effect."""
    _size(subject)
    ticks = subject.spec.decision_interval <= max_pictures(subject.spec)
    requests = [*subject.short_session.requests]
    for moment in range(1, len(requests)):
        requests[moment] = _with_draw(requests[moment], [0], ticks=ticks)
    got = [step_bytes(pb.Step(behaviors=step.behaviors)) for step in subject.expect_steps(requests)]
    expect(got == subject.short_session.step_bytes, "different steps if arenas are drawn", "the same bytes")


@check("Act")
def most_pictures_are_accepted(subject: Subject) -> None:
    """An Act draws at most 64 pictures, of at most 2^24 bytes together."""
    most = max_pictures(subject.spec)
    got = len(_draw(subject, ([0, subject.arenas - 1] * most)[:most]))
    expect(got == most, f"{got} pictures", most)


REFUSED = (  # name, section, rule, what a session of so many arenas is asked to draw, words
    (
        "too_many_pictures_are_refused",
        "Act",
        "An Act draws at most 64 pictures.",
        lambda arenas: [[0] * (MAX_PICTURES + 1)],
        ["draw", "picture"],
    ),
    (
        "unknown_arena_in_draw_is_refused",
        "Act",
        "Act.draw lists arenas of this session.",
        lambda arenas: [[0, arenas], [0, 2**32 - 1]],
        ["draw", "arena"],
    ),
)


@table(REFUSED)
def _draw_is_refused(subject: Subject, draws: Callable[[int], list[list[int]]], words: list[str]) -> None:
    _size(subject)
    for draw in draws(subject.arenas):
        subject.expect_refused(*_requests(subject, draw), words=words)


@check("GameSpec")
def draw_is_refused_without_pictures(subject: Subject) -> None:
    """If the spec has no picture, the game cannot be drawn and Act.draw is refused."""
    skip_unless(not subject.spec.HasField("picture"), "the game has pictures")
    # Act names FAILED_PRECONDITION; INVALID_ARGUMENT is accepted too.
    codes = [INVALID_ARGUMENT, FAILED_PRECONDITION]
    subject.expect_refused(*_requests(subject, [0]), codes=codes, words=["draw", "picture"])


def _size(subject: Subject) -> tuple[int, int, int]:
    skip_unless(subject.spec.HasField("picture"), "the game has no pictures")
    return subject.spec.picture.height, subject.spec.picture.width, 3


def _with_draw(request: pb.PlayRequest, draw: Sequence[int], *, ticks: bool) -> pb.PlayRequest:
    """Return an Act that draws. ticks: also the ticks of the first arena."""
    return act_request(pb.Act(behaviors=request.act.behaviors, draw=draw, draw_ticks=0 if ticks else None))


def _requests(subject: Subject, draw: Sequence[int], *, ticks: bool = False) -> list[pb.PlayRequest]:
    """Return a short session whose last Act draws."""
    requests = subject.short_session.requests[:4]
    if len(requests) < 2:
        raise Violation(f"{subject.short_session.end} in response to Act", "a Step")
    return [*requests[:-1], _with_draw(requests[-1], draw, ticks=ticks)]


def _draw(subject: Subject, draw: Sequence[int]) -> list[pb.Tensor]:
    _size(subject)
    return list(subject.expect_answered(*_requests(subject, draw))[-1].step.pictures)
