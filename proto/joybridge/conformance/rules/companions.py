"""What a server serves beside the contract: health and reflection."""

from collections.abc import Sequence

import grpc
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto
from grpc_health.v1 import health_pb2
from grpc_reflection.v1alpha import reflection_pb2

from joybridge.conformance.registry import Broken, check, expect
from joybridge.conformance.subject import Subject
from joybridge.conformance.wire import SERVICE, Ended
from joybridge.v1 import bridge_pb2 as pb

# Both versions have the same messages; a server may have either.
REFLECTIONS = ["grpc.reflection.v1", "grpc.reflection.v1alpha"]


@check("COMPANIONS", once=True)
def the_server_says_that_it_is_well(subject: Subject) -> None:
    """A server also serves grpc.health.v1, under the service name ""."""
    _expect_health(subject, "")


@check("COMPANIONS", once=True)
def the_service_says_that_it_is_well(subject: Subject) -> None:
    """A server also serves grpc.health.v1, under the service name "joybridge.v1.SimulatorService"."""
    _expect_health(subject, SERVICE)


@check("COMPANIONS", once=True)
def reflection_lists_the_service(subject: Subject) -> None:
    """A server also serves reflection."""
    answer = _reflect(subject, reflection_pb2.ServerReflectionRequest(list_services=""))
    names = [service.name for service in answer.list_services_response.service]
    expect(SERVICE in names, f"services {names}", f"{SERVICE} among them")


@check("COMPANIONS", once=True)
def reflection_has_the_methods_of_the_service(subject: Subject) -> None:
    """A server also serves reflection, of this contract."""
    came = {(m.name, m.client_streaming, m.server_streaming) for f in _files(subject) for s in f.service
            for m in s.method}  # fmt: skip
    wanted = {("ListGames", False, False), ("DescribeGame", False, False), ("Play", True, True)}
    expect(wanted <= came, f"methods {sorted(came)}", sorted(wanted))


@check("CHANGES", once=True)
def reflection_has_every_field_of_the_contract(subject: Subject) -> None:
    """Within v1 fields are only added: those of this version are there, with their numbers and types."""
    ours = FileDescriptorProto()
    pb.DESCRIPTOR.CopyToProto(ours)
    came = {field for file in _files(subject) for field in _fields(file.message_type)}
    missing = sorted(set(_fields(ours.message_type)) - came)
    expect(not missing, f"nothing like {missing[:5]}", "every message and field of bridge.proto")


def _expect_health(subject: Subject, service: str) -> None:
    request = health_pb2.HealthCheckRequest(service=service)
    answer = subject.server.call("/grpc.health.v1.Health/Check", request, health_pb2.HealthCheckResponse)
    if isinstance(answer, Ended):
        raise Broken(answer, "SERVING")
    came = health_pb2.HealthCheckResponse.ServingStatus.Name(answer.status)
    expect(came == "SERVING", came, "SERVING")


def _reflect(
    subject: Subject, request: reflection_pb2.ServerReflectionRequest
) -> reflection_pb2.ServerReflectionResponse:
    """Return the answer of whichever version of reflection there is."""
    ends = []
    for version in REFLECTIONS:
        call = subject.server.channel.stream_stream(
            f"/{version}.ServerReflection/ServerReflectionInfo",
            reflection_pb2.ServerReflectionRequest.SerializeToString,
            reflection_pb2.ServerReflectionResponse.FromString,
        )(iter([request]), timeout=subject.server.seconds)
        try:
            for answer in call:
                return answer
        except grpc.RpcError as error:
            ends.append(f"{error.code().name} from {version}")
    raise Broken(" and ".join(ends) or "no answer", "an answer")


def _files(subject: Subject) -> list[FileDescriptorProto]:
    answer = _reflect(subject, reflection_pb2.ServerReflectionRequest(file_containing_symbol=SERVICE))
    return [FileDescriptorProto.FromString(data) for data in answer.file_descriptor_response.file_descriptor_proto]


def _fields(messages: Sequence[DescriptorProto]) -> list[tuple[str, str, int, int, int]]:
    return [
        (message.name, field.name, field.number, field.type, field.label)
        for message in messages
        for field in message.field
    ]
