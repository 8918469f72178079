"""Demonstrations become datasets of Minari, and datasets of Minari become demonstrations."""

import json
import re
from pathlib import Path

import gymnasium
import h5py
import minari
import numpy as np
import pytest
from gymnasium import spaces
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage

from joybridge.adapters.spaces import AgentSpaces
from joybridge.cli import main
from joybridge.client.client import Session
from joybridge.client.recording import RecordingError
from joybridge.config.config import Config
from joybridge.config.policy_config import PolicyConfig
from joybridge.demonstrations.cloning import targets
from joybridge.demonstrations.episodes import Episode, finished_episodes, join_episodes
from joybridge.demonstrations.files import find_demonstrations, load_demonstration
from joybridge.demonstrations.recorded import load_recorded
from joybridge.gym.observer import Observer
from joybridge.layouts import list_roles
from joybridge.minari import reading, writing
from joybridge.policy.actor import Actor
from joybridge.policy.encoder import ObservationEncoder
from joybridge.simulator import axis, behavior, button, sensor, spec
from tests.support.demonstrated import record

pytestmark = pytest.mark.usefixtures("signals")

CONFIG = PolicyConfig(frame_stack=3, hidden_sizes=[8])


def rows(role, game, demonstrations):
    """Return what a policy clones, one row per decision, in an order of their own."""
    actor = Actor(role, game.behaviors[role.behavior], CONFIG, 0)
    learned, _, _ = targets(actor, demonstrations, Config(game="any", layout="hybrid"))
    assert learned is not None
    parts = [learned.observations.numbers, learned.continuous, learned.discrete, learned.masks]
    table = np.hstack([part.flatten(1).double().numpy() for part in parts if part is not None])
    return table[np.lexsort(table.T)]


@pytest.fixture(scope="module")
def exported(simulator, tmp_path_factory):
    """Return the folder of a game's demonstrations and that of its datasets, by the name of the game."""
    folder = tmp_path_factory.mktemp("minari")
    for game, decisions in (("hybrid", 40), ("ferry", 300), ("noughts", 40), ("orchard", 70)):
        record(folder / game / "demos", simulator, game, decisions, arenas=3)
        assert main(["minari", str(folder / game / "demos"), str(folder / game / "datasets")]) == 0
    return {game.name: (game / "demos", game / "datasets") for game in folder.iterdir()}


# ---------------------------------------------------------------------------------------------------------- export


@pytest.mark.parametrize("game", ["hybrid", "ferry", "noughts", "orchard"])
def test_what_is_exported_and_imported_is_the_same_to_a_policy(exported, game):
    demos, datasets = exported[game]
    ours = [load_recorded(file, None) for file in find_demonstrations(demos)]
    described = ours[0].spec
    theirs = [load_demonstration(file, described) for file in find_demonstrations(datasets)]
    assert len(theirs) == len(described.behaviors)
    for role in list_roles("hybrid", described):
        np.testing.assert_array_equal(rows(role, described, ours), rows(role, described, theirs))
    for index, _ in enumerate(described.behaviors):
        paid = [
            sorted(
                one.rewards.tolist()
                for found in some
                for part in found.stretches
                for one in finished_episodes(part, index)
            )
            for some in (ours, theirs)
        ]
        assert paid[0] == paid[1] != []


def test_the_only_channel_of_a_game_is_read_without_its_weight(exported):
    ours = load_recorded(next(iter(find_demonstrations(exported["hybrid"][0]))), None)
    part = ours.spec.behaviors[0]
    del part.channels[1:]
    part.channels[0].default_weight = 0.1
    episode = next(one for stretch in ours.stretches for one in finished_episodes(stretch, 0))
    episode = Episode(**(episode._asdict() | {"rewards": episode.rewards[:, :1]}))
    (written,) = writing._buffers(part, [episode])
    np.testing.assert_array_equal(written.rewards, episode.rewards[:, 0] * np.float32(0.1))
    np.testing.assert_array_equal(reading._rewards(written.rewards, written.infos["rewards"], part), episode.rewards)
    part.channels.add(name="style")  # which the game did not have then
    read = reading._rewards(written.rewards, written.infos["rewards"], part)
    np.testing.assert_array_equal(read, np.c_[episode.rewards, np.zeros(len(read), np.float32)])


@pytest.mark.parametrize("game", ["hybrid", "ferry", "noughts", "orchard"])
def test_minari_reads_what_is_exported(exported, simulator, game, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(exported[game][1]))
    with Session(simulator, game, arenas=1, seed=0) as session:
        described = session.spec
    listed = minari.list_local_datasets()
    assert set(listed) == {f"{game}/{one.name}-v0" for one in described.behaviors}
    for one in described.behaviors:
        dataset = minari.load_dataset(f"{game}/{one.name}-v0")
        encoder = ObservationEncoder(one.name, one, None, {})
        assert dataset.observation_space == Observer(encoder, one, 1, 1, flatten=False).space
        for episode in dataset:
            assert not (episode.terminations | episode.truncations)[:-1].any()
            assert episode.terminations[-1] != episode.truncations[-1]
            for number in range(len(episode)):
                seen = {name: values[number] for name, values in episode.observations.items()}
                act = episode.actions
                act = {k: v[number] for k, v in act.items()} if isinstance(act, dict) else act[number]
                assert dataset.observation_space.contains(seen) and dataset.action_space.contains(act)
            if one.metrics:
                (noted,) = dataset.storage.get_episode_metadata([episode.id])
                assert set(noted["metrics"]) == {metric.name for metric in one.metrics}


def test_a_dataset_that_is_there_is_not_overwritten(exported, capsys):
    demos, datasets = exported["hybrid"]
    before = {file: file.read_bytes() for file in datasets.rglob("*") if file.is_file()}
    assert main(["minari", str(demos), str(datasets)]) == 1
    assert "is there already; name another folder, or delete it" in capsys.readouterr().err
    assert before == {file: file.read_bytes() for file in datasets.rglob("*") if file.is_file()}


def test_an_export_that_fails_leaves_nothing_that_looks_like_a_dataset(exported, tmp_path, monkeypatch, capsys):
    def full(self, episodes):
        raise OSError(28, "No space left on device", "main_data.hdf5")

    monkeypatch.setattr("minari.dataset._storages.hdf5_storage.HDF5Storage.update_episodes", full)
    assert main(["minari", str(exported["hybrid"][0]), str(tmp_path)]) == 1
    assert "cannot write main_data.hdf5: No space left on device" in capsys.readouterr().err
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []


def test_an_export_of_nothing_says_so(tmp_path, simulator, capsys):
    assert main(["minari", str(tmp_path), str(tmp_path / "datasets")]) == 1
    assert f"{tmp_path} holds no file *.demo" in capsys.readouterr().err
    record(tmp_path, simulator, decisions=1)
    assert main(["minari", str(tmp_path), str(tmp_path / "datasets")]) == 1
    assert "holds no decision of a finished episode; nothing is written" in capsys.readouterr().err


# ---------------------------------------------------------------------------------------------------------- import


def test_a_dataset_is_cloned_by_a_run_that_resumes_and_cannot_be_replayed(exported, simulator, tmp_path, capsys):
    _, datasets = exported["hybrid"]
    file, run = tmp_path / "hybrid.yaml", tmp_path / "run"
    file.write_text(
        "game: hybrid\narenas: 4\ntotal_timesteps: 128\nlog_interval: 64\n"
        "policy: {frame_stack: 1, hidden_sizes: [8], rollout_steps: 16, minibatch_size: 32}\n"
    )
    command = ["train", str(file), "--run", str(run), "--simulator", simulator, "--demos", str(datasets)]
    assert main([*command, "stop_at=64"]) == 0
    assert re.search(r"player: \d+ decisions of \d+ episodes are cloned", capsys.readouterr().out)
    assert (run / "demonstrations.sha256").read_text().endswith("  hybrid/player-v0/data/main_data.hdf5\n")
    assert main([*command, "--resume"]) == 0
    for place in (datasets / "hybrid/player-v0", datasets / "hybrid/player-v0/data/main_data.hdf5"):
        assert main(["replay", str(place)]) == 1
        assert f"{place} is a dataset of Minari, which cannot be repeated" in capsys.readouterr().err


def described(observation_space, action_space):
    """Return the spec of the game that an environment with these spaces is, and its spaces."""
    agent = AgentSpaces(observation_space, action_space)
    game = type("Any", (), {"name": "any", "description": "any", "options": (), "version": ""})
    return spec(game, [behavior("agent", sensors=agent.sensors, axes=agent.axes, branches=agent.branches)]), agent


def columns(rows):
    """Return observations or actions as Minari wants them: parts first, then time."""
    first = rows[0]
    if isinstance(first, dict):
        return {key: columns([row[key] for row in rows]) for key in first}
    if isinstance(first, tuple):
        return tuple(columns([row[index] for row in rows]) for index in range(len(first)))
    return np.array(rows)


def write(folder, observation_space, action_space, *episodes, **infos):
    """Write a dataset of Minari, as its users have them; return its file."""
    folder = folder / "any" / "agent-v0"
    folder.mkdir(parents=True)
    storage = MinariStorage.new(folder / "data", observation_space, action_space)
    storage.update_metadata({"dataset_id": "any/agent-v0", "minari_version": minari.__version__})
    storage.update_episodes(
        EpisodeBuffer(
            observations=columns(seen),
            actions=columns(acts),
            rewards=np.ones(len(acts)),
            infos=infos or None,
            terminations=np.arange(len(acts)) == len(acts) - 1,
            truncations=np.zeros(len(acts), bool),
        )
        for seen, acts in episodes
    )
    return folder / "data/main_data.hdf5"


BOX = spaces.Box(-1.0, 1.0, (3,), np.float64)


@pytest.mark.parametrize(
    ("observation_space", "action_space"),
    [
        (BOX, spaces.Discrete(3, start=1)),
        (spaces.Discrete(5, start=2), spaces.Box(np.array([-2.0, 0.1]), np.array([2.0, 0.7]), dtype=np.float64)),
        (spaces.MultiDiscrete([3, 2]), spaces.MultiDiscrete([2, 3, 4])),
        (spaces.Box(0, 255, (40, 40, 3), np.uint8), spaces.MultiBinary(3)),
        (
            spaces.Dict(arm=spaces.Dict(speed=BOX, on=spaces.MultiBinary(2)), place=spaces.Discrete(4)),
            spaces.Dict(turn=spaces.Box(-1.0, 1.0, (2, 2)), gear=spaces.Discrete(3), more=spaces.Tuple([BOX])),
        ),
        (spaces.Tuple([BOX, spaces.Discrete(2)]), spaces.Tuple([spaces.Discrete(2), BOX])),
        (spaces.Box(-5, 5, (), np.int64), spaces.Box(-3, 3, (1,), np.int32)),
    ],
    ids=lambda space: type(space).__name__,
)
def test_a_dataset_fits_the_game_that_its_environment_is(tmp_path, observation_space, action_space):
    observation_space.seed(1), action_space.seed(1)
    game, agent = described(observation_space, action_space)
    lengths = (4, 1, 7)
    episodes = [
        ([observation_space.sample() for _ in range(n + 1)], [action_space.sample() for _ in range(n)]) for n in lengths
    ]
    demonstration = load_demonstration(write(tmp_path, observation_space, action_space, *episodes), game)
    image = isinstance(observation_space, spaces.Box) and observation_space.dtype == np.uint8  # stored as JPEG
    found = [one for part in demonstration.stretches for one in finished_episodes(part, 0)]
    assert demonstration.episodes(0) == (3, 0) and demonstration.remark() == ""
    for one, (seen, acts) in zip(found, sorted(episodes, key=lambda pair: len(pair[1])), strict=True):
        for index, part in enumerate(game.behaviors[0].sensors):
            wanted = np.array([agent.observe(row)[part.name] for row in seen])
            if image:
                assert one.observations[index].shape == wanted.shape and one.observations[index].dtype == np.uint8
            else:
                np.testing.assert_array_equal(one.observations[index], wanted.astype(one.observations[index].dtype))
        names = [*(one.name for one in agent.axes), *(one.name for one in agent.branches)]
        for number, act in enumerate(acts):
            values = [*one.act.axes[number], *one.act.choices[number].tolist()]
            again = agent.act(dict(zip(names, values, strict=True)))
            assert str(columns([again])) == str(columns([act])) or np.allclose(flat(again), flat(act))


def flat(act):
    """Return the numbers of an action."""
    if isinstance(act, dict):
        act = tuple(act.values())
    return np.concatenate([flat(part) for part in act]) if isinstance(act, tuple) else np.ravel(act)


def test_a_dataset_of_cartpole_fits_the_game_cartpole(tmp_path):
    env = gymnasium.make("CartPole-v1")
    game, _ = described(env.observation_space, env.action_space)
    episodes = []
    for seed in range(5):
        seen, acts, over = [env.reset(seed=seed)[0]], [], False
        while not over:
            acts.append(int(seen[-1][2] > 0))
            observation, _, *ends, _ = env.step(acts[-1])
            seen.append(observation)
            over = any(ends)
        episodes.append((seen, acts))
    file = write(tmp_path, env.observation_space, env.action_space, *episodes)
    (role,) = list_roles("hybrid", game)
    actor = Actor(role, game.behaviors[0], PolicyConfig(frame_stack=1, hidden_sizes=[8]), 0)
    learned, remark, _ = targets(actor, [load_demonstration(file, game)], Config(game="any", layout="hybrid"))
    assert learned is not None
    assert f"{sum(len(acts) for _, acts in episodes)} decisions of 5 episodes are cloned" in remark
    np.testing.assert_array_equal(learned.discrete[:, 0], learned.observations.numbers[:, 2] > 0)


def test_masks_who_decides_and_what_is_demonstrated_are_read(tmp_path):
    game, _ = described(BOX, spaces.Discrete(3))
    mask = np.array([[1, 0, 1], [0, 1, 1], [1, 1, 1]], np.int8)
    file = write(
        tmp_path,
        BOX,
        spaces.Discrete(3),
        ([BOX.sample()] * 3, [0, 1]),
        action_mask=mask,
        deciding=np.array([True, False, True]),
        demonstrated=np.array([False, True, True]),
    )
    (stretch,) = load_demonstration(file, game).stretches
    for number, (before,) in enumerate(stretch.steps[:2]):
        assert before.masks is not None and before.deciding is not None
        assert (before.masks[0][0] == mask[number]).all() and before.deciding.tolist() == [number == 0]
    assert stretch.held == [[[]], [[0]]]


GAME, _ = described(spaces.Dict(eye=BOX), spaces.Dict(go=spaces.Box(-1, 1, (1,)), jump=spaces.Discrete(2)))


@pytest.mark.parametrize(
    ("observation_space", "action_space", "message"),
    [
        (
            spaces.Dict(eye=BOX, ear=BOX),
            GAME,
            r"it observes ear Box\(-1.0, 1.0, \(3,\), float64\), eye .*, expected "
            r"the sensors eye \[3\] float32",
        ),
        (spaces.Box(-1, 1, (4,)), GAME, r"it observes observation Box\(-1.0, 1.0, \(4,\), float32\), expected"),
        (spaces.Text(5), GAME, "it observes observation Text"),
        (
            BOX,
            spaces.Discrete(2),
            r"its actions are Discrete\(2\), expected the axes go -1..1 and the branches jump "
            "with 2 choices",
        ),
        (BOX, spaces.Dict(go=spaces.Box(-1, 2, (1,)), jump=spaces.Discrete(2)), r"its actions are Dict\(.*, expected"),
        (BOX, spaces.Dict(go=spaces.Box(-1, 1, (1,)), jump=spaces.Discrete(3)), r"its actions are Dict\(.*, expected"),
        (BOX, spaces.Dict(go=spaces.Box(-1, 1, (1,)), jump=spaces.Text(3)), "jump Text.* is neither an axis nor"),
    ],
)
def test_spaces_that_do_not_fit_are_named_with_those_that_would(tmp_path, observation_space, action_space, message):
    if action_space is GAME:
        action_space = spaces.Dict(go=spaces.Box(-1, 1, (1,)), jump=spaces.Discrete(2))
    file = write(tmp_path, observation_space, action_space)
    with pytest.raises(RecordingError, match=f"^{re.escape(str(file.parent))} does not fit agent: {message}"):
        load_demonstration(file, GAME)


NUMBER = spaces.Box(-1.0, 1.0, (1,))


@pytest.mark.parametrize(
    ("seen", "acts", "infos", "message"),
    [
        ([0, np.nan, 0], [0, 0], {}, "value nan at"),
        ([0, 0, 0], [0, 1.5], {}, "axis 'action' got 1.5 in decision 1, expected -1..1"),
        ([0, 0, 0], [0, np.inf], {}, "value inf at"),
        ([0, 0], [0, 0], {}, r"shape is \[2, 1\], expected \[3, 1\]"),
        ([0, 0, 0], [0, 0], {"deciding": np.ones(2, bool)}, r"deciding is \[2\], expected \[3\]"),
    ],
)
def test_what_an_episode_may_not_hold_is_named_with_its_number(tmp_path, seen, acts, infos, message):
    game, _ = described(NUMBER, NUMBER)
    fine = ([[0.0]] * 3, [[0.0]] * 2)
    file = write(tmp_path, NUMBER, NUMBER, fine, ([[one] for one in seen], [[one] for one in acts]), **infos)
    number = 0 if infos else 1
    with pytest.raises(RecordingError, match=f"^{re.escape(str(file.parent))}, episode {number}: .*{message}"):
        load_demonstration(file, game)


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        (np.zeros((3, 3), bool), "branch 'action' got '1' in decision 0, which its mask forbids"),
        (np.ones((3, 2), bool), r"action_mask is \[3, 2\], expected \[3, 3\], one flag per choice"),
    ],
)
def test_masks_that_contradict_what_was_done_are_named(tmp_path, mask, message):
    game, _ = described(BOX, spaces.Discrete(3))
    file = write(tmp_path, BOX, spaces.Discrete(3), ([BOX.sample()] * 3, [1, 1]), action_mask=mask)
    with pytest.raises(RecordingError, match=message):
        load_demonstration(file, game)


def test_a_dataset_that_would_read_elsewhere_or_run_code_is_refused(tmp_path):
    game, _ = described(NUMBER, NUMBER)
    file = write(tmp_path, NUMBER, NUMBER, ([[0.0]] * 3, [[0.0]] * 2))
    with h5py.File(file, "a") as data:
        data["episode_0/infos"] = h5py.ExternalLink(str(tmp_path / "other.hdf5"), "/")
    with pytest.raises(RecordingError, match="episode_0/infos is a link"):
        load_demonstration(file, game)
    note = file.with_name("metadata.json")
    metadata = json.loads(note.read_text())
    del metadata["action_space"]  # so that Minari would make the environment
    metadata["env_spec"] = json.dumps({"id": "Any-v0", "entry_point": "os:abort", "kwargs": {}})
    note.write_text(json.dumps(metadata))
    with pytest.raises(RecordingError, match="names no action_space"):
        load_demonstration(file, game)
    note.write_text(json.dumps(metadata | {"data_format": "arrow"}))
    with pytest.raises(RecordingError, match="has the format 'arrow', expected hdf5"):
        load_demonstration(file, game)


@pytest.mark.promise("X6")
def test_a_dataset_that_is_too_large_is_refused_before_it_is_read(tmp_path, monkeypatch):
    game, _ = described(NUMBER, NUMBER)
    file = write(tmp_path, NUMBER, NUMBER, ([[0.0]] * 3, [[0.0]] * 2))
    with h5py.File(file, "a") as data:
        data.create_dataset("episode_0/infos/hollow", (10**8,), np.uint8, chunks=True)  # no byte of it
    assert file.stat().st_size < 100_000
    with pytest.raises(RecordingError, match="hollow has 100,000,000 bytes, almost none of which are in the file"):
        load_demonstration(file, game)
    with h5py.File(file, "a") as data:
        del data["episode_0/infos/hollow"]
        for number in range(6):  # none of them is suspicious
            data.create_dataset(f"episode_0/infos/{number}", data=np.zeros(10**5, np.uint8))
    monkeypatch.setattr(reading, "MAX_ARRAYS_BYTES", 500_000)
    with pytest.raises(RecordingError, match=r"600,\d+ bytes of arrays, expected at most 500,000; split the dataset"):
        load_demonstration(file, game)


def refusal(file, game):
    """Return what is said of a dataset that is refused, None if it is not."""
    try:
        load_demonstration(file, game)
    except RecordingError as error:
        return str(error)
    return None


def test_a_dataset_that_is_damaged_anywhere_is_named_or_read(exported, simulator, tmp_path):
    with Session(simulator, "hybrid", arenas=1, seed=0) as session:
        game = session.spec
    (whole,) = find_demonstrations(exported["hybrid"][1])
    file = tmp_path / "data/main_data.hdf5"
    file.parent.mkdir()
    rng, refused = np.random.default_rng(0), 0
    for name in ("metadata.json", "main_data.hdf5"):
        data = whole.with_name(name).read_bytes()
        file.write_bytes(whole.read_bytes())
        for place in rng.integers(0, len(data), 8):
            for broken in (data[:place], data[:place] + bytes([data[place] ^ 0x41]) + data[place + 1 :]):
                file.with_name("metadata.json").write_bytes(whole.with_name("metadata.json").read_bytes())
                file.with_name(name).write_bytes(broken)
                said = refusal(file, game)
                assert said is None or str(file.parent) in said
                refused += said is not None
    assert refused >= 16


def test_a_dataset_of_another_game_or_behavior_is_named(exported, simulator, tmp_path):
    (file,) = find_demonstrations(exported["hybrid"][1])
    with Session(simulator, "ferry", arenas=1, seed=0) as session:
        ferry = session.spec
    with pytest.raises(RecordingError, match="is of the game hybrid, expected ferry; name another folder"):
        load_demonstration(file, ferry)
    file = write(tmp_path, NUMBER, NUMBER, ([[0.0]] * 3, [[0.0]] * 2))
    with pytest.raises(RecordingError, match=r"is a dataset of agent, expected one of the behaviors .*; give it an ID"):
        load_demonstration(file, ferry)


def test_names_that_cannot_stand_in_a_dataset_are_refused(tmp_path, monkeypatch, capsys):
    game = type("Any", (), {"name": "any", "description": "any", "options": (), "version": ""})
    odd = spec(game, [behavior("agent", sensors=[sensor("a/b", [1])], axes=[axis("x")], branches=[button("y")])])
    shown = type("Shown", (), {"spec": odd, "stretches": [], "remark": lambda self: ""})()
    monkeypatch.setattr("joybridge.minari.writing.load_recorded", lambda file, spec: shown)
    (tmp_path / "one.demo").touch()
    assert main(["minari", str(tmp_path), str(tmp_path / "out")]) == 1
    assert "agent: 'a/b' cannot be a name in a dataset; rename it in the game" in capsys.readouterr().err


def test_without_minari_the_command_to_install_it_is_named(exported, simulator, monkeypatch, capsys):
    demos, datasets = exported["hybrid"]
    monkeypatch.setitem(__import__("sys").modules, "minari", None)
    assert main(["minari", str(demos), str(datasets)]) == 2
    assert "pip install 'joybridge[minari]'" in capsys.readouterr().err
    (file,) = find_demonstrations(datasets)
    with pytest.raises(Exception, match=r"needs the module minari; install it with `pip install 'joybridge\[minari\]'"):
        load_demonstration(file, load_recorded(next(Path(demos).iterdir()), None).spec)


def test_episodes_of_many_lengths_fill_several_stretches(exported):
    (file,) = find_demonstrations(exported["hybrid"][0])
    ours = load_recorded(file, None)
    episodes = [one for part in ours.stretches for one in finished_episodes(part, 0)]
    joined = list(join_episodes(episodes * 60, ours.spec, 0))
    assert len(joined) > 1
    again = [one for part in joined for one in finished_episodes(part, 0)]
    assert sorted(map(len, again)) == sorted(map(len, episodes * 60))
