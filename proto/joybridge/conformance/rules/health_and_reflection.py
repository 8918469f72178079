"""The gRPC services that a server has beside the contract's own: health and reflection."""

from collections.abc import Sequence

from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto
from grpc_reflection.v1alpha import reflection_pb2

from joybridge.conformance.client import SERVICE
from joybridge.conformance.expectations import Violation, expect
from joybridge.conformance.registry import check, table
from joybridge.conformance.subject import Subject
from joybridge.v1 import bridge_pb2 as pb

# Both versions have the same messages; a server may have either.
REFLECTIONS = ["grpc.reflection.v1", "grpc.reflection.v1alpha"]


HEALTH = [  # name, section, rule, the name of the service
    (
        f"health_of_the_{what}_is_serving",
        "COMPANIONS",
        f'A server also serves grpc.health.v1, with the service name "{service}".',
        service,
    )
    for what, service in (("server", ""), ("service", SERVICE))
]


@table(HEALTH, per_server=True)
def _health_is_serving(subject: Subject, service: str) -> None:
    subject.client.expect_serving(service)


@check("COMPANIONS", per_server=True)
def reflection_lists_the_service(subject: Subject) -> None:
    """A server also serves reflection."""
    answer = _reflect(subject, reflection_pb2.ServerReflectionRequest(list_services=""))
    names = [service.name for service in answer.list_services_response.service]
    expect(SERVICE in names, f"services {names}", f"a list with {SERVICE}")


@check("COMPANIONS", per_server=True)
def reflection_has_every_method(subject: Subject) -> None:
    """Reflection describes the methods of this contract."""
    methods = [method for file in _files(subject) for service in file.service for method in service.method]
    got = {(method.name, method.client_streaming, method.server_streaming) for method in methods}
    expected = {("ListGames", False, False), ("DescribeGame", False, False), ("Play", True, True)}
    expect(expected <= got, f"methods {sorted(got)}", sorted(expected))


@check("CHANGES", per_server=True)
def reflection_has_every_field(subject: Subject) -> None:
    """Within v1 fields are only added: all fields of this version exist with their numbers and types."""
    ours = FileDescriptorProto()
    pb.DESCRIPTOR.CopyToProto(ours)
    got = {field for file in _files(subject) for field in _fields(file.message_type)}
    missing = sorted(set(_fields(ours.message_type)) - got)
    expect(not missing, f"no field like {missing[:5]}", "every field of bridge.proto")


def _reflect(
    subject: Subject, request: reflection_pb2.ServerReflectionRequest
) -> reflection_pb2.ServerReflectionResponse:
    """Return the response of the first version of reflection that the server has."""
    failures = []
    for version in REFLECTIONS:
        method = f"/{version}.ServerReflection/ServerReflectionInfo"
        exchange = subject.client.play([request], method=method, response=reflection_pb2.ServerReflectionResponse)
        if exchange.responses:
            return exchange.responses[0]
        failures.append(f"{exchange.status.code.name} from {version}")
    raise Violation(" and ".join(failures) or "no response", "a response")


def _files(subject: Subject) -> list[FileDescriptorProto]:
    answer = _reflect(subject, reflection_pb2.ServerReflectionRequest(file_containing_symbol=SERVICE))
    return [FileDescriptorProto.FromString(data) for data in answer.file_descriptor_response.file_descriptor_proto]


def _fields(messages: Sequence[DescriptorProto]) -> list[tuple[str, str, int, int, int]]:
    return [
        (message.name, field.name, field.number, field.type, field.label)
        for message in messages
        for field in message.field
    ]
