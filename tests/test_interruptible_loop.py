"""The event loop of the sessions: all kinds of callers, and interrupts and finalizers at every instruction."""

import asyncio
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import ModuleType

import pytest

from joybridge.client import interruptible_loop
from joybridge.client.interruptible_loop import EventLoop
from joybridge.client.signals import uninterrupted, wait_for_interrupt
from tests.support.instructions import run_with

OURS = (interruptible_loop,)
TRACED = (interruptible_loop, asyncio.runners, asyncio.base_events)


@pytest.fixture
def loop() -> Iterator[EventLoop]:
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    loop = EventLoop()
    yield loop
    loop._close()
    signal.signal(signal.SIGINT, handler)


async def double(number: int) -> int:
    await asyncio.sleep(0)
    return 2 * number


async def wait_forever() -> None:
    await asyncio.Event().wait()


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


def interrupt_and_discard_exceptions() -> None:
    """Be interrupted in a place from which no exception gets out, such as a destructor or a callback of gRPC."""
    with suppress(BaseException):
        interrupt()


def instructions_of_run(loop: EventLoop, modules: tuple[ModuleType, ...], *, signals: bool) -> range:
    """Return the numbers of the instructions of `run`, once the loop exists."""
    loop.run(double, 1)
    count = run_with(lambda: None, 0, modules, lambda: loop.run(double, 1), signals=signals)
    assert count > 50
    return range(count)


def test_it_returns_the_result(loop):
    assert loop.run(double, 2) == 4


def test_it_raises_the_exception(loop):
    async def fail() -> None:
        raise LookupError("no such game")

    with pytest.raises(LookupError, match="no such game"):
        loop.run(fail)
    assert loop.run(double, 2) == 4


def test_it_runs_inside_another_event_loop(loop):
    async def cell() -> int:
        return loop.run(double, 2)

    assert asyncio.run(cell()) == 4


def test_threads_take_turns(loop):
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda number: loop.run(double, number), range(100))) == [2 * n for n in range(100)]


@pytest.mark.parametrize("interrupted", [interrupt, interrupt_and_discard_exceptions])
def test_an_interrupt_ends_a_wait(loop, interrupted):
    async def wait() -> None:
        asyncio.get_running_loop().call_soon(interrupted)
        await wait_forever()

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            loop.run(wait)
    assert loop.run(double, 2) == 4


def test_an_interrupt_ends_a_wait_inside_another_event_loop(loop):
    main = threading.get_ident()

    async def wait() -> None:
        signal.pthread_kill(main, signal.SIGINT)
        await wait_forever()

    async def cell() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # as notebooks have it
        with pytest.raises(KeyboardInterrupt):
            loop.run(wait)
        assert loop.run(double, 2) == 4

    asyncio.run(cell())


def test_an_interrupt_ends_a_wait_for_another_threads_turn(loop):
    begun, end = threading.Event(), asyncio.Event()
    main = threading.get_ident()

    async def hold() -> None:
        begun.set()
        signal.pthread_kill(main, signal.SIGINT)
        await end.wait()

    def wait_for_turn() -> None:
        other.start()
        begun.wait()
        loop.run(double, 2)

    other = threading.Thread(target=loop.run, args=(hold,))
    with pytest.raises(KeyboardInterrupt):
        wait_for_turn()
    loop._runner.get_loop().call_soon_threadsafe(end.set)
    other.join()
    assert loop.run(double, 2) == 4


def test_work_that_ignores_its_cancellation_does_not_lose_the_interrupt(loop):
    async def insist() -> int:
        asyncio.get_running_loop().call_soon(interrupt)
        with suppress(asyncio.CancelledError):
            await wait_forever()
        return 1

    with pytest.raises(KeyboardInterrupt):
        loop.run(insist)


def test_no_interrupt_is_lost_at_any_instruction(loop):
    for number in instructions_of_run(loop, TRACED, signals=True):
        with pytest.raises(KeyboardInterrupt):
            run_with(interrupt, number, TRACED, lambda: loop.run(double, 1), signals=True)
        assert loop.run(double, 2) == 4


def test_no_interrupt_is_lost_while_the_loop_holds_them_back_even_if_exceptions_are_discarded(loop):
    holding = False

    def act() -> None:
        nonlocal holding
        holding = loop._holding_interrupts
        interrupt_and_discard_exceptions()

    held = 0
    for number in instructions_of_run(loop, TRACED, signals=True):
        holding = raised = False
        try:
            run_with(act, number, TRACED, lambda: loop.run(double, 1), signals=True)
        except KeyboardInterrupt:
            raised = True
        assert raised == holding, number
        held += holding
    assert held > 10


def test_the_programs_own_handler_stays_and_may_end_a_wait(loop):
    def stop(number: int, frame: object) -> None:
        raise SystemExit("stopped")

    async def wait() -> None:
        asyncio.get_running_loop().call_soon(interrupt)
        await wait_forever()

    signal.signal(signal.SIGINT, stop)
    with pytest.raises(SystemExit, match="stopped"):
        loop.run(wait)
    assert loop.run(double, 2) == 4
    assert signal.getsignal(signal.SIGINT) is stop


def test_the_programs_own_handler_may_end_a_wait_inside_another_event_loop(loop):
    main = threading.get_ident()

    def stop(number: int, frame: object) -> None:
        raise SystemExit("stopped")

    async def wait() -> None:
        signal.pthread_kill(main, signal.SIGINT)
        await wait_forever()

    async def cell() -> None:
        signal.signal(signal.SIGINT, stop)
        with pytest.raises(SystemExit, match="stopped"):
            loop.run(wait)
        assert loop.run(double, 2) == 4

    asyncio.run(cell())


def test_a_finalizer_never_waits_at_any_instruction(loop):
    """What it wants done while the loop is in use is done by a later run."""
    done = 0

    async def finish() -> None:
        nonlocal done
        await asyncio.sleep(0)
        done += 1

    instructions = instructions_of_run(loop, OURS, signals=False)
    for number in instructions:
        run_with(lambda: loop.run_soon(finish), number, OURS, lambda: loop.run(double, 1))
    loop.run(asyncio.sleep, 0)
    loop.run(asyncio.sleep, 0)
    assert done == len(instructions)


def test_what_a_finalizer_wants_after_the_end_is_not_done(loop):
    loop._close()
    loop.run_soon(wait_forever)


def test_the_end_of_the_program_leaves_alone_what_a_daemon_thread_waits_for(loop):
    """`joybridge play` ends while the thread of a page waits for the simulator."""
    running, end = threading.Event(), asyncio.Event()

    async def wait() -> str:
        running.set()
        await end.wait()
        return "done"

    with ThreadPoolExecutor(1) as pool:
        result = pool.submit(loop.run, wait)
        running.wait()
        try:
            loop._close()
        finally:
            loop._runner.get_loop().call_soon_threadsafe(end.set)
        assert result.result() == "done"


def test_an_interrupt_in_a_block_without_interrupts_is_raised_after_it():
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        handler = signal.signal(number, signal.default_int_handler)
        done: list[int] = []
        with pytest.raises(KeyboardInterrupt):
            _raise_in_block(number, done)
        assert done == [number]
        assert signal.signal(number, handler) is signal.default_int_handler


def _raise_in_block(number: int, done: list[int]) -> None:
    with uninterrupted():
        signal.raise_signal(number)
        done.append(number)


def test_a_wait_ends_by_a_signal_that_another_thread_receives():
    """`threading.Event.wait` would go on: nothing wakes the main thread, which alone handles signals."""
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    other = threading.Timer(0.05, lambda: signal.pthread_kill(threading.get_ident(), signal.SIGINT))

    def wait() -> None:
        other.start()
        wait_for_interrupt()

    try:
        with pytest.raises(KeyboardInterrupt):
            wait()
    finally:
        other.join()
        signal.signal(signal.SIGINT, handler)
