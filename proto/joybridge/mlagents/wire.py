"""What both ends of the communicator say about themselves, and how they call each other."""

from joybridge.contract.errors import JoybridgeError
from joybridge.contract.text import printable
from joybridge.contract.versions import own_version
from joybridge.mlagents import communicator_pb2 as ml

SERVICE = "communicator_objects.UnityToExternalProto"
METHOD = "Exchange"
VERSION = "1.5.0"  # of the communicator
PORT = 5004  # where a trainer waits for a player that is started by hand
FINE, END, FAILED = 200, 400, 500  # of a header; a trainer takes a player's status that is not 200 for its end
MAX_MESSAGE_BYTES = 4 * 2**20  # bytes of a player's message: the server of ML-Agents takes no larger ones
ANY_LENGTH = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1)]


class CommunicatorError(JoybridgeError):
    """The other end of ML-Agents' communicator does not fit, is gone, or sent what cannot be used."""


def capabilities() -> ml.Capabilities:
    """Return what Joybridge understands."""
    return ml.Capabilities(
        base=True, concatenated_png=True, channel_mapping=True, hybrid_actions=True, variable_length=True, groups=True
    )


def check_version(other: str, who: str) -> None:
    """Raise CommunicatorError unless a version of the communicator has the same major number as ours.

    who: the other end, for the error.
    """
    if other.partition(".")[0] != VERSION.partition(".")[0]:
        came = printable(other[:30]) or "unknown"
        raise CommunicatorError(
            f"{who} speaks version {came} of ML-Agents' communicator, {own_version().product} "
            f"speaks {VERSION}; the first numbers must be equal: use another release of ML-Agents there"
        )
