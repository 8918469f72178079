"""Do something in the middle of a function, at every bytecode instruction where it may happen."""

import dis
import sys
from collections.abc import Callable, Collection
from types import CodeType, FrameType, ModuleType
from typing import Any


def run_with(
    action: Callable[[], object],
    number: int,
    modules: Collection[ModuleType],
    work: Callable[[], object],
    *,
    signals: bool = False,
) -> int:
    """Call `work`, and call `action` before the instruction of that number, from 0, among those of some modules.

    signals: count only the instructions before which Python may handle signals. Returns the number of instructions.
    """
    files = {module.__file__ for module in modules}
    names: dict[CodeType, dict[int, str]] = {}
    count = 0

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        code, before = frame.f_code, ""
        if code.co_filename not in files:
            return None
        if code not in names:
            names[code] = {each.offset: each.opname for each in dis.get_instructions(code)}
        frame.f_trace_opcodes = True

        def trace_instruction(frame: FrameType, event: str, argument: Any) -> Any:
            nonlocal count, before
            if event == "opcode":
                name = names[code][frame.f_lasti]
                if not signals or before.startswith("CALL") or name in ("RESUME", "JUMP_BACKWARD"):
                    count += 1
                    if count == number + 1:
                        action()
                before = name
            return trace_instruction

        return trace_instruction

    previous = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(previous)
    return count
