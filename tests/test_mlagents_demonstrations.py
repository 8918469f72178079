"""Files `.demo` of ML-Agents are cloned: what they hold, what does not fit, and what happens to files."""

import re

import numpy as np
import pytest

from joybridge.cli import main
from joybridge.client.client import Session
from joybridge.client.recording import RecordingError
from joybridge.demonstrations.episodes import finished_episodes
from joybridge.demonstrations.files import load_demonstration
from joybridge.demonstrations.recorded import load_recorded
from joybridge.layouts import list_roles, make_acts
from joybridge.layouts.random_acts import obey_masks, press_at_random
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents_player.records import AgentRecords
from joybridge.simulator import axis, behavior, branch, button, channel, sensor, spec
from tests.test_minari import rows

pytestmark = [pytest.mark.nightly, pytest.mark.usefixtures("signals")]


def varint(number):
    return bytes([number]) if number < 128 else bytes([number & 127 | 128]) + varint(number >> 7)


def parameters(part):
    """Return what Unity says of a behavior with this device."""
    device = part.device
    actions = ml.ActionSpec(
        continuous_actions=len(device.axes),
        discrete_actions=len(device.branches),
        branch_sizes=[len(one.choices) for one in device.branches],
    )
    return ml.BehaviorParameters(name=part.name, action_spec=actions)


def encode(described, steps, heading=None):
    """Return the bytes of a file, as Unity writes them. described: BehaviorParameters."""
    heading = heading or ml.DemonstrationHeading(api_version=1, name="any", steps=len(steps), episodes=1)
    head = heading.SerializeToString()
    data = (varint(len(head)) + head).ljust(33, b"\0")
    for message in (described, *steps):
        body = message.SerializeToString()
        data += varint(len(body)) + body
    return data


def play(address, game, folder, decisions=60, arenas=2):
    """Play at random, recorded by Joybridge; return the spec and the same as steps of ML-Agents, in the order of time.

    The step that ends an episode comes before the first one of the next, each with the action that led to it.
    """
    rng, steps, ids = np.random.default_rng(2), [], np.arange(arenas)
    records: dict[bool, AgentRecords] = {}
    with Session(address, game, arenas=arenas, seed=7) as session:
        session.record_demonstration(folder)
        (part,) = session.spec.behaviors
        (act,) = make_acts(session.spec, arenas)

        def note(seen, rewards, lanes, masks=None, interrupted=None):
            writer = records.setdefault(masks is None, AgentRecords(part, masked=masks is not None))
            agents = ml.AgentList.FromString(writer.pack(seen, rewards, ids[lanes], masks, interrupted)).agents
            for lane, agent in zip(lanes, agents, strict=True):
                action = ml.Action(continuous=act.axes[lane].tobytes(), discrete=act.choices[lane].tolist())
                steps.append(ml.DemonstrationStep(agent=agent, action=action))

        everybody = np.arange(arenas)
        note(session.steps[0].observations, np.zeros(arenas), everybody, session.steps[0].masks)
        for _ in range(decisions):
            press_at_random(part.device, act, rng)
            obey_masks(act, session.steps[0], rng)
            (after,) = session.step([act])
            rewards = after.rewards.sum(axis=1)
            if len(after.ended):
                note(after.final_observations, rewards[after.ended], after.ended, None, after.truncated[after.ended])
                ids[after.ended] += arenas
                rewards[after.ended] = 0
            note(after.observations, rewards, everybody, after.masks)
        return session.spec, steps


@pytest.mark.parametrize("game", ["archer", "orchard"])
def test_a_file_of_ml_agents_is_the_same_to_a_policy_as_our_own(simulator, tmp_path, game):
    described, steps = play(simulator, game, tmp_path / "ours", decisions=130)
    file = tmp_path / "theirs.demo"
    file.write_bytes(encode(parameters(described.behaviors[0]), steps))
    ours = load_recorded(next((tmp_path / "ours").iterdir()), None)
    theirs = load_demonstration(file, described)
    assert ours.episodes(0)[0] == theirs.episodes(0)[0] > 0 and "unfinished" in theirs.remark()
    (role,) = list_roles("hybrid", described)
    np.testing.assert_array_equal(rows(role, described, [ours]), rows(role, described, [theirs]))
    ends = [
        sorted(
            (len(one), one.terminated, one.truncated) for part in some.stretches for one in finished_episodes(part, 0)
        )
        for some in (ours, theirs)
    ]
    assert ends[0] == ends[1]


GAME = spec(
    type("Any", (), {"name": "any", "description": "any", "options": (), "version": ""}),
    [
        behavior(
            "agent",
            sensors=[sensor("eye", [2, 2, 3], dtype=np.uint8), sensor("ear", [4])],
            axes=[axis("turn", 0.0, 10.0)],
            branches=[branch("gear", ["low", "middle", "high"]), button("jump")],
        )
    ],
)
(PART,) = GAME.behaviors


def observation(name, shape, values):
    return ml.Observation(name=name, shape=shape, floats=ml.Floats(data=np.asarray(values, "<f4").tobytes()))


def moment(turn=0.0, gear=0, *, done=False, reward=0.0, mask=b"", eye=0, **changes):
    """Return a step in which the agent sees `eye`, after it has turned by `turn` and chosen `gear`."""
    seen = [observation("ear", [4], [eye] * 4), observation("eye", [3, 2, 2], np.full(12, eye / np.float32(255)))]
    given = {"observations": seen, "done": done, "reward": reward, "action_mask": mask} | changes
    action = ml.Action(continuous=np.float32(turn).tobytes(), discrete=[gear, 0])
    return ml.DemonstrationStep(agent=ml.Agent(**given), action=action)


def load(tmp_path, *steps, game=GAME, data=None, **heading):
    file = tmp_path / "any.demo"
    head = ml.DemonstrationHeading(api_version=1, name="any", **heading)
    file.write_bytes(encode(parameters(PART), steps, head) if data is None else data)
    return load_demonstration(file, game)


def test_what_an_agent_did_stands_in_its_next_step(tmp_path):
    demonstration = load(
        tmp_path,
        moment(eye=1),
        moment(-1.0, 1, eye=2, reward=0.5),
        moment(0.5, 2, eye=3, reward=1.0, group_reward=2.0, done=True, interrupted=True),
    )
    ((one,),) = (list(finished_episodes(part, 0)) for part in demonstration.stretches)
    assert one.act.axes[:, 0].tolist() == [0.0, 7.5] and one.act.choices[:, 0].tolist() == [1, 2]
    assert one.observations[0].dtype == np.uint8 and one.observations[0][:, 1, 1, 2].tolist() == [1, 2, 3]
    assert one.observations[1][:, 0].tolist() == [1, 2, 3] and one.rewards[:, 0].tolist() == [0.5, 3.0]
    assert (one.terminated, one.truncated) == (False, True)


def test_a_game_that_a_build_of_unity_is_has_images_of_floats_a_branch_less_and_two_rewards(tmp_path):
    image, vector = np.arange(12.0).reshape(3, 2, 2), np.arange(12.0)
    served = spec(
        type("Any", (), {"name": "any", "description": "any", "options": (), "version": ""}),
        [
            behavior(
                "agent",
                sensors=[sensor("camera", [2, 2, 3]), sensor("grid", [2, 2, 3])],
                branches=[branch("discrete_1", ["0", "1", "2"])],
                channels=[channel("reward"), channel("group_reward")],
            )
        ],
    )
    actions = ml.ActionSpec(discrete_actions=2, branch_sizes=[1, 3])
    seen = [observation("camera", [3, 2, 2], image), observation("grid", [12], vector)]
    steps = [
        ml.DemonstrationStep(
            agent=ml.Agent(observations=seen, done=done, reward=1, group_reward=2, action_mask=bytes([0, 1, 0, 0])),
            action=ml.Action(discrete=[0, 2]),
        )
        for done in (False, True)
    ]
    data = encode(ml.BehaviorParameters(action_spec=actions), steps)
    ((one,),) = (list(finished_episodes(part, 0)) for part in load(tmp_path, data=data, game=served).stretches)
    np.testing.assert_array_equal(one.observations[0][0], image.transpose(1, 2, 0))
    np.testing.assert_array_equal(one.observations[1][0], vector.reshape(2, 2, 3))
    assert one.act.choices.tolist() == [[2]] and one.rewards.tolist() == [[1, 2]]
    assert one.masks is not None and one.masks[0][0].tolist() == [False, True, True]


def test_agents_that_take_turns_in_a_file_are_told_apart_and_unfinished_episodes_left_out(tmp_path):
    steps = [moment(eye=eye, id=eye % 2, done=eye > 3) for eye in range(6)] + [moment(eye=9, id=7), moment(eye=9, id=7)]
    demonstration = load(tmp_path, *steps, moment(id=8))
    seen = [
        one.observations[1][:, 0].tolist() for part in demonstration.stretches for one in finished_episodes(part, 0)
    ]
    assert seen == [[0, 2, 4], [1, 3, 5]]
    assert demonstration.remark().endswith("any.demo: left out: 1 unfinished episode")


def test_masks_are_read_and_obeyed(tmp_path):
    mask = bytes([1, 0, 0, 0, 0])  # 1: forbidden
    ((one,),) = (
        list(finished_episodes(part, 0))
        for part in load(tmp_path, moment(mask=mask), moment(gear=1), moment(done=True)).stretches
    )
    assert one.masks is not None and one.masks[0].tolist() == [[False, True, True], [True] * 3, [True] * 3]
    with pytest.raises(RecordingError, match="branch 'gear' got 'low' in decision 0, which its mask forbids"):
        load(tmp_path, moment(mask=mask), moment(gear=0), moment(done=True))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"observations": [observation("ear", [5], [0] * 5), observation("eye", [3, 2, 2], [0] * 12)]},
            r"it observes \['ear', 'eye'\] of \[\[5\], \[3, 2, 2\]\], expected eye",
        ),
        (
            {"observations": [observation("ear", [4], [0] * 3), observation("eye", [3, 2, 2], [0] * 12)]},
            "ear has 3 values, expected 4",
        ),
        (
            {"observations": [observation("ear", [4], [np.nan] * 4), observation("eye", [3, 2, 2], [0] * 12)]},
            "sensor ear: value nan at",
        ),
        (
            {
                "observations": [
                    ml.Observation(name="ear", shape=[4], compressed=b"x"),
                    observation("eye", [3, 2, 2], [0] * 12),
                ]
            },
            "an observation is compressed; set the compression of its sensor to none",
        ),
        ({"mask": b"\1\1"}, "action_mask has 2 values, expected 5"),
        ({"gear": 3}, r"branch 'gear' got 3 in decision 1, expected 0\.\.2"),
        ({"gear": -1}, "branch 'gear' got -1 in decision 1"),
        ({"turn": np.nan}, "a continuous action is not a number"),
    ],
)
def test_what_does_not_fit_is_named_with_its_episode(tmp_path, change, message):
    with pytest.raises(RecordingError, match=f"any.demo, episode 1: .*{message}"):
        load(tmp_path, moment(), moment(done=True), moment(), moment(), moment(**change), moment(done=True))


def test_another_device_or_behavior_is_named(tmp_path):
    other = spec(
        type("Any", (), {"name": "any", "description": "any", "options": (), "version": ""}),
        [behavior("agent", sensors=[sensor("ear", [4])], axes=[axis("turn")], branches=[])],
    )
    with pytest.raises(
        RecordingError, match=r"has 1 continuous actions and branches of \[3, 2\] choices, expected 1 and"
    ):
        load(tmp_path, moment(), game=other)
    two = spec(
        type("Any", (), {"name": "any", "description": "any", "options": (), "version": ""}),
        [behavior(name, sensors=[sensor("ear", [4])], axes=[axis("turn")]) for name in "ab"],
    )
    with pytest.raises(RecordingError, match="is of the behavior 'agent', expected one of a, b"):
        load(tmp_path, moment(), game=two)
    body = ml.BehaviorParameters(name="agent").SerializeToString()
    with pytest.raises(RecordingError, match=r"it is older than ML-Agents 2\.0; record it again"):
        load(tmp_path, data=encode(parameters(PART), [])[:33] + varint(len(body)) + body)


def test_a_file_that_was_cut_off_anywhere_loses_only_its_end(tmp_path):
    steps = [moment(eye=number, done=number % 3 == 2) for number in range(9)]
    data = encode(parameters(PART), steps)
    begin, known = len(encode(parameters(PART), [])), []
    for size in range(1, len(data), 3):
        if size < begin:
            with pytest.raises(RecordingError, match=r"any\.demo is no demonstration of ML-Agents that can be read"):
                load(tmp_path, data=data[:size])
            continue
        demonstration = load(tmp_path, data=data[:size])
        known.append(demonstration.episodes(0)[0])
        assert re.search(r"any\.demo: left out: .*\d+ steps, which are not in the file", demonstration.remark())
    assert known == sorted(known) and set(known) == {0, 1, 2}
    assert load(tmp_path, data=data).remark() == ""


def test_a_file_that_is_damaged_is_named_or_read(tmp_path):
    data, rng = (
        encode(parameters(PART), [moment(eye=number, done=number == 5) for number in range(6)]),
        np.random.default_rng(0),
    )
    refused = 0
    for place in range(len(data)):
        broken = data[:place] + bytes([data[place] ^ int(rng.integers(1, 256))]) + data[place + 1 :]
        try:
            load(tmp_path, data=broken)
        except RecordingError as error:
            refused += str(tmp_path / "any.demo") in str(error)
    assert refused > len(data) / 10
    with pytest.raises(RecordingError, match=rf"the step at byte {len(data):,} has no observations"):
        load(tmp_path, data=data + bytes(10**7))
    with pytest.raises(RecordingError, match="byte 33 is no size of a message"):
        load(tmp_path, data=data[:33] + b"\xff" * 9)


def test_a_file_of_ml_agents_is_trained_on_and_cannot_be_replayed(simulator, tmp_path, capsys):
    described, steps = play(simulator, "hybrid", tmp_path / "ours", decisions=40)
    (tmp_path / "demos").mkdir()
    file = tmp_path / "demos/any.demo"
    file.write_bytes(encode(parameters(described.behaviors[0]), steps))
    config = tmp_path / "hybrid.yaml"
    config.write_text(
        "game: hybrid\narenas: 4\ntotal_timesteps: 64\nlog_interval: 64\n"
        "policy: {frame_stack: 1, hidden_sizes: [8], rollout_steps: 16, minibatch_size: 32}\n"
    )
    command = ["train", str(config), "--run", str(tmp_path / "run"), "--simulator", simulator]
    assert main([*command, "--demos", str(file.parent)]) == 0
    assert re.search(r"player: \d+ decisions of \d+ episodes are cloned", capsys.readouterr().out)
    assert main(["replay", str(file)]) == 1
    assert f"{file} is a demonstration of ML-Agents, which cannot be repeated" in capsys.readouterr().err
