"""The section `environment_parameters` of ML-Agents as ours: constants, samplers and a curriculum.

Source: the documentation of ML-Agents 1.1.0, "Environment Parameter Randomization" and "Curriculum".
"""

from collections.abc import Mapping
from typing import Any

from joybridge.config.errors import ConfigError

WHERE = "environment_parameters"
LESSON = {"name", "value", "completion_criteria"}
CRITERIA = {
    "behavior",
    "measure",
    "threshold",
    "min_lesson_length",
    "signal_smoothing",
    "require_reset",
}
MEASURES = ("reward", "progress")


def settings(given: Mapping[str, Any], behavior: str) -> dict[str, Any]:
    """Return our keys `parameters` and `curriculum`. behavior: the one that is trained. Raises ConfigError."""
    curricula = {name: value for name, value in given.items() if isinstance(value, Mapping) and "curriculum" in value}
    if len(curricula) > 1:
        raise ConfigError(
            f"{WHERE}: {' and '.join(curricula)} have a curriculum each, and lessons of their own; here is one list of "
            "lessons for all: write it as `curriculum`, each lesson with the values of all of them"
        )
    values = {name: _value(f"{WHERE}.{name}", value) for name, value in given.items() if name not in curricula}
    lessons = [lesson for name, value in curricula.items() for lesson in _lessons(name, value, behavior)]
    return {"parameters": values, "curriculum": lessons}


def _value(where: str, value: Any) -> Any:
    """Return a constant or a sampler as ours."""
    if not isinstance(value, Mapping):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ConfigError(f"{where}: got {value!r}, expected a number, a sampler or a curriculum")
        return value
    kind, numbers = value.get("sampler_type"), value.get("sampler_parameters")
    if kind != "uniform":
        raise ConfigError(
            f"{where}.sampler_type: got {kind!r}; samplers here are uniform, or ours: log_uniform, choice"
        )
    if not isinstance(numbers, Mapping) or set(numbers) != {"min_value", "max_value"}:
        wanted = "min_value and max_value; the values depend on the seed of the run alone"
        raise ConfigError(f"{where}.sampler_parameters: got {numbers!r}, expected {wanted}")
    return {"uniform": [numbers["min_value"], numbers["max_value"]]}


def _lessons(name: str, value: Mapping[str, Any], behavior: str) -> list[dict[str, Any]]:
    where, given = f"{WHERE}.{name}.curriculum", value["curriculum"]
    if not isinstance(given, list) or not given or not all(isinstance(lesson, Mapping) for lesson in given):
        raise ConfigError(f"{where}: got {given!r}, expected a list of lessons")
    lessons = []
    for number, lesson in enumerate(given):
        place = f"{where}.{number}"
        _know(lesson, LESSON, place)
        if "value" not in lesson:
            raise ConfigError(f"{place}: it has no `value`")
        ours = {"name": lesson.get("name", ""), "parameters": {name: _value(f"{place}.value", lesson["value"])}}
        if number < len(given) - 1:  # ML-Agents does not look at the criteria of the last lesson
            ours["until"] = _until(f"{place}.completion_criteria", lesson.get("completion_criteria"), behavior)
        lessons.append(ours)
    return lessons


def _until(where: str, criteria: Any, behavior: str) -> dict[str, Any]:
    if not isinstance(criteria, Mapping):
        raise ConfigError(f"{where}: got {criteria!r}, expected when the lesson ends; every lesson but the last has it")
    _know(criteria, CRITERIA, where)
    measure, judged = criteria.get("measure", "reward"), criteria.get("behavior", behavior)
    if measure not in MEASURES:
        raise ConfigError(f"{where}.measure: got {measure!r}, expected {' or '.join(MEASURES)}")
    if criteria.get("require_reset", False) is not False:
        wanted = "false: every arena begins the next lesson with its next episode"
        raise ConfigError(f"{where}.require_reset: got {criteria['require_reset']!r}, expected {wanted}")
    length = criteria.get("min_lesson_length", 0)
    return {
        "metric": measure,
        "policy": None if judged == behavior else judged,
        "above": criteria.get("threshold", 0.0),
        "episodes": 1 if length == 0 else length,
    }


def _know(given: Mapping[str, Any], known: set[str], where: str) -> None:
    for key in given:
        if key not in known:
            raise ConfigError(f"{where}.{key}: ML-Agents 1.1.0 has no such key; remove it")
