"""Who may call a server: addresses, TLS, the token, malformed and compressed messages."""

import argparse
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import grpc
import numpy as np
import pytest
from grpc import StatusCode
from grpc_health.v1 import health_pb2
from hypothesis import given
from hypothesis import strategies as st

from joybridge.cli import main as trainer
from joybridge.client.errors import from_grpc
from joybridge.commands.look import main as look
from joybridge.conformance.__main__ import main as check
from joybridge.conformance.doctor import main as doctor
from joybridge.contract import limits
from joybridge.contract.address import address, is_local
from joybridge.contract.codec import pack
from joybridge.contract.credentials import (
    Credentials,
    CredentialsError,
    ProtectedAddress,
    load_credentials,
    read_token,
)
from joybridge.contract.limits import max_pictures, response_bytes
from joybridge.contract.text import printable
from joybridge.contract.versions import mismatch
from joybridge.gym import BridgeEnv
from joybridge.simulator.__main__ import main
from joybridge.simulator.authentication import ServerCredentials, ServerCredentialsError, load_server_credentials
from joybridge.simulator.game_adapter import batched
from joybridge.simulator.session import Refusal, Session
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc
from joybridge.viewer.play import main as viewer
from joybridge.viewer.watch import main as watch
from tests.support.faulty_game import PICTURE
from tests.support.games import Hybrid
from tests.support.servers import Server, end, server
from tests.support.wire import SECONDS, Stream, act, start

TOKEN = "0123456789abcdef-a-secret"


class Guarded(NamedTuple):
    """A server with TLS and a token, and the files of its clients."""

    server: Server
    certificate: Path
    token: Path


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path, Path]:
    """Return the files of a certificate for localhost, of its key, and of a token."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl makes the certificate")
    folder = tmp_path_factory.mktemp("doors")
    certificate, key, token = folder / "server.pem", folder / "server.key", folder / "token"
    command = ["openssl", "req", "-x509", "-nodes", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1"]
    command += ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"]
    subprocess.run([*command, "-keyout", str(key), "-out", str(certificate)], check=True, capture_output=True)
    token.write_text(TOKEN + "\n")
    token.chmod(0o600)
    return certificate, key, token


@pytest.fixture(scope="module")
def guarded(files) -> Iterator[Guarded]:
    certificate, key, token = files
    arguments = ["--tls-cert", str(certificate), "--tls-key", str(key), "--token-file", str(token)]
    with server("--address", "127.0.0.1:0", *arguments, stderr=subprocess.PIPE) as process:
        yield Guarded(process, certificate, token)
        process.terminate()
        status, text = end(process)
    assert status == 0 and TOKEN not in text and "Traceback" not in text


# ---------------------------------------------------------------------------------------------------- addresses


@pytest.mark.parametrize("place", ["127.0.0.1:0", "127.8.9.1:5005", "[::1]:0", "localhost:0", "unix:s"])
def test_addresses_of_this_machine_alone_need_no_protection(place):
    assert is_local(place)
    assert load_server_credentials(place, None, None, None) == ServerCredentials()


@pytest.mark.parametrize("place", ["0.0.0.0:0", "[::]:5005", "192.0.2.1:5005", "0:5005"])
@pytest.mark.promise("X1")
def test_other_addresses_are_refused_without_both_tls_and_a_token(place, files):
    certificate, key, token = files
    for given_files in ((None, None, None), (certificate, key, None), (None, None, token)):
        with pytest.raises(ServerCredentialsError, match="needs --tls-cert, --tls-key and --token-file"):
            load_server_credentials(place, *given_files)
    protection = load_server_credentials(place, certificate, key, token)
    assert protection.token == TOKEN and TOKEN not in repr(protection)


def test_a_server_that_strangers_could_reach_does_not_start(capsys):
    assert main(["serve", "--address", "0.0.0.0:0"]) == 2
    assert capsys.readouterr().err == (
        "error: 0.0.0.0:0 can be reached from other machines, which needs --tls-cert, --tls-key and --token-file; give "
        "them, or listen on 127.0.0.1 or unix:PATH\n"
    )


def test_a_certificate_without_its_key_is_refused(files):
    with pytest.raises(ServerCredentialsError, match="TLS needs both --tls-cert and --tls-key"):
        load_server_credentials("127.0.0.1:0", files[0], None, None)


def test_a_host_that_does_not_exist_is_named():
    with pytest.raises(OSError, match=r"there is no host 'nowhere\.invalid'"):
        is_local("nowhere.invalid:5005")
    with pytest.raises(OSError, match=r"there is no host 'a\.\.b'"):
        is_local("a..b:5005")


@pytest.mark.parametrize("text", ["unix:", "unix:5", "host", "host:", ":5005", "host:65536", "host:-1"])
def test_malformed_addresses_are_refused(text):
    if text == "unix:5":
        assert address(text) == text  # a path
    else:
        with pytest.raises(argparse.ArgumentTypeError, match="expected HOST:PORT"):
            address(text)


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660])
@pytest.mark.promise("X2")
def test_a_token_that_other_users_can_read_is_refused(mode, tmp_path):
    token = tmp_path / "token"
    token.write_text(TOKEN)
    token.chmod(mode)
    with pytest.raises(CredentialsError, match=r"other users can read; keep it with `chmod 600 .*token`") as caught:
        load_credentials(token_file=token)
    assert TOKEN not in str(caught.value)
    token.chmod(0o600)
    assert load_credentials(token_file=token).token == TOKEN


# ------------------------------------------------------------------------------------------------------- TLS


def nothing(path: Path) -> None:
    path.write_bytes(b"")


def garbage(path: Path) -> None:
    path.write_bytes(b"\x00\xff garbage")


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-60])


def truncated_inside(path: Path) -> None:
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([*lines[:2], lines[-1]]))


def a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def a_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def an_endless_device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


DAMAGES = [nothing, garbage, truncated, truncated_inside, a_folder, a_pipe, an_endless_device]


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("damaged", ["server.pem", "server.key"])
@pytest.mark.promise("X1")
def test_a_server_that_is_told_to_use_tls_never_listens_without(damaged, damage, files, tmp_path, capsys):
    certificate, key, token = [Path(shutil.copy(file, tmp_path)) for file in files]
    damage(tmp_path / damaged)
    protection = ["--tls-cert", str(certificate), "--tls-key", str(key), "--token-file", str(token)]
    assert main(["serve", "--address", "0.0.0.0:0", *protection]) == 2
    errors = capsys.readouterr()
    assert errors.err.startswith("error: ") and str(tmp_path / damaged) in errors.err and "listening" not in errors.out


def test_a_key_of_another_certificate_or_with_a_password_is_refused(files, tmp_path):
    certificate, key, token = files
    for options in (["ecparam", "-name", "prime256v1", "-genkey", "-noout"], ["ec", "-in", str(key), "-aes128"]):
        password = ["-passout", "pass:secret"] if options[0] == "ec" else []
        other = tmp_path / options[0]
        subprocess.run(["openssl", *options, *password, "-out", str(other)], check=True, capture_output=True)
        with pytest.raises(CredentialsError, match=r"are no certificate and its key without a password"):
            load_server_credentials("127.0.0.1:0", certificate, other, token)


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_client_that_is_told_to_use_tls_never_calls_without(damage, files, tmp_path, capsys):
    certificate = Path(shutil.copy(files[0], tmp_path))
    damage(certificate)
    with pytest.raises(CredentialsError, match=str(certificate)):
        load_credentials(certificate, files[2])
    assert main(["list", "--simulator", "127.0.0.1:1", "--tls-ca", str(certificate)]) == 2
    assert str(certificate) in capsys.readouterr().err


FAR = "192.0.2.1:5005"  # an address that documents use and no machine has
SENDING = {
    "list": (main, ["list", "--simulator", FAR]),
    "new": (main, ["new", "--for", FAR, "--game", "orchard"]),
    "check": (check, ["check", FAR]),
    "doctor": (doctor, ["doctor", FAR]),
    "look": (look, ["look", FAR, "look.png", "--game", "orchard"]),
    "train": (trainer, ["train", "orchard/hybrid", "--simulator", FAR, "--wait", "1"]),
    "play": (viewer, ["play", "orchard", "--simulator", FAR, "--no-browser"]),
    "watch": (watch, ["watch", FAR, "--no-browser"]),
}


@pytest.mark.parametrize("command", SENDING)
@pytest.mark.promise("X2")
def test_no_command_sends_a_token_in_clear_text_to_another_machine(command, files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run, arguments = SENDING[command]
    assert run([*arguments, "--token-file", str(files[2])]) in (1, 2)
    printed = capsys.readouterr()
    assert f"the token would travel to {FAR} in clear text" in printed.err + printed.out
    assert TOKEN not in printed.err + printed.out


@pytest.mark.parametrize("place", [FAR, "[2001:db8::1]:5005", "nowhere.invalid:5005"])
def test_no_environment_sends_a_token_in_clear_text_to_another_machine(place):
    with pytest.raises(CredentialsError, match="in clear text; let that server use TLS"):
        BridgeEnv("orchard", simulator=ProtectedAddress(place, Credentials(token=TOKEN)))
    for place in ("127.0.0.1:1", "unix:s", "[::1]:1"):
        Credentials(token=TOKEN).channel(place).close()


# ------------------------------------------------------------------------------------------------- the token


@pytest.mark.parametrize(
    "content", ["", "short", "two words that are long enough", "x" * 1001, "ü" * 20, "a" * 20 + "\nb"]
)
def test_what_is_no_token_is_refused_without_being_shown(tmp_path, content):
    path = tmp_path / "token"
    path.write_text(content)
    with pytest.raises(CredentialsError) as caught:
        read_token(path)
    assert str(path) in str(caught.value) and (not content or content not in str(caught.value))


def test_files_that_cannot_be_read_are_named(tmp_path):
    with pytest.raises(CredentialsError, match=r"cannot read .*missing: No such file"):
        load_credentials(tls_ca=tmp_path / "missing")


def test_a_token_is_not_shown(files):
    assert TOKEN not in repr(load_credentials(token_file=files[2]))


def test_a_server_with_tls_speaks_to_no_client_without(guarded):
    with grpc.insecure_channel(guarded.server.address) as channel, pytest.raises(grpc.RpcError) as caught:
        rpc.SimulatorServiceStub(channel).ListGames(pb.ListGamesRequest(), timeout=SECONDS)
    assert caught.value.code() == StatusCode.UNAVAILABLE


# --------------------------------------------------------------------------------------------------- messages

UNARY = {
    "/joybridge.v1.SimulatorService/ListGames": pb.ListGamesRequest,
    "/joybridge.v1.SimulatorService/DescribeGame": pb.DescribeGameRequest,
    "/grpc.health.v1.Health/Check": health_pb2.HealthCheckRequest,
}
MALFORMED = [b"\xff", b"\x0a\x7f", b"\x0a\x03\x0a\x01\xff", b"\x0a\xff\xff\xff\xff\x7f", b"\x0b" * 200]


@pytest.mark.parametrize("method", UNARY)
def test_bytes_that_are_no_message_are_refused_by_every_unary_call(simulator, method):
    with grpc.insecure_channel(simulator) as channel:
        for data in MALFORMED:
            with pytest.raises(grpc.RpcError) as caught:
                channel.unary_unary(method)(data, timeout=SECONDS)
            assert caught.value.code() == StatusCode.INVALID_ARGUMENT
            assert caught.value.details().startswith("the request is not a message of this method: ")


@pytest.mark.parametrize(
    "method", ["/grpc.health.v1.Health/Watch", "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"]
)
def test_bytes_that_are_no_message_are_refused_by_the_companions(simulator, method):
    with grpc.insecure_channel(simulator) as channel:
        for data in MALFORMED:
            with pytest.raises(grpc.RpcError) as caught:
                list(channel.stream_stream(method)(iter([data]), timeout=SECONDS))
            assert caught.value.code() == StatusCode.INVALID_ARGUMENT


@pytest.mark.parametrize("algorithm", [grpc.Compression.Gzip, grpc.Compression.Deflate])
@pytest.mark.promise("X6")
def test_compressed_messages_are_refused_before_they_are_unpacked(simulator, algorithm):
    with Stream(simulator, compression=algorithm) as stream:
        code, text = stream.refusal(start("x" * 50_000_000))
    assert code == StatusCode.UNIMPLEMENTED and "is disabled" in text


@pytest.mark.parametrize(("size", "most"), [((0, 0), 0), ((8, 6), 64), ((640, 400), 21), ((2048, 2048), 1)])
def test_the_number_of_pictures_depends_on_their_size(size, most):
    spec = pb.GameSpec(picture=pb.PictureSize(width=size[0], height=size[1]))
    assert max_pictures(spec) == most
    assert most * 3 * size[0] * size[1] <= 2**24
    assert most * 3 * size[0] * size[1] <= response_bytes(spec, 1, 64) < 2**25


def test_more_pictures_than_the_bound_are_refused(monkeypatch):
    monkeypatch.setattr(limits, "MAX_PICTURE_BYTES", 5 * 3 * PICTURE[0] * PICTURE[1])
    session = Session({"hybrid": batched(Hybrid)})
    session.answer(start("hybrid"))
    axes, choices = np.ones((2, 2), np.float32), np.zeros((2, 2), np.int32)
    resting = pb.BehaviorAct(axes=pack(axes), choices=pack(choices))
    assert len(session.answer(act(resting, draw=[0] * 5)).step.pictures) == 5
    with pytest.raises(Refusal, match="asks for 6 pictures up to arena 1, expected at most 5 of"):
        session.answer(act(resting, draw=[1] * 6))


# ----------------------------------------------------------------------------------------------------- text


@given(st.text(st.builds(chr, st.integers(0, sys.maxunicode))))  # the default alphabet takes seconds to make
def test_printable_text_has_no_control_characters_and_is_left_alone_if_it_had_none(text):
    assert printable(text).isprintable()
    if text.isprintable():
        assert printable(text) == text


def test_control_characters_are_shown_as_python_writes_them():
    assert printable("a\x1b]0;owned\r\nb\u202e\udcff") == "a\\x1b]0;owned\\r\\nb\\u202e\\udcff"


@pytest.mark.parametrize("name", ["hybrid\x1b[2J", "a\nerror: run `curl …`"])
def test_control_characters_of_a_client_do_not_come_back(simulator, name):
    with Stream(simulator) as stream:
        code, text = stream.refusal(start("hybrid", version=pb.Version(product=name, revision=99)))
    assert code == StatusCode.FAILED_PRECONDITION and text.isprintable()


class Hostile(NamedTuple):
    """What gRPC raises for a status with control characters."""

    def code(self):
        return StatusCode.INTERNAL

    def details(self):
        return "\x1b]0;owned\x07\r\nerror: run `curl …`"

    def trailing_metadata(self):
        return None


def test_control_characters_of_a_server_do_not_reach_the_errors_of_a_client():
    text = str(from_grpc(Hostile(), "127.0.0.1:5005"))
    assert (
        text.startswith(r"error from the simulator at 127.0.0.1:5005: \x1b]0;owned\x07\r\nerror: run")
        and text.isprintable()
    )
    assert mismatch(pb.Version(revision=1), pb.Version(product="\x1b[2J\r\n")).isprintable()


# ----------------------------------------------------------------------------------- the kit, doctor and trainer


def test_kit_and_doctor_reach_a_protected_server_with_its_certificate_and_token(guarded, capsys):
    place = guarded.server.address
    protection = ["--tls-ca", str(guarded.certificate), "--token-file", str(guarded.token)]
    assert check(["check", place, *protection, "--family", "security", "--family", "health_and_reflection"]) == 0
    assert re.search(r"\n9 passed, 0 failed, 0 warnings, 0 not applicable in ", capsys.readouterr().out)
    assert doctor(["doctor", place, *protection, "--game", "orchard"]) == 0
    assert doctor(["doctor", place]) == 2
    assert "another program may listen there, or TLS is missing or wrong (--tls-ca)" in capsys.readouterr().out


@pytest.mark.slow
def test_a_trainer_reaches_a_protected_server_and_the_run_remembers_how(guarded, tmp_path, capsys, signals):
    run, place = tmp_path / "run", ["--simulator", guarded.server.address]
    protection = ["--tls-ca", str(guarded.certificate), "--token-file", str(guarded.token)]
    config = ["orchard/hybrid", "total_timesteps=4000", "log_interval=4000"]
    assert trainer(["train", *config, "--run", str(run), *place, "--tls-ca", str(guarded.certificate)]) == 1
    assert "--token-file" in capsys.readouterr().err
    assert trainer(["train", *config, "--run", str(run), *place, *protection]) == 0
    assert trainer(["evaluate", str(run), "--episodes", "2"]) == 0
    assert f"simulator: {guarded.server.address}, as in the training" in capsys.readouterr().err
    written = [file.read_bytes() for file in run.rglob("*") if file.is_file()]
    assert written and not any(TOKEN.encode() in content for content in written)
    assert trainer(["record", str(run), str(tmp_path / "play.mp4"), "--seconds", "1", *place, *protection]) == 0
    assert (
        main(["new", "--for", guarded.server.address, "--game", "orchard", "--folder", str(tmp_path), *protection]) == 0
    )
    assert (tmp_path / "orchard.yaml").exists()
    capsys.readouterr()
    assert main(["list", "--simulator", guarded.server.address, *protection]) == 0
    assert "\norchard: " in capsys.readouterr().out
    assert look(["look", guarded.server.address, str(tmp_path / "look.png"), "--game", "orchard", *protection]) == 0


def test_credentials_without_an_address_are_refused(capsys):
    for command in (["train", "orchard/hybrid"], ["evaluate", "run"], ["look", "orchard", "look.png"]):
        with pytest.raises(SystemExit):
            (look if command[0] == "look" else trainer)([*command, "--tls-ca", "server.pem"])
        assert "--tls-ca and --token-file belong to" in capsys.readouterr().err


def test_an_environment_plays_at_a_protected_server(guarded):
    credentials = load_credentials(guarded.certificate, guarded.token)
    env = BridgeEnv("orchard", simulator=ProtectedAddress(guarded.server.address, credentials))
    env.reset(seed=1)
    assert env.step(env.action_space.sample())[0].shape == env.observation_space.shape
    env.close()
