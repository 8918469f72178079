"""The order of messages, and messages that are none."""

from joybridge.conformance.registry import check, expect
from joybridge.conformance.subject import EARLY, SAVE, Recording, Subject, act_request, reset_request
from joybridge.conformance.wire import OK
from joybridge.v1 import bridge_pb2 as pb

LATER = b"\xf8\x07\x01"  # field 127, a varint: what a later contract may have


@check("ERRORS")
def an_act_before_start_is_refused(subject: Subject) -> None:
    """Start comes first; Act before Start is FAILED_PRECONDITION."""
    subject.refused(_an_act(subject), codes=[EARLY], words=["start"])


@check("ERRORS")
def a_reset_before_start_is_refused(subject: Subject) -> None:
    """Start comes first; a message that may not be sent now is FAILED_PRECONDITION."""
    subject.refused(reset_request(1), codes=[EARLY], words=["start"])


@check("ERRORS")
def a_save_before_start_is_refused(subject: Subject) -> None:
    """Start comes first; a message that may not be sent now is FAILED_PRECONDITION."""
    subject.refused(SAVE, codes=[EARLY], words=["start"])


@check("ERRORS")
def a_second_start_is_refused(subject: Subject) -> None:
    """Start comes once; a second one is FAILED_PRECONDITION."""
    subject.refused(subject.start(), subject.start(), codes=[EARLY], words=["start"])


@check("ERRORS")
def a_start_in_the_middle_of_a_session_is_refused(subject: Subject) -> None:
    """Start comes once, first, and not after an Act or a Reset."""
    subject.refused(
        subject.start(), _an_act(subject), reset_request(1), subject.start(), codes=[EARLY], words=["start"]
    )


@check("PlayRequest")
def an_empty_request_is_refused_at_the_beginning(subject: Subject) -> None:
    """The client sends one request, Start, Act, Reset or Save; a message with none of them is wrong."""
    subject.refused(pb.PlayRequest(), words=[])


@check("PlayRequest")
def an_empty_request_is_refused_in_a_session(subject: Subject) -> None:
    """The client sends one request, Start, Act, Reset or Save; a message with none of them is wrong."""
    subject.refused(subject.start(), pb.PlayRequest(), words=[])


@check("ERRORS")
def a_refusal_ends_the_session(subject: Subject) -> None:
    """Every error ends its session: what was sent after it is not answered."""
    played = subject.play(subject.start(), pb.PlayRequest(), _an_act(subject), _an_act(subject))
    came = f"{len(played.responses)} responses and {played.end}"
    expect(len(played.responses) == 1 and played.end.code != OK.code, came, "1 response and an error")


@check("CHANGES")
def an_unknown_field_of_a_start_is_refused(subject: Subject) -> None:
    """A server ignores what it does not know only where this file says so."""
    start = pb.Start.FromString(subject.start().start.SerializeToString() + LATER)
    subject.refused(pb.PlayRequest(start=start), words=[])


@check("CHANGES")
def an_unknown_field_of_an_act_is_refused(subject: Subject) -> None:
    """A server ignores what it does not know only where this file says so."""
    act = pb.Act.FromString(_an_act(subject).act.SerializeToString() + LATER)
    subject.refused(subject.start(), act_request(act), words=[])


@check("CHANGES")
def an_unknown_request_is_refused(subject: Subject) -> None:
    """A kind of request that the contract does not have is refused and not ignored."""
    subject.refused(subject.start(), LATER, words=[])


def _an_act(subject: Subject) -> pb.PlayRequest:
    """Return what a session may do first."""
    brief: Recording = subject.brief
    return brief.requests[1] if len(brief.requests) > 1 else act_request(pb.Act())
