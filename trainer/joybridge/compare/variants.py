"""The variants of a comparison: configurations that differ in some keys, and what the folder knows of them."""

import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from google.protobuf.json_format import MessageToDict, ParseDict, ParseError

from joybridge.compare.environments import check_spaces, environment_of, is_registered
from joybridge.compare.names import SEED, file_name
from joybridge.config.config import MAY_CHANGE, Config, dump_config, load_config, make_config
from joybridge.config.config_files import find_config
from joybridge.config.differences import differences, in_words
from joybridge.config.errors import ConfigError
from joybridge.config.files import storing, write_atomically
from joybridge.config.overrides import split, split_values
from joybridge.contract.files import read_file
from joybridge.progress import say
from joybridge.run.folder import MAX_NAME_CHARS
from joybridge.v1 import bridge_pb2 as pb

NOT_VARIED = {"seed": "--seeds", "game": "a comparison for each game"}  # keys that do not vary, and what to use instead
FREE = {*MAY_CHANGE, "seed"} - {"log_interval"}  # keys that may change when a comparison is repeated
SEARCH = "search.journal"  # of Optuna, in the folder of a search
VARIANTS = "variants.json"
TRAINERS = {"sb3": "Stable-Baselines3"}  # others than ours, with their names for people
PACKAGES = {"sb3": "stable-baselines3"}
MAX_BYTES = 2**26  # of this file
# What a simulator may come to offer without another score: descriptions, and what else it can do with the same game.
OFFERS = {"description", "max_arenas", "picture", "snapshot_bytes_per_arena", "parameters_per_episode"}


@dataclass(frozen=True)
class Variant:
    """One of the compared configurations."""

    label: str  # what differs, for people: "bucket-11", or "hybrid, gamma=0.9"
    config: Config
    by: str = ""  # the trainer, "sb3"; "": ours

    @property
    def name(self) -> str:
        """Return the name of its files."""
        return file_name(self.label)


class Kept(NamedTuple):
    """What the folder of a comparison knows of a variant."""

    config: Config
    spec: pb.GameSpec  # of its game when the comparison began


def beside(variants: Sequence[Variant], trainer: str, given: Sequence[str] = ()) -> list[Variant]:
    """Return the same variants, trained by another trainer. given: games of the command line.

    Raises ConfigError if it is not installed, and for a game that it cannot train.
    """
    if find_spec(PACKAGES[trainer].replace("-", "_")) is None:
        raise ConfigError(f"--beside {trainer} needs {TRAINERS[trainer]}: `pip install {PACKAGES[trainer]}`")
    for variant in variants:
        if not is_registered(environment_of(variant.config.game, given)):
            raise ConfigError(
                f"--beside {trainer} trains environments of Gymnasium, as in --gym CartPole-v1, and there is none "
                f"called {variant.config.game!r}; to train this game with {TRAINERS[trainer]}, write a program with "
                "joybridge.gym.sb3.BridgeVecEnv, as in docs/gymnasium.md"
            )
        check_spaces(environment_of(variant.config.game, given))
    say(f"loading {TRAINERS[trainer]}, which takes some seconds")
    from joybridge.compare.sb3 import check_config  # it imports the other trainer, and other errors come sooner

    for variant in variants:
        check_config(variant.config)
    return [Variant(f"{variant.label}, {TRAINERS[trainer]}", variant.config, trainer) for variant in variants]


def read_values(text: str, option: str = "--set") -> tuple[str, list[str]]:
    """Return what "policy.gamma=0.9,0.99" means; commas in brackets do not separate values. Raises ConfigError.

    option: of the command line, which errors name.
    """
    key, equals, rest = text.partition("=")
    values = split_values(rest)
    if not key or not equals or not all(values):
        raise ConfigError(f"{option} got {text!r}, expected KEY=VALUE,VALUE,… as in policy.gamma=0.9,0.99")
    if key in NOT_VARIED:
        raise ConfigError(f"{option} {key}=…: {key} does not vary here; use {NOT_VARIED[key]}")
    if len(set(values)) < len(values):
        raise ConfigError(f"{option} got {text!r}, which names a value twice; name each value once")
    return key, values


class Change(NamedTuple):
    """Keys that are set together, beside the configuration as it is."""

    name: str  # of the variant; "": it is called after its keys
    pairs: list[tuple[str, str]]


def read_change(text: str) -> Change:
    """Return what a change says: KEY=VALUE, with spaces between several, and "NAME: " before them or not.

    Spaces in brackets and in double quotes do not separate keys. Raises ConfigError.
    """
    if re.match(r"[^=\s]+:\S", text.partition("=")[0]):
        raise ConfigError(f"--change got {text!r}; a name needs a space behind its colon, as in 'far: arenas=2'")
    name, keys = named.groups() if (named := re.fullmatch(r"\s*([^=:]+?)\s*:\s+(.*)", text)) else ("", text)
    pairs = [read_values(part, "--change") for part in split(keys, " ") if part]
    if not pairs or any(len(values) > 1 for _, values in pairs):
        raise ConfigError(
            f"--change got {text!r}, expected KEY=VALUE, or several that are set together, as in "
            "'policy.gamma=0.9 policy.epochs=8', or with a name, as in 'far: policy.gamma=0.999'; write a change for "
            "each value"
        )
    return Change(name, [(key, value) for key, (value,) in pairs])


def make_variants(
    configs: Sequence[str],
    overrides: Sequence[str],
    grid: Sequence[tuple[str, Sequence[str]]],
    changes: Sequence[Change] = (),
) -> list[Variant]:
    """Return a variant for each configuration and combination of values, unchanged and with each change alone.

    configs: files or names of installed configurations, all of one game. overrides: what all variants share, KEY=VALUE
    each. grid: keys and their values. Raises ConfigError.
    """
    shared = {override.partition("=")[0] for override in overrides}
    varied = {key for key, _ in grid}
    if twice := sorted({key for change in changes for key, _ in change.pairs} & (shared | varied)):
        raise ConfigError(f"--change {twice[0]}=…: {twice[0]} is set twice; set it once")
    for index, (key, _) in enumerate(grid):
        if key in shared or key in dict(grid[:index]):
            raise ConfigError(f"{key} is set twice; set it once, with all of its values")
    if "seed" in shared:
        raise ConfigError("seed=…: use --seeds for the number of seeds, and --first-seed for the first of them")
    paths, variants = [find_config(config) for config in configs], []
    combinations = itertools.product(*(values for _, values in grid))
    labeled = zip(paths, _labels(paths), strict=True)
    for (path, label), values, change in itertools.product(labeled, combinations, [Change("", []), *changes]):
        pairs = [(key, value) for (key, _), value in zip(grid, values, strict=True)]
        made = load_config(path, [*overrides, *(f"{key}={value}" for key, value in (*pairs, *change.pairs))])
        said = pairs if change.name else [*pairs, *change.pairs]
        parts = [label] if len(paths) > 1 else []
        parts += [value if key == "layout" else f"{key.removeprefix('policy.')}={value}" for key, value in said]
        parts += [change.name] if change.name else []
        variants.append(Variant(", ".join(parts) or ("unchanged" if changes else made.layout), made))
    if len(games := {variant.config.game for variant in variants}) > 1:
        raise ConfigError(f"the configurations are of {' and '.join(sorted(games))}; compare those of one game")
    for one, other in itertools.combinations(variants, 2):
        if one.config == other.config or one.name == other.name:
            what = "the same configuration" if one.config == other.config else "files of the same name"
            raise ConfigError(f"{one.label!r} and {other.label!r} have {what}; leave one of them out")
    for variant in variants:
        if len(variant.name) > MAX_NAME_CHARS or SEED.search(variant.name):
            raise ConfigError(f"{variant.label!r} cannot name files; put its values into a configuration instead")
    return variants


def pairs_to_test(variants: Sequence[Variant], keys: Sequence[str]) -> list[tuple[str, str]]:
    """Return the labels of the pairs of variants that differ in one of these keys alone; without keys, of all pairs.

    Raises ConfigError for a key in which no pair differs alone.
    """
    pairs = list(itertools.combinations(variants, 2))
    if not keys:
        return [(one.label, other.label) for one, other in pairs]
    differing = [_differing(one, other) for one, other in pairs]
    found = {
        key: [at for at, changed in enumerate(differing) if all(f"{name}.".startswith(f"{key}.") for name in changed)]
        for key in keys
    }
    if unknown := [key for key, places in found.items() if not places]:
        known = sorted({name for changed in differing for name in changed})
        raise ConfigError(
            f"--pairs {unknown[0]}: no two variants differ in it alone; variants differ in {', '.join(known)}"
        )
    chosen = sorted({at for places in found.values() for at in places})
    return [(pairs[at][0].label, pairs[at][1].label) for at in chosen]


def _differing(one: Variant, other: Variant) -> list[str]:
    """Return the keys in which two variants differ; "beside" for the trainer."""
    before, now = (variant.config.model_dump(mode="json") for variant in (one, other))
    return [key for key, *_ in differences(before, now)] + ["beside"] * (one.by != other.by)


def _labels(paths: Sequence[Path]) -> list[str]:
    """Return what configurations are called: as their files, after folders where these have the same name."""
    whole = [path.resolve().with_suffix("").parts for path in paths]
    names = []
    for parts in whole:
        others = {other for other in whole if other != parts}
        lengths = range(1, len(parts) + 1)
        length = next(n for n in lengths if all(other[-n:] != parts[-n:] for other in others))
        names.append("/".join(parts[-length:]))
    return names


def check_unchanged(variant: Variant, folder: Path) -> None:
    """Raise ConfigError if the folder of a comparison holds another configuration of this name."""
    kept = read_variants(folder).get(variant.name)
    if kept is not None:
        before, now = kept.config.model_dump(), variant.config.model_dump()
        changed = [each for each in differences(before, now) if each[0].partition(".")[0] not in FREE]
        if changed:
            raise ConfigError(
                f"{folder} holds another comparison: of {variant.label!r}, {in_words(changed)}; repeat the command as "
                "it was, or name another folder with --output"
            )


def check_game(variant: Variant, spec: pb.GameSpec, folder: Path) -> None:
    """Raise ConfigError if the game of a variant was another when the comparison began."""
    before = kept_spec(variant, folder)
    if before is not None:
        was, now = _rules(before), _rules(spec)
        now["options"] = {name: value for name, value in now["options"].items() if name in was["options"]}
        changed = list(differences(was, now))
        if changed:
            raise ConfigError(
                f"the game {spec.name} has changed since {folder} was begun: of {variant.label!r}, "
                f"{in_words(changed)}; bring the former game back, or name another folder with --output"
            )


def kept_spec(variant: Variant, folder: Path) -> pb.GameSpec | None:
    """Return the spec of a variant's game when the comparison began; None if it begins now. Raises ConfigError."""
    kept = read_variants(folder).get(variant.name)
    return kept and kept.spec


def read_variants(folder: Path) -> dict[str, Kept]:
    """Return what the folder knows of its variants, by name; nothing in a new folder. Raises ConfigError."""
    path = folder / VARIANTS
    try:
        data = json.loads(read_file(path, MAX_BYTES))
        return {
            name: Kept(make_config(each["config"]), ParseDict(each["spec"], pb.GameSpec()))
            for name, each in data.items()
        }
    except FileNotFoundError:
        return {}
    except NotADirectoryError as error:
        raise ConfigError(f"{folder} is, or is in, a file; name another folder with --output") from error
    except (OSError, ValueError, ParseError, ConfigError, AttributeError, KeyError, TypeError) as error:
        raise ConfigError(f"{path} cannot be read ({error}); delete it, and repeat the command") from error


def keep(variants: Sequence[Variant], specs: Sequence[pb.GameSpec], folder: Path) -> None:
    """Write the configurations of variants, and the specs of their games, into the folder. Raises StorageError.

    The folder `configs` has each configuration as a file of its own, for the trainers.
    """
    kept = read_variants(folder)
    for variant, spec in zip(variants, specs, strict=True):
        kept[variant.name] = Kept(variant.config, spec)
        path = config_path(folder, variant.name)
        with storing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, dump_config(variant.config).encode())
    lines = [
        f"{json.dumps(name)}: {json.dumps({'config': each.config.model_dump(), 'spec': _as_dict(each.spec)})}"
        for name, each in sorted(kept.items())
    ]
    write_atomically(folder / VARIANTS, ("{\n" + ",\n".join(lines) + "\n}\n").encode())


def config_path(folder: Path, name: str) -> Path:
    """Return the file of a variant's configuration."""
    return folder / "configs" / f"{name}.yaml"


def _as_dict(spec: pb.GameSpec) -> dict[str, Any]:
    """Return a spec as plain data."""
    return MessageToDict(spec, preserving_proto_field_name=True)


def _rules(spec: pb.GameSpec) -> dict[str, Any]:
    """Return a spec as plain data, without what changes no score. Of its options, only the defaults decide."""
    defaults = {option.name: option.default_choice for option in spec.options}
    return {**_without_offers(_as_dict(spec)), "options": defaults}


def _without_offers(value: Any) -> Any:
    """Return plain data without the keys of OFFERS, at any depth."""
    if isinstance(value, dict):
        return {key: _without_offers(each) for key, each in value.items() if key not in OFFERS}
    return [_without_offers(each) for each in value] if isinstance(value, list) else value
