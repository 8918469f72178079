"""Keys about what is played: parameters that are drawn at each episode, and the lessons of a curriculum."""

from typing import Annotated, Any, Self, TypeAlias

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator

from joybridge.config.game_settings import KINDS, read_value

MAX_LESSONS = 1000
MAX_LESSON_EPISODES = 100_000  # that a lesson looks at


class Checked(BaseModel):
    """What all parts of a configuration share: unknown keys are refused, and numbers are finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, coerce_numbers_to_str=True)


Value: TypeAlias = Annotated[
    float | dict[str, list[float]],
    BeforeValidator(read_value),
    WithJsonSchema(
        {
            "$comment": "number or distribution",
            "anyOf": [
                {"type": "number"},
                *(
                    {
                        "type": "object",
                        "required": [kind],
                        "additionalProperties": False,
                        "properties": {kind: {"type": "array", "items": {"type": "number"}}},
                    }
                    for kind in KINDS
                ),
            ],
        }
    ),
]


class Until(Checked):
    """When a lesson is over: a mean over its last episodes is above, or below, a threshold."""

    metric: str = Field("reward", description="reward, length, a metric of the game, or progress: the share of the run")
    policy: str | None = Field(None, description="whose episodes count; null: those of the first policy")
    above: float | None = Field(None, description="the mean must be larger")
    below: float | None = Field(None, description="or it must be smaller")
    episodes: int = Field(
        100,
        ge=1,
        le=MAX_LESSON_EPISODES,
        description="episodes of the lesson over which the mean is taken, the last ones",
    )

    @model_validator(mode="after")
    def _one_threshold(self) -> Self:
        if (self.above is None) == (self.below is None):
            raise ValueError("expected one threshold, `above: NUMBER` or `below: NUMBER`")
        return self


class Lesson(Checked):
    """A part of a curriculum."""

    name: str = Field("", max_length=100, description="for messages")
    parameters: dict[str, Value] = Field(
        {}, description="parameters in this lesson; others as outside of the curriculum"
    )
    hand: dict[str, Any] = Field({}, description="limits of the hand in this lesson, as under hand; others as outside")
    until: Until | None = Field(None, description="when the next lesson begins; only the last one has none")


class EvaluateDuring(Checked):
    """What policies play in between to be measured, without learning."""

    every: int | None = Field(
        None,
        ge=1,
        description="timesteps; the next row of metrics gets columns held_out_…, as does the last one; null: only that",
    )
    episodes: int = Field(64, ge=1, le=MAX_LESSON_EPISODES, description="that are played each time, the same ones")
    deterministic: bool = Field(False, description="take the most probable action instead of sampling")
    options: dict[str, str] = Field({}, description="options that differ from the training")
    parameters: dict[str, Value] = Field({}, description="parameters that differ from the training")


def _check_lessons(lessons: list[Lesson]) -> list[Lesson]:
    for number, lesson in enumerate(lessons, 1):
        if (lesson.until is None) != (number == len(lessons)):
            wanted = "the last lesson has no `until`" if lesson.until else "every lesson but the last has `until`"
            raise ValueError(f"lesson {number} of {len(lessons)}: {wanted}")
    return lessons


Lessons: TypeAlias = Annotated[list[Lesson], Field(max_length=MAX_LESSONS), AfterValidator(_check_lessons)]
