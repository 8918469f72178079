"""A configuration of ML-Agents as one of ours: `joybridge train their.yaml --behavior NAME game=GAME`.

Every key of ML-Agents 1.1.0 for PPO is in BEHAVIOR or RUN. Its value becomes that of a key of ours, or it is refused
with what to do instead, unless it is the one value that Joybridge plays by. A key that the file leaves out has the
default of ML-Agents.
"""

from collections.abc import Iterator, Mapping
from math import ceil
from typing import Any, NamedTuple

from joybridge.config.config_files import merge
from joybridge.config.errors import ConfigError
from joybridge.mlagents_player.environment_parameters import settings

MOST, MAX_LAYERS = 10**9, 1000  # of numbers
ARENAS = 75  # where the file does not say


class Key(NamedTuple):
    """What becomes of a key of ML-Agents."""

    default: Any  # there
    ours: str = ""  # our key; "": there is none
    instead: str = ""  # without a key of ours: why other values than the default are refused, and what to do


BEHAVIOR = {
    "trainer_type": Key("ppo", instead="Joybridge has PPO only"),
    "max_steps": Key(500_000, "total_timesteps"),
    "time_horizon": Key(64, "policy.time_horizon"),
    "summary_freq": Key(50_000, "log_interval"),
    "checkpoint_interval": Key(500_000, "checkpoint_interval"),
    "even_checkpoints": Key(False, instead="set checkpoint_interval"),
    "keep_checkpoints": Key(5, "keep_checkpoints"),
    "init_path": Key(None, instead="checkpoints of ML-Agents cannot be read; use --from with a run of Joybridge"),
    "threaded": Key(False, instead="leave it out; pipeline_groups=2, the default, collects while policies decide"),
    "hyperparameters.batch_size": Key(1024, "policy.minibatch_size"),
    "hyperparameters.buffer_size": Key(10_240, "policy.rollout_steps"),
    "hyperparameters.learning_rate": Key(3e-4, "policy.learning_rate"),
    "hyperparameters.learning_rate_schedule": Key("linear", "policy.learning_rate_schedule"),
    "hyperparameters.beta": Key(5e-3, "policy.entropy_coef"),
    "hyperparameters.beta_schedule": Key(None, "policy.entropy_coef_schedule"),
    "hyperparameters.epsilon": Key(0.2, "policy.clip_range"),
    "hyperparameters.epsilon_schedule": Key(None, "policy.clip_range_schedule"),
    "hyperparameters.lambd": Key(0.95, "policy.gae_lambda"),
    "hyperparameters.num_epoch": Key(3, "policy.epochs"),
    "hyperparameters.shared_critic": Key(False, "policy.shared_body"),
    "network_settings.normalize": Key(False, "policy.scale_observations"),
    "network_settings.hidden_units": Key(128, "policy.hidden_sizes"),
    "network_settings.num_layers": Key(2, "policy.hidden_sizes"),
    "network_settings.vis_encode_type": Key(None, "policy.image_encoder"),
    "network_settings.memory.memory_size": Key(None, "policy.memory.size"),
    "network_settings.memory.sequence_length": Key(None, "policy.memory.length"),
    "network_settings.goal_conditioning_type": Key("hyper", instead="a goal is a sensor as any other here"),
    "network_settings.deterministic": Key(False, instead="use `joybridge evaluate RUN --deterministic`"),
    "reward_signals.extrinsic.gamma": Key(0.99, "policy.gamma"),
    "reward_signals.extrinsic.strength": Key(1.0, instead="set policy.reward_weights, per reward channel"),
    "reward_signals.extrinsic.network_settings": Key(None, instead="the critic has the network of the policy"),
    "reward_signals": Key(None, instead="rewards are those of the game: there is no curiosity, GAIL or RND here"),
    "behavioral_cloning": Key(None, instead="put your files .demo into a folder, and add --demos DIR"),
    "self_play": Key(None, instead="use the key `opponents`, as in `opponents.shares.past=0.5`"),
}
VALUES: dict[str, dict[Any, str]] = {  # ours, where they have other names
    "network_settings.normalize": {False: "none", True: "running"},
    "network_settings.vis_encode_type": {None: "none", "simple": "simple", "nature_cnn": "nature", "resnet": "impala"},
}
REMEMBERED = ("network_settings.memory.memory_size", "network_settings.memory.sequence_length")
SCHEDULES = ("hyperparameters.beta_schedule", "hyperparameters.epsilon_schedule")  # by default that of learning_rate
MEMORY = {"memory_size": 128, "sequence_length": 64}  # defaults of a memory, which the file has to ask for
SIZES = ("network_settings.num_layers", "network_settings.hidden_units")
RUN = {
    "env_settings.num_areas": Key(1, "arenas"),
    "env_settings.num_envs": Key(1, "arenas"),
    "env_settings.seed": Key(-1, "seed"),
    "env_settings.max_lifetime_restarts": Key(10, "max_restarts"),
    "env_settings.timeout_wait": Key(60, instead="use --wait SECONDS"),
    "env_settings": Key(None, instead="use --unity BUILD"),
    "engine_settings": Key(None, instead="leave it out; a build has its own: --unity 'BUILD time_scale=20'"),
    "torch_settings.device": Key(None, "accelerator"),
    "checkpoint_settings.run_id": Key("ppo", instead="use --run DIR"),
    "checkpoint_settings.results_dir": Key("results", instead="use --run DIR"),
    "checkpoint_settings.resume": Key(False, instead="use --resume"),
    "checkpoint_settings.initialize_from": Key(None, instead="use --from RUN"),
    "checkpoint_settings.force": Key(False, instead="use another --run, or delete the folder"),
    "checkpoint_settings.inference": Key(False, instead="use `joybridge evaluate RUN`"),
    "debug": Key(False, instead="leave it out"),
}


def translate(data: Mapping[str, Any], behavior: str, arenas: Any) -> dict[str, Any]:
    """Return our configuration for the settings of one behavior, without the game. Raises ConfigError.

    arenas: what the command line sets, if it does. A buffer is that of all arenas, a rollout that of one lane.
    """
    data = dict(data)
    behaviors, shared = (_section(key, data.pop(key, None)) for key in ("behaviors", "default_settings"))
    if behavior not in behaviors and not shared:
        known = ", ".join(map(str, behaviors)) or "none"
        raise ConfigError(f"--behavior {behavior}: the file has no such behavior under `behaviors`; it has {known}")
    own = merge(shared, _section(f"behaviors.{behavior}", behaviors.get(behavior)))
    remembers = isinstance(network := own.get("network_settings"), Mapping) and network.get("memory") is not None
    if remembers:
        own = merge({"network_settings": {"memory": MEMORY}}, own)
    parameters = _section("environment_parameters", data.pop("environment_parameters", None))
    theirs = _read(own, BEHAVIOR, f"behaviors.{behavior}.")
    run = _read(data, RUN, "")
    areas = _number(run, "env_settings.num_areas") * _number(run, "env_settings.num_envs")
    if not isinstance(arenas, int) or arenas < 1:
        arenas = areas if areas > 1 else ARENAS
    ours: dict[str, Any] = {"arenas": arenas, **settings(parameters, behavior), "policy": {"frame_stack": 1}}
    simple = {key: _value(key, value) for key, value in theirs.items() if key not in (*SIZES, *REMEMBERED)}
    for key in SCHEDULES:
        simple[key] = simple[key] or simple["hyperparameters.learning_rate_schedule"]
    simple |= {key: run[key] for key in ("env_settings.seed", "torch_settings.device") if run[key] not in (-1, None)}
    simple["env_settings.max_lifetime_restarts"] = run["env_settings.max_lifetime_restarts"]
    simple["hyperparameters.buffer_size"] = ceil(_number(theirs, "hyperparameters.buffer_size") / arenas)
    for key, value in simple.items():
        ours = merge(ours, _nested((BEHAVIOR | RUN)[key].ours, value))
    if remembers:
        ours = merge(ours, {"policy": {"memory": _memory(*(_number(theirs, key) for key in REMEMBERED))}})
    layers, units = (_number(theirs, key) for key in SIZES)
    if layers > MAX_LAYERS:
        raise ConfigError(f"{SIZES[0]}: got {layers}, expected at most {MAX_LAYERS}")
    return merge(ours, _nested("policy.hidden_sizes", [units] * layers))


def table() -> Iterator[str]:
    """Yield the rows of a table of all keys, as Markdown."""
    yield "| ML-Agents | default there | Joybridge |"
    yield "|---|---|---|"
    for name, key in (BEHAVIOR | RUN).items():
        default = "–" if key.default is None else str(key.default).lower()
        ours = f"`{key.ours}`" if key.ours else f"other values are refused: {key.instead}"
        yield f"| `{name}` | {default} | {ours} |"


def _read(data: Any, keys: Mapping[str, Key], where: str) -> dict[str, Any]:
    """Return the values of all keys that have one of ours, defaults filled in. Raises ConfigError."""
    found = {name: key.default for name, key in keys.items() if key.ours}
    for name, value in _leaves(data, "", keys):
        known = next((prefix for prefix in _prefixes(name) if prefix in keys), None)
        if known is None:
            raise ConfigError(f"{where}{name}: got {value!r}; PPO of ML-Agents 1.1.0 has no such key; remove it")
        if keys[known].ours:
            found[name] = value
        elif known != name or value != keys[known].default:
            raise ConfigError(f"{where}{name}: got {value!r}; {keys[known].instead}")
    return found


def _leaves(data: Any, name: str, keys: Mapping[str, Key]) -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and their values; sections without content have none."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from _leaves(value, f"{name}.{key}" if name else str(key), keys)
    elif data is not None or name in keys:
        yield name, data


def _prefixes(name: str) -> Iterator[str]:
    while name:
        yield name
        name = name.rpartition(".")[0]


def _value(key: str, value: Any) -> Any:
    """Return what we call a value. Raises ConfigError for one that we do not have."""
    if key not in VALUES:
        return value
    if isinstance(value, list) or value not in VALUES[key]:
        raise ConfigError(f"{key}: got {value!r}, expected one of {', '.join(map(str, VALUES[key]))}")
    return VALUES[key][value]


def _memory(size: int, length: int) -> dict[str, Any]:
    """Return our memory. Half of their size is what an LSTM says, the other half its cells. Raises ConfigError."""
    if size % 2:
        raise ConfigError(f"{REMEMBERED[0]}: got {size}, expected an even number, as ML-Agents does")
    return {"kind": "lstm", "size": size // 2, "length": length}


def _section(name: str, value: Any) -> dict[str, Any]:
    """Return a section of the file, which may be left out. Raises ConfigError if it has no keys."""
    if value is not None and not isinstance(value, Mapping):
        raise ConfigError(f"{name}: got {value!r}, expected a section with keys")
    return dict(value or {})


def _nested(key: str, value: Any) -> dict[str, Any]:
    for part in reversed(key.split(".")):
        value = {part: value}
    return value  # type: ignore[no-any-return]


def _number(values: Mapping[str, Any], key: str) -> int:
    value = values[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1 <= value <= MOST or value != int(value):
        raise ConfigError(f"{key}: got {value!r}, expected a whole number from 1 to {MOST:,}")
    return int(value)
