"""Start simulators on nodes of a Ray cluster: `python -m joybridge.ray_cluster.program HOST:PORT N SECONDS GAME…`.

Prints READY with the address, certificate and token of each simulator as JSON. The simulators end with this process,
which ends when its standard input closes.
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
from joybridge.ray_cluster.simulators import TOKEN, join_cluster

JOIN_SECONDS = 20.0
NOTICE_SECONDS = 10.0  # after which a wait is mentioned
END_SECONDS = 1.0  # for all of them to end; on a lost node they are gone
VALID_DAYS = 3650

Place = tuple[str, str, str]  # address, certificate (PEM) and token of a simulator


class Simulator:
    """A simulator on a node: an actor of Ray.

    Ray sends what belongs to `__main__` by value. So this class runs also on a node without joybridge, or with another
    version of it, and names the node. Hence it imports joybridge late.
    """

    def start(self, wanted: str, games: list[str]) -> Place:
        """Start it with further games, if `wanted` is the version here. Raises RuntimeError, which names the node."""
        from ray.util import get_node_ip_address

        host = get_node_ip_address()
        try:
            check_version(wanted)
            return self._start(host, games)
        except Exception as error:
            raise RuntimeError(f"node {host}: {error}") from None

    def _start(self, host: str, games: list[str]) -> Place:
        from joybridge.client.launch import simulator_process

        place = f"[{host}]:0" if ":" in host else f"{host}:0"
        running = ExitStack()
        with TemporaryDirectory(prefix="joybridge-") as folder:
            certificate, token, options = protect(Path(folder), host)
            address = running.enter_context(simulator_process(games, place, options))
        self.running = running
        return address, certificate, token

    def end(self) -> None:
        """End the simulator and the actor."""
        from ray.actor import exit_actor

        self.running.close()
        exit_actor()


def check_version(wanted: str) -> None:
    """Raise RuntimeError unless joybridge is installed here in the wanted version."""
    repair = f"install it there with `pip install 'joybridge[simulator,cluster]=={wanted}'`"
    try:
        found = version("joybridge")
    except PackageNotFoundError:
        raise RuntimeError(f"joybridge is not installed; {repair}") from None
    if found != wanted:
        raise RuntimeError(f"joybridge {found} is installed, but the trainer has {wanted}; {repair}")


def protect(folder: Path, host: str) -> tuple[str, str, list[str]]:
    """Make a key, a certificate for an IP address and a token. Return certificate, token and the options of `serve`."""
    key, certificate, token = folder / "key.pem", folder / "certificate.pem", folder / "token"
    token.touch(0o600)
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


def start_all(ray: Any, actors: list[Any], games: list[str], seconds: float) -> list[Place]:
    """Start the simulators of all actors. Raises SystemExit after so many seconds, or if one cannot be started."""
    count = len(actors)
    started = [actor.start.remote(version("joybridge"), games) for actor in actors]
    notice = min(NOTICE_SECONDS, seconds)
    try:
        ready, missing = ray.wait(started, num_returns=count, timeout=notice)
        if missing:
            ray.get(ready)
            print(
                f"waiting up to {seconds:g} s for {len(missing)} of {count} simulators: {cores(ray)}",
                file=sys.stderr,
            )
            ready, missing = ray.wait(started, num_returns=count, timeout=seconds - notice)
        places: list[Place] = ray.get(ready)
    except ray.exceptions.RayError as error:
        raise SystemExit(f"error: {getattr(error, 'cause', None) or error}") from None
    if missing:
        raise SystemExit(
            f"error: {len(ready)} of {count} simulators started within {seconds:g} s: {cores(ray)}; free cores, add "
            f"nodes, or lower --simulators"
        )
    return places


def cores(ray: Any) -> str:
    """Return how many cores of the cluster are free."""
    free, all_of_them = (resources().get("CPU", 0.0) for resources in (ray.available_resources, ray.cluster_resources))
    return f"{free:g} of {all_of_them:g} cores of the cluster are free, and a simulator needs one"


def give_up(address: str) -> None:
    """End this process with an error, although Ray is still trying to join."""
    text = f"error: the Ray cluster at {address} did not let us join within {JOIN_SECONDS:g} s; {TOKEN}"
    print(text, file=sys.stderr, flush=True)
    os._exit(1)


def main() -> None:
    """Start the simulators, and end them when standard input closes."""
    address, count, seconds, *games = sys.argv[1:]
    limit = Timer(JOIN_SECONDS, give_up, [address])
    limit.daemon = True
    limit.start()
    output, sys.stdout = sys.stdout, StringIO()  # Ray prints pages there when a node is lost
    ray = join_cluster(address, logging_level=logging.ERROR)
    limit.cancel()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # Ray's own handler prints its stack
    # On as many nodes as possible. If a node is lost before its simulator runs, Ray starts it elsewhere.
    remote = ray.remote(num_cpus=1, scheduling_strategy="SPREAD", max_restarts=-1, max_task_retries=-1)(Simulator)
    actors = [remote.remote() for _ in range(int(count))]  # an actor ends when nothing refers to it
    print(READY + json.dumps(start_all(ray, actors, games, float(seconds))), file=output)
    try:
        sys.stdin.buffer.read()  # nothing is ever written to it
    finally:  # Ray ends actors with this process, but not if the head of the cluster is gone
        ray.wait([actor.end.remote() for actor in actors], num_returns=len(actors), timeout=END_SECONDS)


if __name__ == "__main__":
    main()
