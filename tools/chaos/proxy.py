"""A proxy between a client and a server that holds bytes back, swallows them, or resets its connections."""

import socket
import struct
import threading
from contextlib import suppress


class Proxy:
    """Passes bytes between clients and a server."""

    def __init__(self, target: str) -> None:
        """Listen on a free port of this machine. target: HOST:PORT."""
        host, _, port = target.rpartition(":")
        self.target = (host, int(port))
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.listener.getsockname()[1]}"
        self.flowing = threading.Event()  # while it is not set, every byte is held back
        self.flowing.set()
        self.ends: list[socket.socket] = []
        self.swallowed: set[socket.socket] = set()  # ends whose bytes go nowhere
        threading.Thread(target=self._accept, daemon=True).start()

    def swallow(self) -> None:
        """Let the bytes of all present connections vanish, without closing them. New connections are not affected."""
        self.swallowed.update(self.ends)

    def cut(self) -> None:
        """Reset all connections."""
        for end in self.ends:
            with suppress(OSError):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        self.ends = []

    def _accept(self) -> None:
        while True:
            client, _ = self.listener.accept()
            server = socket.create_connection(self.target)
            self.ends += [client, server]
            for source, sink in ((client, server), (server, client)):
                threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                self.flowing.wait()
                if source not in self.swallowed:
                    sink.sendall(data)
