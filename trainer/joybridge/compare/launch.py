"""From variants to runs: the specs of their games, their jobs, and where these are trained."""

import argparse
import shlex
from collections.abc import Callable, Sequence

from joybridge.client.command_line import wanted_simulators
from joybridge.client.simulator_source import open_simulators
from joybridge.compare.environments import environment_of
from joybridge.compare.job import Job, PeerJob, Process, start
from joybridge.compare.ranges import PRUNE_FROM
from joybridge.compare.scores import PARTS
from joybridge.compare.variants import TRAINERS, Variant, check_game, keep
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import HELD_OUT, is_of_episodes, measured_columns, training_columns
from joybridge.layouts import list_roles
from joybridge.plugins import load
from joybridge.policy.config_fit import check_fit, fitting_spec
from joybridge.progress import say
from joybridge.v1 import bridge_pb2 as pb


def served_specs(variants: Sequence[Variant], options: argparse.Namespace) -> list[pb.GameSpec]:
    """Return the spec of each variant's game, from a simulator, and keep it in the folder.

    Raises ConfigError for a variant that does not fit its game, and for a game that has changed.
    """
    with open_simulators(wanted_simulators(options), options.wait, say) as connect:
        address = connect()[0]
        specs = [fitting_spec(address, variant.config) for variant in variants]
    for variant, spec in zip(variants, specs, strict=True):
        check_variant(variant, spec)
        check_game(variant, spec, options.output)
    keep(variants, specs, options.output)
    return specs


def check_variant(variant: Variant, spec: pb.GameSpec) -> None:
    """Raise ConfigError, which names the variant, unless its policies can be made for a spec."""
    try:
        check_fit(variant.config, spec)
    except ConfigError as error:
        raise ConfigError(f"{variant.label}: {error}") from error


def check_length(config: Config) -> None:
    """Raise ConfigError for runs that are too short for a row of metrics."""
    if config.log_interval > config.end:
        raise ConfigError(
            f"log_interval is {config.log_interval:,}, longer than the runs of {config.end:,} timesteps, so they have "
            "no metrics; make it a tenth of them or less, or lengthen the runs"
        )


def check_metric(variant: Variant, spec: pb.GameSpec, metric: str, behavior: str | None) -> None:
    """Raise ConfigError unless the scored policy of a variant has a metric.

    metric: a column of metrics. behavior: whose metrics count; None: the first one's.
    """
    config = variant.config
    scored = next((each for each in spec.behaviors if each.name == behavior), spec.behaviors[0])
    names = [] if variant.by else [each.name for each in scored.metrics]
    measured = measured_columns(names, list(config.games))
    plain = metric.removeprefix(HELD_OUT)
    if plain in measured and plain != metric and config.evaluate_during is None:
        raise ConfigError(
            f"--metric {metric}: {variant.label} measures nothing held out; set evaluate_during, as in "
            "evaluate_during.episodes=100"
        )
    trained = not variant.by and metric in (*training_columns(), *_statistics(config, spec))
    if plain not in measured and not trained:
        more = f"; {HELD_OUT}… before each of these" if config.evaluate_during else ""
        training = "" if variant.by else f"; of the training: {', '.join(training_columns())}, entropy_BRANCH"
        whose = f"a run of {TRAINERS[variant.by]}" if variant.by else spec.name
        raise ConfigError(f"--metric got {metric!r}; {whose} has {', '.join(measured)}{more}{training}")


def _statistics(config: Config, spec: pb.GameSpec) -> list[str]:
    """Return the columns of the entropies, and of a term of the loss, that the policies of a game have."""
    names = []
    for role in list_roles(config.layout, spec):
        branches, axes = role.layout.names(spec.behaviors[role.behavior].device)
        names += [f"entropy_{name}" for name in (*branches, *axes)]
        if loss := config.policy_config(role.name).loss:
            names.append(f"loss_{loss.rpartition(':')[2]}")
    return names


def too_short_for_scores(variants: Sequence[Variant], specs: Sequence[pb.GameSpec], metric: str) -> str:
    """Return a warning if few of the longest episodes can end where a score counts them; "" if enough can.

    Held-out scores do not depend on this.
    """
    for variant, spec in zip(variants, specs, strict=True):
        config = variant.config
        scored = max(config.end // PARTS, config.log_interval)
        longest = config.arenas * spec.max_episode_decisions * spec.behaviors[0].agents_per_arena
        if longest > scored and is_of_episodes(metric):
            return (
                f"a score is the mean over the episodes that end in the last {scored:,} of "
                f"{config.end:,} timesteps, and an episode of {spec.max_episode_decisions:,} decisions in each "
                f"of {config.arenas} arenas takes {longest:,}: train for longer, or add --test or "
                "evaluate_during.episodes=30, which play whole episodes"
            )
    return ""


def different_bodies(variants: Sequence[Variant], specs: Sequence[pb.GameSpec]) -> str:
    """Return a warning if some variants train actor and critic with one body and others with two; "" if none differ.

    It is a second difference between layouts that no name shows, see `PolicyConfig.shared_body`.
    """
    bodies: dict[tuple[bool, ...], list[str]] = {}
    for variant, spec in zip(variants, specs, strict=True):
        if not variant.by:
            roles = list_roles(variant.config.layout, spec)
            shared = {
                variant.config.policy_config(each.name).shares_body(each.layout.space.continuous) for each in roles
            }
            bodies.setdefault(tuple(sorted(shared)), []).append(variant.label)
    if len(bodies) < 2:
        return ""
    words = {(False,): "have a body each", (True,): "share one", (False, True): "share one in some of the policies"}
    said = "; ".join(f"{words[shared]} in {listed(labels)}" for shared, labels in sorted(bodies.items()))
    return (
        f"the variants differ in their networks, too: actor and critic {said}. With policy.shared_body=false behind "
        "the options, they have a body each in all"
    )


def listed(labels: Sequence[str]) -> str:
    """Return labels side by side, those with commas in quotes."""
    return ", ".join(f'"{label}"' if "," in label else label for label in labels)


def make_job(variant: Variant, spec: pb.GameSpec, seed: int, options: argparse.Namespace) -> Job:
    """Return a run of a variant.

    Without snapshots, a run that goes on after a loss has other figures; such a run ends, and is repeated as a whole.
    """
    place = variant.name, seed, variant.config.end, options.output / "configs", options.output / "runs"
    if variant.by:
        environment = environment_of(variant.config.game, options.game)
        return PeerJob(*place, arguments=("--ppo", options.ppo, "--environment", environment), exact=False)
    exact = bool(spec.snapshot_bytes_per_arena)
    return Job(
        *place,
        overrides=() if exact else ("max_restarts=0",),
        arguments=tuple(wanted_simulators(options).arguments()),
        exact=exact,
    )


def scored_policy(variant: Variant, spec: pb.GameSpec, behavior: str | None) -> str:
    """Return the policy whose metrics are compared; "" for the only policy of a game. Raises ConfigError.

    It is the last one of the behavior: of axes and buttons the one with the buttons, as in the paper.
    """
    names = [each.name for each in spec.behaviors]
    if behavior is not None and behavior not in names:
        raise ConfigError(f"--behavior got {behavior!r}; {spec.name} has {', '.join(names)}")
    roles = list_roles(variant.config.layout, spec)
    index = names.index(behavior) if behavior is not None else 0
    return [role.name for role in roles if role.behavior == index][-1] if len(roles) > 1 else ""


def seeds(options: argparse.Namespace) -> range:
    """Return the seeds that each variant is trained with."""
    return range(options.first_seed, options.first_seed + options.seeds)


def seed_words(options: argparse.Namespace) -> list[str]:
    """Return the options that say which seeds these are."""
    return ["--seeds", f"{options.seeds}", *(["--first-seed", f"{options.first_seed}"] if options.first_seed else [])]


def backend(options: argparse.Namespace) -> tuple[int, Callable[[Job], Process]]:
    """Return how many runs are trained at the same time, and what starts one: here, or on a Ray cluster."""
    if options.backend == "local":
        return options.jobs or 1, start
    cluster = load("joybridge.clusters", "ray-grid")(options.cluster, options.jobs or 1)
    return options.jobs or cluster.room(), cluster.start


def number(value: float) -> str:
    """Return a number as it is written, with all of its digits."""
    return f"{value!r}".removesuffix(".0")


def repetition(options: argparse.Namespace) -> str:
    """Return the command that makes the same comparison or search elsewhere."""
    words = ["joybridge", "compare", options.config]
    words += [word for config in options.also for word in ("--also", config)]
    words += ["--layouts", *options.layouts] if options.layouts else []
    words += ["--set", *options.set] if options.set else []
    words += ["--change", *options.change] if options.change else []
    words += ["--pairs", *options.pairs] if options.pairs else []
    words += ["--search", *options.search, "--trials", f"{options.trials}"] if options.search else []
    words += ["--prune-from", number(options.prune_from)] if options.prune_from not in (None, PRUNE_FROM) else []
    words += seed_words(options) if not options.search else []
    words += ["--metric", options.metric] if options.metric != "reward" else []
    words += ["--test", *options.test] if options.test or (options.test is not None and not options.over) else []
    words += ["--over", f"{options.over.key}={','.join(options.over.values)}"] if options.over else []
    words += ["--episodes", f"{options.episodes}"] if options.test is not None else []
    words += ["--deterministic"] if options.deterministic else []
    words += ["--beside", options.beside] if options.beside else []
    words += ["--ppo", options.ppo] if options.ppo != "{}" else []
    words += ["--behavior", options.behavior] if options.behavior else []
    words += ["--score", number(options.score)] if options.score is not None else []
    overrides, games = options.typed
    words += [word for game in games for word in ("--game", game)]
    words += ["--simulator", "ADDRESS"] if options.simulator else []
    words += ["--figures", options.figures] if options.figures else []
    return shlex.join([*words, "--output", "FOLDER", *overrides])
