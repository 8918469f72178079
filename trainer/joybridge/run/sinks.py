"""Where rows of metrics go besides the CSV files of a run: TensorBoard, Weights & Biases and MLflow.

None of them needs a network: without a login and without MLFLOW_TRACKING_URI, all files are in the folder of the run. A
sink that fails while a run goes on is given up with a warning, and the run goes on; the CSV files have everything.
"""

import logging
import os
import re
import secrets
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from netrc import NetrcParseError, netrc
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError, StorageError
from joybridge.config.files import storing, write_atomically
from joybridge.config.metrics import Row, metrics_name
from joybridge.contract.files import read_file

log = logging.getLogger("joybridge.trainer")

_UNNAMEABLE = re.compile(r"[^\w\-. :/]", re.ASCII)  # what MLflow takes in no name, as the brackets of "action[0]"

PACKAGES = {"tensorboard": "tensorboard", "wandb": "wandb", "mlflow": "mlflow"}


class Sink(Protocol):
    """Takes the rows of one policy."""

    def write(self, timesteps: int, row: Row) -> None:
        """Take a row of metrics."""

    def close(self) -> None:
        """Finish."""


class TensorBoard:
    """Event files in the folder `tensorboard` of a run."""

    def __init__(self, run: Path, policy: str, after: int, config: Config) -> None:
        """Begin, or continue after so many timesteps. Raises StorageError."""
        from torch.utils.tensorboard import SummaryWriter  # takes seconds to load

        self._folder = run / "tensorboard"
        with storing(self._folder):
            self._board = SummaryWriter(self._folder / metrics_name(policy), purge_step=after + 1)

    def write(self, timesteps: int, row: Row) -> None:
        """Take a row of metrics. Raises StorageError."""
        with storing(self._folder):
            for name, value in row.items():
                self._board.add_scalar(name, value, timesteps)
            self._board.flush()

    def close(self) -> None:
        """Finish the file."""
        self._board.close()


class WeightsAndBiases:
    """A run of Weights & Biases for each policy, in one group; in the folder `wandb` unless there is a login.

    Without a login, a training that goes on is another run of the group.
    """

    def __init__(self, run: Path, policy: str, after: int, config: Config) -> None:
        """Begin, or continue the run whose name is noted in the folder."""
        import wandb

        mode = os.environ.get("WANDB_MODE") or ("online" if _has_login() else "offline")
        note = run / f"wandb-{metrics_name(policy)}"  # as the run of MLflow is noted
        # Offline, each training is a run of its own: `wandb sync` would replace the first part by one of the same name.
        goes_on = after and note.exists() and mode != "offline"
        name = read_file(note, 1000).decode() if goes_on else secrets.token_hex(8)
        write_atomically(note, name.encode())
        self._run: Any = wandb.init(
            project=os.environ.get("WANDB_PROJECT", "joybridge"),
            group=run.name,
            name=f"{run.name}-{policy}",
            id=name,
            dir=run,
            mode=mode,
            resume=None if mode == "offline" else "allow",
            reinit="create_new",
            config=config.model_dump(),
            settings=wandb.Settings(console="off", silent=True),
        )

    def write(self, timesteps: int, row: Row) -> None:
        """Take a row of metrics."""
        self._run.log(row, step=timesteps)

    def close(self) -> None:
        """Finish the run."""
        self._run.finish()


def _has_login() -> bool:
    """Return whether Weights & Biases knows the user, by the variable or by the file that its login writes."""
    host = urlsplit(os.environ.get("WANDB_BASE_URL", "https://api.wandb.ai")).hostname
    try:
        noted = netrc(os.environ.get("NETRC")).authenticators(host or "")
    except (OSError, NetrcParseError):
        noted = None
    return bool(os.environ.get("WANDB_API_KEY") or noted)


class MLflow:
    """A run of MLflow for each policy, in the store of MLFLOW_TRACKING_URI, or in the folder `mlruns` of the run."""

    def __init__(self, run: Path, policy: str, after: int, config: Config) -> None:
        """Begin, or continue the run whose name is noted in the folder."""
        from mlflow import MlflowClient

        uri = os.environ.get("MLFLOW_TRACKING_URI") or (run / "mlruns").resolve().as_uri()
        if uri.startswith("file:"):
            os.environ.setdefault("MLFLOW_ALLOW_FILE_STORE", "true")  # it prefers a database, which needs more packages
        self._client: Any = MlflowClient(tracking_uri=uri)
        note = run / f"mlflow-{metrics_name(policy)}"
        if after and note.exists():
            self._id = read_file(note, 1000).decode()
            return
        name = os.environ.get("MLFLOW_EXPERIMENT_NAME", "joybridge")
        found = self._client.get_experiment_by_name(name)
        experiment = found.experiment_id if found else self._client.create_experiment(name)
        self._id = self._client.create_run(experiment, run_name=f"{run.name}-{policy}").info.run_id
        for key, value in config.model_dump(exclude={"policies", "policy"}).items():
            self._client.log_param(self._id, key, value)
        for key, value in config.policy_config(policy).model_dump().items():
            self._client.log_param(self._id, f"policy.{key}", value)
        write_atomically(note, self._id.encode())

    def write(self, timesteps: int, row: Row) -> None:
        """Take a row of metrics."""
        for name, value in row.items():
            self._client.log_metric(self._id, _UNNAMEABLE.sub("_", name), value, step=timesteps)

    def close(self) -> None:
        """Finish the run."""
        self._client.set_terminated(self._id)


SINKS: dict[str, Callable[[Path, str, int, Config], Sink]] = {
    "tensorboard": TensorBoard,
    "wandb": WeightsAndBiases,
    "mlflow": MLflow,
}


def check_sinks(names: Sequence[str]) -> None:
    """Raise ConfigError for a sink whose package is not installed."""
    for name in names:
        if find_spec(PACKAGES[name]) is None:
            raise ConfigError(f"log_to: {name} is not installed; install it with `pip install 'joybridge[{name}]'`")


class Sinks:
    """All sinks of one policy."""

    def __init__(self, run: Path, policy: str, after: int, config: Config) -> None:
        """Begin, or continue after so many timesteps. Raises StorageError."""
        self._open: dict[str, Sink] = {}
        for name in config.log_to:
            try:
                self._open[name] = SINKS[name](run, policy, after, config)
            except Exception as error:
                self._fail(name, error)

    def write(self, timesteps: int, row: Row) -> None:
        """Give all a row of metrics. Raises StorageError."""
        self._each(lambda sink: sink.write(timesteps, row))

    def close(self) -> None:
        """Finish all."""
        self._each(lambda sink: sink.close())

    def _each(self, tell: Callable[[Sink], None]) -> None:
        for name, sink in list(self._open.items()):
            try:
                tell(sink)
            except Exception as error:
                del self._open[name]
                self._fail(name, error)

    def _fail(self, name: str, error: Exception) -> None:
        """Warn of a sink that fails; a disk that is full is an error of the run."""
        if isinstance(error, StorageError):
            raise error
        reason = str(error).partition("\n")[0]
        log.warning("log_to: %s failed and gets no more rows (%s: %s)", name, type(error).__name__, reason)
