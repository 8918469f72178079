"""What a pointer is to a policy: train one small game in several ways, and print a table.

    python -m tools.pointer --seeds 3 --timesteps 200000 --output runs/pointer

The game says that its axes are positions, and never changes: `pointer`, `layout` and `penalty_ramp` are keys of the
configuration. Runs of as many timesteps that the folder already holds are not repeated, and go on where they ended.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

from joybridge.config.metrics import read_rows
from joybridge.simulator import (
    Action,
    Game,
    TimeStep,
    axis,
    behavior,
    button,
    channel,
    option,
    sensor,
    spec,
    transition,
    truncation,
)

DECISIONS = 120  # per episode
MOTHS, REACH, DRIFT = 3, 0.12, 0.03  # of the field from -1 to 1; the drift is per decision
LAST = 0.2  # of a run, which counts

VARIANTS = {
    "placed, `hybrid`": ["layout=hybrid"],
    "moved, `hybrid`": ["layout=hybrid", "pointer=velocity"],
    "placed, `bucket-11`": ["layout=bucket-11"],
    "moved, `bucket-11`": ["layout=bucket-11", "pointer=velocity"],
    "moved, `hybrid`, a miss costs 0.3": ["layout=hybrid", "pointer=velocity", "options.miss=dear"],
    "the same, `policy.penalty_ramp=100000`": [
        "layout=hybrid",
        "pointer=velocity",
        "options.miss=dear",
        "policy.penalty_ramp=100000",
    ],
}


class Moths(Game):
    """Put the pointer on a moth and press the button. Moths that are caught appear elsewhere."""

    name = "moths"
    description = "Put a net on moths that drift, and press the button there."
    version = "1"
    in_event_loop = True
    options = (option("miss", ["cheap", "dear"], description="what a press beside all moths costs: 0.02 or 0.3"),)

    @classmethod
    def describe(cls, options):  # type: ignore[no-untyped-def]
        """Return the spec: two axes that place the net, and a button."""
        player = behavior(
            "player",
            sensors=[
                sensor("net", [2], -1, 1, "x, y"),
                sensor("moth", [2], -2, 2, "the nearest one, from the net"),
                sensor("flight", [2], -1, 1, "how it moves"),
            ],
            axes=[axis("x", kind="position", way="right"), axis("y", kind="position", way="up")],
            branches=[button("catch", key="space")],
            channels=[channel("caught"), channel("missed", -0.3 if options["miss"] == "dear" else -0.02)],
            metrics=["caught", "presses"],
        )
        return spec(cls, [player], max_episode_decisions=DECISIONS, tick_seconds=0.1)

    def reset(self) -> TimeStep:
        """Begin an episode with the net in the middle."""
        self.decisions = self.caught = self.presses = 0
        self.net = np.zeros(2)
        self.moths = self.rng.uniform(-1, 1, (MOTHS, 2))
        self.flights = self.rng.uniform(-DRIFT, DRIFT, (MOTHS, 2))
        return transition(self._observe())

    def step(self, action: Action) -> TimeStep:
        """Place the net, catch what is under it, and let the moths fly."""
        self.net = np.array([action["x"], action["y"]])
        nearest, pressed = self._nearest(), bool(action["catch"])
        hit = pressed and bool(np.linalg.norm(self.moths[nearest] - self.net) < REACH)
        if hit:
            self.moths[nearest] = self.rng.uniform(-1, 1, 2)
        self.moths += self.flights
        self.flights[np.abs(self.moths) > 1] *= -1
        self.moths = self.moths.clip(-1, 1)
        self.decisions, self.caught, self.presses = self.decisions + 1, self.caught + hit, self.presses + pressed
        rewards = {"caught": float(hit), "missed": float(pressed and not hit)}
        if self.decisions < DECISIONS:
            return transition(self._observe(), rewards)
        return truncation(self._observe(), rewards, {"caught": self.caught, "presses": self.presses})

    def _nearest(self) -> int:
        return int(np.linalg.norm(self.moths - self.net, axis=1).argmin())

    def _observe(self) -> dict[str, object]:
        nearest = self._nearest()
        return {"net": self.net, "moth": self.moths[nearest] - self.net, "flight": self.flights[nearest] / DRIFT}


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Train one small game with a pointer that is placed, and moved.")
    parser.add_argument("--seeds", type=int, default=3, help="runs of each way; default: %(default)s")
    parser.add_argument("--timesteps", type=int, default=200_000, help="of each run; default: %(default)s")
    parser.add_argument("--output", type=Path, default=Path("runs/pointer"), help="folder of the runs")
    options = parser.parse_args()
    print(f"| {options.timesteps:,} timesteps, {options.seeds} seeds | caught per episode | presses |\n|---|---|---|")
    for number, (name, keys) in enumerate(VARIANTS.items()):
        runs = [
            train(options.output / f"{number}-s{seed}-{options.timesteps}", seed, options.timesteps, keys)
            for seed in range(options.seeds)
        ]
        caught, presses = (", ".join(f"{run[metric]:.1f}" for run in runs) for metric in ("caught", "presses"))
        print(f"| {name} | {caught} | {presses} |", flush=True)


def train(run: Path, seed: int, timesteps: int, keys: list[str]) -> dict[str, float]:
    """Return the means of the last rows of a run, which is trained unless it is finished. Raises CalledProcessError."""
    metrics = run / "metrics-player.csv"
    if not metrics.exists() or read_rows(metrics)[-1]["timesteps"] < timesteps:
        run.parent.mkdir(parents=True, exist_ok=True)
        settings = run.parent / "pointer.yaml"
        settings.write_text(
            "game: moths\narenas: 32\npipeline_groups: 1\nlog_interval: 10000\nlog_to: []\n"
            "policy: {frame_stack: 1, hidden_sizes: [64, 64], rollout_steps: 64, time_horizon: 64, epochs: 8,\n"
            "  learning_rate: 1.0e-3, entropy_coef: 0.005, entropy: sum}\n"
        )
        command = [sys.executable, "-m", "joybridge", "train", "--game", "tools.pointer:Moths"]
        command += [str(settings), "--run", str(run), f"seed={seed}", f"total_timesteps={timesteps}", *keys]
        command += ["--resume"] if (run / "config.yaml").exists() else []
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    rows = read_rows(metrics)
    last = rows[-max(1, round(LAST * len(rows))) :]
    return {metric: float(np.mean([row[metric] for row in last])) for metric in ("caught", "presses")}


if __name__ == "__main__":
    main()
