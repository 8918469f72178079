"""One policy in training: its network, the rollout it collects, and the update from the rollout before.

Update u learns from rollout u. With `overlap` it does so while rollout u + 1 is collected, some minibatches
whenever the trainer would wait for the simulator; that rollout is then played by the network as it was before
update u, exactly one update behind. Which minibatches are learned when depends on the step alone, never on a
clock, so a run is reproducible either way.
"""

import copy
from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import numpy as np
import torch

from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.tensors import Array
from joybridge.trainer.checkpoint import CheckpointError
from joybridge.trainer.config import PolicyConfig
from joybridge.trainer.layouts import Layout
from joybridge.trainer.observations import Senses
from joybridge.trainer.ppo.fast.gradient import ClosedFormGradient
from joybridge.trainer.ppo.fast.kernels import choose
from joybridge.trainer.ppo.gae import estimate_advantages
from joybridge.trainer.ppo.loss import Batch, Gradient, Update, anneal, autograd_gradient
from joybridge.trainer.ppo.networks import Network, flatten_parameters
from joybridge.trainer.ppo.rollout import Rollout
from joybridge.v1 import bridge_pb2 as pb

SAMPLES, SHUFFLES = range(2)  # what random numbers are for


class DivergedError(Exception):
    """An update has made a network useless; the run keeps its state from before."""


class Policy:
    """A policy that acts in every lane of one behavior and learns from what follows."""

    def __init__(
        self,
        name: str,
        spec: pb.GameSpec,
        behavior: int,
        layout: Layout,
        config: PolicyConfig,
        arenas: Sequence[int],
        seed: int,
        device: str = "cpu",
    ) -> None:
        """Make an untrained policy for the behavior of that index, or for a part of its device.

        arenas: the first arena of each group and, last, their number; groups act in turn. `seed` fixes the
        network, the samples and the shuffles. device: where the network lives and learns.
        """
        self.name, self.behavior, self.layout, self.config, self.seed = name, behavior, layout, config, seed
        self.senses = Senses(name, spec.behaviors[behavior], config)
        self.metrics = [metric.name for metric in spec.behaviors[behavior].metrics]
        bounds = [lane_count(spec.behaviors[behavior], arena) for arena in arenas]
        self.groups = [slice(first, end) for first, end in pairwise(bounds)]
        self.lanes = bounds[-1]
        space = layout.space
        shared = config.shared_body if config.shared_body is not None else space.continuous == 0
        self.device = torch.device(device)
        self.network = Network(self.senses.size * config.frame_stack, space, config.hidden_sizes, shared, seed).to(
            self.device
        )
        self.sizes = np.array(space.branches, np.int64)
        self.acting = copy.deepcopy(self.network) if config.overlap else self.network
        self.weights = flatten_parameters(self.network)
        self.optimizer = torch.optim.Adam([self.weights], fused=True)
        reference = partial(autograd_gradient, self.network)
        closed_form = device == "cpu" and not config.autograd
        self.gradient: Gradient = ClosedFormGradient(self.network) if closed_form else reference
        self.rollout, self.last = (
            Rollout(config.rollout_steps, self.lanes, self.senses.size, config.frame_stack, space) for _ in range(2)
        )
        self.parts, self.last_parts = (
            [rollout.part(lanes) for lanes in self.groups] for rollout in (self.rollout, self.last)
        )
        self.rollouts = 0  # finished ones
        self.progress = 0.0  # share of the run at the end of the last rollout
        self.update: Update | None = None  # from the last rollout, where it is not finished
        self._draw_samples()

    def _rng(self, rollout: int, purpose: int) -> np.random.Generator:
        """Return the generator of one rollout for one purpose; so nothing random need ever be saved."""
        return np.random.Generator(np.random.Philox(key=[self.seed, rollout], counter=[0, 0, 0, purpose]))

    def _draw_samples(self) -> None:
        rng = self._rng(self.rollouts, SAMPLES)
        self.normal = rng.standard_normal(self.rollout.continuous.shape, np.float32)
        self.uniform = rng.random(self.rollout.discrete.shape, np.float32)

    def begin(self, steps: Sequence[StepArrays], group: int = 0) -> None:
        """Take a group's first observations of new episodes; here and below, steps and acts are the group's.

        They hold one entry per behavior.
        """
        step = steps[self.behavior]
        self.parts[group].begin(self.senses.frames(step.observations), step.deciding)

    @torch.inference_mode()
    def act(
        self, steps: Sequence[StepArrays], acts: Sequence[ActArrays], group: int = 0, *, deterministic: bool = False
    ) -> None:
        """Decide on the present observations and write the decision into the policy's part of `acts`.

        deterministic: the likeliest action instead of a sample.
        """
        step, act = steps[self.behavior], acts[self.behavior]
        rollout, network, lanes = self.parts[group], self.acting, self.groups[group]
        t = rollout.step
        masks = rollout.set_masks(None if step.masks is None else self.layout.masks(step.masks))
        outputs, values = network.heads(self._tensor(rollout.observations[t]))
        choose(
            _array(outputs), _array(network.mean_bias), _array(network.log_variance), self.sizes, masks,
            self.uniform[t, lanes], self.normal[t, lanes], deterministic,
            rollout.continuous[t], rollout.discrete[t], rollout.log_probs[t],
        )  # fmt: skip
        rollout.values[t] = _array(values)
        self.layout.write(rollout.continuous[t], rollout.discrete[t], act, step.masks)

    def take(self, steps: Sequence[StepArrays], group: int = 0) -> Array:
        """Store what followed the decision; return the rewards, float32 [lanes of the group]."""
        step, rollout = steps[self.behavior], self.parts[group]
        rewards = self.senses.rewards(step)
        if step.truncated.any() and step.final_observations is not None:
            final = rollout.final_stack(step.ended, self.senses.frames(step.final_observations))
            rollout.final_values[rollout.step, step.ended] = self._values(final)
        rollout.add_step(step, self.senses.frames(step.observations), rewards)
        return rewards

    @property
    def full(self) -> bool:
        """Return whether an update is due."""
        return all(part.full for part in self.parts)

    @torch.inference_mode()
    def _values(self, observations: Array) -> Array:
        return _array(self.acting.value(self._tensor(observations)))

    def _tensor(self, array: Array) -> torch.Tensor:
        return torch.from_numpy(array).to(self.device)

    def learn_on(self) -> None:
        """Do the present step's share of an update that overlaps with the rollout."""
        if self.update is not None:
            self.update.advance((self.parts[0].step + 1) / self.config.rollout_steps)

    def turn_over(self, progress: float) -> dict[str, float]:
        """Begin to learn from the full rollout, after a share `progress` of the run, and to collect the next.

        Return the statistics of an update that was finished by it; with `overlap` that is the one before. Nothing is
        learned from a rollout in which nothing was decided. Raises DivergedError.
        """
        statistics = self._finish_update()
        batch, value = self._batch() if self.rollout.live().any() else (None, {})
        self.next_rollout()
        self.progress = progress
        if self.config.overlap:
            self.acting.load_state_dict(self.network.state_dict())
        if batch is not None:
            self.update = self._begin_update(batch)
            if not self.config.overlap:
                statistics = self._finish_update()
        return statistics | value

    def _finish_update(self) -> dict[str, float]:
        """Learn what is left of the update, if there is one, and return its statistics. Raises DivergedError."""
        if self.update is None:
            return {}
        statistics, self.update = self.update.finish(), None
        if not self.weights.isfinite().all():
            found = ", ".join(f"{name} {value:g}" for name, value in statistics.items())
            raise DivergedError(
                f"the network of {self.name} is no longer finite ({found}); look for huge rewards or observations, or "
                "take a smaller learning_rate in a new run"
            )
        return statistics

    def next_rollout(self) -> None:
        """Begin the next rollout where this one ended."""
        self.last, self.rollout = self.rollout, self.last
        self.last_parts, self.parts = self.parts, self.last_parts
        for part, last in zip(self.parts, self.last_parts, strict=True):
            part.continue_from(last)
        self.rollouts += 1
        self._draw_samples()

    def _batch(self) -> tuple[Batch, dict[str, float]]:
        """Return what the full rollout has to teach, and as a statistic its mean value estimate."""
        config, rollout = self.config, self.rollout
        rollout.join_masks(self.parts)
        live = rollout.live()
        advantages = estimate_advantages(
            rollout.rewards, rollout.values, self._values(rollout.observations[-1]), rollout.terminated,
            rollout.truncated, rollout.final_values, live,
            gamma=config.gamma, lam=config.gae_lambda, horizon=config.time_horizon,
        )  # fmt: skip
        return rollout.batch(advantages, live).to(self.device), {"value": float(rollout.values[live].mean())}

    def _begin_update(self, batch: Batch) -> Update:
        config = self.config
        return Update(
            self.gradient, self.optimizer, batch,
            anneal(self.progress, config.learning_rate, config.clip_range, config.entropy_coef),
            epochs=config.epochs, minibatch=config.minibatch_size, rng=self._rng(self.rollouts - 1, SHUFFLES),
        )  # fmt: skip

    def state(self) -> dict[str, Array]:
        """Return copies of everything that fixes what follows, right after `turn_over`, for a checkpoint."""
        state = {f"network.{name}": _array(t).copy() for name, t in self.network.state_dict().items()}
        moments = self.optimizer.state_dict()["state"].get(0, {})
        state |= {f"adam.{name}": _array(moment).copy() for name, moment in moments.items()}
        state |= {"rollouts": np.array(self.rollouts), "progress": np.array(self.progress)}
        state |= {"observations": self.rollout.observations[0].copy(), "deciding": self.rollout.deciding[0].copy()}
        if self.update is not None:
            fields = vars(self.update.batch).items()
            state |= {f"batch.{name}": _array(field).copy() for name, field in fields if field is not None}
        return state

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self.load_network(state)
        moments = _tensors(state, "adam.")
        groups = self.optimizer.state_dict()["param_groups"]
        self.optimizer.load_state_dict({"state": {0: moments} if moments else {}, "param_groups": groups})
        self.rollouts, self.progress = int(state["rollouts"]), float(state["progress"])
        self.rollout.observations[0] = state["observations"]
        self.rollout.deciding[0] = state["deciding"]
        batch = _tensors(state, "batch.")
        if batch:
            whole = Batch(**({"masks": None} | batch))  # type: ignore[arg-type]
            self.update = self._begin_update(whole.to(self.device))
        else:
            self.update = None
        self._draw_samples()

    def load_network(self, state: dict[str, Array]) -> None:
        """Take back the network alone. Raises CheckpointError where it does not fit."""
        try:
            self.network.load_state_dict(_tensors(state, "network."))
            self.acting.load_state_dict(self.network.state_dict())
        except RuntimeError as error:
            text = f"{self.name}: the checkpoint's network does not fit this game, layout or version: {error}"
            raise CheckpointError(text) from error


def _array(tensor: torch.Tensor) -> Array:
    """Return a tensor's numbers: the very same where it lives on the processor, else a copy."""
    return tensor.detach().cpu().numpy()


def _tensors(state: dict[str, Array], prefix: str) -> dict[str, torch.Tensor]:
    """Return the arrays whose names begin with `prefix`, without it, as tensors of their own."""
    return {k.removeprefix(prefix): torch.from_numpy(v.copy()) for k, v in state.items() if k.startswith(prefix)}
