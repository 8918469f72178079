"""The runs of a comparison under test settings of the game, by which neither a policy was trained nor a choice made."""

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from joybridge.client.command_line import wanted_simulators
from joybridge.client.errors import SimulatorLost
from joybridge.client.simulator_source import open_simulators
from joybridge.compare.job import Job
from joybridge.compare.kept_tests import PlayedTest, Reached, find_result, keep_result
from joybridge.compare.made_with import MadeWith
from joybridge.compare.scores import Run
from joybridge.compare.table import TABLE
from joybridge.compare.variants import TRAINERS, Variant, config_path
from joybridge.config.config import load_config
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import check_settings
from joybridge.config.metrics import measured_columns
from joybridge.contract.argument_types import Once, at_least
from joybridge.contract.errors import JoybridgeError
from joybridge.progress import minutes_left, say
from joybridge.run.checkpoint import checkpoints
from joybridge.run.folder import check_playable, run_spec
from joybridge.v1 import bridge_pb2 as pb

EPISODES = 210  # as many as `evaluate` plays
SEED = 2**62  # of the games: not those of a training, nor of `evaluate_during`, and the same for all runs


def add_test_options(compares: argparse._ActionsContainer) -> None:
    """Add the options that say what is played for a test, and how."""
    compares.add_argument(
        "--test",
        nargs="*",
        metavar="KEY=VALUE",
        help="let each finished run play other settings of the game, as in parameters.wind=3, and compare these scores "
        "on a page of their own; without settings: other episodes of the same game",
    )
    compares.add_argument(
        "--over",
        action=Once,
        metavar="KEY=VALUE,VALUE,…",
        help="let each finished run play under each value of an option, a parameter or a limit of the hand, as in "
        "parameters.wind=0,1,3, and write a page with one table and one picture of all",
    )
    compares.add_argument(
        "--episodes",
        type=at_least(1),
        metavar="N",
        help=f"of a test, of each run; default {EPISODES}",
    )
    compares.add_argument(
        "--deterministic", action="store_true", help="in a test, take the most probable actions instead of sampling"
    )


def check_test(variants: Sequence[Variant], specs: Sequence[pb.GameSpec], options: argparse.Namespace) -> None:
    """Raise ConfigError for a test that the runs could not play, before they are trained; specs: of their games."""
    if options.test is None:
        return
    if (options.output / TABLE).exists() and not (options.output / "runs").is_dir():
        raise ConfigError(f"a test needs the policies of the runs, and there is no folder {options.output / 'runs'}")
    option = "--over" if options.over else "--test"
    for variant, spec in zip(variants, specs, strict=True):
        if variant.by or variant.config.games:
            who = TRAINERS.get(variant.by, "a run of several games")
            raise ConfigError(f"--test cannot play {variant.label}, of {who}; leave this variant out")
        known = {f"options.{each.name}={choice}" for each in spec.options for choice in each.choices}
        known |= {f"parameters.{each.name}" for each in spec.parameters}
        for words in test_settings(options):
            played = load_config(config_path(options.output, variant.name), words)
            check_playable(variant.config, played, variant.label)
            check_settings(played.options, played.parameters, spec)
            given = [f"options.{name}={choice}" for name, choice in played.options.items()]
            given += [f"parameters.{name}" for name in played.parameters]
            if wrong := [each for each in given if each not in known]:
                raise ConfigError(
                    f"{option} got {wrong[0]}; {spec.name} has {', '.join(sorted(known)) or 'nothing to set'}"
                )
        behavior = next((each for each in spec.behaviors if each.name == options.behavior), spec.behaviors[0])
        measured = measured_columns([each.name for each in behavior.metrics])[:-2]  # of an episode, not of many
        if options.metric not in measured:
            raise ConfigError(f"{option} got --metric {options.metric}; of its episodes it has {', '.join(measured)}")


def test_settings(options: argparse.Namespace) -> list[list[str]]:
    """Return the overrides under which each run plays, once for each value of `--over`."""
    return [[*options.test, each] for each in options.over.settings] if options.over else [options.test]


def test_words(options: argparse.Namespace) -> str:
    """Return how the policies play in a test, for the page; "" without a test."""
    if options.test is None:
        return ""
    settings = f"under {' '.join(options.test)}" if options.test else "under the settings of its training"
    settings = f"otherwise {settings}" if options.over else settings
    actions = "the most probable actions" if options.deterministic else "sampled actions"
    return f"{settings}, with {actions} (seed {SEED})"


def test_marks(options: argparse.Namespace) -> list[str]:
    """Return what makes the page of a test another one, for the names of its files; nothing without a test."""
    if options.test is None:
        return []
    over = [f"over {options.over.key}={','.join(options.over.values)}"] if options.over else []
    tested = [" ".join(["test", *options.test])] if options.test or not over else []
    return [*tested, *over, *(["deterministic"] if options.deterministic else [])]


def test_runs(
    runs: Mapping[Job, Run], policies: Mapping[Job, str], options: argparse.Namespace, played_with: MadeWith
) -> tuple[list[dict[Job, Run]], dict[Job, str]]:
    """Return the runs with what their newest policies have reached in a test as scores, and why others have none.

    There is an entry for each of the settings that `test_settings` lists, with the same runs in all. What a run has
    played before, with the same things, is not played again. policies: whose metric counts; "": the only one. Raises
    ConfigError, SimulatorError and StorageError.
    """
    tested, failed = list[dict[Job, Run]](), dict[Job, str]()
    done, played, total, begin = 0, 0, len(runs) * len(test_settings(options)), time.monotonic()
    say(f"{len(runs)} runs play {options.episodes} episodes each{_of_values(options)}, one after the other")
    with ExitStack() as opened:
        address = ""  # of a simulator, which is started when the first run has to play
        for settings in test_settings(options):
            reached = dict[Job, Run]()
            for job, run in runs.items():
                done += 1
                if job in failed:
                    continue
                if longer := _trained_longer(job):
                    failed[job] = longer
                    continue
                test = PlayedTest(
                    settings, options.episodes, options.deterministic, SEED, _newest(job.run), played_with
                )
                # The game of a simulator that is running may have changed without a trace.
                found = None if options.simulator else find_result(job.run, test)
                if found is None:
                    address = address or opened.enter_context(_simulator(options))
                    try:
                        found = _play(job.run, test, address)
                    except JoybridgeError as error:
                        failed[job] = str(error)
                        if isinstance(error, SimulatorLost):
                            address = ""  # the next run has another one
                        continue
                    keep_result(job.run, test, found)
                    played += 1
                measured = found[policies[job] or next(iter(found))]
                mean = measured.means[options.metric]
                reached[job] = replace(run, measured=mean, episodes=measured.episodes)
                under = f" under {' '.join(settings)}" if options.over else ""
                left = minutes_left((time.monotonic() - begin) / max(played, 1) * (total - done))
                say(f"{done} of {total}: {job.name}: {options.metric} {mean:.4g}{under}{left}")
            tested.append(reached)
    return [{job: run for job, run in reached.items() if job not in failed} for reached in tested], failed


@contextmanager
def _simulator(options: argparse.Namespace) -> Iterator[str]:
    """Yield the address of a simulator."""
    with open_simulators(wanted_simulators(options), options.wait, say) as connect:
        yield connect()[0]


def _play(run: Path, test: PlayedTest, address: str) -> dict[str, Reached]:
    """Return what each policy of a run reaches in a test. Raises JoybridgeError."""
    from joybridge.play.evaluate import evaluate  # after the training: torch takes seconds to load
    from joybridge.play.playing import PlaySpec

    plays = PlaySpec(run, address, test.seed, test.deterministic, test.settings)
    found = evaluate(plays, episodes=test.episodes, say=lambda _: None)
    return {name: Reached(each.episodes, each.means) for name, each in found.items()}


def _trained_longer(job: Job) -> str:
    """Return why the newest policy of a run is not the one of the page, "" if it is.

    A run may have gone on, with another `stop_at`. The page takes its rows until the end that is compared.
    """
    config, newest = load_config(job.config, job.settings()), _newest(job.run)
    if newest <= config.end:
        return ""
    agents = sum(behavior.agents_per_arena for behavior in run_spec(job.run).behaviors)
    policies = [config.policy, *map(config.policy_config, config.policies)]
    cycle = config.arenas * agents * max(policy.rollout_steps for policy in policies)
    if newest < config.end + cycle:
        return ""
    return (
        f"its newest policy has trained for {newest:,} timesteps, and {config.end:,} are compared; give these settings "
        "another --output"
    )


def _newest(run: Path) -> int:
    """Return the timesteps of the newest checkpoint of a run; 0 if it has none."""
    return max((int(each.name) for each in checkpoints(run)), default=0)


def _of_values(options: argparse.Namespace) -> str:
    return f" under each of {len(options.over.values)} values of {options.over.key}" if options.over else ""
