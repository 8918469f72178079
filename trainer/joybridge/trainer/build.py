"""From a configuration and a spec to policies: which there are, and which part of which device each holds."""

from collections.abc import Sequence

import numpy as np
import torch

from joybridge.trainer.agent import Policy
from joybridge.trainer.config import Config, ConfigError
from joybridge.trainer.layouts import LayoutError, make_layouts, policy_name
from joybridge.trainer.wire.shards import split
from joybridge.v1 import bridge_pb2 as pb


def make_policies(config: Config, spec: pb.GameSpec, arenas: int, groups: int = 1) -> list[Policy]:
    """Return untrained policies for all behaviors of the spec, their lanes in groups. Raises ConfigError."""
    if config.accelerator == "cuda" and not torch.cuda.is_available():
        raise ConfigError("accelerator is cuda, but torch finds no such device here; set accelerator=cpu")
    policies: list[Policy] = []
    seeds = np.random.SeedSequence(config.seed)
    for index, behavior in enumerate(spec.behaviors):
        try:
            layouts = make_layouts(config.layout, behavior.device)
        except LayoutError as error:
            raise ConfigError(f"layout: {error}") from error
        for part, layout in layouts.items():
            name = policy_name(behavior.name, part, alone=len(spec.behaviors) == 1)
            seed = int(seeds.spawn(1)[0].generate_state(1, np.uint64)[0])
            policy_config = config.policy_config(name)
            policies.append(
                Policy(name, spec, index, layout, policy_config, split(arenas, groups), seed, config.accelerator)
            )
    names = [policy.name for policy in policies]
    for name in config.policies:
        if name not in names:
            raise ConfigError(f"policies: there is no policy {name!r}; this game and layout have {', '.join(names)}")
    return policies


def rollout_cycle(policies: Sequence[Policy]) -> int:
    """Return the decisions after which all rollouts are empty again. Raises ConfigError if they never are."""
    cycle = max(policy.config.rollout_steps for policy in policies)
    for policy in policies:
        if cycle % policy.config.rollout_steps:
            raise ConfigError(
                f"policies.{policy.name}.rollout_steps is {policy.config.rollout_steps}, which does not divide the "
                f"longest, {cycle}"
            )
    return cycle
