"""`joybridge minari`: write demonstrations as datasets of Minari, one for each behavior. Needs no torch."""

import argparse
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from joybridge.client.demonstration_log import SUFFIX
from joybridge.client.run_command import run_command
from joybridge.config.errors import ConfigError, StorageError
from joybridge.config.files import storing
from joybridge.contract.argument_types import command_parser
from joybridge.demonstrations.episodes import Episode, finished_episodes
from joybridge.demonstrations.recorded import load_recorded
from joybridge.minari.reading import OURS
from joybridge.v1 import bridge_pb2 as pb

if TYPE_CHECKING:
    from minari.data_collector import EpisodeBuffer

MINARI_CHARACTERS = re.compile(r"[^-\w]")


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status."""
    parser, minari = command_parser(
        prog,
        "minari",
        "Write demonstrations as datasets of Minari, GAME/BEHAVIOR-v0 for each behavior.",
    )
    minari.add_argument("demos", type=Path, help=f"a folder with demonstrations, files *{SUFFIX}")
    minari.add_argument(
        "output", type=Path, help="the folder of the datasets; Minari finds it by the variable MINARI_DATASETS_PATH"
    )
    return run_command(_export, parser.parse_args(arguments))


def _export(options: argparse.Namespace) -> None:
    for line in export(options.demos, options.output):
        print(line)


def export(demos: Path, output: Path) -> Iterator[str]:
    """Write the finished episodes of all files in a folder as datasets; yield what is written and what is left out.

    Raises ConfigError, RecordingError and StorageError.
    """
    import minari  # noqa: F401 - what is missing is said before files are read

    files = sorted(demos.glob(f"*{SUFFIX}"))
    if not files:
        raise ConfigError(f"{demos} holds no file *{SUFFIX}; record some with `joybridge play GAME --demos {demos}`")
    shown = [load_recorded(files[0], None)]
    shown += [load_recorded(file, shown[0].spec) for file in files[1:]]
    yield from filter(None, (demonstration.remark() for demonstration in shown))
    spec = shown[0].spec
    names = {one.name: f"{_name(spec.name)}/{_name(one.name)}-v0" for one in spec.behaviors}
    for behavior in spec.behaviors:
        _check_names(behavior)
        if (output / names[behavior.name]).exists():
            raise StorageError(f"{output / names[behavior.name]} is there already; name another folder, or delete it")
    written = 0
    for index, behavior in enumerate(spec.behaviors):
        found = [one for part in shown for stretch in part.stretches for one in finished_episodes(stretch, index)]
        found = [one for one in found if one.demonstrated.any()]
        if found:
            _write(output, names[behavior.name], spec.name, behavior, found)
            yield f"{output / names[behavior.name]}: {len(found):,} episodes, {sum(map(len, found)):,} decisions"
            written += 1
    if not written:
        raise ConfigError(f"{demos} holds no decision of a finished episode; nothing is written")


def _write(output: Path, name: str, game: str, behavior: pb.Behavior, episodes: Sequence[Episode]) -> None:
    """Write one dataset, which is there as a whole or not at all. Raises StorageError."""
    from joybridge.policy.observation_space import make_observation_space
    from minari import __version__
    from minari.dataset.minari_storage import MinariStorage

    target = (output / name).absolute()  # Minari measures the files of a relative path wrongly
    with storing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".", dir=target.parent) as folder:
            whole = Path(folder) / "dataset"
            whole.mkdir()
            storage = MinariStorage.new(
                whole / "data",
                make_observation_space(behavior.sensors, 1, flatten=False),
                _action_space(behavior.device),
                jpeg_encoding=False,
            )
            storage.update_metadata(
                {
                    "dataset_id": name,
                    "minari_version": __version__,
                    OURS: {"game": game, "behavior": behavior.name},
                    "description": f"Demonstrations of {behavior.name} in the game {game}, recorded by Joybridge.",
                }
            )
            storage.update_episodes(_buffers(behavior, episodes))
            storage.update_episode_metadata(_metrics(behavior, episodes))
            whole.rename(target)


def _action_space(device: pb.Device) -> Any:
    """Return the space of what the device is given: a Box, a MultiDiscrete or both, in a Dict."""
    from gymnasium.spaces import Box, Dict, MultiDiscrete

    low, high = (np.array([getattr(axis, bound) for axis in device.axes], np.float32) for bound in ("low", "high"))
    both = {}
    if device.axes:
        both["continuous"] = Box(low, high, dtype=np.float32)
    if device.branches:
        both["discrete"] = MultiDiscrete([len(branch.choices) for branch in device.branches])
    return Dict(both) if len(both) > 1 else next(iter(both.values()))


def _buffers(behavior: pb.Behavior, episodes: Iterable[Episode]) -> "Iterator[EpisodeBuffer]":
    """Yield episodes as Minari stores them."""
    from minari.data_collector import EpisodeBuffer

    weights = np.array([channel.default_weight for channel in behavior.channels], np.float32)
    for one in episodes:
        actions = {"continuous": one.act.axes, "discrete": one.act.choices.astype(np.int64)}
        used = [values for values in actions.values() if values.shape[1]]
        infos: dict[str, Any] = {"deciding": one.deciding, "demonstrated": np.append(one.demonstrated, True)}
        if one.masks is not None:
            infos["action_mask"] = np.concatenate(one.masks, axis=1)
        infos["rewards"] = {
            channel.name: np.append(np.float32(0), one.rewards[:, column])
            for column, channel in enumerate(behavior.channels)
        }
        ends = np.arange(len(one)) == len(one) - 1
        yield EpisodeBuffer(
            observations={sensor.name: seen for sensor, seen in zip(behavior.sensors, one.observations, strict=True)},
            actions=actions if len(used) > 1 else used[0],
            rewards=one.rewards @ weights,
            terminations=ends & one.terminated,
            truncations=ends & one.truncated,
            infos=infos,
        )


def _metrics(behavior: pb.Behavior, episodes: Iterable[Episode]) -> Iterator[dict[str, float]]:
    for one in episodes:
        values = [] if one.metrics is None else one.metrics.tolist()
        yield {f"metrics/{metric.name}": value for metric, value in zip(behavior.metrics, values, strict=False)}


def _name(text: str) -> str:
    return MINARI_CHARACTERS.sub("_", text)


def _check_names(behavior: pb.Behavior) -> None:
    """Raise ConfigError for a name that divides names in an HDF5 file."""
    for name in (*(one.name for one in behavior.sensors), *(one.name for one in behavior.channels)):
        if "/" in name or name == ".":
            raise ConfigError(f"{behavior.name}: {name!r} cannot be a name in a dataset; rename it in the game")
