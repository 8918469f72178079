"""Parameters that a run draws, and its lessons: configuration, when lessons end, resumption, what is played later."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import joybridge.commands.train as trainer
from joybridge.config.config import HandConfig, load_config
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import read_rows
from joybridge.contract.codec import StepArrays
from joybridge.games.archer.game import Archer
from joybridge.games.orchard.game import Orchard
from joybridge.policy.config_fit import check_fit
from joybridge.policy.episodes import Episodes
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.curriculum import Curriculum
from joybridge.run.folder import play_config
from joybridge.simulator.game_adapter import batched

ARCHER = batched(Archer).describe({"observation": "state"})
CURRICULUM = """
game: archer
parameters: {size: {log_uniform: [0.5, 2]}}
curriculum:
  - {name: large, parameters: {size: 3}, until: {metric: accuracy, above: 0.5, episodes: 2}}
  - {parameters: {size: {choice: [1, 2]}}, until: {metric: length, below: 20, episodes: 1}}
  - {parameters: {size: {uniform: [0.2, 0.4]}}}
"""


def config(tmp_path, text="game: archer", *overrides):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    return load_config(path, overrides)


# ---------------------------------------------------------------------------------------------------- configurations


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("2", 2.0),
        ("{uniform: [0.5, 2]}", {"uniform": [0.5, 2.0]}),
        ("{log_uniform: [0.5, 2]}", {"log_uniform": [0.5, 2.0]}),
        ("{choice: [1, 3]}", {"choice": [1.0, 3.0]}),
    ],
)
def test_a_parameter_is_a_number_or_a_distribution_that_replaces_any_other(tmp_path, written, read):
    for text in ("game: archer", "game: archer\nparameters: {size: {uniform: [1, 2]}}"):
        made = config(tmp_path, text, f"parameters.size={written}")
        assert made.parameters == {"size": read}
        check_fit(made, ARCHER)


@pytest.mark.parametrize(
    ("written", "error"),
    [
        ("{uniform: [1]}", "parameters.size: .* two numbers"),
        ("{normal: [1, 2]}", "parameters.size: .* expected a number, {uniform"),
        ("{uniform: [1, 2], choice: [1]}", "parameters.size: .* expected a number, {uniform"),
        ("{}", "parameters.size: .* expected a number, {uniform"),
        ("{choice: [large]}", "parameters.size: .* expected a number"),
        ("true", "parameters.size: .* expected a number"),
        (".nan", "parameters.size: .* expected a number"),
        ("{choice: []}", "parameters.size: .* has 0 values, expected 1 to 100"),
        ("{uniform: [2, 1]}", "parameters.size: .* low below high"),
        ("{uniform: [1, 5]}", "parameters.size: .* got 5, expected 0.1..4"),
    ],
)
def test_a_distribution_that_cannot_be_drawn_from_is_an_error_that_names_its_key(tmp_path, written, error):
    with pytest.raises(ConfigError, match=error):
        check_fit(config(tmp_path, "game: archer", f"parameters.size={written}"), ARCHER)


def test_a_game_without_parameters_per_episode_is_named(tmp_path):
    spec = batched(Archer).describe({"observation": "state"})
    spec.parameters_per_episode = False
    with pytest.raises(ConfigError, match=r"parameters.size: archer: its parameters cannot be drawn per episode"):
        check_fit(config(tmp_path, "game: archer", "parameters.size={uniform: [1, 2]}"), spec)
    lessons = config(tmp_path, "game: orchard", "curriculum=[{parameters: {apple: 1}}]")
    with pytest.raises(ConfigError, match=r"curriculum.0.parameters.apple: .*cannot be drawn"):
        check_fit(lessons, batched(Orchard).describe({"observation": "state"}))


@pytest.mark.parametrize(
    ("lessons", "error"),
    [
        ("[{parameters: {size: 1}}, {parameters: {size: 2}}]", "curriculum: .*lesson 1 of 2: every lesson but"),
        ("[{parameters: {size: 1}, until: {above: 1}}]", "curriculum: .*lesson 1 of 1: the last lesson has no"),
        ("[{parameters: {size: 1}, until: {}}]", "curriculum.0.until: .*expected one threshold"),
        ("[{parameters: {size: 1}, until: {above: 1, below: 2}}]", "curriculum.0.until: .*expected one threshold"),
        ("[{parameters: {size: 1}, until: {over: 1}}]", "unknown key 'curriculum.0.until.over'"),
        ("[{parameters: {size: big}}]", "curriculum.0.parameters.size: .*expected a number"),
        ("[{hand: {late: 1}}]", "unknown key 'curriculum.0.hand.late'"),
        ("[{hand: {delay: 1}, until: {above: 1}}, {hand: {delay: -1}}]", "curriculum.1.hand.delay: got -1"),
        ("[{parameters: {size: 9}}]", "curriculum.0.parameters.size: .*got 9, expected 0.1..4"),
        ("[{parameters: {weight: 1}}]", "curriculum.0.parameters.weight: .*unknown parameter 'weight'"),
        (
            "[{parameters: {size: 1}, until: {metric: score, above: 1}}, {parameters: {}}]",
            "curriculum.0.until.metric: .*'score'; archer has reward, length, hits, accuracy, progress",
        ),
        (
            "[{parameters: {size: 1}, until: {policy: foe, above: 1}}, {parameters: {}}]",
            "curriculum.0.until.policy: .*'foe'; there are archer",
        ),
    ],
)
def test_a_wrong_curriculum_is_an_error_that_names_the_lesson(tmp_path, lessons, error):
    with pytest.raises(ConfigError, match=error):
        check_fit(config(tmp_path, "game: archer", f"curriculum={lessons}"), ARCHER)


# ----------------------------------------------------------------------------------------------------- when they end


class Run:
    """A curriculum over three lanes whose episodes a test ends."""

    def __init__(self, chosen):
        self.episodes = Episodes(3, ["hits", "accuracy"], {0: "size"})
        policy: Any = SimpleNamespace(actor=SimpleNamespace(name="archer"), lanes=3, episodes=self.episodes)
        self.curriculum = Curriculum(chosen, ARCHER, [policy])

    def end(self, *lanes, accuracy=0.0, length=1):
        """End the episodes of some lanes after so many decisions, in one step."""
        ended, quiet = np.array(lanes, np.int32), np.zeros(3, bool)
        step = StepArrays([], np.zeros((3, 1), np.float32), quiet, quiet, ended=ended)
        step.metrics = np.array([[0.0, accuracy]] * len(lanes), np.float32)
        step.parameters = np.ones((len(lanes), 1), np.float32)
        self.episodes.length[ended] = length - 1
        self.episodes.add(step, np.zeros(3))
        self.curriculum.watch()

    @property
    def lesson(self):
        return self.curriculum.row()["lesson"]

    @property
    def size(self):
        return self.curriculum.distributions["size"]


def test_a_lesson_ends_when_the_mean_over_its_last_episodes_is_beyond_the_threshold(tmp_path):
    run = Run(config(tmp_path, CURRICULUM))
    assert (run.lesson, list(run.size.choice.values)) == (1, [3.0])
    run.end(0, accuracy=1.0)
    assert not run.curriculum.advance(0.9)  # one episode of two
    run.end(1, accuracy=0.0)
    assert not run.curriculum.advance(0.9)  # 0.5 is not above 0.5
    run.episodes.summarize()  # a row of metrics forgets the episodes, the curriculum does not
    run.end(0, accuracy=1.0)
    run.end(1, accuracy=0.1)
    assert run.curriculum.advance(0.9)
    assert (run.lesson, list(run.size.choice.values)) == (2, [1.0, 2.0])
    assert run.curriculum.heading() == "lesson 2 of 3: size={choice: [1, 2]}"


def test_episodes_that_began_in_the_lesson_before_do_not_count(tmp_path):
    run = Run(config(tmp_path, CURRICULUM))
    run.end(0, 1, accuracy=1.0)
    assert run.curriculum.advance(0.5)
    run.end(2, length=5)  # began in lesson 1
    assert not run.curriculum.advance(0.5)
    run.end(2, length=5)
    assert run.curriculum.advance(0.5) and run.lesson == 3
    run.end(0, 1, 2, accuracy=1.0)
    assert not run.curriculum.advance(1.0) and run.size.uniform.high == 0.4


def test_a_lesson_may_end_by_the_progress_of_the_run(tmp_path):
    text = (
        "game: archer\ncurriculum: [{parameters: {size: 2}, until: {metric: progress, above: 0.3}}, {parameters: {}}]"
    )
    run = Run(config(tmp_path, text))
    assert not run.curriculum.advance(0.3) and run.curriculum.advance(0.31)
    assert list(run.size.choice.values) == [1.0]  # its default, as outside of the curriculum


def test_a_curriculum_goes_on_from_its_state(tmp_path):
    chosen = config(tmp_path, CURRICULUM)
    run, resumed = Run(chosen), Run(chosen)
    run.end(0, 1, accuracy=1.0)
    run.curriculum.advance(0.1)
    run.end(1, length=50)
    resumed.curriculum.load(run.curriculum.state())
    for one in (run, resumed):
        one.end(0, length=5)  # began in lesson 1
        assert not one.curriculum.advance(0.2)
        one.end(1, length=5)
        assert one.curriculum.advance(0.3)


def test_without_a_curriculum_parameters_are_as_they_are(tmp_path):
    run = Run(config(tmp_path, "game: archer\nparameters: {size: 2}"))
    run.end(0)
    assert run.curriculum.parameters == {"size": 2.0} and run.curriculum.distributions == {}
    assert not run.curriculum.advance(1.0) and run.curriculum.row() == {} and run.curriculum.heading() == ""


def test_policies_play_the_last_lesson_unless_told_otherwise(tmp_path):
    slow = CURRICULUM.replace("[0.2, 0.4]}}}", "[0.2, 0.4]}}, hand: {delay: 2}}")
    config(tmp_path, f"{slow}hand: {{noise: 0.1}}")
    assert play_config(tmp_path, []).hand == HandConfig(delay=2, noise=0.1)
    assert play_config(tmp_path, ["hand.delay=3"]).hand == HandConfig(delay=3, noise=0.1)
    assert play_config(tmp_path, []).parameters == {"size": {"uniform": [0.2, 0.4]}}
    assert play_config(tmp_path, ["parameters.size=2"]).parameters == {"size": 2.0}
    with pytest.raises(ConfigError, match=r"game belongs to the training of .*; another program .* --pygame PROGRAM"):
        play_config(tmp_path, ["game.pygame=other.py"])


# ------------------------------------------------------------------------------------------------------------ training

SMALL = ["arenas=4", "policy.rollout_steps=20", "policy.minibatch_size=40", "log_interval=400", "total_timesteps=1600"]
BEASTS = Path(__file__).parents[1] / "configs" / "beastly_rivals" / "bucket-3.yaml"
LESSONS = (
    "curriculum=[{parameters: {beast_speed: 1.5}, until: {metric: survival, above: 1, episodes: 3}}, "
    "{parameters: {beast_speed: {uniform: [0.5, 1.5]}}, hand: {delay: 2}}]"
)


def train(run, simulators, *more):
    """Train with lessons, and return what fixes how the policy and the lessons go on."""
    places = [part for address in simulators for part in ("--simulator", address)]
    status = trainer.main(["train", str(BEASTS), "--run", str(run), *places, *SMALL, LESSONS, *more])
    assert status == 0
    arrays, _ = load_checkpoint(run)
    return {name: array for name, array in arrays.items() if "/policy/" in name or name.startswith("curriculum/")}


@pytest.mark.slow
def test_lessons_are_the_same_to_the_bit_in_two_sessions_in_three_and_after_a_resumption(simulator, tmp_path, capsys):
    runs = [
        train(tmp_path / "whole", [simulator]),
        train(tmp_path / "shards", [simulator] * 3),
        train(tmp_path / "parts", [simulator], "stop_at=800") and train(tmp_path / "parts", [simulator], "--resume"),
    ]
    output = capsys.readouterr().out
    assert (
        "lesson 1 of 2: beast_speed=1.5" in output
        and "lesson 2 of 2: beast_speed={uniform: [0.5, 1.5]}, hand.delay=2" in output
    )
    for arrays in runs[1:]:
        assert len(arrays) > 10 and all(np.array_equal(array, runs[0][name]) for name, array in arrays.items())
    (metrics,) = (tmp_path / "whole").glob("metrics-*.csv")
    rows = read_rows(metrics)
    assert [row["lesson"] for row in rows] == sorted(row["lesson"] for row in rows) and rows[-1]["lesson"] == 2
    drawn = [row["parameters.beast_speed"] for row in rows if "parameters.beast_speed" in row]
    assert len(set(drawn)) > 1 and all(0.5 <= value <= 1.5 for value in drawn)
