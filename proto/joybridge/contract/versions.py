"""Product version and contract revision of this package, and the comparison of two versions.

The rules are in the section VERSIONS of bridge.proto.
"""

from functools import cache
from importlib.metadata import version

from joybridge.contract.text import printable
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["REVISION", "mismatch", "own_version"]

REVISION = 1  # of bridge.proto; every release that adds to the file increases it by one


@cache
def own_version() -> pb.Version:
    """Return the version that this package states, as a client and as a server."""
    return pb.Version(product=f"joybridge {version('joybridge')}", revision=REVISION)


def mismatch(client: pb.Version, server: pb.Version) -> str:
    """Return why a client cannot work with a server, in one sentence with the fix, or "" if it can.

    Revision 0 means that a side does not state its revision. A client that states none works with every server;
    a server that states none is too old for every client that needs a revision.
    """
    if client.revision <= server.revision:
        return ""
    return printable(
        f"the client ({client.product or 'unnamed'}) needs contract revision {client.revision}, the simulator "
        f"({server.product or 'unnamed'}) has revision {server.revision or 'none'}; update the simulator, or use a "
        "client of its version"
    )
