"""One policy in training: what it senses and is paid, its network, its rollout, its updates."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import torch

from joybridge.codec import ActArrays, StepArrays, lane_count
from joybridge.spec import element_count
from joybridge.tensors import Array
from joybridge.v1 import bridge_pb2 as pb
from trainer.actions import Layout
from trainer.advantages import estimate_advantages
from trainer.checkpoint import CheckpointError
from trainer.config import ConfigError, PolicyConfig
from trainer.distributions import branch_log_probs, gaussian_log_probs, sample_branches, sample_gaussians
from trainer.gradient import ClosedFormGradient
from trainer.networks import Network, flatten_parameters
from trainer.ppo import Gradient, anneal, autograd_gradient, update
from trainer.rollout import Rollout


class Senses:
    """The part of a behaviour's step that concerns one policy: its sensors and its reward."""

    def __init__(self, name: str, behaviour: pb.Behaviour, config: PolicyConfig) -> None:
        """Choose sensors and weights. Raises ConfigError for a sensor or channel the game does not have."""
        sensors = [sensor.name for sensor in behaviour.sensors]
        channels = [channel.name for channel in behaviour.channels]
        wanted = sensors if config.sensors is None else config.sensors
        _require_known(f"{name}: sensors", wanted, sensors)
        _require_known(f"{name}: channels", config.channels, channels)
        self.sensors = [sensors.index(sensor) for sensor in wanted]
        self.size = sum(element_count(behaviour.sensors[i]) for i in self.sensors)
        weights = {c.name: c.default_weight for c in behaviour.channels} | config.channels
        self.weights = np.array([weights[channel] for channel in channels], np.float32)

    def frames(self, observations: Sequence[Array]) -> Array:
        """Return the chosen sensors side by side, float32 [rows, size]."""
        rows = len(observations[0])
        return np.concatenate([observations[i].reshape(rows, -1) for i in self.sensors], axis=1, dtype=np.float32)

    def rewards(self, step: StepArrays) -> Array:
        """Return the weighted sum of the channels, float32 [lanes]."""
        return step.rewards @ self.weights


def _require_known(where: str, names: object, known: Sequence[str]) -> None:
    for name in names:  # type: ignore[attr-defined]
        if name not in known:
            raise ConfigError(f"{where}: the game has no {name!r}; it has {', '.join(known)}")


class Policy:
    """A policy that acts in every lane of one behaviour and learns from what follows."""

    def __init__(
        self, name: str, behaviour: pb.Behaviour, layout: Layout, config: PolicyConfig, *, arenas: int, seed: int
    ) -> None:
        """Make an untrained policy; `seed` fixes its network, its samples and its shuffles."""
        self.name, self.layout, self.config, self.seed = name, layout, config, seed
        self.senses = Senses(name, behaviour, config)
        self.lanes = lane_count(behaviour, arenas)
        space = layout.space
        shared = config.shared_body if config.shared_body is not None else space.continuous == 0
        width = self.senses.size * config.stack
        self.network = Network(width, space, config.hidden, shared, seed)
        self.weights = flatten_parameters(self.network)
        self.optimizer = torch.optim.Adam([self.weights], fused=True)
        reference = partial(autograd_gradient, self.network)
        self.gradient: Gradient = reference if config.autograd else ClosedFormGradient(self.network)
        self.rollout = Rollout(config.rollout, self.lanes, self.senses.size, config.stack, space)
        self.updates = 0
        self._draw_noise()

    def _rng(self) -> np.random.Generator:
        """Return the generator of the present rollout and its update; nothing of it need be saved."""
        return np.random.Generator(np.random.Philox(key=[self.seed, self.updates]))

    def _draw_noise(self) -> None:
        rng = self._rng()
        rollout = self.rollout
        self.normal = torch.from_numpy(rng.standard_normal(rollout.continuous.shape, np.float32))
        self.uniform = torch.from_numpy(rng.random(rollout.discrete.shape, np.float32))
        self.shuffles = rng

    def begin(self, step: StepArrays) -> None:
        """Take the first observations of new episodes."""
        self.rollout.begin(self.senses.frames(step.observations), step.deciding)

    @torch.inference_mode()
    def act(self, step: StepArrays, act: ActArrays, *, deterministic: bool = False) -> None:
        """Decide on the present observations and write the decision into the policy's part of `act`.

        deterministic: the likeliest action instead of a sample.
        """
        rollout, t = self.rollout, self.rollout.step
        network = self.network
        outputs = network(torch.from_numpy(rollout.observations[t]))
        log_probs = torch.zeros(self.lanes)
        if network.space.branches:
            masks = rollout.set_masks(None if step.masks is None else self.layout.masks(step.masks))
            logits = outputs.logits if masks is None else outputs.logits + torch.from_numpy(masks)
            discrete = logits.argmax(-1) if deterministic else sample_branches(logits, self.uniform[t])
            log_probs += branch_log_probs(logits, discrete)[0]
            rollout.discrete[t] = discrete.numpy()
        if network.space.continuous:
            normal = torch.zeros_like(outputs.mean) if deterministic else self.normal[t]
            continuous = sample_gaussians(outputs.mean, network.log_variance, normal)
            log_probs += gaussian_log_probs(outputs.mean, network.log_variance, continuous)[0]
            rollout.continuous[t] = continuous.numpy()
        rollout.values[t] = outputs.value.numpy()
        rollout.log_probs[t] = log_probs.numpy()
        self.layout.write(rollout.continuous[t], rollout.discrete[t], act, step.masks)

    def take(self, step: StepArrays) -> Array:
        """Store what followed the decision; return the rewards, float32 [lanes]."""
        rollout = self.rollout
        rewards = self.senses.rewards(step)
        if step.truncated.any() and step.final_observations is not None:
            final = rollout.final_stack(step.ended, self.senses.frames(step.final_observations))
            rollout.final_values[rollout.step, step.ended] = self._values(final)
        rollout.add_step(step, self.senses.frames(step.observations), rewards)
        return rewards

    @torch.inference_mode()
    def _values(self, observations: Array) -> Array:
        return self.network.value(torch.from_numpy(observations)).numpy()

    def learn(self, progress: float) -> dict[str, float]:
        """Update the network from the full rollout after a share `progress` of the run; return statistics."""
        config, rollout = self.config, self.rollout
        live = rollout.live()
        advantages = estimate_advantages(
            rollout.rewards, rollout.values[:-1], self._values(rollout.observations[-1]), rollout.terminated,
            rollout.truncated, rollout.final_values, live,
            gamma=config.gamma, lam=config.lam, horizon=config.horizon,
        )  # fmt: skip
        coefficients = anneal(progress, config.learning_rate, config.clip, config.entropy)
        statistics = {"value": float(rollout.values[:-1][live].mean()), "learning_rate": coefficients.learning_rate}
        statistics |= update(
            self.gradient, self.optimizer, rollout.batch(advantages, live), coefficients,
            epochs=config.epochs, minibatch=config.minibatch, rng=self.shuffles,
        )  # fmt: skip
        self.forget()
        return statistics

    def forget(self) -> None:
        """Begin the next rollout; the network stays as it is."""
        self.rollout.carry_over()
        self.updates += 1
        self._draw_noise()

    def state(self) -> dict[str, Array]:
        """Return copies of everything that fixes what follows, between two rollouts, for a checkpoint."""
        state = {f"network.{name}": t.detach().numpy().copy() for name, t in self.network.state_dict().items()}
        moments = self.optimizer.state_dict()["state"].get(0, {})
        state |= {f"adam.{name}": moment.numpy().copy() for name, moment in moments.items()}
        state["updates"] = np.array(self.updates)
        state["observations"] = self.rollout.observations[0].copy()
        state["deciding"] = self.rollout.deciding[0].copy()
        return state

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self.load_network(state)
        moments = {
            k.removeprefix("adam."): torch.from_numpy(v.copy()) for k, v in state.items() if k.startswith("adam.")
        }
        groups = self.optimizer.state_dict()["param_groups"]
        self.optimizer.load_state_dict({"state": {0: moments} if moments else {}, "param_groups": groups})
        self.updates = int(state["updates"])
        self.rollout.observations[0] = state["observations"]
        self.rollout.deciding[0] = state["deciding"]
        self._draw_noise()

    def load_network(self, state: dict[str, Array]) -> None:
        """Take back the network alone."""
        weights = {k.removeprefix("network."): v for k, v in state.items() if k.startswith("network.")}
        try:
            self.network.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in weights.items()})
        except RuntimeError as error:
            text = f"{self.name}: the checkpoint's network does not fit this game, layout or version: {error}"
            raise CheckpointError(text) from error
