"""`joybridge rate`: a tournament among the policies of runs, and a page with their ratings.

The log of all matches is in the folder of the page. Repeated with another seed, the command adds matches to it, and
ratings are fitted to all of them. A tournament counts only as a whole: if it ended early, short matches would be too
many among those that were finished.
"""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path

from joybridge.client.command_line import (
    add_simulator_options,
    add_trust_option,
    check_simulator_options,
    wanted_simulators,
)
from joybridge.client.run_command import run_command
from joybridge.client.simulator_source import choose_simulators, last_simulators, open_simulators
from joybridge.config.errors import ConfigError
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.argument_types import SEEDS, at_least, command_parser
from joybridge.play.figures import add_figures
from joybridge.progress import say
from joybridge.run.folder import play_config, run_config
from joybridge.run.matches import Match, locked_log, read_matches, write_matches
from joybridge.run.own_code import check_code, trust_all

MATCHES, POLICIES = 1000, 8


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status."""
    parser, rates = command_parser(
        prog, "rate", "Let policies of runs play each other in a tournament, and write a page with their ratings."
    )
    rates.add_argument("runs", nargs="+", metavar="RUN", help="folders of runs of one game")
    rates.add_argument(
        "--policies",
        type=at_least(1),
        default=POLICIES,
        metavar="N",
        help="policies of each run at most, evenly chosen from its checkpoints; default %(default)s",
    )
    rates.add_argument(
        "--matches",
        type=at_least(1),
        default=MATCHES,
        metavar="N",
        help="matches that are played at least; default %(default)s",
    )
    rates.add_argument(
        "--others",
        action="append",
        default=[],
        metavar="WHO",
        help="another player: script:NAME, a script of the game's author, an exported policy.json, or RUN@TIMESTEPS; "
        "may be repeated",
    )
    rates.add_argument(
        "--seed", type=at_least(0, SEEDS), default=1000, help="seed of games, seats and samples; default %(default)s"
    )
    rates.add_argument(
        "--anchor", metavar="PLAYER", help="whose rating is 0; default: the earliest policy of the first run"
    )
    rates.add_argument(
        "--output",
        type=Path,
        metavar="FOLDER",
        help="for the log of all matches and the page; default: rating in the first run",
    )
    add_figures(rates)
    add_simulator_options(rates, "the simulators of the first run's last training, if they answer; otherwise ")
    add_trust_option(rates)
    add_overrides(rates, "options and parameters of the game that differ from the training of the first run")
    options = parse_overrides(parser, arguments)
    # All words in front of an option are runs to argparse.
    settings = [word for word in options.runs if "=" in word and not Path(word).exists()]
    options.runs = [Path(word) for word in options.runs if word not in settings]
    options.overrides = [*settings, *options.overrides]
    if not options.runs:
        parser.error(f"{settings[0]} is a setting; name the folder of a run before it")
    check_simulator_options(parser, options)
    return run_command(rate_runs, options)


def rate_runs(options: argparse.Namespace) -> None:
    """Play a tournament, add it to the log, and write the page."""
    from joybridge.compare.rating import rate  # here, so that what is not installed is missed before anything is played
    from joybridge.compare.rating_page import Tournament, rating_table, write_rating_page

    first, folder = options.runs[0], options.output or options.runs[0] / "rating"
    if options.trust_run:
        trust_all([*options.runs, *options.others])
    config = play_config(first, options.overrides)
    configs = {run: run_config(run) for run in options.runs}
    for run, other in configs.items():
        check_code(run, other)
        if other.game != config.game:
            raise ConfigError(f"{run} plays {other.game}, expected {config.game} as {first}; name runs of one game")
        if (other.pointer, other.pointer_speed) != (config.pointer, config.pointer_speed):
            raise ConfigError(f"{run} has another `pointer` than {first}, so its axes mean other things; leave one out")
        if run != first and other.in_last_lesson().hand != config.hand:
            say(f"{run} plays with the hand of {first}, which differs from its own")
    simulators = choose_simulators(
        wanted_simulators(options), last_simulators(first), config, say, trust=options.trust_run
    )
    with open_simulators(simulators, options.wait, say) as connect:
        address = connect()[0]
        from joybridge.play.tournament import play_tournament
        from joybridge.policy.config_fit import fitting_spec
        from joybridge.run.others import load_other, rated_name, run_of
        from joybridge.run.trained import find_trained, load_actors

        spec = fitting_spec(address, config)
        agents = sum(behavior.agents_per_arena for behavior in spec.behaviors)
        if agents < 2:
            raise ConfigError(f"{spec.name} has one agent, and a match needs two; rate runs of a game for several")
        trained = {
            f"{run if unclear(run, options.runs) else run.name}@{one.timesteps}": one
            for run in configs
            for one in find_trained(run, options.policies)
        }
        if len(trained) + len(options.others) < 2:
            raise ConfigError(
                f"{first} has one checkpoint, and a tournament needs two players; keep more with keep_checkpoints, or "
                "add a run or --others"
            )
        others = {}
        for name in options.others:
            loaded, called = load_other(name, config.game, spec), rated_name(name)
            taken = called in others or (called in trained and run_of(name) not in configs)  # by another folder's run
            others[name if taken else called] = loaded
        players = {name: load_actors(one, configs[one.run], spec) for name, one in trained.items()} | others
        names, before = list(players), read_matches(folder)
        settings = " ".join(sorted(options.overrides))
        check_settings_of_log(before, settings, folder)
        log = others_matches(before, names, options.seed)
        anchor = options.anchor or next(iter(trained))
        if anchor not in (known := {*names, *(player for match in log for player in match.players)}):
            raise ConfigError(f"--anchor got {anchor!r}, expected one of {', '.join(sorted(known))}")
        say(f"{len(names)} players: {', '.join(names)}")
        if len(log) < len(before):
            say(f"{len(before) - len(log):,} matches of these players with this seed are played again")
        played = play_tournament(players, config, address=address, matches=options.matches, seed=options.seed, say=say)
    new = [
        Match(
            players=tuple(names[holder] for holder in result.holders),
            places=tuple(result.places.tolist()),
            seed=options.seed,
            settings=settings,
        )
        for result in played
    ]
    with locked_log(folder):  # people may have played in the meantime
        log = [*others_matches(read_matches(folder), names, options.seed), *new]
        write_matches(folder, log)
    if anchor not in {player for match in log for player in match.players}:
        raise ConfigError(
            f"{anchor}, whose rating would be 0, has played in none of {len(log):,} matches, which are kept; play more "
            "with --matches and another --seed, or name another player with --anchor"
        )
    say(f"rating {len(log):,} matches")
    tournament = Tournament(
        title=config.game,
        matches=log,
        ratings=rate(log, anchor),
        anchor=anchor,
        trained={name: (name.rpartition("@")[0], one.timesteps) for name, one in trained.items()},
        command=shlex.join(["joybridge", "rate", *map(str, options.runs), *repeated(options)]),
    )
    paths = write_rating_page(tournament, folder, options.figures)
    print(rating_table(tournament), "", *paths, sep="\n")


def check_settings_of_log(log: Sequence[Match], settings: str, folder: Path) -> None:
    """Raise ConfigError if a log has matches that were played under other settings of the game."""
    for match in log:
        if match.settings != settings:
            raise ConfigError(
                f"{folder} holds matches played with {match.settings or 'the settings of the training'}, and these are "
                f"played with {settings or 'those of the training'}; name another folder with --output"
            )


def others_matches(log: Sequence[Match], players: Sequence[str], seed: int) -> list[Match]:
    """Return the matches of a log that a tournament of these players with this seed does not play again."""
    return [match for match in log if match.seed != seed or not {*players}.issuperset(match.players)]


def unclear(run: Path, runs: Sequence[Path]) -> bool:
    """Return whether the name of a run's folder is that of another one, too."""
    return sum(run.name == other.name for other in {*runs}) > 1


def repeated(options: argparse.Namespace) -> list[str]:
    """Return the options that play the same tournament again."""
    given = ["--policies", f"{options.policies}", "--matches", f"{options.matches}", "--seed", f"{options.seed}"]
    given += ["--anchor", options.anchor] if options.anchor else []
    given += [word for name in options.others for word in ("--others", name)]
    return given + (["--output", str(options.output)] if options.output else []) + list(options.overrides)
