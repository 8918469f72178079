"""Errors as gRPC statuses: a code and a sentence, and for programs a reason and a field. See ERRORS in bridge.proto."""

from typing import Any

from google.protobuf.message import DecodeError
from google.rpc.error_details_pb2 import BadRequest, ErrorInfo
from google.rpc.status_pb2 import Status
from grpc import StatusCode
from grpc_status import rpc_status

from joybridge.contract.text import printable
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["CODES", "details_of", "status"]

_DOMAIN, _PREFIX = "joybridge.v1", "REASON_"
_REASONS = {
    StatusCode.NOT_FOUND: [pb.REASON_UNKNOWN_GAME],
    StatusCode.INVALID_ARGUMENT: [
        pb.REASON_MALFORMED_MESSAGE, pb.REASON_UNKNOWN_REQUEST, pb.REASON_UNKNOWN_OPTION, pb.REASON_UNKNOWN_CHOICE,
        pb.REASON_UNKNOWN_PARAMETER, pb.REASON_PARAMETER_OUT_OF_RANGE, pb.REASON_NO_ARENAS, pb.REASON_WRONG_SNAPSHOT,
        pb.REASON_WRONG_BEHAVIORS, pb.REASON_WRONG_TENSOR, pb.REASON_NOT_FINITE, pb.REASON_ACTION_OUT_OF_RANGE,
        pb.REASON_ACTION_MASKED, pb.REASON_WRONG_DRAW, pb.REASON_WRONG_DISTRIBUTION,
    ],
    StatusCode.FAILED_PRECONDITION: [
        pb.REASON_OLD_SERVER, pb.REASON_WRONG_ORDER, pb.REASON_NO_SNAPSHOTS, pb.REASON_NO_PICTURES,
        pb.REASON_NO_DISTRIBUTIONS,
    ],
    StatusCode.RESOURCE_EXHAUSTED: [
        pb.REASON_TOO_MANY_ARENAS, pb.REASON_TOO_MANY_SESSIONS, pb.REASON_MESSAGE_TOO_LARGE,
    ],
    StatusCode.INTERNAL: [pb.REASON_GAME_FAILED, pb.REASON_GAME_TOO_SLOW],
    StatusCode.DEADLINE_EXCEEDED: [pb.REASON_NO_START, pb.REASON_IDLE],
    StatusCode.UNAUTHENTICATED: [pb.REASON_NO_TOKEN],
    StatusCode.UNAVAILABLE: [pb.REASON_SHUTTING_DOWN],
}  # fmt: skip
CODES: dict[int, StatusCode] = {reason: code for code, reasons in _REASONS.items() for reason in reasons}


def status(reason: "pb.Reason", sentence: str, field: str = "") -> Any:
    """Return a grpc.Status, which is (code, sentence, trailing metadata).

    `context.abort(*status)` sends it from a grpc.aio server, `context.abort_with_status(status)` from a grpc one.
    field: the path of the wrong field from the request, "" if there is none.
    """
    message = Status(code=CODES[reason].value[0], message=sentence)
    message.details.add().Pack(ErrorInfo(reason=pb.Reason.Name(reason).removeprefix(_PREFIX), domain=_DOMAIN))
    if field:
        message.details.add().Pack(BadRequest(field_violations=[BadRequest.FieldViolation(field=field)]))
    return rpc_status.to_status(message)


def details_of(error: Any) -> tuple[str, str]:
    """Return the reason and the field that a server has added to a grpc.RpcError.

    Either is "" if the server has not added it; so is a reason that the contract does not have.
    """
    reason = field = ""
    try:
        message = rpc_status.from_call(error)
        for detail in message.details if message is not None else ():
            info, request = ErrorInfo(), BadRequest()
            if detail.Unpack(info) and info.domain == _DOMAIN and _PREFIX + info.reason in pb.Reason.keys():  # noqa: SIM118
                reason = info.reason
            elif detail.Unpack(request) and request.field_violations:
                field = printable(request.field_violations[0].field)
    except (ValueError, DecodeError):  # details of another error, or none that can be read
        return "", ""
    return reason, field
