"""Pictures: of the right size, in the right order, and only of what is there."""

from collections.abc import Sequence

from joybridge.conformance.reading import expect_fit
from joybridge.conformance.registry import Broken, check, expect, needs
from joybridge.conformance.subject import EARLY, INVALID, Subject, act_request, record
from joybridge.v1 import bridge_pb2 as pb

MOST = 64  # pictures of one act


@check("Step")
def pictures_have_the_size_of_the_spec(subject: Subject) -> None:
    """Pictures are UINT8 [height, width, 3]."""
    size = _size(subject)
    for picture in _draw(subject, [0, 1]):
        expect_fit(picture, pb.DTYPE_UINT8, size, "a picture")


@check("Step")
def there_is_a_picture_per_arena_asked_for(subject: Subject) -> None:
    """There is one picture per arena in Act.draw, also where an arena is asked for twice."""
    for draw in ([0], [1], [0, 1], [1, 1, 0]):
        came = len(_draw(subject, draw))
        expect(came == len(draw), f"{came} pictures for draw {draw}", len(draw))


@check("Step")
def pictures_come_in_the_order_of_the_request(subject: Subject) -> None:
    """Pictures stand in the order of Act.draw."""
    forth, back = _draw(subject, [0, 1]), _draw(subject, [1, 0])
    expect(
        forth[:1] == back[1:] and forth[1:] == back[:1], "pictures in another order", "those of 1, 0 for draw [1, 0]"
    )


@check("DETERMINISM")
def the_same_play_gives_the_same_pictures(subject: Subject) -> None:
    """The same seed and actions give the same bytes, pictures included."""
    expect(_draw(subject, [0, 1]) == _draw(subject, [0, 1]), "other pictures in a second session", "the same bytes")


@check("Act")
def drawing_changes_nothing_of_the_play(subject: Subject) -> None:
    """Act.draw asks for pictures after the step and for nothing else."""
    _size(subject)
    requests = [*subject.brief.requests]
    for moment in range(1, len(requests)):
        requests[moment] = _drawn(requests[moment], [0])
    came = [record(pb.Step(behaviors=step.behaviors)) for step in subject.play(*requests).steps]
    expect(came == subject.brief.records, "another play where arenas were drawn", "the same bytes")


@check("Act")
def as_many_pictures_as_the_contract_allows_can_be_drawn(subject: Subject) -> None:
    """An act draws at most 64 arenas."""
    came = len(_draw(subject, [0, 1] * (MOST // 2)))
    expect(came == MOST, f"{came} pictures", MOST)


@check("Act")
def too_many_pictures_are_refused(subject: Subject) -> None:
    """An act draws at most 64 arenas."""
    _size(subject)
    subject.refused(*_requests(subject, [0] * (MOST + 1)), words=["draw", "picture"])


@check("Act")
def an_arena_that_does_not_exist_is_not_drawn(subject: Subject) -> None:
    """Act.draw lists arenas of this session."""
    _size(subject)
    for arena in (2, 2**32 - 1):
        subject.refused(*_requests(subject, [0, arena]), words=["draw", "arena"])


@check("GameSpec")
def a_game_without_a_picture_refuses_to_draw(subject: Subject) -> None:
    """Where the spec has no picture the game cannot be drawn and Act.draw is refused."""
    needs(not subject.spec.HasField("picture"), "the game can be drawn")
    # The manual names no status here: the content is wrong, or it is sent where it may not be.
    subject.refused(*_requests(subject, [0]), codes=[INVALID, EARLY], words=["draw", "picture"])


def _size(subject: Subject) -> tuple[int, int, int]:
    needs(subject.spec.HasField("picture"), "the game cannot be drawn")
    return subject.spec.picture.height, subject.spec.picture.width, 3


def _drawn(request: pb.PlayRequest, draw: Sequence[int]) -> pb.PlayRequest:
    return act_request(pb.Act(behaviors=request.act.behaviors, draw=draw))


def _requests(subject: Subject, draw: Sequence[int]) -> list[pb.PlayRequest]:
    """Return a short play whose last act draws."""
    requests = subject.brief.requests[:4]
    if len(requests) < 2:
        raise Broken(f"{subject.brief.end} in a play without pictures", "a play in which to draw")
    return [*requests[:-1], _drawn(requests[-1], draw)]


def _draw(subject: Subject, draw: Sequence[int]) -> list[pb.Tensor]:
    _size(subject)
    return list(subject.answered(*_requests(subject, draw))[-1].step.pictures)
