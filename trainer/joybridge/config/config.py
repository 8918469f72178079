"""The configuration of a run: every key with its default and meaning, checked. Files hold only what differs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, Field, ValidationError, field_validator, model_validator

from joybridge.config.config_files import dump_yaml, merge, read_overrides, read_yaml
from joybridge.config.errors import ConfigError
from joybridge.config.games import SEVERAL, GameConfig, Games
from joybridge.config.parameter_keys import Checked, EvaluateDuring, Lessons, Value
from joybridge.config.policy_config import PolicyConfig
from joybridge.config.presets import preset_of
from joybridge.config.wrong_keys import wrong_key
from joybridge.plugins import load

MAY_CHANGE = (  # in a resumed run
    "stop_at",
    "checkpoint_interval",
    "checkpoint_seconds",
    "keep_checkpoints",
    "timeout_seconds",
    "transport",
    "max_restarts",
    "log_interval",
    "log_to",
    "stratify_by",
)
OF_THE_GAME = ("options", "parameters")
OF_ONE_GAME = ("options", "parameters", "curriculum", "stratify_by", "evaluate_during")  # not of several
OF_SEVERAL_GAMES = ("common_device", "tell_game", "share_by")
# What a configuration may change when a policy plays.
PLAYABLE_KEYS = (*OF_THE_GAME, "games", "hand", "timeout_seconds", "transport")
PLAYABLE_KEYS_OF_A_GAME = (*OF_THE_GAME, "simulator")  # of one among several

T = TypeVar("T", bound=BaseModel)


class OpponentsConfig(Checked):
    """Who plays beside the learner in a game of several agents."""

    shares: dict[str, Annotated[float, Field(ge=0)]] = Field(
        {},
        description="who holds seats, and how often: `past` policies of this run, the `learner`, the folder of "
        "another run, an exported policy.json, or `script:NAME` of the game; one seat of a match is always the "
        "learner's; none: it holds all",
    )
    sampling: Literal["uniform", "latest", "pfsp_hard", "pfsp_even"] = Field(
        "uniform",
        description="of past policies; pfsp_hard: rather those that beat the learner, pfsp_even: rather "
        "those as strong as it",
    )
    pool_size: int = Field(
        20, ge=1, le=1000, description="past policies that are kept, spread evenly over the training"
    )
    at_once: int = Field(
        4, ge=1, description="past policies that are drawn for the matches until the pool takes the next one"
    )
    pool_updates: int = Field(20, ge=1, description="updates after which a policy is added to them")

    @field_validator("shares")
    @classmethod
    def _some_share(cls, shares: dict[str, float]) -> dict[str, float]:
        if shares and not sum(shares.values()):
            raise ValueError("expected a share above 0")
        return shares


class HandConfig(Checked):
    """What a person's hand can do. The defaults change nothing."""

    delay: int = Field(
        0, ge=0, le=1000, description="decisions between an observation and the action that answers it: reaction time"
    )
    hold: int = Field(
        1, ge=1, description="minimum decisions between changes of a branch; 3 allows one press every 6 decisions"
    )
    reach: float = Field(
        1.0, gt=0, le=1, description="the farthest an axis goes, as a share of the way from rest to its end"
    )
    change: float = Field(
        1.0, gt=0, le=1, description="the most that an axis changes in a decision, as a share of its range"
    )
    noise: float = Field(0.0, ge=0, description="standard deviation of an axis, as a share of its distance from rest")


class Config(Checked):
    """A whole run."""

    game: str = Field(description="which game is trained: its name, MODULE:CLASS, gym:ID or pygame:PROGRAM")
    preset: Literal["sb3", "cleanrl", "paper"] | None = Field(
        None,
        description="settings of another program, for what is not set beside this key; on a command line it replaces "
        "what a file sets",
    )
    options: dict[str, str] = Field({}, description="options of the game, as in `joybridge list`")
    parameters: dict[str, Value] = Field(
        {},
        description="parameters of the game, as in `joybridge list`; {uniform: [LOW, HIGH]}, {log_uniform: [LOW, "
        "HIGH]} or {choice: [VALUE, …]}: drawn at each episode",
    )
    curriculum: Lessons = Field(
        [],
        description="lessons, one after the other: `parameters` and `hand`, and `until` when, see Curricula in "
        "docs/training.md",
    )
    games: Games = Field(
        {},
        description="several games that one policy plays, in place of `game`: a name for each, then its keys, see "
        "docs/several-games.md",
    )
    common_device: dict[str, Annotated[list[str], Field(min_length=1)]] = Field(
        {},
        description="parts of the device of several games, by hand: a name, then the axes or the branches that it "
        "stands for, each as PART or GAME.PART; others go by their names",
    )
    tell_game: bool = Field(False, description="let the policy know which of several games it plays")
    share_by: Literal["arenas", "progress"] = Field(
        "arenas",
        description="how often each of several games is learned from: as often as it is played (arenas), or more often "
        "while its rewards change (progress)",
    )
    layout: str = Field(
        "hybrid",
        description="how policies map to the device: hybrid, bucket-N, bucket-N-mu, joint-N, ordinal-N, beta, "
        "squashed, gsde-N, threshold-T, map-WxH, multiagent, one of an installed package, or MODULE:NAME-SETTING; "
        "after commas, NAME=LAYOUT for an axis, a branch or a behavior",
    )
    arenas: int = Field(75, ge=1, le=2**20, description="copies of the game that are played at once")
    pipeline_groups: int = Field(
        2, ge=1, description="parts of the arenas that take turns: one is played while others are decided for"
    )
    accelerator: Literal["cpu", "cuda"] = Field(
        "cpu", description="where networks live; small ones are faster on the processor"
    )
    seed: int = Field(0, ge=0, lt=2**64, description="of the game, the networks and the samples")
    total_timesteps: int = Field(30_000_000, ge=1, description="length of the run, and of its schedules")
    stop_at: int | None = Field(
        None, ge=1, description="end earlier, after so many timesteps, with the schedules unchanged"
    )
    log_interval: int = Field(300_000, ge=1, description="timesteps between two rows of metrics")
    log_to: list[Literal["tensorboard", "wandb", "mlflow"]] = Field(
        ["tensorboard"], description="where rows of metrics go besides the CSV files of the run"
    )
    checkpoint_interval: int = Field(1_000_000, ge=1, description="timesteps between two checkpoints")
    checkpoint_seconds: float = Field(60.0, gt=0, description="seconds between two checkpoints, if this is sooner")
    keep_checkpoints: int = Field(2, ge=1, description="checkpoints that are kept, the newest ones")
    timeout_seconds: float = Field(
        30.0,
        gt=0,
        description="seconds to wait for an answer of a simulator before it is taken for lost; four times as "
        "long until the first step, because games may be compiled",
    )
    transport: Literal["auto", "local", "grpc"] = Field(
        "auto", description="of a session's messages; local: a Unix socket, auto: that if the simulator offers it"
    )
    max_restarts: int = Field(10, ge=0, description="maximum number of recoveries from a lost simulator")
    best_metric: str = Field(
        "reward", description="metric whose highest value marks the best checkpoint; -length: the lowest of length"
    )
    weights_from: str | None = Field(
        None, description="folder of a run whose trained policies this one begins with; written by --from"
    )
    demonstrations: str | None = Field(
        None, description="folder of demonstrations that the policies clone; written by --demos"
    )
    cloning: Literal["alone", "beside_ppo"] = Field(
        "alone",
        description="alone: policies only imitate, PPO teaches the critic; beside_ppo: it is a term in the loss of PPO",
    )
    evaluate_during: EvaluateDuring | None = Field(
        None,
        description="held-out settings that policies play during training: `every`, `episodes`, "
        "`deterministic`, and `options` and `parameters` that differ, see Held-out settings in docs/training.md",
    )
    stratify_by: str | None = Field(
        None, description="option whose choices, but the default, evaluation plays equally often"
    )
    opponents: OpponentsConfig = Field(OpponentsConfig(), description="who plays beside the learner")
    pointer: Literal["position", "velocity"] | None = Field(
        None,
        description="what policies do to axes that place a pointer: put it there (position), or move it from "
        "where it is (velocity); null: as the game has it",
    )
    pointer_speed: float = Field(
        0.1,
        gt=0,
        le=1,
        description="with `pointer: velocity`, the farthest that a pointer moves in a decision, as a "
        "share of its range",
    )
    hand: HandConfig = Field(HandConfig(), description="limits of a person's hand, between policies and the game")
    policy: PolicyConfig = Field(PolicyConfig(), description="what all policies share")
    policies: dict[str, dict[str, Any]] = Field(
        {}, description="what differs for one policy: its name, then a key as those of policy"
    )

    @model_validator(mode="before")
    @classmethod
    def _with_preset(cls, data: Any) -> Any:
        """Lay the given keys on top of those of their preset."""
        if not isinstance(data, dict):
            return data
        name = {"game": SEVERAL} if data.get("games") else {}
        return merge(name | preset_of(data), data)

    @model_validator(mode="after")
    def _one_game_or_several(self) -> Self:
        """Refuse what belongs to one game beside several."""
        if self.game == SEVERAL and not self.games:
            raise ValueError("no game is left in `games`; name one at least")
        if self.games and self.game != SEVERAL:
            raise ValueError(f"there is a game, {self.game!r}, beside `games`; give one of the two")
        wrong = [key for key in OF_ONE_GAME if getattr(self, key)] if self.games else []
        wrong += ["opponents"] if self.games and self.opponents.shares else []
        if not self.games:
            fields = type(self).model_fields
            wrong += [key for key in OF_SEVERAL_GAMES if getattr(self, key) != fields[key].default]
        if wrong:
            hint = f"write games.NAME.{wrong[0]}" if wrong[0] in OF_THE_GAME else "leave it out"
            raise ValueError(f"`{wrong[0]}` does not go with {'several games' if self.games else 'one game'}; {hint}")
        if len(self.games) > self.arenas:
            raise ValueError(f"{self.arenas} arenas are too few for {len(self.games)} games")
        return self

    @model_validator(mode="after")
    def _progress_can_be_compared(self) -> Self:
        """Refuse policies that cannot learn more often from some games than from others."""
        for name in ("", *self.policies) if self.share_by == "progress" else ():  # "": those without keys of their own
            config = self.policy_config(name)
            if not config.scale_rewards:
                raise ValueError("`share_by: progress` compares rewards of games; set policy.scale_rewards=true")
            if config.memory.kind != "none":
                raise ValueError("`share_by: progress` does not go with policy.memory; leave one of them out")
        return self

    @property
    def played(self) -> dict[str, GameConfig]:
        """Return the games that are played, by name: those of `games`, or the only one."""
        if self.games:
            return {name: one.model_copy(update={"game": one.game or name}) for name, one in self.games.items()}
        return {self.game: GameConfig(game=self.game, options=self.options, parameters=self.parameters)}

    def of_game(self, name: str) -> "Config":
        """Return the configuration when only this one of several games is played. Raises ConfigError."""
        if name not in self.games:
            known = ", ".join(self.games) or f"only {self.game}"
            raise ConfigError(f"there is no game {name!r} among several; there are {known}; see --only-game")
        one = self.played[name]
        return self.model_copy(update={"game": one.game, "options": one.options, "parameters": one.parameters})

    def in_last_lesson(self) -> "Config":
        """Return the configuration with the parameters and the hand of the last lesson, if it has a curriculum."""
        last = self.curriculum[-1].parameters if self.curriculum else {}
        played = {"parameters": self.parameters | last, "hand": self.hands[-1], "curriculum": []}
        return self.model_copy(update=played)

    @property
    def hands(self) -> list[HandConfig]:
        """Return the limits of the hand in each lesson; without lessons, the only ones. Raises ConfigError."""
        outside = self.hand.model_dump()
        return [
            _validate(HandConfig, merge(outside, lesson.hand), f"curriculum.{index}.hand.")
            for index, lesson in enumerate(self.curriculum)
        ] or [self.hand]

    def policy_config(self, name: str) -> PolicyConfig:
        """Return the configuration of the policy called `name`. Raises ConfigError."""
        merged = merge(self.policy.model_dump(), self.policies.get(name, {}))
        return _validate(PolicyConfig, merged, f"policies.{name}.")

    @property
    def end(self) -> int:
        """Return the number of timesteps after which the run stops."""
        return min(self.total_timesteps, self.stop_at or self.total_timesteps)


def load_config(path: Path, overrides: Sequence[str] = (), behavior: str = "") -> Config:
    """Return the configuration in a YAML file with "key=value" overrides. Raises ConfigError.

    Keys of overrides may be dotted ("policy.learning_rate=1e-4"); values are YAML. behavior: the file is one of
    ML-Agents, and this is whose settings are used.
    """
    data, over = read_yaml(path), read_overrides(overrides)
    over = merge(preset_of(over), over)
    if behavior:
        data = load("joybridge.configurations", "mlagents")(data, behavior, over.get("arenas"))
    return make_config(merge(data, over))


def make_config(data: dict[str, Any]) -> Config:
    """Return the configuration with these keys and values. Raises ConfigError."""
    config = _validate(Config, data, "")
    for name in config.policies:
        config.policy_config(name)
    _ = config.hands  # those of lessons are checked when they are put together
    return config


def dump_config(config: Config) -> str:
    """Return the whole configuration as YAML that `load_config` reads back."""
    return dump_yaml(config.model_dump())


def play_settings(config: Config) -> dict[str, Any]:
    """Return the options, parameters and limits of the hand that are set, by key: {"parameters.size": 0.5}."""
    of_game = {f"{key}.{name}": value for key in OF_THE_GAME for name, value in getattr(config, key).items()}
    return of_game | {f"hand.{key}": value for key, value in config.hand}


def _validate(model: type[T], data: dict[str, Any], prefix: str) -> T:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise ConfigError(wrong_key(error, prefix, Config.model_fields)) from None
