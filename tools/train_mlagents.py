"""Train with the real ML-Agents 1.1.0 on one side: its messages on a player's side, or its trainer.

python -m tools.train_mlagents            our trainer, and a player that is written on the messages of mlagents_envs
python -m tools.train_mlagents --learn    mlagents-learn, and Orchard as its player (`joybridge mlagents`)

Both need Python 3.10. For mlagents-learn 5 GB are installed into `.venv-mlagents-learn` once. Exit status: 0; 1 if a
training fails or does not reach its score; 77 where the packages cannot be had.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tools import check_mlagents
from tools.check_mlagents import REQUIREMENTS, ROOT, free_ports, install
from tools.checked import MISSING, Failed

LEARNER = ROOT / ".venv-mlagents-learn"  # which git ignores
LEARNING = (
    *REQUIREMENTS,
    "torch==2.2.2",
    "onnx==1.15.0",
    "tensorboard",
    "h5py",
    "six",
    "attrs",
    "huggingface-hub",
    "cattrs<1.7",
    "gym==0.26.2",
    "pettingzoo==1.15.0",
)
FOLDER = ROOT / "tools/mlagents"
AREAS, PLAYERS = 16, 2
STAND_IN_REWARD = 6.8  # of 8 per episode; random play earns 2.9
GAME, METRIC, CAUGHT = "orchard", "picker/caught", 0.9  # random play catches 0.15 of the apples
READ = """
import sys
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
for event in EventAccumulator(sys.argv[1]).Reload().Scalars(sys.argv[2]):
    print(event.step, event.value)
"""


def main() -> int:
    """Train, and return the exit status."""
    parser = argparse.ArgumentParser(description="Train with the real ML-Agents on one side.")
    parser.add_argument("--learn", action="store_true", help="with mlagents-learn; default: with our trainer")
    options = parser.parse_args()
    missing = install(LEARNER, LEARNING, "mlagents.trainers.learn") if options.learn else install()
    if missing:
        print(f"not trained: {missing}")
        return MISSING
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        try:
            print(their_trainer(Path(folder)) if options.learn else our_trainer(Path(folder)))
        except Failed as failure:
            print(f"failed: {failure}", file=sys.stderr)
            return 1
    print(f"trained in {time.monotonic() - begin:.0f} s")
    return 0


def our_trainer(folder: Path) -> str:
    """Let `joybridge train` start players of mlagents_envs' messages; return how it went. Raises Failed."""
    player = _build(folder / "stand_in", f'"{check_mlagents.ENVIRONMENT}/bin/python" "{FOLDER}/stand_in.py"')
    _run(
        sys.executable,
        "-m",
        "joybridge",
        "train",
        f"{FOLDER}/stand_in.yaml",
        "--unity",
        f"{player} areas={AREAS}",
        "--run",
        f"{folder}/run",
        f"arenas={AREAS * PLAYERS}",
    )
    (metrics,) = (folder / "run").glob("metrics*.csv")
    with metrics.open(newline="") as file:
        *_, last = csv.DictReader(file)
    if float(last["reward"]) < STAND_IN_REWARD:
        raise Failed(f"the reward per episode is {last['reward']}, expected {STAND_IN_REWARD}")
    return f"our trainer, {PLAYERS} players: reward {float(last['reward']):.2f} of 8 per episode"


def their_trainer(folder: Path) -> str:
    """Let `mlagents-learn` start `joybridge mlagents` and train it; return how it went. Raises Failed."""
    player = _build(folder / f"{GAME}.x86_64", f'"{sys.executable}" -m joybridge mlagents {GAME}')
    (port,) = free_ports(1)
    _run(
        f"{LEARNER}/bin/mlagents-learn", f"{FOLDER}/{GAME}.yaml", "--env", str(player), "--base-port", str(port),
        "--num-areas", str(AREAS * PLAYERS), "--seed", "0", "--run-id", GAME, "--results-dir", f"{folder}/results",
    )  # fmt: skip
    (events,) = (folder / "results" / GAME / METRIC.partition("/")[0]).glob("events.*")
    said = _run(f"{LEARNER}/bin/python", "-c", READ, str(events), METRIC, capture_output=True).splitlines()
    steps, caught = said[-1].split()
    if float(caught) < CAUGHT:
        raise Failed(f"{METRIC} is {caught} after {steps} decisions, expected {CAUGHT}")
    return f"mlagents-learn: {METRIC} {float(caught):.3f} after {int(steps):,} decisions"


def _build(path: Path, command: str) -> Path:
    """Write a player, as the executable file of a build."""
    path.write_text(f'#!/bin/sh\nexec {command} "$@"\n')
    path.chmod(0o700)
    return path


def _run(*command: str, capture_output: bool = False) -> str:
    """Run a command and return its output. Raises Failed."""
    done = subprocess.run(command, text=True, check=False, capture_output=capture_output)
    if done.returncode:
        raise Failed(f"{' '.join(command)} ended with {done.returncode}\n{done.stderr or ''}")
    return done.stdout or ""


if __name__ == "__main__":
    sys.exit(main())
