"""The model of scale, and its page from figures that are not measured."""

import json

import pytest

from tools import scale
from tools.bench.measure import GAMES
from tools.scale import Costs, predict

COSTS = Costs(simulate=6e-6, wire=2e-6, act=4e-6, learn=10e-6)


def test_one_simulator_beside_one_learner_waits_for_neither_and_learning_comes_after_both():
    found = predict(COSTS, 2)
    assert found.rate == pytest.approx(1.0 / 18e-6)
    assert found.saturated == "learn"
    assert found.core_hours == pytest.approx(1e9 * 18e-6 * 2 / 3600)


def test_more_simulators_help_until_the_policies_are_slower():
    assert predict(COSTS, 3).rate == pytest.approx(predict(COSTS, 1000).rate) == pytest.approx(1.0 / 14e-6)
    assert predict(COSTS._replace(learn=1e-6), 3).saturated == "act"
    assert predict(COSTS._replace(learn=1e-6), 2).saturated == "simulate"
    assert predict(COSTS, 4, simulators=1).rate == predict(COSTS, 2).rate


def test_several_learners_divide_the_work_and_pay_for_their_gradients():
    assert predict(COSTS, 1000, learners=10, gradients=0.5).rate == pytest.approx(10.0 / 19e-6)
    assert predict(COSTS._replace(wait=20e-6), 1000, learners=10, gradients=0.5).rate == pytest.approx(10.0 / 39e-6)
    assert predict(COSTS._replace(wait=20e-6), 2).saturated == "wait"
    with pytest.raises(ValueError, match="4 cores for 4 learners"):
        predict(COSTS, 4, learners=4)


def test_the_page_is_drawn_from_figures_alone(tmp_path):
    point = {"arenas": 64, "us": 5.0, "p50_us": 300.0, "p95_us": 400.0, "simulate_us": 2.0, "simulator_cpu_us": 4.0}
    many = {"sessions": 4, "per_second": 12345.0, "p95_us": 400.0, "mb": 200.0}
    run = {
        "per_second": 40000.0,
        "act": 4e-6,
        "learn": 10e-6,
        "waited": 3e-6,
        "simulators_cpu": 8e-6,
        "memory": [{"timesteps": 1000, "trainer": 400.0, "simulator": 180.0}],
    }
    figures = {
        "machine": "a machine",
        "arenas": {game: [point | {"mb": 180.0}] for game in GAMES},
        "sessions": {game: [many] for game in GAMES},
        "trainings": {name: [run | {"simulators": count} for count in (1, 2)] for name in scale.TRAININGS},
    }
    scale.write_page(json.loads(json.dumps(figures)), tmp_path)
    text = (tmp_path / "README.md").read_text()
    assert "simulate 4.0, wire 4.0, act 4.0, wait 7.0, learn 10.0" in text
    assert "| shooting_birds/bucket-11 | 1 | 40 000 | 40 000 | 1 |" in text
    assert "| shooting_birds/bucket-11 | 2 | 47 619 | 40 000 | 1.19 |" in text
    assert (tmp_path / "curves.png").stat().st_size > 1000
