"""Compiles what the tests share, which Python and Numba keep on disk, before several processes do the same at once."""

from pathlib import Path
from tempfile import TemporaryDirectory

from joybridge.client.launch import simulator_process
from joybridge.config.config import load_config
from joybridge.config.config_files import FOLDER
from joybridge.run.train import train

# The compiled games; one kind of actions, and both. The third has networks of one layer, which many tests train.
CONFIGS = ("shooting_birds/bucket-3", "beastly_rivals/hybrid", "ferry/hybrid")
SMALL = ("arenas=4", "policy.rollout_steps=8", "policy.time_horizon=8", "policy.minibatch_size=16", "stop_at=32")


def main() -> None:
    """Train a little on each game."""
    with simulator_process() as address, TemporaryDirectory() as folder:
        for number, name in enumerate(CONFIGS):
            config = load_config(FOLDER / f"{name}.yaml", SMALL)
            train(config, Path(folder) / str(number), [address], resume=False)


if __name__ == "__main__":
    main()
