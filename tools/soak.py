"""Whether memory grows: a trainer and its simulator run for minutes, and their resident memory is sampled (Linux).

python -m tools.soak                            three minutes with 256 arenas
python -m tools.soak --minutes 60 --arenas 27 --config beastly_rivals/bucket-3

The first third of the time is left out: caches fill, and code is compiled. The rest is divided into blocks; a line
through the means of the blocks gives the slope and its 95 % confidence interval. One line per process. The exit status
is 1 if a process grows: if the interval lies above LIMIT.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence

import numpy as np
from scipy import stats

from tools.chaos.process import children, mebibytes

BLOCKS = 10
LIMIT = 1.0  # MiB per hour
SAMPLE_SECONDS = 0.5


def slope(hours: Sequence[float], memory: Sequence[float]) -> tuple[float, float]:
    """Return the growth of memory in MiB per hour, and half the width of its 95 % confidence interval."""
    times, sizes = ([block.mean() for block in np.array_split(np.array(values), BLOCKS)] for values in (hours, memory))
    line = stats.linregress(times, sizes)
    return float(line.slope), float(line.stderr * stats.t.ppf(0.975, BLOCKS - 2))


def watch(trainer: "subprocess.Popen[bytes]", minutes: float) -> dict[str, list[tuple[float, float]]]:
    """Return (hour, MiB) samples of a trainer and its simulator. Raises RuntimeError if the trainer ends."""
    samples: dict[str, list[tuple[float, float]]] = {"trainer": [], "simulator": []}
    begin = time.monotonic()
    while (now := (time.monotonic() - begin) / 60.0) < minutes:
        if trainer.poll() is not None:
            raise RuntimeError(f"the trainer ended with status {trainer.returncode} after {now:.1f} minutes")
        processes = {"trainer": trainer.pid, "simulator": next(iter(children(trainer.pid)), None)}
        for name, process in processes.items():
            if process is not None and now > minutes / 3.0:
                samples[name].append((now / 60.0, mebibytes(process)))
        time.sleep(SAMPLE_SECONDS)
    return samples


def main() -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=3.0, help="default %(default)g")
    parser.add_argument("--arenas", type=int, default=256, help="default %(default)s")
    parser.add_argument("--config", default="shooting_birds/bucket-11", help="default %(default)s")
    options = parser.parse_args()
    grows = False
    with tempfile.TemporaryDirectory() as folder:
        settings = [f"arenas={options.arenas}", "total_timesteps=1000000000000"]
        command = [sys.executable, "-m", "joybridge", "train", options.config, *settings, "--run", f"{folder}/run"]
        trainer = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        try:
            samples = watch(trainer, options.minutes)
        finally:
            trainer.terminate()
            trainer.wait()
    for name, sampled in samples.items():
        times, sizes = zip(*sampled, strict=True)
        growth, half = slope(times, sizes)
        grows |= growth - half > LIMIT
        print(
            f"{name}: {sizes[0]:.0f} to {sizes[-1]:.0f} MiB in {60.0 * (times[-1] - times[0]):.1f} minutes, growth "
            f"{growth:+.2f} ± {half:.2f} MiB per hour{', which is too much' if growth - half > LIMIT else ''}",
            flush=True,
        )
    return int(grows)


if __name__ == "__main__":
    sys.exit(main())
