"""PPO on one page, in plain PyTorch: axes and buttons at once, with masks. A loop to copy and change.

python trainer/examples/ppo.py archer --timesteps 150000
"""

import argparse
from collections.abc import Iterator

import numpy as np
import torch
from gymnasium.spaces import Dict, MultiDiscrete
from torch import Tensor, nn
from torch.distributions import Categorical, Normal

from joybridge.gym import BridgeVectorEnv

STEPS, EPOCHS, MINIBATCH = 60, 4, 256
GAMMA, LAMBDA, CLIP, ENTROPY, LEARNING_RATE = 0.99, 0.95, 0.2, 0.003, 3e-3


class Agent(nn.Module):
    """Policy and value. An action is a row of floats: the axes, then the choice of each branch."""

    def __init__(self, inputs: int, axes: int, branches: list[int]) -> None:
        """inputs: numbers of an observation. branches: numbers of choices."""
        super().__init__()
        self.axes, self.branches = axes, branches
        self.body = nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh())
        self.policy, self.value = nn.Linear(64, axes + sum(branches)), nn.Linear(64, 1)
        self.log_std = nn.Parameter(torch.full((axes,), -0.5))

    def forward(self, observation: Tensor, mask: Tensor, action: Tensor | None = None) -> tuple[Tensor, ...]:
        """Return actions (new ones if none are given), their log-probabilities, entropies and values."""
        body = self.body(observation)
        mean, logits = self.policy(body).split([self.axes, sum(self.branches)], dim=1)
        gaussian = Normal(mean, self.log_std.exp())
        choices = [Categorical(logits=part) for part in logits.masked_fill(~mask, -1e9).split(self.branches, dim=1)]
        if action is None:
            action = torch.cat([gaussian.sample(), *(choice.sample()[:, None].float() for choice in choices)], dim=1)
        axes, indices = action[:, : self.axes], action[:, self.axes :].T
        log_prob, entropy = gaussian.log_prob(axes).sum(1), gaussian.entropy().sum(1)  # one joint probability
        for choice, index in zip(choices, indices, strict=True):
            log_prob, entropy = log_prob + choice.log_prob(index), entropy + choice.entropy()
        return action, log_prob, entropy, self.value(body)[:, 0]


def train(envs: BridgeVectorEnv, timesteps: int, seed: int = 0) -> Iterator[float]:
    """Train an agent; yield the mean reward of the episodes that ended in each rollout."""
    torch.manual_seed(seed)
    space = envs.single_action_space
    parts = space.spaces if isinstance(space, Dict) else {"": space}
    discrete = [part for part in parts.values() if isinstance(part, MultiDiscrete)]
    axes = sum(part.shape[0] for part in parts.values() if not isinstance(part, MultiDiscrete))
    agent = Agent(envs.single_observation_space.shape[0], axes, [int(n) for part in discrete for n in part.nvec])
    optimizer = torch.optim.Adam(agent.parameters(), lr=LEARNING_RATE)
    observations, infos = envs.reset(seed=seed)
    episode, lanes = np.zeros(envs.num_envs), torch.arange(envs.num_envs)
    for _ in range(timesteps // (STEPS * envs.num_envs)):
        rollout, ended_rewards = [], []
        for _ in range(STEPS):
            observation, mask = torch.as_tensor(observations), torch.as_tensor(infos["action_mask"])
            with torch.no_grad():
                action, log_prob, _, value = agent(observation, mask)
            both = {"continuous": action[:, :axes].numpy(), "discrete": action[:, axes:].long().numpy()}
            sent = both if isinstance(space, Dict) else both["discrete" if discrete else "continuous"]
            decides = torch.as_tensor(infos["deciding"])
            observations, rewards, terminated, truncated, infos = envs.step(sent)
            episode += rewards
            for lane in np.flatnonzero(terminated | truncated):
                ended_rewards.append(episode[lane])
                episode[lane] = 0.0
                if truncated[lane]:  # the game could have gone on: the value stands for the rest
                    final = torch.as_tensor(infos["final_obs"][lane])[None]
                    rewards[lane] += GAMMA * float(agent(final, mask[:1])[3])
            done = torch.as_tensor(terminated | truncated)
            rollout.append(
                (observation, mask, action, log_prob, value, torch.as_tensor(rewards).float(), done, decides)
            )
        obs, masks, actions, log_probs, values, paid, dones, deciding = map(torch.stack, zip(*rollout, strict=True))
        with torch.no_grad():
            next_value = agent(torch.as_tensor(observations), torch.as_tensor(infos["action_mask"]))[3]
        advantages, advantage = torch.zeros_like(values), torch.zeros(len(lanes))
        for step in reversed(range(STEPS)):
            goes_on = (~dones[step]).float()
            delta = paid[step] + GAMMA * next_value * goes_on - values[step]
            advantages[step] = advantage = delta + GAMMA * LAMBDA * advantage * goes_on
            next_value = values[step]
        kept = deciding.flatten()  # what a lane does while it waits does not count
        batch = [part.flatten(0, 1)[kept] for part in (obs, masks, actions, log_probs, advantages, advantages + values)]
        for _ in range(EPOCHS):
            for rows in torch.randperm(len(batch[0])).split(MINIBATCH):
                observation, mask, action, old, gain, target = (part[rows] for part in batch)
                _, log_prob, entropy, value = agent(observation, mask, action)
                ratio = (log_prob - old).exp()
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                policy_loss = -torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
                loss = policy_loss + 0.5 * (value - target).square().mean() - ENTROPY * entropy.mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimizer.step()
        yield float(np.mean(ended_rewards)) if ended_rewards else float("nan")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Train a game with PPO in plain PyTorch.")
    parser.add_argument("game", help="the name of a game, or MODULE:CLASS")
    parser.add_argument("--timesteps", type=int, default=150_000, help="default %(default)s")
    parser.add_argument("--arenas", type=int, default=32, help="default %(default)s")
    options = parser.parse_args()
    torch.set_num_threads(1)  # networks this small are slower with more
    envs = BridgeVectorEnv(options.game, options.arenas, frame_stack=1)
    for update, reward in enumerate(train(envs, options.timesteps), 1):
        print(f"{update * STEPS * envs.num_envs:>10,} timesteps  reward {reward:8.2f}", flush=True)
    envs.close()


if __name__ == "__main__":
    main()
