"""`joybridge replay`: repeat a recorded session on any simulator, and name the step where it fails or differs.

A session is recorded where something went wrong (a fault), or to show how something is done (a demonstration).
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from joybridge.client.client import CALL_SECONDS, Session
from joybridge.client.command_line import (
    add_simulator_options,
    check_simulator_options,
    run_command,
    say,
    wanted_simulators,
)
from joybridge.client.errors import SimulatorError
from joybridge.client.recording import Recording, RecordingError, digest, load_recording
from joybridge.client.simulator_source import open_simulators
from joybridge.demonstrations.files import foreign_kind


class FaultFound(SimulatorError):
    """The recorded session fails again, or is no longer the same; the text names the step."""


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.commands.replay") -> int:
    """Run the command line and return its exit status: 1 if a step fails or differs."""
    parser = argparse.ArgumentParser(prog=prog)
    commands = parser.add_subparsers(dest="command", required=True)
    replays = commands.add_parser("replay", help="repeat what led to a fault, or a demonstration")
    replays.add_argument("file", type=Path, help="a file of the folder faults of a run, or a demonstration")
    replays.set_defaults(overrides=[])
    add_simulator_options(replays)
    options = parser.parse_args(arguments)
    check_simulator_options(replays, options)
    if len(options.simulator) > 1:
        replays.error(f"replay uses one simulator, got {len(options.simulator)}")
    return run_command(_replay, options)


def _replay(options: argparse.Namespace) -> None:
    if kind := foreign_kind(options.file):
        raise RecordingError(
            f"{options.file} is {kind}, which cannot be repeated, because it does not hold the session; name a file "
            "that Joybridge recorded"
        )
    recording = load_recording(options.file)
    if recording.error:
        say(f"the fault was: {recording.error}")
    if recording.cut:
        say(f"its last record was not written to its end: {recording.cut} bytes are left out")
    with open_simulators(wanted_simulators(options), options.wait, say) as connect:
        steps = replay(connect()[0], recording, options.timeout or CALL_SECONDS)
    print(f"{steps} steps are as they were recorded, and none fails")


def replay(address: str, recording: Recording, timeout: float = CALL_SECONDS) -> int:
    """Repeat a recorded session at a simulator and return how many steps it has.

    Raises FaultFound at the first step that fails or that has other bytes than were recorded.
    """
    start = recording.start
    step = 0
    try:
        with Session(
            address, start.game, arenas=start.arenas, seed=start.seed, first_arena=start.first_arena,
            options=start.options, parameters=start.parameters, distributions=start.distributions,
            snapshot=start.snapshot.parts if start.HasField("snapshot") else None, timeout=timeout,
        ) as session:  # fmt: skip
            if session.server != recording.server:
                say(f"recorded with {recording.server}, replayed with {session.server}")
            for exchange in recording.exchanges:
                if not exchange.request.HasField("start"):
                    step += exchange.request.HasField("act")
                    session.repeat(exchange.request)
                if exchange.digest is not None and digest(session.steps) != exchange.digest:
                    raise FaultFound(f"step {step} has other bytes than were recorded")
    except FaultFound:
        raise
    except SimulatorError as error:
        raise FaultFound(f"step {step} fails: {error}") from error
    return step
