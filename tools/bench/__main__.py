"""How fast it is on this machine: medians over windows, with their spread.

python -m tools.bench [simulator | pictures | wire | learner | train | start | peers | all] [--json]

simulator   a game alone, in this process, by number of arenas
pictures    the images that agents observe, beside a bare write of as many bytes
wire        simulator process and client with random actions, and the round trip of one arena beside a bare echo
learner     sample passes of an update, beside the bare matrix products of the same shapes; with images, beside the
            bare forward and backward passes of the network, and with memory of its recurrent layer
train       all of it: what `joybridge train` reaches
start       seconds that a simulator takes, seconds until a run's first update, and memory of both (Linux)
peers       the same beside Stable-Baselines3's PPO and a Gymnasium AsyncVectorEnv, on the same game
"""

import argparse
import json
import sys

from tools.bench.learner import bench_learner
from tools.bench.measure import (
    machine,
)
from tools.bench.simulator import bench_pictures, bench_simulator, bench_wire
from tools.bench.training import bench_peers, bench_start, bench_train

BENCHES = {
    "simulator": bench_simulator,
    "pictures": bench_pictures,
    "wire": bench_wire,
    "learner": bench_learner,
    "train": bench_train,
    "start": bench_start,
    "peers": bench_peers,
}


def main() -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Measure how fast it is on this machine.")
    parser.add_argument("what", nargs="?", default="all", choices=[*BENCHES, "all"], help="default %(default)s")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line of stdout")
    options = parser.parse_args()
    print(machine(), flush=True)
    results = {}
    for name in BENCHES if options.what == "all" else [options.what]:
        print(f"\n{name}", flush=True)
        results[name] = BENCHES[name]()
        for what, figure in results[name].items():
            low, median, high = (
                f"{figure[key]:,.4g}" if figure[key] < 100 else f"{figure[key]:,.0f}"
                for key in ("low", "median", "high")
            )
            print(f"  {what:<64} {median:>12}  ({low} – {high})", flush=True)
    if options.json:
        print(json.dumps({"machine": machine(), "results": results}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
