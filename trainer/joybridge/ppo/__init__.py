"""PPO: rollout buffer, advantages, networks, loss. `fast/` holds the compiled twin of the loss."""
