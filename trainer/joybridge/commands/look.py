"""`joybridge look`: pictures of random play, each beside what was pressed, above the images that agents observe.

They show in seconds whether a game draws what it does, for example that "up" is up. Needs neither torch nor pydantic.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import numpy as np

from joybridge.client.client import Session, describe, wait_for
from joybridge.client.launch import simulator_process
from joybridge.client.own_games import choose_at, choose_game
from joybridge.client.run_command import protected, run_command, search_here
from joybridge.commands.contact_sheet import Line, Tile, write_sheet
from joybridge.config.errors import ConfigError, no_picture
from joybridge.config.game_or_config import game_or_config
from joybridge.config.game_settings import GameSettings, check_settings
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.address import address, is_address
from joybridge.contract.argument_types import SEEDS, at_least, command_parser
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.credentials import add_credentials_arguments
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.layouts.random_acts import obey_masks, press_at_random
from joybridge.play.pointer_marks import mark_pointers
from joybridge.policy.encoder import ObservationEncoder
from joybridge.progress import say
from joybridge.v1 import bridge_pb2 as pb

APART = 0.3  # seconds of game time between two pictures, about
WAIT = 3.0  # seconds for a simulator to answer


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status."""
    return run_command(_look, _parse(arguments, prog))


def _look(options: argparse.Namespace) -> None:
    search_here()
    what, settings = game_or_config(options.what, options.overrides)
    with _open(what, settings, options) as session:
        spec = session.spec
        if not spec.HasField("picture"):
            raise no_picture(spec.name)
        every = decisions_apart(spec)
        write_sheet(list(islice(random_play(session, every, options.seed), options.pictures)), options.output)
    apart = f"{every} decisions" if every > 1 else "decision"
    print(f"{options.output}: {options.pictures} pictures of {spec.name}, one every {apart}\n{spec.description}")


def _parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    parser, look = command_parser(
        prog, "look", "Draw random play of a game, beside what was pressed, into one picture."
    )
    look.add_argument(
        "what",
        metavar="GAME|CONFIG|ADDRESS",
        help="a game, by its name or as MODULE:CLASS; a configuration, with its options and parameters; or "
        "HOST:PORT or unix:PATH of a running simulator",
    )
    look.add_argument("output", type=Path, help="the file of the picture, as in look.png")
    look.add_argument("--game", metavar="NAME", help="of the simulator at ADDRESS; may be left out if it has only one")
    add_credentials_arguments(look)
    look.add_argument(
        "--pictures", type=at_least(1), default=12, metavar="N", help="how many are drawn; default %(default)s"
    )
    look.add_argument(
        "--seed", type=at_least(0, SEEDS), default=0, help="of the game and of the decisions; default %(default)s"
    )
    add_overrides(look, "options and parameters of the game, e.g. parameters.size=0.5")
    options = parse_overrides(parser, arguments)
    at = is_address(options.what)
    if (options.tls_ca or options.token_file) and not at:
        look.error("--tls-ca and --token-file belong to the address of a running simulator")
    if options.game and not at:
        look.error("--game belongs to the address of a running simulator; give the game in place of the address")
    return options


@contextmanager
def _open(what: str, settings: GameSettings, options: argparse.Namespace) -> Iterator[Session]:
    """Open a session of one arena, at a simulator that is running or is started for it. Raises JoybridgeError.

    what: a game, or the address of a simulator, whose game the options name.
    """
    if not is_address(what):
        name, places = choose_game(what, (), None)
        with simulator_process(places) as place, _begin(place, name, settings, options.seed) as session:
            yield session
        return
    try:
        place = protected(address(what), options)
    except argparse.ArgumentTypeError as error:
        raise ConfigError(str(error)) from None
    wait_for(place, WAIT, say)
    with _begin(place, choose_at(place, options.game), settings, options.seed) as session:
        yield session


def _begin(place: str, game: str, settings: GameSettings, seed: int) -> Session:
    """Return a new session. Raises ConfigError and SimulatorError."""
    check_settings(*settings, describe(place, game, {}))
    return Session(place, game, arenas=1, seed=seed, options=settings.options, parameters=settings.parameters)


def decisions_apart(spec: pb.GameSpec) -> int:
    """Return the number of decisions between two pictures."""
    seconds = spec.tick_seconds * spec.decision_interval
    return max(1, round(APART / seconds)) if seconds else 1


def random_play(session: Session, every: int, seed: int) -> Iterator[Tile]:
    """Play random decisions without end; yield the picture after every so many of them, beside what was pressed.

    Axes and choices stay for these decisions, so that one sees what they do. A choice that becomes forbidden is
    replaced by an allowed one. Raises SimulatorError.
    """
    spec, rng, decisions = session.spec, np.random.default_rng(seed), 0
    encoders = [ObservationEncoder(behavior.name, behavior, None, {}) for behavior in spec.behaviors]
    acts = make_acts(spec, session.arenas)
    while True:
        for behavior, act in zip(spec.behaviors, acts, strict=True):
            press_at_random(behavior.device, act, rng)
        rewards = [np.zeros(len(step.rewards)) for step in session.steps]
        ended = False
        for left in reversed(range(every)):
            before = session.steps
            for act, step in zip(acts, before, strict=True):
                obey_masks(act, step, rng)
            pictures: list[Array] = []
            if left:
                after = session.step(acts)
            else:
                after, pictures = session.step_and_draw(acts, [0])
            decisions += 1
            ended = ended or any(len(step.ended) for step in after)
            for encoder, step, total in zip(encoders, after, rewards, strict=True):
                total += encoder.rewards(step)
        lines = [Line(f"decision {decisions}"), *_describe(spec, acts, before, rewards)]
        shown = [*lines, Line("a new episode has begun")] if ended else lines
        yield Tile(mark_pointers(pictures[0], spec, acts), shown, observed_images(spec, after))


def observed_images(spec: pb.GameSpec, steps: Sequence[StepArrays]) -> list[Array]:
    """Return the images that all agents observe, uint8 [height, width] or [height, width, 1 or 3]."""
    return [
        image
        for behavior, step in zip(spec.behaviors, steps, strict=True)
        for sensor, values in zip(behavior.sensors, step.observations, strict=True)
        if sensor.HasField("image")
        for image in values
    ]


def _describe(
    spec: pb.GameSpec, acts: list[ActArrays], before: list[StepArrays], rewards: list[Array]
) -> Iterator[Line]:
    """Yield what each agent pressed in the last decision, and its reward since the last picture."""
    alone = sum(len(act.axes) for act in acts) == 1
    for behavior, act, step, paid in zip(spec.behaviors, acts, before, rewards, strict=True):
        for lane, (axes, choices) in enumerate(zip(act.axes.tolist(), act.choices.tolist(), strict=True)):
            waits = step.deciding is not None and not step.deciding[lane]
            if not alone:
                number = f" {lane}" if len(act.axes) > 1 else ""
                yield Line(f"{behavior.name}{number}{' waits' if waits else ''}")
            if not waits:
                for axis, value in zip(behavior.device.axes, axes, strict=True):
                    yield Line(f"{axis.name} {value:+.2f}", (value - axis.low) / (axis.high - axis.low))
                for branch, choice in zip(behavior.device.branches, choices, strict=True):
                    yield Line(f"{branch.name}: {branch.choices[choice]}")
            yield Line(f"reward {paid[lane]:+.4g}")
