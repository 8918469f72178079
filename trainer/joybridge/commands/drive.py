"""`joybridge drive`: the policy of a run plays a pygame program in its own window, by the real clock."""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from joybridge.client.command_line import add_trust_option, at_least, run_command, say
from joybridge.client.launch import simulator_process
from joybridge.client.simulator_source import last_simulators
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.contract.places import PYGAME
from joybridge.run.folder import play_config

MAX_DECISIONS = 100_000  # of an episode: only the program ends it


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status."""
    parser = argparse.ArgumentParser(prog=prog)
    drive = parser.add_subparsers(dest="command", required=True).add_parser(
        "drive", help="let the policy of a run play a pygame program in its own window, by the real clock"
    )
    drive.add_argument(
        "program",
        metavar="PROGRAM",
        help="FILE, MODULE or PACKAGE:SCRIPT; settings that differ from those of the training may follow, quoted",
    )
    drive.add_argument("run", type=Path, help="folder of a run")
    drive.add_argument("--episodes", type=at_least(1), default=1, help="how many are played; default %(default)s")
    drive.add_argument("--seed", type=at_least(0), default=1, help="of action sampling; default %(default)s")
    drive.add_argument("--checkpoint", default="", metavar="WHICH", help="its timesteps, or best; default: the newest")
    drive.add_argument("--deterministic", action="store_true", help="take the most probable action")
    add_trust_option(drive)
    return run_command(_drive, parser.parse_args(arguments))


def _drive(options: argparse.Namespace) -> None:
    config = play_config(options.run, ())
    remembered = last_simulators(options.run).believed(options.trust_run).games
    sys.path.insert(0, str(Path.cwd()))
    with simulator_process([window_place(options.program, remembered, config)]) as address:
        from joybridge.play.playing import PlaySpec, open_play  # it imports torch, errors come sooner

        plays = PlaySpec(options.run, address, options.seed, options.deterministic, checkpoint=options.checkpoint)
        with open_play(plays) as play:
            say(f"{play.heading()}; the window's close button or Ctrl-C ends it")
            left, reward, decisions = options.episodes, 0.0, 0
            for played in play.decisions():
                reward += sum(float(each.sum()) for each in played.rewards)
                decisions += 1
                if any(len(step.ended) for step in played.after):
                    print(f"reward {reward:.6g} in {decisions} decisions", flush=True)
                    left, reward, decisions = left - 1, 0.0, 0
                if left == 0:
                    break


def window_place(program: str, remembered: Sequence[str], config: Config) -> str:
    """Return the place of a program in its own window, with the settings of the program of the training.

    program: as after --pygame. remembered: the places of the training's games. Raises ConfigError.
    """
    try:
        (name, *own), words = _parts(program)
        trained = next((each.removeprefix(PYGAME) for each in remembered if each.startswith(PYGAME)), name)
        (_, *settings), arguments = _parts(trained)
    except ValueError as error:
        raise ConfigError(f"the program {program!r}: {error}") from error
    chosen = {word.partition("=")[0] for word in own}
    kept = [word for word in settings if word.partition("=")[0] not in chosen]
    forced = [f"name={config.game}", "window=true", f"max_decisions={MAX_DECISIONS}"]
    return PYGAME + shlex.join(
        [name, *kept, *own, *forced, *(["--", *(words or arguments)] if words or arguments else [])]
    )


def _parts(program: str) -> tuple[list[str], list[str]]:
    """Return a program with its settings, and its arguments."""
    words = shlex.split(program)
    at = words.index("--") if "--" in words else len(words)
    return words[:at] or [""], words[at + 1 :]
