"""Write a configuration for an environment, or a game of a running server in any language, with values that suit it.

With these values the built-in small games are learned within 300 000 timesteps. Games of one's own are often harder, so
the run is longer; it takes minutes.
"""

import json
import re
import shlex
from pathlib import Path

from joybridge.contract.places import GYM
from joybridge.simulator.new_game.learning import images, layout, policy
from joybridge.simulator.new_game.write import check_new, command, write_new
from joybridge.v1 import bridge_pb2 as pb

LANES = 64  # that learn from each update together, about
IMAGE_LANES = 16  # the same, where they see images


def write_config(spec: pb.GameSpec, place: tuple[str, str], folder: Path) -> str:
    """Write NAME.yaml for a game; return the commands to type next.

    place: the option with which it is trained, as in ("--gym", "CartPole-v1"). Raises NewGameError.
    """
    option, what = place
    named = option == "--gym"  # the configuration names the game's place, and no command needs to
    with_it = "" if named else f" {shlex.join(place)}"
    path = folder / (re.sub(r"[^\w.-]", "_", spec.name) + ".yaml")
    check_new([path])
    write_new({path: starter_config(spec, f"{GYM}{what}" if named else spec.name)})
    joybridge, run = shlex.quote(command(Path())), shlex.quote(f"runs/{path.stem}")
    config = _argument(path.name if folder.resolve() == Path.cwd() else str(path))
    drawn = spec.HasField("picture")
    video = f"\n  {joybridge} record {run} {_argument(f'{path.stem}.mp4')}" if drawn else ""
    return f"""Created {path}, the training of {spec.name}.

Train it{", evaluate the policy and record a video" if drawn else " and evaluate the policy"}:

  {joybridge} train {config}{with_it} --run {run}
  {joybridge} evaluate {run}{video}

Check it in some minutes against the contract, as whether the same seed gives the same episode:

{_check(place, joybridge, spec.name)}"""


def _check(place: tuple[str, str], joybridge: str, name: str) -> str:
    """Return the commands that check a game, which has to be served first unless it is."""
    option, what = place
    served = option == "--simulator"
    serve = "" if served else f"  {joybridge} serve {shlex.join(place)} --port 5006    # and in another terminal\n"
    return f"{serve}  {joybridge} check {what if served else '127.0.0.1:5006'} --game {shlex.quote(name)}"


def _argument(name: str) -> str:
    """Return the name of a file as an argument of a command, which no option looks like."""
    return shlex.quote(f"./{name}" if name.startswith("-") else name)


def starter_config(spec: pb.GameSpec, game: str) -> str:
    """Return the text of a configuration that suits a spec. game: its name, or where it is."""
    name, game = (json.dumps(text, ensure_ascii=False) for text in (spec.name, game))
    lanes = max(behavior.agents_per_arena for behavior in spec.behaviors)
    arenas = max(1, min((IMAGE_LANES if images(spec) else LANES) // lanes, spec.max_arenas))
    return f"""\
# A start for {name}. `joybridge keys` lists all keys.
game: {game}
{layout(spec)}
arenas: {arenas:<18}# played in parallel
total_timesteps: 1000000  # more if the reward still rises at the end
log_interval: {20000 if images(spec) else 50000}       # timesteps between two rows of metrics
{policy(spec)}"""
