"""Generated code is up to date, bridge.proto keeps the lint rules, and within v1 fields are only added.

data/bridge_v1.binpb is the first contract of v1, and data/VERSION/bridge.binpb that of each version. Generating the
code does not change them. Replacing them breaks clients that were released.
"""

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import DescriptorProto, EnumDescriptorProto, FieldDescriptorProto, FileDescriptorSet

from joybridge.contract.versions import REVISION
from joybridge.v1 import bridge_pb2 as pb
from tools.generate_proto import MLAGENTS, PROTO, SOURCE, generate

GENERATED = PROTO / Path(SOURCE).parent
DATA = Path(__file__).parent / "data"
BASELINE = DATA / "bridge_v1.binpb"
EARLIER = [BASELINE, *sorted(DATA.glob("*/bridge.binpb"))]


def read(path: Path) -> FileDescriptorSet:
    return FileDescriptorSet.FromString(path.read_bytes())


# ----------------------------------------------------------------------------------------------- generated code


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    output = tmp_path_factory.mktemp("proto")
    generate(output)
    return output / Path(SOURCE).parent


@pytest.mark.parametrize("name", ["bridge_pb2.py", "bridge_pb2.pyi", "bridge_pb2_grpc.py"])
def test_generated_code_is_what_the_proto_file_generates(fresh, name):
    assert (GENERATED / name).read_text() == (fresh / name).read_text()


@pytest.mark.parametrize("name", ["communicator_pb2.py", "communicator_pb2.pyi"])
def test_generated_code_of_the_wire_of_ml_agents_is_what_its_proto_file_generates(fresh, name):
    folder = Path(MLAGENTS).parent
    assert (PROTO / folder / name).read_text() == (fresh.parents[1] / folder / name).read_text()


def test_the_descriptor_set_is_what_the_proto_file_generates(fresh):
    assert (GENERATED / "bridge.binpb").read_bytes() == (fresh / "bridge.binpb").read_bytes()


def test_nothing_else_is_generated_and_nothing_generated_is_missing(fresh):
    generated = {path.name for path in GENERATED.iterdir() if path.name.startswith("bridge")}
    assert generated == {path.name for path in fresh.iterdir()} | {"bridge.proto"}


# --------------------------------------------------------------------------------------------------------- lint


@pytest.fixture(scope="module")
def buf() -> list[str]:
    """Return the command that runs buf: an installed one, or the pinned one that npm fetches."""
    if shutil.which("buf"):
        return ["buf"]
    if not shutil.which("npx"):
        pytest.skip("install buf, or npm, to lint bridge.proto")
    command = ["npx", "--yes", "@bufbuild/buf@1.75.0"]
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=600, check=False)
    if done.returncode:
        pytest.skip(f"npm cannot fetch buf: {done.stderr[-200:]}")
    return command


@pytest.mark.promise("P4")
def test_the_proto_file_keeps_the_standard_lint_rules_of_buf(buf):
    done = subprocess.run([*buf, "lint", "proto"], cwd=PROTO.parent, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


def test_the_manual_and_the_code_have_the_same_revision():
    text = (GENERATED / "bridge.proto").read_text()
    assert re.findall(r"REVISION: (\d+) is the revision of this file", text) == [str(REVISION)]


# ---------------------------------------------------------------------------------------------- breaking changes

Fact = tuple[str, object]


def facts(files: FileDescriptorSet) -> Iterator[Fact]:
    """Yield everything that clients of a contract rely on, as (name, what it is)."""
    for file in files.file:
        yield f"{file.package}: syntax", file.syntax
        for message in file.message_type:
            yield from message_facts(message, file.package)
        for enum in file.enum_type:
            yield from enum_facts(enum, file.package)
        for service in file.service:
            yield f"service {file.package}.{service.name}", ""
            for method in service.method:
                streams = method.client_streaming, method.server_streaming
                name = f"method {file.package}.{service.name}.{method.name}"
                yield name, (method.input_type, method.output_type, *streams)


def message_facts(message: DescriptorProto, scope: str) -> Iterator[Fact]:
    name = f"{scope}.{message.name}"
    yield f"message {name}", message.options.map_entry
    for field in message.field:
        yield f"field {name}.{field.name}", field_fact(field, message)
    for nested in message.nested_type:
        yield from message_facts(nested, name)
    for enum in message.enum_type:
        yield from enum_facts(enum, name)


def field_fact(field: FieldDescriptorProto, message: DescriptorProto) -> object:
    oneof = message.oneof_decl[field.oneof_index].name if field.HasField("oneof_index") else None
    kind = field.type, field.type_name, field.label, oneof, field.proto3_optional
    return field.number, *kind, field.json_name, field.default_value, field.options.SerializeToString()


def enum_facts(enum: EnumDescriptorProto, scope: str) -> Iterator[Fact]:
    yield f"enum {scope}.{enum.name}", ""
    for value in enum.value:
        yield f"enum value {scope}.{enum.name}.{value.name}", value.number


def breaks(before: FileDescriptorSet, after: FileDescriptorSet) -> list[str]:
    """Return what is not in `after` as it was in `before`. Additions break nothing."""
    now = dict(facts(after))
    return [name for name, fact in facts(before) if name not in now or now[name] != fact]


@pytest.mark.promise("P4")
@pytest.mark.parametrize("earlier", EARLIER, ids=lambda path: path.parent.name)
def test_the_contract_keeps_what_earlier_ones_had(earlier):
    assert breaks(read(earlier), read(GENERATED / "bridge.binpb")) == []


def test_the_check_sees_every_name_of_the_proto_file():
    names = dict(facts(read(GENERATED / "bridge.binpb")))
    assert "method joybridge.v1.SimulatorService.Play" in names and "enum value joybridge.v1.Dtype.DTYPE_BOOL" in names
    messages = pb.DESCRIPTOR.message_types_by_name
    fields = {f"field {field.full_name}" for message in messages.values() for field in message.fields}
    assert fields and fields <= names.keys()
    assert {f"message {message.full_name}" for message in messages.values()} <= names.keys()


def message(files, name):
    return next(message for message in files.file[0].message_type if message.name == name)


def field(files, path):
    owner, name = path.split(".")
    return next(field for field in message(files, owner).field if field.name == name)


def method(files, name):
    return next(method for method in files.file[0].service[0].method if method.name == name)


def remove(things, name):
    things.remove(next(thing for thing in things if thing.name == name))


BREAKING = {
    "a field removed": (lambda f: remove(message(f, "Act").field, "draw"), "field joybridge.v1.Act.draw"),
    "a field renamed": (lambda f: setattr(field(f, "Start.seed"), "name", "root"), "field joybridge.v1.Start.seed"),
    "a field renumbered": (lambda f: setattr(field(f, "Start.seed"), "number", 9), "field joybridge.v1.Start.seed"),
    "a field of another type": (
        lambda f: setattr(field(f, "Start.seed"), "type", FieldDescriptorProto.TYPE_INT64),
        "field joybridge.v1.Start.seed",
    ),
    "a field of another message": (
        lambda f: setattr(field(f, "BehaviorAct.axes"), "type_name", ".joybridge.v1.Step"),
        "field joybridge.v1.BehaviorAct.axes",
    ),
    "a field no longer repeated": (
        lambda f: setattr(field(f, "Act.draw"), "label", FieldDescriptorProto.LABEL_OPTIONAL),
        "field joybridge.v1.Act.draw",
    ),
    "a field out of its oneof": (
        lambda f: field(f, "PlayRequest.save").ClearField("oneof_index"),
        "field joybridge.v1.PlayRequest.save",
    ),
    "a oneof renamed": (
        lambda f: setattr(message(f, "PlayResponse").oneof_decl[0], "name", "answer"),
        "field joybridge.v1.PlayResponse.started",
    ),
    "a field that always has a value": (
        lambda f: (
            field(f, "Reset.seed").ClearField("oneof_index"),
            field(f, "Reset.seed").ClearField("proto3_optional"),
        ),
        "field joybridge.v1.Reset.seed",
    ),
    "a map of other values": (
        lambda f: setattr(message(f, "Start").nested_type[1].field[1], "type", FieldDescriptorProto.TYPE_FLOAT),
        "field joybridge.v1.Start.ParametersEntry.value",
    ),
    "a message removed": (lambda f: remove(f.file[0].message_type, "Ended"), "message joybridge.v1.Ended"),
    "an enum removed": (lambda f: remove(f.file[0].enum_type, "Dtype"), "enum joybridge.v1.Dtype"),
    "an enum value removed": (
        lambda f: remove(f.file[0].enum_type[0].value, "DTYPE_UINT8"),
        "enum value joybridge.v1.Dtype.DTYPE_UINT8",
    ),
    "an enum value renumbered": (
        lambda f: setattr(f.file[0].enum_type[0].value[1], "number", 7),
        "enum value joybridge.v1.Dtype.DTYPE_FLOAT32",
    ),
    "a method removed": (
        lambda f: remove(f.file[0].service[0].method, "ListGames"),
        "method joybridge.v1.SimulatorService.ListGames",
    ),
    "a method made unary": (
        lambda f: (method(f, "Play").ClearField("client_streaming"), method(f, "Play").ClearField("server_streaming")),
        "method joybridge.v1.SimulatorService.Play",
    ),
    "a method that answers otherwise": (
        lambda f: setattr(method(f, "DescribeGame"), "output_type", ".joybridge.v1.GameSpec"),
        "method joybridge.v1.SimulatorService.DescribeGame",
    ),
    "a service removed": (lambda f: f.file[0].service.pop(), "service joybridge.v1.SimulatorService"),
    "another package": (lambda f: setattr(f.file[0], "package", "joybridge.v2"), "message joybridge.v1.Tensor"),
    "another syntax": (lambda f: setattr(f.file[0], "syntax", "proto2"), "joybridge.v1: syntax"),
}


@pytest.mark.parametrize("change", BREAKING)
def test_a_breaking_change_is_found(change):
    edit, broken = BREAKING[change]
    changed = read(BASELINE)
    edit(changed)
    assert broken in breaks(read(BASELINE), changed)


def test_additions_break_nothing():
    changed = read(BASELINE)
    file = changed.file[0]
    message(changed, "Start").field.add(
        name="later", number=99, type=FieldDescriptorProto.TYPE_BOOL, label=FieldDescriptorProto.LABEL_OPTIONAL
    )
    file.message_type.add(name="Later")
    file.enum_type[0].value.add(name="INT64", number=5)
    file.service[0].method.add(name="Later", input_type=".joybridge.v1.Later", output_type=".joybridge.v1.Later")
    assert len(list(facts(changed))) == len(list(facts(read(BASELINE)))) + 4
    assert breaks(read(BASELINE), changed) == []
