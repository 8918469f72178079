"""What Optuna decides in a search: the next settings, which trials are hopeless, and which keys matter.

Every answer is computed anew from the trials so far, with a generator seeded by (seed, number of the trial). So a
search that was killed goes on as if it had not been, and Optuna keeps nothing. It is imported only here.
"""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.trial import TrialState, create_trial

from joybridge.compare.ranges import Numbers, Range
from joybridge.compare.trials import Trial

optuna.logging.set_verbosity(optuna.logging.WARNING)  # it reports each study that is made

ATTEMPTS = 20  # to propose settings that have not been tried: so many by TPE, then as many at random
# The sampler takes settings that failed for bad ones, so they count as pruned before the first report.
STATES = {
    "running": TrialState.RUNNING, "complete": TrialState.COMPLETE, "pruned": TrialState.PRUNED,
    "failed": TrialState.PRUNED,
}  # fmt: skip


def propose(ranges: Sequence[Range], trials: Sequence[Trial], seed: int) -> dict[str, str] | None:
    """Return the settings of the next trial, by key; None if all combinations seem to have been tried.

    trials: all before it. Settings near those of running ones are avoided; no settings are proposed twice, because they
    would give the same score.
    """
    tried = [trial.settings for trial in trials]
    for attempt in range(2 * ATTEMPTS):
        generator = int(np.random.SeedSequence((seed, len(trials), attempt)).generate_state(1)[0])
        study = _study(ranges, trials, generator, random=attempt >= ATTEMPTS)
        params = study.ask(_distributions(ranges)).params
        settings = {
            each.key: each.write(params[each.key]) if isinstance(each, Numbers) else params[each.key] for each in ranges
        }
        if settings not in tried:
            return settings
    return None


def hopeless(
    ranges: Sequence[Range], trials: Sequence[Trial], settings: Mapping[str, str], rungs: Mapping[int, float]
) -> bool:
    """Return whether all that a trial has reached is below the median of the complete ones at its last rung.

    trials: those that it is compared with. rungs: what it has reached so far, by timesteps, at least one.
    """
    study = _study(ranges, trials)
    study.enqueue_trial(_params(ranges, settings))
    trial = study.ask(_distributions(ranges))
    for timesteps, value in rungs.items():
        trial.report(value, timesteps)
    return trial.should_prune()


def importances(ranges: Sequence[Range], trials: Sequence[Trial]) -> dict[str, float]:
    """Return how much each key matters for reaching the best scores (PED-ANOVA), as shares of 1, the largest first.

    Empty if too many scores are equal to tell.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        try:
            return optuna.importance.get_param_importances(_study(ranges, trials))
        except UserWarning:
            return {}


def _study(ranges: Sequence[Range], trials: Sequence[Trial], seed: int = 0, *, random: bool = False) -> optuna.Study:
    """Return a study in memory that knows these trials. random: it samples at random, whatever it knows."""
    sampler = optuna.samplers.RandomSampler(seed=seed) if random else optuna.samplers.TPESampler(seed=seed)
    study = optuna.create_study(direction="maximize", sampler=sampler, pruner=optuna.pruners.MedianPruner())
    distributions = _distributions(ranges)
    study.add_trials(
        create_trial(
            params=_params(ranges, trial.settings), distributions=distributions, state=STATES[trial.state],
            value=trial.score if trial.state == "complete" else None, intermediate_values=trial.rungs,
        )
        for trial in trials
    )  # fmt: skip
    return study


def _distributions(ranges: Sequence[Range]) -> dict[str, BaseDistribution]:
    return {each.key: _distribution(each) for each in ranges}


def _distribution(each: Range) -> BaseDistribution:
    if not isinstance(each, Numbers):
        return CategoricalDistribution(each.values)
    if each.whole:
        return IntDistribution(int(each.low), int(each.high), log=each.log)
    return FloatDistribution(each.low, each.high, log=each.log)


def _params(ranges: Sequence[Range], settings: Mapping[str, str]) -> dict[str, Any]:
    return {each.key: each.read(settings[each.key]) for each in ranges}
