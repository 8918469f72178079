"""Simulators on the nodes of a Ray cluster, and how a program joins one."""

import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from joybridge.client.launch import announcing
from joybridge.client.reachability import why_closed
from joybridge.contract.credentials import Credentials, ProtectedAddress

__all__ = ["PRIVATE", "TOKEN", "cluster_simulators", "import_ray", "join_cluster"]

# Environment of a cluster on this machine: addresses on loopback only, no usage statistics sent.
PRIVATE = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_USAGE_STATS_ENABLED": "0"}
TOKEN = "if it asks for a token, set RAY_AUTH_MODE=token"  # noqa: S105, as `ray start` of 2.60 does
PROGRAM = [sys.executable, "-P", "-u", "-m", "joybridge.ray_cluster.program"]


@contextmanager
def cluster_simulators(cluster: str, count: int, games: Sequence[str], wait: float) -> Iterator[list[str]]:
    """Start `count` simulators on the nodes of the cluster at HOST:PORT and yield their addresses with credentials.

    games: as for `simulator_process`, installed on the nodes. wait: seconds to wait for free cores. The simulators end
    with the block, or with this process if that is killed. Raises SimulatorLost.

    A process of its own joins the cluster, because Ray ends a process whose cluster is lost, and a trainer must save.
    """
    with announcing([*PROGRAM, cluster, f"{count}", f"{wait}", *games], "") as places:
        yield [
            ProtectedAddress(address, Credentials(certificate.encode(), token))
            for address, certificate, token in json.loads(places)
        ]


def join_cluster(address: str, **options: Any) -> Any:
    """Join the Ray cluster at HOST:PORT with options of `ray.init`, and return the module `ray`.

    Raises SystemExit if Ray is not installed, no cluster is there, or it refuses the connection.
    """
    host, _, port = address.rpartition(":")
    if host == "127.0.0.1":
        os.environ.update(PRIVATE)  # read when Ray is imported
    if not port.isdecimal():
        raise SystemExit(f"error: no Ray cluster at {address}: expected HOST:PORT of its head, as in 10.0.0.1:6379")
    if problem := why_closed(host, int(port)):  # Ray would try for minutes
        raise SystemExit(
            f"error: no Ray cluster at {address}: {problem}; start it with `ray start --head --port {port}`, or give "
            "the address of its head"
        )
    ray = import_ray()
    try:
        ray.init(address, log_to_driver=False, **options)
    except (ConnectionError, RuntimeError) as error:  # RuntimeError: another version of Ray or Python, in many lines
        raise SystemExit(f"error: {' '.join(str(error).split())}; {TOKEN}") from error
    return ray


def import_ray() -> Any:
    """Return the module `ray`. Raises SystemExit if it is not installed."""
    try:
        import ray
    except ImportError as error:
        raise SystemExit(f"error: {error}; install it with `pip install 'joybridge[cluster]'`") from error
    return ray
