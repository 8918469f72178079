"""From a configuration and a spec to policies: which there are, and which part of which device each holds."""

from collections.abc import Sequence

import numpy as np

from joybridge.v1 import bridge_pb2 as pb
from trainer.actions import LayoutError, make_layouts, policy_name
from trainer.config import Config, ConfigError
from trainer.policy import Policy


def make_policies(config: Config, spec: pb.GameSpec, arenas: int) -> list[list[Policy]]:
    """Return untrained policies, a list per behaviour of the spec. Raises ConfigError.

    A policy that holds a whole device is named after its behaviour; one that holds a part of it after the
    part, with the behaviour's name in front where there are several.
    """
    grouped: list[list[Policy]] = []
    seeds = np.random.SeedSequence(config.seed)
    for behaviour in spec.behaviours:
        try:
            layouts = make_layouts(config.layout, behaviour.device)
        except LayoutError as error:
            raise ConfigError(f"layout: {error}") from error
        group = []
        for part, layout in layouts.items():
            name = policy_name(behaviour.name, part, alone=len(spec.behaviours) == 1)
            seed = int(seeds.spawn(1)[0].generate_state(1, np.uint64)[0])
            group.append(Policy(name, behaviour, layout, config.policy_config(name), arenas=arenas, seed=seed))
        grouped.append(group)
    names = [policy.name for group in grouped for policy in group]
    for name in config.policies:
        if name not in names:
            raise ConfigError(f"policies: there is no policy {name!r}; this game and layout have {', '.join(names)}")
    return grouped


def rollout_cycle(policies: Sequence[Policy]) -> int:
    """Return the decisions after which all rollouts are empty again. Raises ConfigError if they never are."""
    cycle = max(policy.config.rollout for policy in policies)
    for policy in policies:
        if cycle % policy.config.rollout:
            raise ConfigError(
                f"policies.{policy.name}.rollout is {policy.config.rollout}, which does not divide the longest, {cycle}"
            )
    return cycle
