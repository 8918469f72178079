"""Train on a GPU, and check what is promised for one: `python -m tools.check_gpu`.

The same seed gives the same bits twice, and a run that is stopped in its middle and resumed ends in the same ones; its
policy is played and exported without a GPU. Pictures, memory, several policies and opponents are among the trainings.
How many timesteps per second there are is printed beside those of the processor.

Exit status: 0; 1 if a promise is not kept; 77 where PyTorch finds no GPU.
"""

import argparse
import re
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import torch

from joybridge.run.checkpoint import SUMS, checkpoints
from tools.check_wheel import Programs
from tools.checked import MISSING, Failed

PICTURES = ["options.observation=screen", "options.screen_size=84", "policy.image_encoder=impala"]
MEMORY = ["policy.memory.size=64", "policy.memory.length=30", "policy.frame_stack=1"]
Training = tuple[str, int, list[str]]  # a configuration, its timesteps, and other changes
TRAININGS: tuple[Training, ...] = (
    ("shooting_birds/hybrid", 45_000, []),
    ("shooting_birds/screen", 45_000, []),
    ("shooting_birds/screen", 15_000, PICTURES),
    ("shooting_birds/hybrid", 45_000, [*MEMORY, "policy.memory.kind=gru"]),
    ("shooting_birds/hybrid", 45_000, [*MEMORY, "policy.memory.kind=lstm"]),
    ("beastly_rivals/multiagent", 45_000, []),
    ("beastly_rivals_full/league", 40_000, []),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Check all trainings and return the exit status."""
    parser = argparse.ArgumentParser(description="Train on a GPU, and check what is promised for one.")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="trainings; default %(default)s")
    options = parser.parse_args(arguments)
    if not torch.cuda.is_available():
        print("not checked: PyTorch finds no GPU", file=sys.stderr)
        return MISSING
    print(f"{torch.cuda.get_device_name()}, PyTorch {torch.__version__}", flush=True)
    failed = 0
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.at_once) as pool:
        checks = [
            pool.submit(check, config, timesteps, changes, Path(folder, str(number)))
            for number, (config, timesteps, changes) in enumerate(TRAININGS)
        ]
        for done in as_completed(checks):
            try:
                print(done.result(), flush=True)
            except Failed as failure:
                failed += 1
                print(f"failed: {failure}", flush=True)
    return int(failed > 0)


def check(config: str, timesteps: int, changes: Sequence[str], folder: Path) -> str:
    """Train a configuration on the GPU in all ways and say what came. Raises Failed."""
    programs = Programs(Path(sys.executable).parent, folder)
    without = Programs(programs.bin, folder / "without")
    without.variables["CUDA_VISIBLE_DEVICES"] = ""
    settings = [*changes, "log_to=[]", f"total_timesteps={timesteps}", f"log_interval={timesteps // 3}"]
    on_gpu = [*settings, "accelerator=cuda"]
    train(programs, config, "once", on_gpu)
    speed = train(programs, config, "again", on_gpu)
    train(programs, config, "resumed", [*on_gpu, f"stop_at={timesteps // 2}"])
    train(programs, config, "resumed", ["--resume", *on_gpu])
    digests = {run: digest(folder / run) for run in ("once", "again", "resumed")}
    what = " ".join([config, *changes])
    if len(set(digests.values())) > 1:
        raise Failed(f"{what}: the same seed gives different bits: {digests}")
    processor = train(without, config, "processor", settings)
    without.run("joybridge", "evaluate", str(folder / "once"), "--episodes", "7")  # one for each level
    without.run("joybridge", "export", str(folder / "once"), "policy.json")
    return (
        f"{what}: {digests['once']} three times; played and exported without a GPU; "
        f"{speed} timesteps/s, {processor} on the processor"
    )


def train(programs: Programs, config: str, run: str, settings: Sequence[str]) -> str:
    """Train and return the timesteps per second of the last row. Raises Failed."""
    output = programs.run("joybridge", "train", config, "--run", run, *settings)
    last: str = re.findall(r"([\d.,]+(?: k)?) timesteps/s", output)[-1]
    return last


def digest(run: Path) -> str:
    """Return a hash of all arrays of the last checkpoint of a run."""
    return (checkpoints(run)[-1] / SUMS).read_text(encoding="utf-8")[:16]


if __name__ == "__main__":
    sys.exit(main())
