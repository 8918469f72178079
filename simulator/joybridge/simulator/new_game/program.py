"""Write what the training of a pygame program begins with: a hook, and a configuration that names both."""

import json
import os
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from joybridge.contract.places import PYGAME, program_name
from joybridge.simulator.catalog import load_game, specs
from joybridge.simulator.new_game.learning import layout, policy
from joybridge.simulator.new_game.write import NewGameError, check_new, command, write_new
from joybridge.simulator.program_options import split_arguments
from joybridge.v1 import bridge_pb2 as pb

FILES = {"hook", "tapes"}  # settings that are paths
ARENAS = 16  # processes, at most
HOOK = '''\
"""What {name} shows and pays. Each function is given the program's main module; delete what you do not need."""


def state(program):  # numbers for the sensor "state", always as many, as in [program.player.x, program.player.y]
    return []


# def reward(program):  # after each frame: a number, or one for each channel, as in {{"coins": 1.0, "hits": -0.1}}
#     return 0.0


def done(program):  # after each frame: whether the episode is over, as in program.lives == 0
    return False


def metrics(program):  # after each decision; the last of an episode is reported, as in {{"level": program.level}}
    return {{}}
'''


def write_program(text: str, folder: Path) -> str:
    """Write NAME_hook.py and NAME.yaml for "PROGRAM KEY=VALUE … -- ARGUMENTS"; return the commands to type next.

    The program is run to see what it reads and shows. Settings become keys; with `hook` among them no hook is written.
    Raises NewGameError and CatalogError.
    """
    try:
        name, keys = program_name(text), _keys(text, folder)
    except ValueError as error:
        raise NewGameError(f"got {text!r}: {error}") from error
    stem = re.sub(r"[^\w.-]", "_", name)
    config, hook = folder / f"{stem}.yaml", folder / f"{stem}_hook.py"
    texts = {}
    if "hook" not in keys:
        texts[hook] = HOOK.format(name=name)
        keys["hook"] = [hook.name]
    check_new([config, *texts])
    game: Any = load_game(PYGAME + text)
    write_new({**texts, config: _config(game, keys)})
    joybridge = shlex.quote(command(folder))
    go = "" if folder.resolve() == Path.cwd() else f"  {shlex.join(['cd', str(folder)])}\n"
    return f"""Created {" and ".join(map(str, [*texts, config]))}.

Say in the hook or by the key `reward` what pays, then train, evaluate the policy and record a video:

{go}  {joybridge} train {shlex.quote(config.name)} --run runs/{shlex.quote(stem)}
  {joybridge} evaluate runs/{shlex.quote(stem)} --episodes 20
  {joybridge} record runs/{shlex.quote(stem)} {shlex.quote(stem)}.mp4"""


def _keys(text: str, folder: Path) -> dict[str, list[str]]:
    """Return the program and its settings as keys of a configuration in a folder. Raises ValueError."""
    words = shlex.split(text)
    words, own = split_arguments(words)
    place = os.path.relpath(words[0], folder) if Path(words[0]).is_file() else words[0]
    keys: dict[str, list[str]] = {"pygame": [place]}
    for word in words[1:]:
        key, _, value = word.partition("=")
        keys.setdefault(key, []).append(os.path.relpath(value, folder) if key in FILES else value)
    return keys | ({"arguments": own} if own else {})


def _config(game: Any, keys: Mapping[str, list[str]]) -> str:
    """Return the text of a configuration for a program; what is written as JSON is YAML, too."""
    spec: pb.GameSpec = next(specs(game))
    shown = {key: values[0] if len(values) == 1 and key != "arguments" else values for key, values in keys.items()}
    lines = [f"  {key}: {json.dumps(value, ensure_ascii=False)}" for key, value in shown.items()]
    if game.numbers and "reward" not in keys:
        lines.append("  # reward:  # one of these or several, without #; each pays the difference of its number")
        for number in game.numbers:
            seen = f"{number.low:g} to {number.high:g} in some seconds of random play"
            lines.append(f"  #   - {json.dumps(number.reward, ensure_ascii=False)}  # {seen}")
    if "done" not in keys:
        end, *others = game.end_texts or ["Game over"]
        among = f"its sources have {', '.join(map(json.dumps, others))}, too" if others else "found in its sources"
        why = among if game.end_texts else "write what yours says"
        lines.append(f"  # done: {json.dumps(end)}  # the episode ends when the program renders this text; {why}")
    if "skip_drawing" not in keys:
        lines.append("  # skip_drawing: true  # faster, if every frame is drawn again: those that nobody sees are not")
    text = "\n".join(lines)
    return f"""\
# A start for {json.dumps(spec.name, ensure_ascii=False)}. `joybridge keys` lists all keys.
game:
{text}
options:
  decision_interval: "4"  # frames per decision; more, up to 16, if keys must be held for long
  screen: "64"            # the picture has as many pixels as a square with this side
{layout(spec)}
arenas: {min(ARENAS, spec.max_arenas):<18}# processes of the program
total_timesteps: 300000   # more if the reward still rises at the end
log_interval: 10000       # timesteps between two rows of metrics
{policy(spec)}"""
