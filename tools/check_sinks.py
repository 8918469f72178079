"""Train with the real Weights & Biases and MLflow, offline, and read with their own readers what they got.

They bring dozens of packages, so they are installed into a folder of their own, beside the environment that runs this.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from joybridge.config.metrics import Row, read_rows
from tools.checked import Failed

ROOT = Path(__file__).parents[1]
PACKAGES = ["wandb>=0.21", "mlflow-skinny>=3"]
TRAIN = [
    "train",
    "archer/hybrid",
    "--run",
    "run",
    "log_to=[tensorboard,wandb,mlflow]",
    "total_timesteps=60000",
    "log_interval=10000",
]
READ = """
import json, struct
from pathlib import Path
from mlflow import MlflowClient
from wandb.proto.wandb_internal_pb2 import Record

def records(data):
    # Chunks of LevelDB's log format after a header of 7 bytes: no chunk crosses a block of 32 KiB.
    place, parts = 7, []
    while place < len(data):
        if (left := 32768 - place % 32768) < 7:
            place += left
            continue
        _, size, kind = struct.unpack_from("<IHB", data, place)
        parts.append(data[place + 7 : place + 7 + size])
        place += 7 + size
        if kind in (1, 4):  # whole, last
            yield Record.FromString(b"".join(parts))
            parts = []

client = MlflowClient(tracking_uri=Path("run/mlruns").resolve().as_uri())
(run,) = client.search_runs([client.get_experiment_by_name("joybridge").experiment_id])
mlflow = [[one.step, one.value] for one in client.get_metric_history(run.info.run_id, "reward")]
wandb = []
for file in sorted(Path("run/wandb").glob("offline-run-*/*.wandb")):
    for record in records(file.read_bytes()):
        cells = {item.key or "/".join(item.nested_key): item.value_json for item in record.history.item}
        if "reward" in cells:
            wandb.append([int(cells["timesteps"]), float(cells["reward"])])
about = [run.data.params["game"], run.data.params["policy.gamma"], run.info.run_name, run.info.status]
print(json.dumps({"mlflow": mlflow, "wandb": wandb, "about": about}))
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Check both and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.check_sinks", description=__doc__.splitlines()[0])
    parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        try:
            folder = Path(temporary)
            install(folder / "packages")
            check(folder)
        except (Failed, subprocess.CalledProcessError) as failure:
            output = getattr(failure, "output", None) or ""
            print(f"failed: {failure}\n{output}", file=sys.stderr)
            return 1
    print("Weights & Biases and MLflow have every row of a run that was stopped and resumed, offline")
    return 0


def install(target: Path) -> None:
    """Install the packages into a folder. Raises CalledProcessError."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(target)]
    subprocess.run([*command, "--constraint", str(ROOT / "constraints.txt"), *PACKAGES], check=True)


def run(folder: Path, *arguments: str, **variables: str) -> str:
    """Run this Python with the packages and return its output. Raises CalledProcessError."""
    hidden = ("WANDB_", "MLFLOW_")
    own = {name: value for name, value in os.environ.items() if not name.startswith(hidden)}
    own |= {"PYTHONPATH": str(folder / "packages"), "HOME": str(folder), **variables}
    result = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=own,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=True,
    )
    return result.stdout


def check(folder: Path) -> None:
    """Train, stop, resume, and compare what came. Raises Failed and CalledProcessError."""
    run(folder, "-m", "joybridge", *TRAIN, "stop_at=30000")
    run(folder, "-m", "joybridge", *TRAIN, "--resume")
    rows = read_rows(folder / "run" / "metrics-archer.csv")
    got = json.loads(run(folder, "-c", READ, MLFLOW_ALLOW_FILE_STORE="true").splitlines()[-1])
    if got["about"] != ["archer", str(0.99), "run-archer", "FINISHED"]:
        raise Failed(f"MLflow says {got['about']} of the run")
    for name in ("mlflow", "wandb"):
        if not alike(got[name], rows):
            raise Failed(
                f"{name} has {got[name]}, expected the rows {[(row['timesteps'], row['reward']) for row in rows]}"
            )
    variables = {"MLFLOW_TRACKING_URI": "http://127.0.0.1:1", "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0"}
    away = [word.replace("=60000", "=20000") if word != "run" else "away" for word in TRAIN]
    said = run(folder, "-m", "joybridge", *away, **variables)
    if "mlflow failed and gets no more rows" not in said or len(read_rows(folder / "away/metrics-archer.csv")) != 2:
        raise Failed(f"a server that does not answer: expected a warning and a whole run, got:\n{said}")


def alike(got: Sequence[Sequence[float]], rows: Sequence[Row]) -> bool:
    """Return whether what was got are the timesteps and rewards of rows, which files of metrics round."""
    wanted = [(row["timesteps"], row["reward"]) for row in rows]
    pairs = zip(got, wanted, strict=False)
    return len(got) == len(wanted) and all(
        a[0] == b[0] and abs(a[1] - b[1]) < 1e-4 * abs(b[1]) + 1e-6 for a, b in pairs
    )


if __name__ == "__main__":
    sys.exit(main())
