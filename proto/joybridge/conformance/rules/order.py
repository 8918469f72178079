"""The order of requests, and requests that the contract does not have."""

from joybridge.conformance.client import OK
from joybridge.conformance.expectations import expect, expect_equal
from joybridge.conformance.recording import SAVE, act_request, reset_request
from joybridge.conformance.registry import check
from joybridge.conformance.subject import FAILED_PRECONDITION, Subject
from joybridge.v1 import bridge_pb2 as pb

UNKNOWN_FIELD = b"\xf8\x07\x01"  # field 127, a varint, which a later version of the contract may have


@check("ERRORS")
def act_before_start_is_refused(subject: Subject) -> None:
    """Act before Start is FAILED_PRECONDITION."""
    subject.expect_refused(_first_act(subject), codes=[FAILED_PRECONDITION], words=["start"])


@check("ERRORS")
def reset_before_start_is_refused(subject: Subject) -> None:
    """Reset before Start is FAILED_PRECONDITION."""
    subject.expect_refused(reset_request(1), codes=[FAILED_PRECONDITION], words=["start"])


@check("ERRORS")
def save_before_start_is_refused(subject: Subject) -> None:
    """Save before Start is FAILED_PRECONDITION."""
    subject.expect_refused(SAVE, codes=[FAILED_PRECONDITION], words=["start"])


@check("ERRORS")
def second_start_is_refused(subject: Subject) -> None:
    """A second Start is FAILED_PRECONDITION."""
    subject.expect_refused(subject.start(), subject.start(), codes=[FAILED_PRECONDITION], words=["start"])


@check("ERRORS")
def start_after_act_and_reset_is_refused(subject: Subject) -> None:
    """A second Start is FAILED_PRECONDITION, also later in the session."""
    requests = [subject.start(), _first_act(subject), reset_request(1), subject.start()]
    subject.expect_refused(*requests, codes=[FAILED_PRECONDITION], words=["start"])


@check("PlayRequest")
def empty_request_before_start_is_refused(subject: Subject) -> None:
    """A PlayRequest has a Start, Act, Reset or Save; one with none of them is INVALID_ARGUMENT."""
    subject.expect_refused(pb.PlayRequest(), words=[])


@check("PlayRequest")
def empty_request_after_start_is_refused(subject: Subject) -> None:
    """A PlayRequest has a Start, Act, Reset or Save; one with none of them is INVALID_ARGUMENT."""
    subject.expect_refused(subject.start(), pb.PlayRequest(), words=[])


@check("ERRORS")
def requests_after_an_error_are_not_answered(subject: Subject) -> None:
    """Every error ends its session; the requests after it are not answered."""
    exchange = subject.play(subject.start(), pb.PlayRequest(), _first_act(subject), _first_act(subject))
    got = f"{len(exchange.responses)} responses and {exchange.status}"
    expect(len(exchange.responses) == 1 and exchange.status.code != OK.code, got, "1 response and an error")


@check("SESSION")
def responses_are_in_request_order(subject: Subject) -> None:
    """Each request gets one response, in order: Started for Start, Step for Act and Reset."""
    requests = [subject.start(), _first_act(subject), reset_request(1), reset_request(1)]
    got = [response.WhichOneof("response") for response in subject.expect_answered(*requests)]
    expect_equal(got, ["started", "step", "step", "step"], "responses")


@check("CHANGES")
def unknown_request_is_refused(subject: Subject) -> None:
    """A request of a kind that the contract does not have is refused."""
    subject.expect_refused(subject.start(), UNKNOWN_FIELD, words=[])


def _first_act(subject: Subject) -> pb.PlayRequest:
    """Return a valid Act for the first decision of a session."""
    requests = subject.short_session.requests
    return requests[1] if len(requests) > 1 else act_request(pb.Act())
