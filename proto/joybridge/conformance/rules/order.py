"""The order of requests, and requests that the contract does not have."""

from collections.abc import Callable

from grpc import StatusCode

from joybridge.conformance.client import OK, Request
from joybridge.conformance.expectations import expect, expect_equal
from joybridge.conformance.recording import SAVE, act_request, reset_request
from joybridge.conformance.registry import Rows, check, table
from joybridge.conformance.subject import FAILED_PRECONDITION, INVALID_ARGUMENT, Subject
from joybridge.v1 import bridge_pb2 as pb

UNKNOWN_FIELD = b"\xf8\x07\x01"  # field 127, a varint, which a later version of the contract may have


def _first_act(subject: Subject) -> pb.PlayRequest:
    """Return a valid Act for the first decision of a session."""
    requests = subject.short_session.requests
    return requests[1] if len(requests) > 1 else act_request(pb.Act())


REFUSED: Rows = (  # name, section, rule, the requests of which the last is refused, its status, words
    ("act_before_start_is_refused", "ERRORS", "Act before Start is FAILED_PRECONDITION.",
     lambda subject: [_first_act(subject)], FAILED_PRECONDITION, ["start"]),
    ("reset_before_start_is_refused", "ERRORS", "Reset before Start is FAILED_PRECONDITION.",
     lambda subject: [reset_request(1)], FAILED_PRECONDITION, ["start"]),
    ("save_before_start_is_refused", "ERRORS", "Save before Start is FAILED_PRECONDITION.",
     lambda subject: [SAVE], FAILED_PRECONDITION, ["start"]),
    ("second_start_is_refused", "ERRORS", "A second Start is FAILED_PRECONDITION.",
     lambda subject: [subject.start()] * 2, FAILED_PRECONDITION, ["start"]),
    ("start_after_act_and_reset_is_refused", "ERRORS",
     "A second Start is FAILED_PRECONDITION, also later in the session.",
     lambda subject: [subject.start(), _first_act(subject), reset_request(1), subject.start()],
     FAILED_PRECONDITION, ["start"]),
    ("empty_request_before_start_is_refused", "PlayRequest",
     "A PlayRequest has a Start, Act, Reset or Save; one with none of them is INVALID_ARGUMENT.",
     lambda subject: [pb.PlayRequest()], INVALID_ARGUMENT, []),
    ("empty_request_after_start_is_refused", "PlayRequest",
     "A PlayRequest has a Start, Act, Reset or Save; one with none of them is INVALID_ARGUMENT.",
     lambda subject: [subject.start(), pb.PlayRequest()], INVALID_ARGUMENT, []),
    ("unknown_request_is_refused", "CHANGES", "A request of a kind that the contract does not have is refused.",
     lambda subject: [subject.start(), UNKNOWN_FIELD], INVALID_ARGUMENT, []),
)  # fmt: skip


@table(REFUSED)
def _is_refused(
    subject: Subject, requests: Callable[[Subject], list[Request]], code: StatusCode, words: list[str]
) -> None:
    subject.expect_refused(*requests(subject), codes=[code], words=words)


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
