"""Each layout learns an identity game: what is shown is what pays. It is played on arrays, without a simulator."""

import numpy as np
import pytest

from joybridge.config.config import Config
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import StepArrays
from joybridge.layouts import make_acts
from joybridge.policy.actor import make_actors
from joybridge.policy.policy import Policy
from joybridge.ppo.threads import use_one_thread
from joybridge.run.train import learn
from joybridge.simulator import axis, behavior, branch, button, sensor
from joybridge.v1 import bridge_pb2 as pb

LANES, STEPS, UPDATES = 64, 8, 15
FAST = PolicyConfig(
    frame_stack=1,
    hidden_sizes=[32],
    rollout_steps=STEPS,
    time_horizon=STEPS,
    minibatch_size=256,
    epochs=6,
    learning_rate=1e-2,
    entropy_coef=0.001,
    gamma=0.0,
)
PLAYER = behavior(
    "player",
    sensors=[sensor("target", [5], -1, 1)],
    axes=[axis("x"), axis("y", 0, 2)],
    branches=[button("a"), branch("gear", ["low", "high", "reverse"])],
)
SPEC = pb.GameSpec(name="identity", behaviors=[PLAYER])


class Identity:
    """The game: a target for both axes, and choices that are right."""

    def __init__(self, layout: str) -> None:
        use_one_thread()
        config = Config(game="identity", layout=layout, policy=FAST)
        self.policies = [Policy(actor, PLAYER, [0, LANES]) for actor in make_actors(config, SPEC)]
        self.acts, self.rng = make_acts(SPEC, LANES), np.random.default_rng(0)
        self.step = self.show(np.zeros(LANES, np.float32))
        for policy in self.policies:
            policy.begin([[self.step]])

    def show(self, rewards: np.ndarray) -> StepArrays:
        """Return a step with new targets."""
        self.aims = self.rng.uniform(-0.8, 0.8, (LANES, 2)).astype(np.float32)
        self.right = self.rng.integers(0, [2, 3], (LANES, 2))
        target = np.column_stack([self.aims, self.right == 1, self.right[:, 1] == 2]).astype(np.float32)
        never = np.zeros(LANES, bool)
        return StepArrays([target], rewards[:, None], never, never)

    def score(self) -> np.ndarray:
        """Return what the actions deserve, 0..1 [lanes]."""
        (act,) = self.acts
        near = 1.0 - np.minimum(1.0, np.abs(act.axes - [0, 1] - self.aims))
        return np.column_stack([near, act.choices == self.right]).mean(axis=1).astype(np.float32)

    def rollout(self) -> float:
        """Play until an update is due; return the mean score."""
        scores = []
        while not self.policies[0].rollout.full:
            for policy in self.policies:
                policy.act([self.step], self.acts)
            scores.append(self.score())
            self.step = self.show(scores[-1])
            for policy in self.policies:
                policy.store([self.step])
        return float(np.mean(scores))


@pytest.mark.parametrize(
    "layout",
    [
        "bucket-5-mu",
        "joint-3",
        "ordinal-7",
        "beta",
        "squashed",
        "gsde-4",
        "bucket-7, y=hybrid, a=threshold-0.0",
    ],
)
def test_the_identity_game_is_learned(layout):
    game, scores = Identity(layout), []
    for update in range(UPDATES):
        scores.append(game.rollout())
        for policy in game.policies:
            statistics = learn(policy, update / UPDATES)
            parts = [value for key, value in statistics.items() if key.startswith("entropy_")]
            assert len(parts) == policy.rollout.space.continuous + len(policy.rollout.space.branches)
            assert np.isfinite(parts).all()
    assert np.mean(scores[:2]) < 0.6 and np.mean(scores[-3:]) > 0.7  # of untrained policies, 0.4
