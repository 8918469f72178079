r"""Play pygame programs at random, and by scripts that read their objects: what policies are held to.

    python -m tools.pygame_learning chimp pong-arcade --episodes 20

The programs and their settings are those of configs/pygame. A script is given by a hook what no policy sees: places of
the program's own objects. The other packages are installed by hand, beside this project.
"""

import argparse
import shlex
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from joybridge.adapters.pygame_programs.form import Form, make_form, options_of
from joybridge.adapters.pygame_programs.players import Played, Players
from joybridge.adapters.pygame_programs.rerun import opened
from joybridge.config.config import load_config
from joybridge.contract.places import PYGAME
from joybridge.contract.spec import choose_options

OWN = "hook="  # among the settings of a program
CONFIGS = Path(__file__).parents[1] / "configs/pygame"
HOOK = """import sys


def state(program):
    frame = sys._getframe()
    while frame is not None and frame.f_code.co_name != {function!r}:
        frame = frame.f_back
    names = frame.f_locals
    return {state}
"""
Player = Callable[[Played, int], bytes]  # of what is seen and the number of the decision
Kind = Callable[[int], Player]  # of the seed of an episode
Act = tuple[dict[str, float], set[str]]  # axes by name, and the buttons that are pressed


class Script(NamedTuple):
    """A player of some lines."""

    function: str  # of the program, which has what is read
    state: str  # an expression over its variables, `names`: a list of numbers
    play: Callable[[list[float], int], Act]  # of the state and the number of the decision


def punch(state: list[float], decision: int) -> Act:
    """Put the fist on the chimp, and press in every second decision."""
    x, y = state
    return {"pointer_x": 2 * x / 1280 - 1, "pointer_y": 1 - 2 * y / 480}, {"mouse_left"} if decision % 2 else set()


def return_balls(state: list[float], decision: int) -> Act:
    """Begin a game, and keep the paddle at the height of the ball."""
    ball, paddle, menu = state
    if menu:
        return {}, {"key_1"} if decision % 2 else set()
    return {}, {"key_s"} if ball > paddle + 10 else {"key_w"} if ball < paddle - 10 else set()


def keep_balls(state: list[float], decision: int) -> Act:
    """Keep the paddle where the lowest ball will be, and press in every second decision: it starts the ball, or shoots.

    The paddle lies half its width left of the pointer.
    """
    ball, speed, width = state
    return {"pointer_x": 2 * (ball + 4 * speed + width / 2) / 575 - 1}, {"mouse_left"} if decision % 2 else set()


def shoot(state: list[float], decision: int) -> Act:
    """Stay near the left edge, go away from a bomb that comes, and shoot in every second decision."""
    player, bomb, fallen = state
    aim = 40.0
    if fallen > 200:
        aim = player + (100 if bomb < player or player < 100 else -100)
    keys = {"key_RIGHT"} if aim > player + 20 else {"key_LEFT"} if aim < player - 20 else set()
    return {}, keys | ({"key_SPACE"} if decision % 2 else set())


SCRIPTS = {
    "chimp": Script("main", "list(names['chimp'].rect.center)", punch),
    "pong-arcade": Script(
        "main",
        "[names['pong'].ball.rect.centery, names['pong'].p1.paddle.centery, names['pong'].show_menu]",
        return_balls,
    ),
    "xboing": Script(
        "run",
        "[*max(((b.y, b.x, b.vx) for b in names['self'].ball_manager.balls), default=(0, 288, 0))[1:],"
        " names['self'].paddle.rect.width]",
        keep_balls,
    ),
    "aliens": Script(
        "main",
        "[names['player'].rect.centerx, *max(((b.rect.bottom, b.rect.centerx) for b in names['bombs']"
        " if abs(b.rect.centerx - names['player'].rect.centerx) < 60), default=(0, 0))[::-1]]",
        shoot,
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Play pygame programs at random, and by scripts.")
    parser.add_argument("programs", nargs="*", default=list(SCRIPTS), help="of configs/pygame; default: all")
    parser.add_argument("--episodes", type=int, default=20, help="of each player; default %(default)s")
    options = parser.parse_args(arguments)
    print("| program | random | scripted |\n| --- | --- | --- |")
    for program in options.programs:
        random, scripted = means(program, options.episodes)
        print(f"| {program} | {random:.1f} | {scripted:.1f} |", flush=True)
    return 0


def means(program: str, episodes: int) -> list[float]:
    """Return the mean rewards of random and of scripted episodes, in the first channel."""
    config, script = load_config(CONFIGS / f"{program}.yaml", []), SCRIPTS[program]
    with tempfile.TemporaryDirectory() as folder:
        place = with_state(config.game.removeprefix(PYGAME), script, Path(folder, "hook.py"))
        with opened(place, {}) as (_, game):
            form = make_form(game.look, choose_options(options_of(game.look), config.options, game.name))
            limit = int(game.settings.number("max_decisions"))
            players = Players(game.processes, form, form.inside(game.settings.number("seconds")), 1)
            kinds = [at_random(form), by_script(form, script)]
            try:
                return [
                    float(np.mean([played(players, seed, kind(seed), limit) for seed in range(episodes)]))
                    for kind in kinds
                ]
            finally:
                players.end([0])


def with_state(place: str, script: Script, hook: Path) -> str:
    """Return a program with a hook that has the state for a script, after what the program's own hook has."""
    first, *settings = shlex.split(place)
    own = [(CONFIGS / word.removeprefix(OWN)).read_text() for word in settings if word.startswith(OWN)]
    hook.write_text("\n\n".join([*own, HOOK.format(function=script.function, state=script.state)]))
    return shlex.join([first, f"{OWN}{hook}", *(word for word in settings if not word.startswith(OWN))])


def played(players: Players, seed: int, player: Player, limit: int) -> float:
    """Return the reward of an episode in the first channel."""
    (seen,) = players.begin([0], [seed])
    reward, decision = 0.0, 0
    while not seen.over and decision < limit:
        players.act(0, player(seen, decision))
        seen = players.receive(0)
        reward, decision = reward + float(seen.rewards[0]), decision + 1
    return reward


def at_random(form: Form) -> Kind:
    """Return players that choose again in each decision, as a policy does at first."""
    axes, counts = len(form.axes()), [len(branch.choices) for branch in form.branches()]

    def begin(seed: int) -> Player:
        rng = np.random.default_rng(seed)
        return lambda *_: _act(rng.uniform(-1, 1, axes), rng.integers(counts))

    return begin


def by_script(form: Form, script: Script) -> Kind:
    """Return players that do what the script says."""

    def play(seen: Played, decision: int) -> bytes:
        places, pressed = script.play(seen.sensors[-1].tolist(), decision)
        axes = np.clip([places.get(axis.name, 0.0) for axis in form.axes()], -1, 1)
        return _act(axes, [branch.name in pressed for branch in form.branches()])

    return lambda _: play


def _act(axes: npt.ArrayLike, choices: npt.ArrayLike) -> bytes:
    return np.asarray(axes, np.float32).tobytes() + np.asarray(choices, np.int32).tobytes()


if __name__ == "__main__":
    sys.exit(main())
