"""`joybridge replay`: repeat a recorded session on any simulator, and name the step where it fails or differs.

A session is recorded where something went wrong (a fault), or to show how something is done (a demonstration). Under
other options that change only what is observed, a demonstration is recorded again as they show it.
"""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from joybridge.client.calls import CALL_SECONDS
from joybridge.client.client import Session
from joybridge.client.command_line import (
    add_simulator_options,
    add_trust_option,
    check_simulator_options,
    wanted_simulators,
)
from joybridge.client.errors import SimulatorError
from joybridge.client.fault_log import FAULTS
from joybridge.client.recording import Recording, RecordingError, digest, load_recording
from joybridge.client.run_command import run_command
from joybridge.client.simulator_source import SimulatorSource, last_simulators, open_simulators
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import read_settings
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.argument_types import command_parser
from joybridge.contract.codec import StepArrays
from joybridge.demonstrations.files import foreign_kind
from joybridge.progress import say
from joybridge.v1 import bridge_pb2 as pb


class FaultFound(SimulatorError):
    """The recorded session fails again, or is no longer the same; the text names the step."""


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line and return its exit status: 1 if a step fails or differs."""
    parser, replays = command_parser(
        prog, "replay", "Repeat what led to a fault, or a demonstration, and say where the game plays otherwise."
    )
    replays.add_argument("file", type=Path, help="a file of the folder faults of a run, or a demonstration")
    replays.add_argument("--demos", type=Path, metavar="DIR", help="record a demonstration again, into this folder")
    add_simulator_options(replays, "for a fault, a simulator with the games of its run; otherwise ")
    add_trust_option(replays)
    add_overrides(replays, "options that change only what is observed, as in options.observation=screen")
    options = parse_overrides(parser, arguments)
    options.changed, options.overrides = options.overrides, []
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
    changed = read_settings(options.changed)
    if changed.parameters:
        raise ConfigError(f"parameters.{next(iter(changed.parameters))}=…: replay changes options only; leave it out")
    if recording.spec is None and (changed.options or options.demos):
        raise RecordingError(f"{options.file} holds a fault, expected a demonstration; repeat it as it was recorded")
    with open_simulators(_simulators(options), options.wait, say) as connect:
        steps = replay(connect()[0], recording, options.timeout or CALL_SECONDS, changed.options, options.demos)
    how = "are paid and end as they were recorded" if changed.options else "are as they were recorded"
    print(f"{steps} steps {how}, and none fails")


def _simulators(options: argparse.Namespace) -> SimulatorSource:
    """Return the simulators of the command line; if it names none, the games of the run in whose faults the file is."""
    wanted, folder = wanted_simulators(options), options.file.resolve().parent
    if wanted != SimulatorSource() or folder.name != FAULTS:
        return wanted
    last = last_simulators(folder.parent)
    return SimulatorSource(games=last.believed(options.trust_run).games) if last.simulators.games else wanted


def replay(
    address: str,
    recording: Recording,
    timeout: float = CALL_SECONDS,
    options: Mapping[str, str] | None = None,
    demos: Path | None = None,
) -> int:
    """Repeat a recorded session at a simulator and return how many steps it has.

    options: of the game, which differ from those of the recording, a demonstration, and change only observations.
    demos: record it again, into this folder.

    Raises FaultFound at the first step that fails or that has other bytes than were recorded; if options differ, other
    rewards or ends.
    """
    start, options = recording.start, options or {}
    step = 0
    try:
        with Session(
            address,
            start.game,
            arenas=start.arenas,
            seed=start.seed,
            first_arena=start.first_arena,
            options={**start.options, **options},
            parameters=start.parameters,
            distributions=start.distributions,
            snapshot=start.snapshot.parts if start.HasField("snapshot") else None,
            timeout=timeout,
        ) as session:
            if session.server != recording.server:
                say(f"recorded with {recording.server}, replayed with {session.server}")
            copy = session.record_demonstration(demos) if demos else None
            for exchange in recording.exchanges:
                if copy:
                    copy.hold(exchange.held)
                if not exchange.request.HasField("start"):
                    step += exchange.request.HasField("act")
                    session.repeat(exchange.request)
                    if recording.error and (failed := session.failed_arenas()):
                        raise FaultFound(
                            f"step {step} fails: the game failed in arenas {failed}; see the simulator's log"
                        )
                if options and exchange.step and _earned(session.steps) != _recorded(exchange.step):
                    raise FaultFound(
                        f"step {step} has other rewards or ends than were recorded, so {_named(options)} changes more "
                        "than what is observed"
                    )
                if not options and exchange.digest is not None and digest(session.steps) != exchange.digest:
                    raise FaultFound(f"step {step} has other bytes than were recorded")
            if copy:
                say(f"recorded again: {copy.path}")
    except FaultFound:
        raise
    except SimulatorError as error:
        raise FaultFound(f"step {step} fails: {error}") from error
    return step


def _earned(steps: Iterable[StepArrays]) -> list[bytes]:
    """Return the bytes of what lanes earn, and of which episodes end."""
    return [array.tobytes() for step in steps for array in (step.rewards, step.terminated, step.truncated)]


def _recorded(step: pb.Step) -> list[bytes]:
    """Return the same bytes of a recorded step."""
    return [tensor.data for one in step.behaviors for tensor in (one.rewards, one.terminated, one.truncated)]


def _named(options: Mapping[str, str]) -> str:
    return " ".join(f"options.{name}={choice}" for name, choice in options.items())
