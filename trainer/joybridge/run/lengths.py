"""What is odd in the lengths of a run. Needs no torch, so that it is said at once."""

from collections.abc import Iterator

from joybridge.config.config import Config

UPDATES = 10  # that a run should have, at least


def too_few_updates(config: Config) -> Iterator[str]:
    """Yield a warning if a run is too short for its rollouts."""
    size = config.arenas * config.policy.rollout_steps
    if config.end < UPDATES * size:
        yield (
            f"{config.end:,} timesteps are {config.end / size:.1f} updates of {size:,} ({config.arenas} arenas, "
            f"policy.rollout_steps {config.policy.rollout_steps}), and a policy hardly learns anything in fewer than "
            f"{UPDATES}: train for longer, or with fewer arenas or shorter rollouts and smaller minibatches"
        )


def intervals_too_short(config: Config) -> Iterator[str]:
    """Yield what is odd in how often a run is measured, which is at its rows of metrics."""
    if config.log_interval > config.end:
        yield (
            f"log_interval is {config.log_interval:,}, longer than the run of {config.end:,} timesteps, so it will "
            "have no row of metrics; make it a tenth of the run or less"
        )
    every = config.evaluate_during and config.evaluate_during.every
    if every and every < config.log_interval:
        yield (
            f"evaluate_during.every is {every:,}, but held-out episodes are played for rows of metrics: at each of "
            f"them, every {config.log_interval:,} timesteps (log_interval)"
        )
