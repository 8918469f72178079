"""Versions are exchanged, a newer client is refused, and fields of a later revision are ignored."""

from collections.abc import Iterator

from joybridge.conformance.client import SERVICE, Status
from joybridge.conformance.expectations import expect, expect_equal
from joybridge.conformance.recording import act_request, step_bytes
from joybridge.conformance.registry import check
from joybridge.conformance.subject import FAILED_PRECONDITION, Subject, expect_error
from joybridge.contract.limits import MAX_NAME
from joybridge.v1 import bridge_pb2 as pb

NEWEST = 2**32 - 1  # a revision that no server has
UNKNOWN_FIELD = b"\xf8\x07\x01"  # field 127, a varint: a field that a later revision may have


@check("VERSIONS", per_server=True)
def every_response_states_product_and_revision(subject: Subject) -> None:
    """A response always carries a Version with revision 1 or higher, and a product of 1 to 100 printable characters."""
    for call, version in _stated(subject):
        expect(version.revision >= 1, f"revision {version.revision} from {call}", "at least 1")
        fits = 1 <= len(version.product) <= MAX_NAME and version.product.isprintable()
        expect(fits, f"{version.product!r} from {call}", "1 to 100 printable characters")


@check("VERSIONS", per_server=True)
def all_responses_state_the_same_version(subject: Subject) -> None:
    """A server implements one revision."""
    (_, first), *others = _stated(subject)
    for call, version in others:
        expect_equal(version.SerializeToString(), first.SerializeToString(), f"version from {call}")


@check("VERSIONS", per_server=True)
def client_of_the_same_revision_is_served(subject: Subject) -> None:
    """A server with the same or a newer revision serves the client; revision 0 is not stated, and served."""
    (_, server), *_ = _stated(subject)
    for revision in {0, 1, server.revision}:
        for call, answer in _answers(subject, pb.Version(product="kit", revision=revision)):
            expect(not isinstance(answer, Status), f"{answer} from {call} for revision {revision}", "a response")


@check("VERSIONS", per_server=True)
def client_that_needs_a_newer_revision_is_refused(subject: Subject) -> None:
    """An older server refuses with FAILED_PRECONDITION; the sentence names both products and both revisions."""
    (_, server), *_ = _stated(subject)
    for call, answer in _answers(subject, pb.Version(product="kit from the future", revision=NEWEST)):
        expect(isinstance(answer, Status), f"a response from {call}", "FAILED_PRECONDITION")
        assert isinstance(answer, Status)
        for word in ("kit from the future", str(NEWEST), server.product, str(server.revision)):
            expect_error(answer, [FAILED_PRECONDITION], [word])


@check("CHANGES", per_server=True)
def unknown_field_of_describe_is_ignored(subject: Subject) -> None:
    """Unknown fields are ignored."""
    name = subject.client.list_games()[0].name
    request = pb.DescribeGameRequest(game=name).SerializeToString() + UNKNOWN_FIELD
    answer = subject.client.call(f"/{SERVICE}/DescribeGame", request, pb.DescribeGameResponse)
    expect(not isinstance(answer, Status), answer, "a spec")
    expect(answer.spec == subject.client.describe(name), "another spec", "the same spec as without the field")


@check("CHANGES")
def unknown_field_of_start_is_ignored(subject: Subject) -> None:
    """Unknown fields are ignored."""
    start = pb.Start.FromString(subject.start().start.SerializeToString() + UNKNOWN_FIELD)
    _expect_same_steps(subject, [pb.PlayRequest(start=start)])


@check("CHANGES")
def unknown_field_of_act_is_ignored(subject: Subject) -> None:
    """Unknown fields are ignored."""
    start, request, *_ = subject.short_session.requests
    act = pb.Act.FromString(request.act.SerializeToString() + UNKNOWN_FIELD)
    _expect_same_steps(subject, [start, act_request(act)])


def _expect_same_steps(subject: Subject, requests: list[pb.PlayRequest]) -> None:
    got = [step_bytes(step) for step in subject.expect_steps(requests)]
    expect(got == subject.short_session.step_bytes[: len(got)], "another step", "the same as without the field")


def _answers(subject: Subject, version: pb.Version) -> Iterator[tuple[str, pb.Version | Status]]:
    """Make every call that carries a Version; yield its name and the server's version, or how it ended."""
    game = subject.client.list_games()[0].name
    for call, request, response in (
        ("ListGames", pb.ListGamesRequest(version=version), pb.ListGamesResponse),
        ("DescribeGame", pb.DescribeGameRequest(game=game, version=version), pb.DescribeGameResponse),
    ):
        answer = subject.client.call(f"/{SERVICE}/{call}", request, response)
        yield call, answer if isinstance(answer, Status) else answer.version
    exchange = subject.play(pb.PlayRequest(start=pb.Start(game=game, arenas=1, version=version)))
    yield "Start", exchange.responses[0].started.version if exchange.responses else exchange.status


def _stated(subject: Subject) -> list[tuple[str, pb.Version]]:
    """Return the server's version from every response that carries it. Raises Violation if a call fails."""
    stated = []
    for call, answer in _answers(subject, pb.Version()):
        expect(not isinstance(answer, Status), f"{answer} from {call}", "a response")
        assert isinstance(answer, pb.Version)
        stated.append((call, answer))
    return stated
