"""Datasets of Minari as demonstrations. A dataset is of one behavior, and each of its episodes is one of an agent."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from joybridge.client.recording import RecordingError
from joybridge.config.errors import ConfigError
from joybridge.contract.files import BLOCK_BYTES, read_file
from joybridge.contract.tensors import Array, TensorError
from joybridge.contract.text import printable
from joybridge.demonstrations.episodes import Episode, check_episode, join_episodes
from joybridge.demonstrations.formats import Format
from joybridge.demonstrations.recorded import Demonstration
from joybridge.v1 import bridge_pb2 as pb

DATA = "main_data.hdf5"  # beside it is METADATA; the folder of both is `data`, in a folder with the name of the dataset
METADATA = "metadata.json"
MAX_METADATA_BYTES = 2**26
MAX_ARRAYS_BYTES = 2**29  # of all arrays together, in memory
MAX_GROWTH = 1000  # bytes in memory for each in the file
MAX_DEPTH = 3  # folders between the one that is named and a dataset, as in NAMESPACE/GAME/NAME-v0
OURS = "joybridge"  # the key of the metadata that an export adds: names of the game and of the behavior


def load_minari(path: Path, spec: pb.GameSpec) -> Demonstration:
    """Return what a dataset holds. path: its file DATA.

    Raises RecordingError unless it fits a behavior of this spec, and ConfigError if Minari is not installed.
    """
    try:
        import h5py  # noqa: F401

        import minari  # noqa: F401
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{path} needs the module {error.name}; install it with `pip install 'joybridge[minari]'`"
        ) from None
    try:
        metadata = json.loads(read_file(path.parent / METADATA, MAX_METADATA_BYTES))
        index = _behavior(path, metadata, spec)
        if metadata["data_format"] != "hdf5":
            raise RecordingError(f"{path.parent} has the format {metadata['data_format']!r}, expected hdf5; convert it")
        for key in ("observation_space", "action_space"):
            if not isinstance(metadata.get(key), str):  # Minari would make the environment to learn its spaces
                raise RecordingError(f"{path.parent} names no {key}; record it again with Minari 0.5 or newer")
        _check_arrays(path)
        episodes = list(_episodes(path, spec.behaviors[index]))
    except RecordingError:
        raise
    except Exception as error:  # whatever libraries raise at a file that is damaged
        reason = f"{type(error).__name__}: {printable(str(error))}"
        raise RecordingError(
            f"{path.parent} is no dataset of Minari that can be read ({reason}); restore it from a copy, or take it "
            "out of the folder"
        ) from error
    return Demonstration(path, spec, list(join_episodes(episodes, spec, index)), 0)


def _behavior(path: Path, metadata: Mapping[str, Any], spec: pb.GameSpec) -> int:
    """Return the number of the behavior that a dataset is of. Raises RecordingError."""
    made = metadata.get(OURS, {})
    if made and made["game"] != spec.name:
        came = printable(str(made["game"]))
        raise RecordingError(f"{path.parent} is of the game {came}, expected {spec.name}; name another folder")
    names = [behavior.name for behavior in spec.behaviors]
    if len(names) == 1:
        return 0
    name = made["behavior"] if made else str(metadata["dataset_id"]).rpartition("/")[2].rpartition("-v")[0]
    if name not in names:
        raise RecordingError(
            f"{path.parent} is a dataset of {printable(str(name))}, expected one of the behaviors {', '.join(names)}; "
            f"give it an ID such as {spec.name}/{names[0]}-v0"
        )
    return names.index(name)


def _check_arrays(path: Path) -> None:
    """Raise ValueError unless all arrays are in the file itself, and not too large, alone or together."""
    import h5py

    found: list[tuple[str, Any]] = []
    size = 0
    with h5py.File(path, "r") as file:
        file.visititems_links(lambda name, link: found.append((name, link)))
        for name, link in found:
            one = file[name] if isinstance(link, h5py.HardLink) else None
            if one is None or (isinstance(one, h5py.Dataset) and (one.is_virtual or one.external)):
                raise ValueError(f"{name} is a link")
            if isinstance(one, h5py.Dataset):
                size += one.nbytes
                if one.nbytes > MAX_GROWTH * max(one.id.get_storage_size(), BLOCK_BYTES):
                    raise ValueError(f"{name} has {one.nbytes:,} bytes, almost none of which are in the file")
    if size > MAX_ARRAYS_BYTES:
        raise ValueError(f"{size:,} bytes of arrays, expected at most {MAX_ARRAYS_BYTES:,}; split the dataset")


def _episodes(path: Path, behavior: pb.Behavior) -> Iterator[Episode]:
    """Yield the episodes of a dataset. Raises RecordingError."""
    from joybridge.minari.spaces import MASK, Unfit, act_reader, mask_reader, sensor_readers
    from minari.dataset.minari_storage import MinariStorage

    storage = MinariStorage.read(path.parent)
    try:
        sensors = sensor_readers(storage.observation_space, behavior)
        act = act_reader(storage.action_space, behavior.device)
    except Unfit as error:
        raise RecordingError(f"{path.parent} does not fit {behavior.name}: {error}") from None
    masks = mask_reader(behavior.device)
    for number, data in enumerate(storage.get_episodes(range(storage.total_episodes))):
        try:
            seen, infos = data["observations"], data["infos"] or {}
            ends = np.array([data["terminations"], data["truncations"]]).astype(bool)
            rows = ends.shape[1] + 1
            given = infos.get(MASK, seen.get(MASK) if isinstance(seen, Mapping) else None)
            if ends[:, :-1].any():
                raise ValueError("it ends before its last decision")
            episode = Episode(
                [read(seen) for read in sensors],
                act(data["actions"]),
                _rewards(data["rewards"], infos.get("rewards"), behavior),
                bool(ends[0, -1]),
                bool(ends[1, -1] and not ends[0, -1]),
                masks(given, rows),
                _flags(infos, "deciding", rows),
                _flags(infos, "demonstrated", rows)[:-1],
            )
            check_episode(episode, behavior)
        except (TensorError, ValueError, IndexError, KeyError, TypeError) as error:
            raise RecordingError(f"{path.parent}, episode {number}: {error}; leave it out, or record again") from error
        yield episode


def _flags(infos: Mapping[str, Any], name: str, rows: int) -> Array:
    """Return a flag of the infos of an episode, bool [rows], true where it is not given. Raises ValueError."""
    flags = np.asarray(infos.get(name, np.ones(rows, bool)))
    if flags.shape != (rows,):
        raise ValueError(f"{name} is {list(flags.shape)}, expected {[rows]}")
    return flags.astype(bool)


def _rewards(rewards: Any, by_channel: Any, behavior: pb.Behavior) -> Array:
    """Return the rewards of an episode, float32 [decisions, channels]; 0 for channels that are not told apart."""
    paid = np.zeros((len(rewards), len(behavior.channels)), np.float32)
    if isinstance(by_channel, Mapping):
        for column, channel in enumerate(behavior.channels):
            if channel.name in by_channel:
                paid[:, column] = by_channel[channel.name][1:]
    elif len(behavior.channels) == 1:
        paid[:, 0] = rewards
    return paid


def _find(path: Path) -> Path | None:
    """Return the file of a dataset that is at a path, or in the folder there."""
    if path.name == DATA:
        return path
    return next((place for place in (path / DATA, path / "data" / DATA) if place.exists()), None)


FORMAT = Format(
    kind="a dataset of Minari",
    patterns=(DATA, *(f"{'*/' * depth}data/{DATA}" for depth in range(MAX_DEPTH + 1))),
    find=_find,
    load=load_minari,
)
