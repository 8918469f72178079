"""Samplers and curricula in a configuration of ML-Agents, as distributions and lessons of ours."""

import pytest

from joybridge.config.config import load_config
from joybridge.config.errors import ConfigError

pytestmark = pytest.mark.nightly

THEIRS = """
environment_parameters:
  wind: {sampler_type: uniform, sampler_parameters: {min_value: 0.5, max_value: 2}}
  size:
    curriculum:
      - name: Large
        value: 3
        completion_criteria: {measure: reward, behavior: Archer, min_lesson_length: 50, threshold: 0.8}
      - value: {sampler_type: uniform, sampler_parameters: {min_value: 1, max_value: 2}}
        completion_criteria: {measure: progress, threshold: 0.5}
      - {name: Small, value: 1, completion_criteria: {threshold: 1}}
behaviors: {Archer: {trainer_type: ppo}}
"""


def test_samplers_become_distributions_and_a_curriculum_becomes_lessons(tmp_path):
    path = tmp_path / "theirs.yaml"
    path.write_text(THEIRS)
    made = load_config(path, ["game=archer"], "Archer")
    assert made.parameters == {"wind": {"uniform": [0.5, 2.0]}}
    one, two, three = made.curriculum
    assert (one.name, one.parameters, three.name, three.parameters) == ("Large", {"size": 3.0}, "Small", {"size": 1.0})
    assert one.until is not None and (one.until.metric, one.until.above, one.until.episodes) == ("reward", 0.8, 50)
    assert two.until is not None and (two.until.metric, two.until.above) == ("progress", 0.5)
    assert two.parameters == {"size": {"uniform": [1.0, 2.0]}} and three.until is None


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        (
            "uniform, sampler_parameters: {min_value: 0.5",
            "gaussian, sampler_parameters: {min_value: 0.5",
            "wind.sampler_type: got 'gaussian'; samplers here are uniform",
        ),
        ("{min_value: 0.5, max_value: 2}", "{min_value: 0.5, max_value: 2, seed: 3}", "wind.sampler_parameters: got"),
        ("value: 3", "valu: 3", "size.curriculum.0.valu: ML-Agents 1.1.0 has no such key"),
        ("measure: progress", "measure: speed", "size.curriculum.1.completion_criteria.measure: got 'speed'"),
        ("threshold: 0.5", "require_reset: true", "require_reset: got True, expected false"),
        ("wind: {sampler_type", "wind: {curriculum: [], sampler_type", "wind and size have a curriculum each"),
    ],
)
def test_what_has_no_counterpart_among_samplers_and_lessons_is_refused_by_name(tmp_path, old, new, error):
    assert old in THEIRS
    path = tmp_path / "theirs.yaml"
    path.write_text(THEIRS.replace(old, new, 1))
    with pytest.raises(ConfigError, match=error):
        load_config(path, ["game=archer"], "Archer")
