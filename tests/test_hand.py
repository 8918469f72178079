"""The hand between a policy and a device: late, slow and not exact, and the same whatever the groups."""

import numpy as np
import pytest

from joybridge.config.config import load_config, make_config
from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.policy.config_fit import check_fit
from joybridge.policy.hand import make_hands
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.train import train
from joybridge.simulator import axis, behavior, branch, button, sensor
from joybridge.v1 import bridge_pb2 as pb

SPEC = pb.GameSpec(
    name="table",
    behaviors=[
        behavior(
            "player",
            sensors=[sensor("eye", [1], -1, 1)],
            axes=[axis("x"), axis("lift", 0.5, 2.5)],
            branches=[button("grip"), branch("gear", ["low", "middle", "high"])],
        )
    ],
)
REST = [0.0, 0.5]


def make(tmp_path, *overrides, first=0, end=2, seed=7):
    (tmp_path / "table.yaml").write_text("game: table\n")
    config = load_config(tmp_path / "table.yaml", list(overrides))
    return make_hands(config, SPEC, first, end, seed)


def play(hands, decisions, lanes=2, ends=(), masks=None):
    """Return what the device gets, axes and choices, for what is chosen; `ends`: (decision, lane) of new episodes."""
    got = []
    for number, (axes, choices) in enumerate(decisions):
        act = ActArrays(
            np.tile(np.array(axes, np.float32), (lanes, 1)), np.tile(np.array(choices, np.int32), (lanes, 1))
        )
        new = np.array([(number, lane) in ends for lane in range(lanes)])
        step = StepArrays([], np.zeros((lanes, 1), np.float32), new, np.zeros(lanes, bool), masks)
        for hand in hands:
            hand.store(step)
            hand.apply(step, act)
        got.append((act.axes.copy(), act.choices.copy()))
    return [axes for axes, _ in got], [choices for _, choices in got]


def test_without_limits_there_is_no_hand(tmp_path):
    assert make(tmp_path) == []
    axes, choices = play([], [([1.0, 2.0], [1, 2])])
    assert axes[0].tolist() == [[1.0, 2.0]] * 2 and choices[0].tolist() == [[1, 2]] * 2


POINTER = pb.GameSpec(
    name="desk",
    behaviors=[
        behavior(
            "player",
            sensors=[sensor("eye", [1], -1, 1)],
            axes=[axis("x", 0, 100, kind="position"), axis("tilt"), axis("y", kind="position")],
        )
    ],
)


def pointing(*overrides, spec=POINTER):
    config = make_config({"game": "desk"} | dict(one.split("=") for one in overrides))
    return make_hands(config, spec, 0, 2, 7)


def test_a_policy_moves_a_pointer_that_the_game_places_and_every_episode_begins_in_the_middle():
    axes, _ = play(pointing("pointer=velocity"), [([100, 0.5, -0.5], [])] * 3, ends={(2, 1)})
    np.testing.assert_allclose(
        [each[0] for each in axes], [[60, 0.5, -0.1], [70, 0.5, -0.2], [80, 0.5, -0.3]], rtol=1e-6
    )
    np.testing.assert_allclose([each[1, 0] for each in axes], [60, 70, 60])
    axes, _ = play(pointing("pointer=velocity", "pointer_speed=0.4"), [([100, 0.5, -1], [])] * 3)
    np.testing.assert_allclose([each[0] for each in axes], [[90, 0.5, -0.8], [100, 0.5, -1], [100, 0.5, -1]], rtol=1e-6)
    assert pointing("pointer=position") == []


def test_a_pointer_of_a_game_that_says_nothing_is_all_axes_that_always_count():
    spec = pb.GameSpec()
    spec.CopyFrom(POINTER)
    for one in spec.behaviors[0].device.axes:
        one.kind = pb.AXIS_KIND_UNSPECIFIED
    axes, _ = play(pointing("pointer=velocity", spec=spec), [([50, 0.5, 0], [])] * 2)
    np.testing.assert_allclose([each[0] for each in axes], [[50, 0.1, 0], [50, 0.2, 0]], rtol=1e-6)


@pytest.mark.parametrize(
    ("pointer", "kind", "text"),
    [
        ("velocity", pb.AXIS_KIND_VELOCITY, "desk has no axis that places a pointer"),
        ("position", pb.AXIS_KIND_VELOCITY, "desk moves its pointer by axis 'x'"),
    ],
)
def test_a_pointer_that_cannot_be_so_is_refused(pointer, kind, text):
    spec = pb.GameSpec()
    spec.CopyFrom(POINTER)
    for one in spec.behaviors[0].device.axes:
        one.kind = kind
    with pytest.raises(ConfigError, match=text):
        check_fit(make_config({"game": "desk", "pointer": pointer}), spec)


def test_an_action_answers_the_observation_of_some_decisions_ago_and_never_one_of_the_last_episode(tmp_path):
    chosen = [([number / 10, 1.0], [number % 2, 2]) for number in range(1, 7)]
    axes, choices = play(make(tmp_path, "hand.delay=2"), chosen, ends={(4, 1)})
    np.testing.assert_allclose([each[0, 0] for each in axes], [0, 0, 0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose([each[1, 0] for each in axes], [0, 0, 0.1, 0.2, 0, 0])
    assert [each[0].tolist() for each in choices] == [[0, 0], [0, 0], [1, 2], [0, 2], [1, 2], [0, 2]]
    assert [each[1].tolist() for each in choices][4:] == [[0, 0], [0, 0]]


def test_in_another_lesson_the_hand_is_as_late_as_that_says_from_the_next_decision_on(tmp_path):
    lessons = "curriculum=[{hand: {delay: 2, reach: 1}, until: {above: 1}}, {hand: {delay: 1}}]"
    hands = make(tmp_path, "hand.reach=0.5", lessons)
    chosen = [([number / 10, 0.5], [0, number % 3]) for number in range(1, 5)]
    axes, choices = play(hands, chosen)
    assert [each[0, 0] for each in axes] == pytest.approx([0, 0, 0.1, 0.2])
    hands[0].limit(load_config(tmp_path / "table.yaml", ["hand.reach=0.5", lessons]).hands[1])
    axes, more = play(hands, [([0.9, 0.5], [0, 0])] * 2)
    assert [each[0, 0] for each in axes] == pytest.approx([0.4, 0.5])  # the last one is at the end of its reach
    assert [each[0, 1] for each in (*choices, *more)] == [0, 0, 1, 2, 1, 0]
    assert hands[0].state()["axes"].shape == (3, 2, 2)  # as many as the latest hand of all lessons keeps


def test_the_hand_of_a_lane_that_waits_stays_as_it_is(tmp_path):
    (late,) = make(tmp_path, "hand.delay=1", "hand.hold=2")
    (moved,) = pointing("pointer=velocity")
    got: list[list[float]] = []
    for number in range(6):  # the first lane decides in every other step, the second one in all
        value = np.full((2, 2), (number + 1) / 10, np.float32)
        deciding = np.array([number % 2 == 0, True])
        step = StepArrays([], np.zeros((2, 1), np.float32), np.zeros(2, bool), np.zeros(2, bool), deciding=deciding)
        act = ActArrays(value, np.full((2, 2), number % 3 == 2, np.int32))
        late.apply(step, act)
        if number % 2 == 0:
            got.append(act.axes[:, 0].tolist())
        moved.apply(step, ActArrays(np.full((2, 3), [100, 0.5, -0.5], np.float32), np.zeros((2, 0), np.int32)))
    np.testing.assert_allclose(
        np.array(got), np.array([[0, 0], [0.1, 0.2], [0.3, 0.4]]), atol=1e-6
    )  # its last choice, not of a wait
    np.testing.assert_allclose(moved.state()["last_axes"][:, 0], [80, 100])


def test_a_choice_is_held_for_some_decisions_unless_it_is_forbidden(tmp_path):
    chosen = [(REST, [grip, 0]) for grip in (1, 0, 0, 0, 1, 0, 1)]
    _, choices = play(make(tmp_path, "hand.hold=3"), chosen, ends={(5, 1)})
    assert [each[0, 0] for each in choices] == [1, 1, 1, 0, 0, 0, 1]
    assert [each[1, 0] for each in choices] == [1, 1, 1, 0, 0, 0, 1]  # a new episode begins with the button released
    masks = [np.ones((2, 2), bool), np.array([[True, True, True], [False, False, True]])]
    _, choices = play(make(tmp_path, "hand.hold=3"), [(REST, [0, 1])] * 2, masks=masks)
    assert [each[:, 1].tolist() for each in choices] == [[1, 2], [1, 2]]


def test_axes_stay_within_reach_and_move_slowly_from_where_they_are(tmp_path):
    axes, _ = play(make(tmp_path, "hand.reach=0.5"), [([-1.0, 2.5], [0, 0]), ([0.2, 0.5], [0, 0])])
    np.testing.assert_allclose(axes[0][0], [-0.5, 1.5])
    np.testing.assert_allclose(axes[1][0], [0.2, 0.5])
    axes, _ = play(
        make(tmp_path, "hand.change=0.25"), [([1.0, 2.5], [0, 0])] * 3 + [([0.9, 0.5], [0, 0])], ends={(2, 1)}
    )
    np.testing.assert_allclose([each[0] for each in axes], [[0.5, 1.0], [1.0, 1.5], [1.0, 2.0], [0.9, 1.5]])
    np.testing.assert_allclose(axes[2][1], [0.5, 1.0])


def test_noise_grows_with_the_distance_from_rest_and_depends_on_seed_arena_and_decision_alone(tmp_path):
    chosen = [([0.5, 1.5], [0, 0])] * 400
    whole, _ = play(make(tmp_path, "hand.noise=0.1", end=6), chosen, lanes=6)
    part, _ = play(make(tmp_path, "hand.noise=0.1", first=2, end=5), chosen, lanes=3)
    np.testing.assert_array_equal([each[2:5] for each in whole], part)
    other, _ = play(make(tmp_path, "hand.noise=0.1", end=6, seed=8), chosen, lanes=6)
    assert not np.array_equal(whole, other)
    spread = np.std(whole, axis=(0, 1))
    np.testing.assert_allclose(spread, [0.05, 0.1], rtol=0.06)
    still, _ = play(make(tmp_path, "hand.noise=0.1"), [(REST, [0, 0])])
    assert still[0].tolist() == [REST] * 2
    edge, _ = play(make(tmp_path, "hand.noise=9"), [([1.0, 2.5], [0, 0])] * 50)
    assert np.min(edge, axis=(0, 1)).tolist() == [-1, 0.5] and np.max(edge, axis=(0, 1)).tolist() == [1, 2.5]


def test_a_hand_that_was_saved_goes_on_as_it_would_have(tmp_path):
    limits = ["hand.delay=2", "hand.hold=2", "hand.change=0.2", "hand.noise=0.3"]
    rng = np.random.default_rng(1)
    chosen = [(rng.uniform([-1, 0.5], [1, 2.5]), rng.integers(0, [2, 3])) for _ in range(20)]
    (hand,), (saved,) = make(tmp_path, *limits), make(tmp_path, *limits)
    play([hand], chosen[:9])
    ended = StepArrays([], np.zeros((2, 1), np.float32), np.array([False, True]), np.zeros(2, bool))
    hand.store(ended)  # a session that continues from here does not tell of this end again
    saved.load(hand.state())
    axes = play([hand], chosen[9:])[0]
    np.testing.assert_array_equal(axes, play([saved], chosen[9:])[0])
    assert axes[0][1].tolist() == REST != axes[0][0].tolist()
    with pytest.raises(ValueError, match="broadcast"):
        make(tmp_path, "hand.delay=1")[0].load(hand.state())


def test_a_run_with_a_hand_resumes_to_the_same_bits(simulator, tmp_path):
    (tmp_path / "small.yaml").write_text(
        "{game: shooting_birds, arenas: 4, log_interval: 1000, total_timesteps: 160, "
        "hand: {delay: 2, hold: 2, noise: 0.2}, "
        "policy: {hidden_sizes: [8], rollout_steps: 10, time_horizon: 10, minibatch_size: 40, epochs: 1}}"
    )

    def trained(name, stop, *, resume=False):
        config = load_config(tmp_path / "small.yaml", [f"stop_at={stop}"])
        train(config, tmp_path / name, [simulator], resume=resume)
        return {name: array.tobytes() for name, array in load_checkpoint(tmp_path / name)[0].items()}

    whole = trained("whole", 160)
    assert trained("parts", 80) != whole
    assert trained("parts", 160, resume=True) == whole
