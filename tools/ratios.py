"""Whether it has become slower than it was beside version 0.1.0, in turns: `python -m tools.ratios`.

    start           a simulator that starts and ends
    first update    a training of one rollout, with its simulator
    timesteps       what 90,000 more of them take
    round trip      the median of a decision of one arena

The first three are CPU seconds, which other programs disturb less than seconds; the last is in seconds. Version 0.1.0
is built from its commit, and has the same packages as this checkout. Each round measures both, one after the other, so
a slow machine, or a busy minute, is slow for both. The median of the rounds' ratios is compared with ratios.json: a
ratio that is more than 15 % larger, twice, is an error.

Exit status: 0; 1 if a ratio is larger twice; 77 where the history of git is not present, as in a shallow clone.
`--write` writes ratios.json instead: after a change that is worth its price, or one that made something faster.
"""

import argparse
import json
import os
import resource
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tools.check_versions import COMMITS, Earlier, is_here
from tools.check_wheel import Programs
from tools.checked import MISSING, Failed

VERSION = "0.1.0"
BASELINE = Path(__file__).with_name("ratios.json")
LIMIT = 1.15  # times the baseline
ROUNDS = 5
FIRST, FURTHER = 4_425, 90_000  # timesteps: a rollout, and what comes after it
START = """
from joybridge.client.launch import simulator_process
with simulator_process():
    pass
"""
ROUND_TRIP = """
import statistics, time
from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.layouts import make_acts
with simulator_process() as address, Session(address, "shooting_birds", arenas=1, seed=0) as session:
    acts, seconds = make_acts(session.spec, 1), []
    for _ in range(4000):
        begin = time.perf_counter()
        session.step(acts)
        seconds.append(time.perf_counter() - begin)
print(statistics.median(seconds[1000:]))
"""

Measures = dict[str, float]


def measure(programs: Programs) -> Measures:
    """Return what each part takes with the programs of a version. Raises Failed."""
    first = cpu_seconds(lambda: train(programs, FIRST))
    return {
        "start": cpu_seconds(lambda: programs.run("python", "-P", "-c", START)),
        "first update": first,
        "timesteps": cpu_seconds(lambda: train(programs, FIRST + FURTHER)) - first,
        "round trip": float(programs.run("python", "-P", "-c", ROUND_TRIP)),
    }


def train(programs: Programs, timesteps: int) -> None:
    """Train for some timesteps. Raises Failed."""
    with tempfile.TemporaryDirectory() as folder:
        settings = [f"total_timesteps={timesteps}", "log_interval=1000000", "--run", f"{folder}/run"]
        programs.run("joybridge", "train", "shooting_birds/bucket-11", *settings)


def cpu_seconds(run: Callable[[], object]) -> float:
    """Return the CPU seconds of the processes that `run` starts and waits for."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@contextmanager
def both_versions() -> Iterator[tuple[Programs, Programs]]:
    """Yield the programs of this checkout and those of the earlier version. Raises Failed."""
    with tempfile.TemporaryDirectory() as temporary:
        yield (
            Programs(Path(sys.executable).parent, Path(temporary) / "here"),
            Earlier(COMMITS[VERSION], Path(temporary) / "earlier"),
        )


def rounds(here: Programs, earlier: Programs) -> dict[str, list[float]]:
    """Return the ratios of some rounds, in order of size. Raises Failed."""
    pairs = [(measure(here), measure(earlier)) for _ in range(ROUNDS)]
    return {name: sorted(ours[name] / theirs[name] for ours, theirs in pairs) for name in pairs[0][0]}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"write {BASELINE.name}")
    write = parser.parse_args(arguments).write
    if not is_here(COMMITS[VERSION]):
        print(f"not checked: the history of git has no commit of {VERSION}; fetch it", file=sys.stderr)
        return MISSING
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # each program would compile what it imports
    try:
        with both_versions() as (here, earlier):
            for programs in (here, earlier):
                measure(programs)  # warms caches up
            ratios = rounds(here, earlier)
            if write:
                medians = {name: round(statistics.median(found), 3) for name, found in ratios.items()}
                BASELINE.write_text(json.dumps(medians, indent=2) + "\n", encoding="utf-8")
            slower = report(ratios)
            if slower:
                print("once more, because a slow minute is not a slow program", flush=True)
                slower &= report(rounds(here, earlier))
    except Failed as failure:
        print(f"failed: {failure}", file=sys.stderr)
        return 1
    if slower:
        print(f"slower than {BASELINE.name}: {', '.join(sorted(slower))}; see --help", file=sys.stderr)
    return int(bool(slower))


def report(ratios: dict[str, list[float]]) -> set[str]:
    """Print ratios beside the largest that are allowed, and return the names of those that are larger."""
    baseline = json.loads(BASELINE.read_text(encoding="utf-8"))
    larger = set()
    for name, found in ratios.items():
        median, allowed = statistics.median(found), LIMIT * baseline[name]
        spread = f"{found[0]:.3f} to {found[-1]:.3f} in {len(found)} rounds"
        print(f"{name}: {median:.3f} times {VERSION} ({spread}), at most {allowed:.3f} expected", flush=True)
        larger |= {name} if median > allowed else set()
    return larger


if __name__ == "__main__":
    sys.exit(main())
