"""`joybridge clone`: policies learn from demonstrations alone. No game is played, so it takes seconds."""

import argparse
import math
from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from joybridge.client.command_line import add_game_options, add_own_game, add_trust_option, say_next
from joybridge.client.recording import load_recording
from joybridge.client.run_command import run_command
from joybridge.client.simulator_source import SimulatorSource, remember
from joybridge.config.config import Config, load_config, make_config
from joybridge.config.config_files import find_config, merge, read_overrides
from joybridge.config.errors import ConfigError, DivergedError
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.argument_types import at_least, command_parser
from joybridge.contract.tensors import Array
from joybridge.demonstrations.files import find_demonstrations, foreign_kind, load_demonstration
from joybridge.demonstrations.recorded import Demonstration
from joybridge.progress import Progress, say
from joybridge.run.folder import check_run, keep_config, keep_spec, run_name
from joybridge.run.own_code import check_code_beside, sign_code
from joybridge.run.run_lock import locked
from joybridge.run.sources import note_sources
from joybridge.v1 import bridge_pb2 as pb

if TYPE_CHECKING:
    from joybridge.demonstrations.supervised import Fit

PASSES = 200
UNSEEN = (
    "What the policy sees may not show when: policy.remember_acts=1 shows it its last decision, such as whether a "
    "button is down, but no file can hold such a policy; a larger policy.frame_stack or policy.memory.kind=gru shows "
    "it more of the past"
)


@dataclass(frozen=True)
class Recorded:
    """What a folder of demonstrations holds, and in which game it was recorded."""

    game: str
    options: dict[str, str]  # of all its files
    differ: list[str]  # the names of the options that differ from file to file
    shown: list[Demonstration]


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line and return its exit status."""
    parser, clones = command_parser(prog, "clone", "Learn from demonstrations alone, without playing the game.")
    clones.add_argument("demos", type=Path, help="a folder of demonstrations, all of one game")
    clones.add_argument("--layout", default="", help="how policies map to the device; default: of the configuration")
    clones.add_argument(
        "--config", default="", help="a YAML file, or the name of an installed one, for the other keys; default: none"
    )
    clones.add_argument("--run", type=Path, help="folder of the new run; default runs/GAME-clone[-KEY=VALUE…]-sSEED")
    clones.add_argument(
        "--passes",
        type=at_least(1),
        default=PASSES,
        metavar="N",
        help="through the demonstrations, at most; it ends earlier once held-out episodes get no better; "
        "default %(default)s",
    )
    add_game_options(clones.add_argument_group("games"), "which the run remembers for those who play it")
    add_trust_option(clones)
    clones.set_defaults(simulator=[])
    add_overrides(clones, "e.g. seed=3 policy.learning_rate=1e-3")
    return run_command(_clone, parse_overrides(parser, arguments))


def _clone(options: argparse.Namespace) -> None:
    if options.config:
        add_own_game(options, [options.config])
    overrides = [*options.overrides, *([f"layout={options.layout}"] if options.layout else [])]
    given = load_config(find_config(options.config), overrides) if options.config else None
    if given and given.games:
        raise ConfigError(
            f"{options.config} is for several games, and clone learns one; clone a policy for all with "
            f"`joybridge train {options.config} --demos {options.demos}`"
        )
    if given:
        check_code_beside(find_config(options.config), given, trusted=options.trust_run)
    recorded = _read(options.demos)
    config = _config(given, overrides, recorded, options.demos)
    run = options.run or Path("runs") / run_name(config, "clone", overrides)
    check_run(config, run, resume=False)
    with locked(run):
        clone(config, run, recorded.shown, options.passes)
        remember(run, SimulatorSource(games=tuple(options.game)), say)
        note_sources(run, options.game, config)
        sign_code(run, config, say)
    say_next("evaluate", str(run))


def _read(folder: Path) -> Recorded:
    """Return what a folder holds. Raises ConfigError, RecordingError and StorageError."""
    files = find_demonstrations(folder)
    own = [file for file in files if not foreign_kind(file)]
    if not own:
        raise ConfigError(
            f"{folder} holds {foreign_kind(files[0])}, which does not say what the game is; clone it with "
            f"`joybridge train CONFIG --demos {folder}`"
        )
    first = load_recording(own[0])
    if first.spec is None:
        raise ConfigError(f"{own[0]} holds a fault, expected a demonstration; move it elsewhere")
    if first.start.game != first.spec.name:  # nothing else of a stranger's file says where a game is
        raise ConfigError(f"{own[0]} is of {first.start.game!r}, but shows {first.spec.name!r}; record it again")
    shown = [load_demonstration(file, first.spec) for file in files]
    options = [dict(one.start.options) for one in (first, *map(load_recording, own[1:]))]
    names = sorted({name for each in options for name in each})
    values = {name: {each.get(name) for each in options} for name in names}
    differ = [name for name in names if len(values[name]) > 1]
    return Recorded(first.start.game, {n: v for n, v in options[0].items() if n not in differ}, differ, shown)


def _config(given: Config | None, overrides: Sequence[str], recorded: Recorded, folder: Path) -> Config:
    """Return the configuration of the new run. Raises ConfigError if it is for another game."""
    known = {"game": recorded.game, "options": recorded.options, "demonstrations": str(folder)}
    if given is None:
        given = make_config(merge(known, read_overrides(overrides)))
    if given.game != recorded.game:
        raise ConfigError(
            f"the configuration is for {given.game}, but {folder} shows {recorded.game}; name another one"
        )
    for name, value in read_overrides(overrides).get("options", {}).items():
        if name not in recorded.differ and recorded.options.get(name) != value:
            raise ConfigError(f"options.{name}: got {value!r}, but {folder} shows {recorded.options}; leave it out")
    if recorded.differ:
        say(f"{folder} shows several values of {', '.join(recorded.differ)}, so the configuration says or leaves it")
    kept = {name: value for name, value in given.options.items() if name in recorded.differ}
    replaced = {n: v for n, v in given.options.items() if n not in kept and recorded.options.get(n) != v}
    if replaced:
        say(f"the options {replaced} of --config are replaced by those of {folder}: {recorded.options}")
    return given.model_copy(update=known | {"options": recorded.options | kept})


def clone(config: Config, run: Path, shown: Sequence[Demonstration], passes: int) -> None:
    """Write a run whose policies have learned what demonstrations show. Raises ConfigError and StorageError."""
    from joybridge.demonstrations.supervised import compare, fit, show, teach_critic  # torch takes seconds to load
    from joybridge.policy.actor import make_actors
    from joybridge.ppo.threads import use_one_thread
    from joybridge.run.checkpoint import Manifest, save_checkpoint
    from joybridge.run.origin import keep_origin, own_origin
    from joybridge.run.run_state import actor_arrays

    use_one_thread()
    spec = shown[0].spec
    for remark in filter(None, (demonstration.remark() for demonstration in shown)):
        say(remark)
    config = _known_weights(config, spec)
    arrays: dict[str, Array] = {}
    each = [(actor, show(actor, shown, config)) for actor in make_actors(config, spec, config.accelerator)]
    if not any(given for _, given in each):
        raise ConfigError("no decision of a finished episode is demonstrated; record whole episodes")
    for actor, given in each:
        if given is None:
            say(f"{actor.name}: none of its decisions is demonstrated, so it stays untrained")
            arrays |= actor_arrays(actor)
            continue
        say(given.remark)
        best = _best_pass(fit(actor, given, passes))
        if best is None:
            raise DivergedError(f"{actor.name}: the loss is not finite; take a smaller policy.learning_rate")
        print(f"{actor.name}: pass {best.passes} is kept: loss {best.loss:.3f}{_held_out(best.held_out)}")
        if given.held_out is not None:
            rows = compare(actor, spec.behaviors[actor.behavior].device, given.held_out)
            width = max(len(row.part) for row in rows)
            print(f"  {'':{width}}  {'as demonstrated':>16}  {'without a policy':>16}")
            for row in rows:
                print(f"  {row.part:{width}}  {row.ours:>16}  {row.without:>16}")
            if same := [row.part for row in rows if not row.learned]:
                say(f"not learned: {', '.join(same)}. {UNSEEN}")
            if given.unsaid:
                unsaid = f"{given.unsaid:,} of {given.unsaid + len(given.held_out):,} held-out decisions"
                print(f"not counted: {unsaid}, which {config.layout} cannot express")
        explained, moments = teach_critic(actor, given)
        if not math.isnan(explained):
            print(f"critic: explains {explained:.0%} of how much held-out decisions earn")
        arrays |= actor_arrays(actor) | moments
    keep_config(config, run)
    keep_spec(spec, run)
    keep_origin(run)
    save_checkpoint(run, arrays, Manifest(timesteps=0, origin=own_origin()))


def _best_pass(results: "Generator[Fit, None, None]") -> "Fit | None":
    """Return the best of what passes reach, None if none reaches anything. An interruption keeps what there is."""
    best, progress = None, Progress()
    with closing(results):
        try:
            for result in results:
                if result.best:
                    best = result
                progress.report(f"pass {result.passes}: loss {result.loss:.3f}{_held_out(result.held_out)}")
        except KeyboardInterrupt:
            if best is None:
                raise
            say("interrupted: the best pass so far is kept")
    return best


def _held_out(loss: float) -> str:
    """Return the loss of the held-out episodes as text. loss: not a number if there are none."""
    return ", with nothing held out of one episode" if math.isnan(loss) else f", held out {loss:.3f}"


def _known_weights(config: Config, spec: pb.GameSpec) -> Config:
    """Return a configuration without weights of rewards that the recorded game did not pay.

    The same program may be recorded with fewer rewards than it is trained with.
    """
    paid = {channel.name for behavior in spec.behaviors for channel in behavior.channels}
    weights = config.policy.reward_weights
    if not (unknown := sorted(set(weights) - paid)):
        return config
    say(f"the demonstrations have no reward {', '.join(unknown)}, so the critic does not learn to expect it")
    known = {name: weight for name, weight in weights.items() if name in paid}
    return config.model_copy(update={"policy": config.policy.model_copy(update={"reward_weights": known})})
