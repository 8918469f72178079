"""Start programs on nodes of a Ray cluster: `python -m joybridge.trainer.wire.ray_program HOST:PORT N SECONDS KIND`.

KIND is simulator or learner. Further arguments are games, or the place of the store of the learners. Prints READY with
the address, certificate and token of each simulator as JSON, or the nodes of the learners. What it has started ends
with this process, which ends when its standard input closes.
"""

import json
import logging
import os
import secrets
import signal
import subprocess
import sys
from contextlib import ExitStack
from importlib.metadata import PackageNotFoundError, version
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Timer
from typing import Any

from joybridge.contract.address import READY
from joybridge.trainer.wire.cluster import TOKEN, join_cluster

JOIN_SECONDS = 20.0
NOTICE_SECONDS = 10.0  # after which a wait is mentioned
END_SECONDS = 1.0  # for all of them to end; on a lost node they are gone
VALID_DAYS = 3650

Place = tuple[str, str, str]  # address, certificate (PEM) and token of a simulator


class Program:
    """A program on a node: an actor of Ray.

    Ray sends what belongs to `__main__` by value. So this class runs also on a node without joybridge, or with another
    version of it, and names the node. Hence it imports joybridge late.
    """

    extra = ""  # of the package, which the program needs
    running: ExitStack

    def start(self, wanted: str, arguments: list[str]) -> Any:
        """Start the program, if `wanted` is the version here. Raises RuntimeError, which names the node."""
        from ray.util import get_node_ip_address

        host = get_node_ip_address()
        try:
            check_version(wanted, self.extra)
            return self._start(host, arguments)
        except Exception as error:
            raise RuntimeError(f"node {host}: {error}") from None

    def _start(self, host: str, arguments: list[str]) -> Any:
        raise NotImplementedError

    def end(self) -> None:
        """End the program and the actor."""
        from ray.actor import exit_actor

        self.running.close()
        exit_actor()


class Simulator(Program):
    """A simulator; its arguments are games."""

    extra = "simulator"

    def _start(self, host: str, arguments: list[str]) -> Place:
        from joybridge.trainer.wire.launch import simulator_process

        place = f"[{host}]:0" if ":" in host else f"{host}:0"
        running = ExitStack()
        with TemporaryDirectory(prefix="joybridge-") as folder:
            certificate, token, options = protect(Path(folder), host)
            address = running.enter_context(simulator_process(arguments, place, options))
        self.running = running
        return address, certificate, token


class Learner(Program):
    """A learner beside the trainer; its argument is the place of their store."""

    extra = "train"

    def _start(self, host: str, arguments: list[str]) -> str:
        from joybridge.trainer.wire.launch import learner_processes

        self.running = ExitStack()
        self.running.enter_context(learner_processes(arguments[0], 1))
        return host


def check_version(wanted: str, extra: str) -> None:
    """Raise RuntimeError unless joybridge is installed here in the wanted version."""
    repair = f"install it there with `pip install 'joybridge[{extra},cluster]=={wanted}'`"
    try:
        found = version("joybridge")
    except PackageNotFoundError:
        raise RuntimeError(f"joybridge is not installed; {repair}") from None
    if found != wanted:
        raise RuntimeError(f"joybridge {found} is installed, but the trainer has {wanted}; {repair}")


def protect(folder: Path, host: str) -> tuple[str, str, list[str]]:
    """Make a key, a certificate for an IP address and a token. Return certificate, token and the options of `serve`."""
    key, certificate, token = folder / "key.pem", folder / "certificate.pem", folder / "token"
    token.write_text(secrets.token_hex(32))
    curve = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1"]
    name = ["-subj", "/CN=joybridge", "-addext", f"subjectAltName=IP:{host}", "-days", f"{VALID_DAYS}"]
    files = ["-keyout", f"{key}", "-out", f"{certificate}"]
    try:
        subprocess.run(["openssl", "req", "-x509", "-nodes", *curve, *name, *files], check=True, capture_output=True)
    except FileNotFoundError:
        raise RuntimeError("the program openssl, which makes certificates, is missing; install it there") from None
    options = ["--tls-cert", f"{certificate}", "--tls-key", f"{key}", "--token-file", f"{token}"]
    return certificate.read_text(), token.read_text(), options


def start_all(ray: Any, actors: list[Any], arguments: list[str], seconds: float, kind: str = "simulator") -> list[Any]:
    """Start the programs of all actors. Raises SystemExit after so many seconds, or if one cannot be started.

    Return what they say of their places.
    """
    count = len(actors)
    started = [actor.start.remote(version("joybridge"), arguments) for actor in actors]
    notice = min(NOTICE_SECONDS, seconds)
    try:
        ready, missing = ray.wait(started, num_returns=count, timeout=notice)
        if missing:
            ray.get(ready)
            print(
                f"waiting up to {seconds:g} s for {len(missing)} of {count} {kind}s: {cores(ray, kind)}",
                file=sys.stderr,
            )
            ready, missing = ray.wait(started, num_returns=count, timeout=seconds - notice)
        places: list[Any] = ray.get(ready)
    except ray.exceptions.RayError as error:
        raise SystemExit(f"error: {getattr(error, 'cause', None) or error}") from None
    if missing:
        raise SystemExit(
            f"error: {len(ready)} of {count} {kind}s started within {seconds:g} s: {cores(ray, kind)}; free cores, add "
            f"nodes, or lower --{kind}s"
        )
    return places


def cores(ray: Any, kind: str) -> str:
    """Return how many cores of the cluster are free."""
    free, all_of_them = (resources().get("CPU", 0.0) for resources in (ray.available_resources, ray.cluster_resources))
    return f"{free:g} of {all_of_them:g} cores of the cluster are free, and a {kind} needs one"


def give_up(address: str) -> None:
    """End this process with an error, although Ray is still trying to join."""
    text = f"error: the Ray cluster at {address} did not let us join within {JOIN_SECONDS:g} s; {TOKEN}"
    print(text, file=sys.stderr, flush=True)
    os._exit(1)


def main() -> None:
    """Run the program."""
    address, count, seconds, kind, *arguments = sys.argv[1:]
    limit = Timer(JOIN_SECONDS, give_up, [address])
    limit.daemon = True
    limit.start()
    output, sys.stdout = sys.stdout, StringIO()  # Ray prints pages there when a node is lost
    ray = join_cluster(address, logging_level=logging.ERROR)
    limit.cancel()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # Ray's own handler prints its stack
    program = {"simulator": Simulator, "learner": Learner}[kind]
    # On as many nodes as possible. If a node is lost before its program runs, Ray starts it elsewhere.
    remote = ray.remote(num_cpus=1, scheduling_strategy="SPREAD", max_restarts=-1, max_task_retries=-1)(program)
    actors = [remote.remote() for _ in range(int(count))]  # an actor ends when nothing refers to it
    print(READY + json.dumps(start_all(ray, actors, arguments, float(seconds), kind)), file=output)
    try:
        sys.stdin.buffer.read()  # nothing is ever written to it
    finally:  # Ray ends actors with this process, but not if the head of the cluster is gone
        ray.wait([actor.end.remote() for actor in actors], num_returns=len(actors), timeout=END_SECONDS)


if __name__ == "__main__":
    main()
