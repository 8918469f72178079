"""A small search."""

SMALL = """
game: archer
arenas: 8
pipeline_groups: 1
total_timesteps: 2000
log_interval: 100
policy: {frame_stack: 1, hidden_sizes: [16], rollout_steps: 20, time_horizon: 20, minibatch_size: 80}
"""


WHAT = ["policy.learning_rate=1e-5..1e-1:log", "policy.epochs=1..5", "layout=hybrid,bucket-3"]
