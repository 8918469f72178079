"""Product version and contract revisions of this package, and the comparison of two versions.

The rules are in the section VERSIONS of bridge.proto.
"""

from functools import cache
from importlib.metadata import version

from joybridge.contract.text import printable
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["OLDEST_REVISION", "PINGED_REVISION", "REVISION", "client_version", "mismatch", "own_version"]

REVISION = 2  # of bridge.proto; every release that adds to the file increases it by one
OLDEST_REVISION = 1  # that clients of this package can work with
PINGED_REVISION = 2  # from which on servers accept pings, see SESSION in bridge.proto


@cache
def own_version() -> pb.Version:
    """Return the version that this package states as a server."""
    return pb.Version(product=f"joybridge {version('joybridge')}", revision=REVISION)


@cache
def client_version() -> pb.Version:
    """Return the version that this package states as a client: the oldest revision that it can work with."""
    return pb.Version(product=own_version().product, revision=OLDEST_REVISION)


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
