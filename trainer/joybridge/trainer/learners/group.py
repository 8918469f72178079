"""The learners of a run as a group of Gloo, which adds up tensors, and who of them is missing.

Gloo has neither tokens nor encryption. So its sockets are bound to one address: that of loopback, or the one with which
a machine reaches its cluster.
"""

import socket
from collections.abc import Callable, Sequence
from datetime import timedelta
from threading import Thread
from typing import Any

from torch import Tensor
from torch.distributed import (  # type: ignore[attr-defined]
    BroadcastOptions,
    ProcessGroupGloo,
    Store,
    TCPStore,
    Work,
)

from joybridge.trainer.errors import LearnerLost

__all__ = ["FOREVER", "Group", "Store", "TCPStore", "answer_presence", "missing_learners", "own_address"]

PRESENCE, PRESENCE_SECONDS = "presence", 2.0  # a key of the store; to wait for an answer
FOREVER = timedelta(days=365)
Gloo: Any = ProcessGroupGloo  # whose methods torch does not declare


class Group:
    """The learners of a run, which do the same operations in the same order; 0 is the trainer."""

    def __init__(self, store: Store, number: int, count: int, host: str, seconds: float) -> None:
        """Connect this learner with all others, which meet at the store.

        host: the IP address of this machine that they reach. seconds: to wait for each operation. Raises LearnerLost.
        """
        self.store, self.number, self.count = store, number, count
        options = Gloo._Options()
        options._timeout = timedelta(seconds=seconds)
        options._devices = [Gloo.create_device(hostname=host)]
        try:
            self.gloo = Gloo(store, number, count, options)
        except RuntimeError as error:
            raise self._lost(error) from None

    def add_up(self, tensor: Tensor) -> None:
        """Replace a tensor by the sum of those of all learners, which is the same bit for bit everywhere."""
        self._wait(lambda: [self.gloo.allreduce([tensor])])

    def spread(self, tensor: Tensor) -> None:
        """Replace a tensor by that of the trainer."""
        options = BroadcastOptions()
        options.rootRank = 0
        self._wait(lambda: [self.gloo.broadcast([tensor], options)])

    def send(self, tensors: Sequence[Sequence[Tensor]]) -> None:
        """Send the learners 1, 2, … their tensors."""
        self._wait(
            lambda: [
                self.gloo.send([tensor], number, 0)
                for number, own in enumerate(tensors, 1)
                for tensor in own
                if tensor.numel()
            ]
        )

    def receive(self, tensors: Sequence[Tensor]) -> None:
        """Replace tensors by those that the trainer sends."""
        self._wait(lambda: [self.gloo.recv([tensor], 0, 0) for tensor in tensors if tensor.numel()])

    def _wait(self, begin: Callable[[], list[Work]]) -> None:
        try:
            for work in begin():
                work.wait()
        except RuntimeError as error:
            raise self._lost(error) from None

    def _lost(self, error: RuntimeError) -> LearnerLost:
        """Return the error to raise. The trainer asks who is present, because Gloo names nobody who does not answer."""
        reason = f"{error}".partition("] ")[2].partition(". ")[0] or f"{error}"
        missing = [] if self.number else missing_learners(self.store, self.count)
        who = ", ".join(f"learner {number} of {self.count}" for number in missing) or "a learner"
        return LearnerLost(f"lost {who}: {reason}")


def missing_learners(store: Store, count: int) -> list[int]:
    """Ask all other learners whether they are present; return the numbers of those that do not answer."""
    store.set(PRESENCE, "")
    missing: list[int] = []
    for number in range(1, count):
        try:
            store.wait([f"{PRESENCE} {number}"], timedelta(seconds=0.01 if missing else PRESENCE_SECONDS))
        except RuntimeError:
            missing.append(number)
    return missing


def answer_presence(host: str, port: int, number: int) -> None:
    """Answer from a thread of its own when the trainer asks who is present; the store is at host and port."""

    def answer() -> None:
        try:
            store = TCPStore(host, port, timeout=FOREVER)
            store.wait([PRESENCE], FOREVER)
            store.set(f"{PRESENCE} {number}", "")
        except RuntimeError:  # the trainer is gone
            pass

    Thread(target=answer, daemon=True).start()


def own_address(host: str, port: int) -> str:
    """Return the IP address with which this machine reaches another one."""
    family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    with socket.socket(family, kind, protocol) as probe:
        probe.connect(place)  # sends nothing
        return str(probe.getsockname()[0])
