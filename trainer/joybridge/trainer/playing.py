"""Play a trained policy without learning: what evaluation and recording share."""

from collections.abc import Sequence
from pathlib import Path

import torch

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.trainer.build import make_policies
from joybridge.trainer.checkpoint import load_checkpoint, select
from joybridge.trainer.config import Config, load_config
from joybridge.trainer.layouts import make_acts
from joybridge.v1 import bridge_pb2 as pb


class Players:
    """The policies of a finished or running training, playing in `arenas` arenas."""

    def __init__(self, run: Path, spec: pb.GameSpec, arenas: int, seed: int, *, deterministic: bool) -> None:
        """Load the newest checkpoint of `run`. deterministic: always the likeliest action, no sampling.

        `seed` fixes the samples. Raises CheckpointError or ConfigError.
        """
        torch.set_num_threads(1)  # networks this small are slower with more
        config = run_config(run).model_copy(update={"seed": seed, "accelerator": "cpu"})
        arrays, manifest = load_checkpoint(run)
        self.timesteps: int = manifest["timesteps"]
        self.deterministic = deterministic
        self.policies = make_policies(config, spec, arenas)
        self.acts = make_acts(spec, arenas)
        for policy in self.policies:
            policy.load_network(select(arrays, f"{policy.name}/policy/"))

    def begin(self, steps: Sequence[StepArrays]) -> None:
        """Take the first observations of new episodes."""
        for policy in self.policies:
            policy.begin(steps)

    def act(self, steps: Sequence[StepArrays]) -> list[ActArrays]:
        """Return the actions for the present observations."""
        for policy in self.policies:
            policy.act(steps, self.acts, deterministic=self.deterministic)
        return self.acts

    def take(self, steps: Sequence[StepArrays]) -> list[Array]:
        """Take what followed; return each policy's rewards [lanes]."""
        rewards = [policy.take(steps) for policy in self.policies]
        for policy in self.policies:
            if policy.full:
                policy.next_rollout()
        return rewards


def run_config(run: Path) -> Config:
    """Return the configuration that a run was made with. Raises ConfigError."""
    return load_config(run / "config.yaml")
