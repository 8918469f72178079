"""The configuration of a run: every key with its default, checked; files hold only what differs.

A YAML file may name another one with `extends:`; mappings are merged, everything else is replaced.
"""

import difflib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from joybridge.trainer.checkpoint import has_checkpoint
from joybridge.trainer.errors import ConfigError
from joybridge.trainer.files import write_atomically

MAY_CHANGE = (
    "stop",
    "checkpoint_interval",
    "log_interval",
    "evaluate_over",
)  # in the middle of a run: nothing that is learned from

T = TypeVar("T", bound=BaseModel)


def _switch(value: Any) -> Any:
    """Return "on" and "off" for what YAML 1.1 makes of them."""
    return {True: "on", False: "off"}.get(value, value) if isinstance(value, bool) else value


Choice = Annotated[str, BeforeValidator(_switch)]


class _Checked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, coerce_numbers_to_str=True)


class PolicyConfig(_Checked):
    """What one policy senses, is paid by, and how it learns."""

    sensors: list[str] | None = Field(None, min_length=1)  # names of the sensors it sees; None: all
    reward_weights: dict[str, float] = {}  # reward channel -> weight; those left out have the game's default
    frame_stack: int = Field(3, ge=1)  # frames it sees at once, oldest first
    hidden_sizes: list[Annotated[int, Field(ge=1)]] = Field([100, 100], min_length=1)  # units per hidden layer
    shared_body: bool | None = None  # one body for actor and critic; None: only if there are no Gaussians
    rollout_steps: int = Field(59, ge=1)  # decisions per lane between two updates
    time_horizon: int = Field(59, ge=1)  # advantages are cut after so many decisions
    minibatch_size: int = Field(256, ge=1)
    epochs: int = Field(4, ge=1)
    learning_rate: float = Field(3.25e-4, gt=0)
    entropy_coef: float = Field(0.05, ge=0)  # coefficient of the entropy bonus
    clip_range: float = Field(0.2, gt=0, lt=1)
    gamma: float = Field(0.99, ge=0, le=1)
    gae_lambda: float = Field(0.95, ge=0, le=1)
    autograd: bool = False  # take gradients from autograd, the reference, not from their closed form


class Config(_Checked):
    """A whole run."""

    game: str
    options: dict[str, Choice] = {}  # option -> choice
    parameters: dict[str, float] = {}  # parameter -> value
    layout: str = "hybrid"  # how policies map to the device; see trainer/actions.py
    arenas: int = Field(75, ge=1)
    groups: int = Field(2, ge=1)  # parts of the arenas that take turns: one is played while others are decided for
    accelerator: Literal["cpu", "cuda"] = "cpu"  # where networks live; small ones are faster on the processor
    seed: int = Field(0, ge=0, lt=2**64)
    total_timesteps: int = Field(30_000_000, ge=1)  # length of the run, and of its schedules
    stop: int | None = Field(None, ge=1)  # end earlier, after so many timesteps, with the schedules unchanged
    log_interval: int = Field(300_000, ge=1)  # timesteps between two rows of metrics
    checkpoint_interval: int = Field(1_000_000, ge=1)  # timesteps between two checkpoints
    evaluate_over: str | None = None  # option whose choices, but the default, evaluation plays equally often
    policy: PolicyConfig = PolicyConfig()  # what all policies share
    policies: dict[str, dict[str, Any]] = {}  # policy name -> what differs for it

    def policy_config(self, name: str) -> PolicyConfig:
        """Return the configuration of the policy called `name`. Raises ConfigError."""
        merged = merge(self.policy.model_dump(), self.policies.get(name, {}))
        return _validate(PolicyConfig, merged, f"policies.{name}.")

    @property
    def end(self) -> int:
        """Return the number of timesteps after which the run stops."""
        return min(self.total_timesteps, self.stop or self.total_timesteps)


def load_config(path: Path, overrides: Sequence[str] = ()) -> Config:
    """Return the configuration in a YAML file with "key=value" overrides. Raises ConfigError.

    Keys of overrides may be dotted ("policy.learning_rate=1e-4"); values are YAML.
    """
    data = _read(path)
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals or not key:
            raise ConfigError(f"override {override!r} is not of the form key=value")
        try:
            value = _number(yaml.safe_load(text))
        except yaml.YAMLError as error:
            raise ConfigError(f"override {override!r}: {text!r} is not YAML: {error}") from error
        for part in reversed(key.split(".")):
            value = {part: value}
        data = merge(data, value)
    config = _validate(Config, data, "")
    for name in config.policies:
        config.policy_config(name)
    return config


def dump_config(config: Config) -> str:
    """Return the whole configuration as YAML that `load_config` reads back."""
    return yaml.safe_dump(config.model_dump(), sort_keys=False)


def check_run(config: Config, run: Path, *, resume: bool) -> None:
    """Raise ConfigError unless `config` can be trained in the folder `run`.

    A resumed run must have been configured alike; only MAY_CHANGE may differ.
    """
    if resume:
        if changed := changes(run_config(run), config):
            raise ConfigError(
                f"cannot resume {run}: {', '.join(changed)} changed "
                f"(was {json.dumps(changed)}); use another --run for a new configuration"
            )
    elif has_checkpoint(run):
        raise ConfigError(f"{run} already holds a run; continue it with --resume, or name another folder with --run")


def keep_config(config: Config, run: Path) -> None:
    """Write the whole configuration into the folder of a run."""
    run.mkdir(parents=True, exist_ok=True)
    write_atomically(run / "config.yaml", dump_config(config).encode())


def run_config(run: Path) -> Config:
    """Return the configuration that a run was made with. Raises ConfigError."""
    return load_config(run / "config.yaml")


def changes(before: Config, now: Config) -> dict[str, Any]:
    """Return what was in keys that have changed and may not in the middle of a run."""
    old, new = before.model_dump(), now.model_dump()
    return {key: old[key] for key in new if old[key] != new[key] and key not in MAY_CHANGE}


def merge(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Return `base` with `over` laid on top; mappings are merged, everything else is replaced."""
    merged = dict(base)
    for key, value in over.items():
        both = isinstance(merged.get(key), dict) and isinstance(value, dict)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def _read(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    if path.resolve() in seen:
        raise ConfigError(f"{path}: `extends` leads back to itself")
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read the configuration {path}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not YAML: {error}") from error
    if not isinstance(data, dict):
        raise ConfigError(f"{path} holds {type(data).__name__}, expected keys and values")
    base = data.pop("extends", None)
    if base is None:
        return data
    return merge(_read(path.parent / str(base), (*seen, path.resolve())), data)


def _number(value: Any) -> Any:
    """Return YAML 1.1's strings of the form 1e-4 as the numbers that people mean."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _validate(model: type[T], data: dict[str, Any], prefix: str) -> T:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        key = prefix + ".".join(str(part) for part in first["loc"])
        if first["type"] != "extra_forbidden":
            raise ConfigError(f"{key}: got {first['input']!r}; {first['msg']}") from None
        fields = PolicyConfig.model_fields if key.startswith(("policy.", "policies.")) else Config.model_fields
        near = difflib.get_close_matches(str(first["loc"][-1]), fields, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known keys are {', '.join(fields)}"
        raise ConfigError(f"unknown key {key!r}; {hint}") from None
