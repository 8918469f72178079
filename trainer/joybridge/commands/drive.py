"""`joybridge drive`: a policy plays a pygame program in its own window, by the real clock."""

import argparse
import os
import shlex
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from joybridge.client.client import Session
from joybridge.client.command_line import add_trust_option
from joybridge.client.launch import simulator_process
from joybridge.client.run_command import run_command, search_here
from joybridge.client.simulator_source import last_simulators
from joybridge.config.errors import ConfigError, no_export
from joybridge.config.programs import merged_place
from joybridge.contract.argument_types import SEEDS, at_least, command_parser
from joybridge.contract.places import PYGAME
from joybridge.progress import Progress, say
from joybridge.run.folder import play_config, run_spec
from joybridge.v1 import bridge_pb2 as pb

MAX_DECISIONS = 100_000  # of an episode: only the program ends it
FILES = (".onnx", ".json")
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")  # variables that name one, or what takes its place


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status."""
    parser, drive = command_parser(
        prog, "drive", "Let a policy play a pygame program in its own window, by the real clock."
    )
    drive.add_argument(
        "program",
        metavar="PROGRAM",
        help="FILE, MODULE or PACKAGE:SCRIPT; settings that differ from those of the training may follow, quoted",
    )
    drive.add_argument("policy", metavar="RUN", type=Path, help="folder of a run, or its policy.onnx or policy.json")
    drive.add_argument("--episodes", type=at_least(1), default=1, help="how many are played; default %(default)s")
    drive.add_argument("--seed", type=at_least(0, SEEDS), default=1, help="of action sampling; default %(default)s")
    drive.add_argument("--checkpoint", default="", metavar="WHICH", help="its timesteps, or best; default: the newest")
    drive.add_argument("--deterministic", action="store_true", help="take the most probable action")
    add_trust_option(drive)
    return run_command(_drive, parser.parse_args(arguments))


Decisions = Iterator[tuple[float, bool]]  # the reward of each, and whether it was the last of an episode


def _drive(options: argparse.Namespace) -> None:
    search_here()
    if sys.platform == "linux" and not any(os.environ.get(name) for name in DISPLAYS):
        raise ConfigError(
            "there is no display on which a window could open: start this in a desktop session, or, to see nothing, "
            "under `xvfb-run -a`"
        )
    with _file_at_play(options) if options.policy.suffix in FILES else _run_at_play(options) as (about, spec, play):
        say(f"{about}; the window's close button or Ctrl-C ends it")
        wanted = 1 / (spec.tick_seconds * spec.decision_interval)
        ends = any(word.startswith(("done=", "hook=")) for word in shlex.split(options.program))
        endless = options.policy.suffix in FILES and not ends
        for _ in range(options.episodes):
            _play_episode(play, wanted, endless=endless)


def _play_episode(play: Decisions, wanted: float, *, endless: bool) -> None:
    """Play an episode and print what came of it, also if it is interrupted.

    wanted: decisions per second. endless: only the program itself ends the episode.
    """
    total, count, begin, progress = 0.0, 0, 0.0, Progress()
    end = "; nothing ends the episode but the program, its window or Ctrl-C" if endless else ""
    try:
        for reward, over in play:
            total, count = total + reward, count + 1
            begin = begin or time.monotonic()  # the first decision may have waited for the policy to be ready
            progress.report(f"{count:,} decisions, reward {total:.6g}{end}")
            if over:
                break
    finally:
        rate = (count - 1) / max(time.monotonic() - begin, 1e-9)
        pace = f", {rate:.1f} per second of {wanted:.1f}" if count > 1 else ""
        print(f"reward {total:.6g} in {count} decisions{pace}", flush=True)


@contextmanager
def _run_at_play(options: argparse.Namespace) -> Iterator[tuple[str, pb.GameSpec, Decisions]]:
    """Let the policy of a run play; yield words about it, the spec of the program, and its decisions."""
    config, trained = play_config(options.policy, ()), run_spec(options.policy)
    if config.games:
        raise ConfigError(f"{options.policy} plays several games, and `drive` policies of one; evaluate or record it")
    remembered = last_simulators(options.policy).believed(options.trust_run).games
    device = trained.behaviors[0].device
    held = device_settings([axis.name for axis in device.axes], [branch.name for branch in device.branches])
    place = window_place(options.program, remembered, config.game, held)
    with simulator_process([place]) as address:
        from joybridge.play.playing import PlaySpec, open_play  # it imports torch, errors come sooner

        plays = PlaySpec(options.policy, address, options.seed, options.deterministic, checkpoint=options.checkpoint)
        with open_play(plays) as play:
            decisions = (
                (sum(float(each.sum()) for each in played.rewards), any(len(step.ended) for step in played.after))
                for played in play.decisions()
            )
            yield play.heading(), play.spec, decisions


@contextmanager
def _file_at_play(options: argparse.Namespace) -> Iterator[tuple[str, pb.GameSpec, Decisions]]:
    """Let an exported policy play; see `_run_at_play`. Its program has no settings but those of the command line."""
    if options.checkpoint or options.deterministic:
        raise ConfigError(f"--checkpoint and --deterministic are for runs; {options.policy} was exported with its own")
    try:
        from joybridge.play.policy_file import play_file
        from joybridge.policy.exported import load_exported, read_exported, read_policy_file
    except ModuleNotFoundError as error:
        raise no_export(options.policy, error) from None

    about, _ = read_exported(read_policy_file(options.policy), str(options.policy))
    held = device_settings([axis.name for axis in about.axes], [branch.name for branch in about.branches])
    with simulator_process([window_place(options.program, (), about.game, held)]) as address:
        session = Session(address, about.game, arenas=1, seed=options.seed, options=about.options)
        with closing(session):
            words = f"{options.policy}, after {about.timesteps:,} timesteps{_unsaid(options.program)}"
            policy = load_exported(options.policy, session.spec)
            yield words, session.spec, play_file(policy, session, options.seed)


def _unsaid(program: str) -> str:
    """Return what an exported policy does not know and the command line does not say, as a part of a sentence."""
    words = shlex.split(program)
    if any(word.startswith(("reward=", "done=", "hook=")) for word in words):
        return ""
    return (
        "; the file does not say what pays and what ends an episode, so all is one episode without rewards: name both "
        f"behind the program, as in \"{words[0]} 'reward=Score: (\\d+)' 'done=Game over'\""
    )


def device_settings(axes: Sequence[str], branches: Sequence[str]) -> list[str]:
    """Return the settings that give a program the device with these axes and branches."""
    named = {kind: [name[len(kind) :] for name in branches if name.startswith(kind)] for kind in ("key_", "mouse_")}
    flags = {
        "mouse": any(name.startswith("pointer") for name in axes),
        "wheel": "wheel" in branches,
        "joystick": any(name.startswith("stick") for name in axes),
    }
    return [
        f"keys={','.join(named['key_'])}",
        f"buttons={','.join(named['mouse_'])}",
        *(f"{name}={str(value).lower()}" for name, value in flags.items()),
    ]


def window_place(program: str, remembered: Sequence[str], game: str, held: Sequence[str]) -> str:
    """Return the place of a program in its own window, with the settings of the program of the training.

    program: as after --pygame. remembered: the places of the training's games. game: its name. held: settings that are
    known of the policy. What stands behind the program goes before both. Raises ConfigError.
    """
    trained = next((each for each in remembered if each.startswith(PYGAME)), "")
    forced = [f"name={game}", "window=true", f"max_decisions={MAX_DECISIONS}"]
    return merged_place(program, trained, forced, held)
