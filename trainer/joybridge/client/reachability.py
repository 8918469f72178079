"""Why no simulator answers at an address, as far as a plain connection tells."""

import socket
from pathlib import Path

CONNECT_SECONDS = 1.0

__all__ = ["why_closed", "why_unreachable"]


def why_unreachable(address: str) -> str:
    """Return what is in the way at HOST:PORT or unix:PATH, a part of a sentence."""
    if address.startswith("unix:"):
        path = Path(address.removeprefix("unix:"))
        return "it does not answer as a simulator" if path.exists() else "there is no such socket"
    host, _, port = address.rpartition(":")
    problem = why_closed(host, int(port))
    return problem or "what listens there does not answer as a simulator; if it demands TLS, give --tls-ca"


def why_closed(host: str, port: int) -> str:
    """Return why no connection to a port can be opened, a part of a sentence; "" if one can."""
    host = host.strip("[]")
    try:
        socket.create_connection((host, port), CONNECT_SECONDS).close()
    except (socket.gaierror, UnicodeError):
        return f"the host name {host!r} is unknown here"
    except ConnectionRefusedError:
        return "nothing listens there"
    except TimeoutError:
        return "the host does not answer"
    except OSError as error:
        return str(error.strerror or error).lower()
    return ""
