"""The trainer's end of ML-Agents' communicator: a gRPC server that one player at a time calls.

The player calls Exchange with what it has to say, and is held until it is answered. So this is a conversation in turns:
`receive` returns what the player says, `answer` answers it. Whatever the player does, both end in time.
"""

import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from queue import Empty, SimpleQueue
from threading import Thread, Timer
from typing import Any

import grpc
from google.protobuf.message import DecodeError

from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents.wire import END, FINE, METHOD, SERVICE
from joybridge.simulator.batched_game import GameError

MAX_MESSAGE_BYTES = 2**26  # bytes of a player's message; trainers of ML-Agents take 2**22
LOOK_SECONDS = 0.5  # between two looks at whether the player is alive
GRACE_SECONDS = 1.0  # for the last answer to arrive
OPTIONS = [
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    ("grpc.max_send_message_length", -1),
    ("grpc.so_reuseport", 0),  # otherwise two servers could listen on one port
]

LAST = ml.Message(header=ml.Header(status=END)).SerializeToString()  # tells a player that this is the end
GONE = "has gone; see its log, and start it again"
SILENT = f"said nothing for {{:g}} s, or more than {MAX_MESSAGE_BYTES} bytes at once; see its log, or allow more time"


class Call:
    """One call of the player, which waits for its answer."""

    def __init__(self, data: bytes, peer: str) -> None:
        """data: the message that came; peer: the connection that it came from."""
        self.data, self.peer = data, peer
        self.answer: SimpleQueue[bytes] = SimpleQueue()
        self.over = False  # it was answered, or the player has gone

    def end(self) -> None:
        """Note that gRPC has ended the call."""
        self.over = True
        self.answer.put(b"")


class Communicator:
    """Listens for one player at a time on a port of this machine."""

    def __init__(self, port: int = 0) -> None:
        """Listen on a port; 0: any free one. Raises GameError if it is taken."""
        self._calls: SimpleQueue[Call] = SimpleQueue()
        self._call: Call | None = None  # that has been received and not been answered
        self._peer = ""  # the connection of the present player
        self._closing = False  # then a player that calls is told that this is the end
        handler = grpc.unary_unary_rpc_method_handler(self._exchange)  # bytes, so that what is malformed arrives here
        self._threads = DaemonPool(2)
        self._server = grpc.server(self._threads, options=OPTIONS)
        self._server.add_generic_rpc_handlers([grpc.method_handlers_generic_handler(SERVICE, {METHOD: handler})])
        try:
            self.port: int = self._server.add_insecure_port(f"127.0.0.1:{port}")
        except RuntimeError as error:
            raise GameError(f"cannot listen on port {port} for a player: it is in use; give another one") from error
        self._server.start()

    def receive(self, seconds: float, alive: Callable[[], str] = str) -> ml.Message:
        """Return what the player says next. Raises GameError if it says nothing, has ended or cannot be understood.

        alive: returns why the player cannot say anything any more, "" as long as it can.
        """
        limit = time.monotonic() + seconds
        while self._call is None or self._call.over:
            if self._call is not None and self._call.peer == self._peer:
                raise self.fault(GONE)
            left = limit - time.monotonic()
            try:
                call = self._calls.get(timeout=max(0.0, min(left, LOOK_SECONDS)))
                if self._peer not in ("", call.peer):  # it called before the present player was known
                    call.answer.put(LAST)
                else:
                    self._call = call
            except Empty:
                if text := alive():
                    raise self.fault(text) from None
                if left <= LOOK_SECONDS:
                    raise self.fault(SILENT.format(seconds)) from None
        self._peer = self._call.peer
        try:
            message = ml.Message.FromString(self._call.data)
        except DecodeError as error:
            raise self.fault("sent what is no message of ML-Agents; update its package") from error
        if message.header.status != FINE:
            raise self.fault(f"has ended (status {message.header.status}); see its log, and start it again")
        return message

    def fault(self, text: str) -> GameError:
        """Return the error for what the player does."""
        return GameError(f"the player at port {self.port} {text}")

    @property
    def waiting(self) -> bool:
        """Whether a player waits for an answer."""
        return self._call is not None and not self._call.over

    def answer(self, content: ml.FromTrainer) -> None:
        """Answer what was received. Raises GameError if the player has gone."""
        call, self._call = self._call, None
        if call is None or call.over:
            raise self.fault(GONE)
        call.answer.put(ml.Message(header=ml.Header(status=FINE), from_trainer=content).SerializeToString())

    def dismiss(self) -> None:
        """Tell the player that this is the end; another player may come then."""
        for call in [self._call, *_rest(self._calls)]:
            if call is not None:
                call.answer.put(LAST)
        self._call, self._peer = None, ""

    def close(self) -> None:
        """Dismiss the player, also one that still computes and calls in a moment, and then listen no longer."""
        self._closing = True
        self.dismiss()
        last = Timer(GRACE_SECONDS, self._stop, (0.0,))
        last.daemon = True
        last.start()

    def end(self) -> None:
        """Close, and wait until the player has heard of it."""
        self.dismiss()
        self._stop(GRACE_SECONDS)

    def _stop(self, seconds: float) -> None:
        """Listen no longer, and end calls after so many seconds."""
        self._server.stop(seconds).wait(GRACE_SECONDS)
        self._threads.shutdown()

    def _exchange(self, data: bytes, context: Any) -> bytes:
        call = Call(data, context.peer())
        if self._peer not in ("", call.peer):
            context.abort(grpc.StatusCode.FAILED_PRECONDITION, "another player is connected; give this one a port")
        if not context.add_callback(call.end):
            return b""
        self._calls.put(call)
        if self._closing:
            self.dismiss()
        return call.answer.get()


class DaemonPool(Executor):
    """Threads for a gRPC server that do not hold up the end of the process."""

    def __init__(self, threads: int) -> None:
        """Start the threads."""
        self._count = threads
        self._jobs: SimpleQueue[tuple[Future[Any], Callable[..., Any], Any, Any] | None] = SimpleQueue()
        for _ in range(threads):
            Thread(target=self._work, daemon=True).start()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Let a thread call the function."""
        future: Future[Any] = Future()
        self._jobs.put((future, function, args, kwargs))
        return future

    def shutdown(self, wait: bool = False, *, cancel_futures: bool = False) -> None:
        """Let the threads end after the functions that were given to them, without waiting for it."""
        for _ in range(self._count):
            self._jobs.put(None)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            future, function, args, kwargs = job
            try:
                future.set_result(function(*args, **kwargs))
            except BaseException as error:
                future.set_exception(error)


def _rest(calls: "SimpleQueue[Call]") -> list[Call]:
    found = []
    while not calls.empty():
        found.append(calls.get())
    return found
