"""The path of one decision through the trainer, from the step that arrives to the actions that leave."""

import sys
from contextlib import closing
from pathlib import Path
from types import FrameType
from typing import Any

from joybridge.client.client import describe
from joybridge.config.config import load_config
from joybridge.policy.actor import make_actors
from joybridge.policy.policy import Policy
from joybridge.run.collect import collect, group_bounds, open_groups
from joybridge.run.profiler import Profiler

CONFIG = Path(__file__).parents[1] / "configs" / "shooting_birds" / "bucket-11.yaml"


def test_one_decision_enters_18_files(simulator):
    """Calls in turn into one file count once. The profiler only measures, and so does not count."""
    config = load_config(CONFIG, ["arenas=2", "pipeline_groups=1"])
    spec = describe(simulator, config.game, config.options)
    (actor,) = make_actors(config, spec)
    policy = Policy(actor, spec.behaviors[actor.behavior], group_bounds(config))
    (group,) = groups = open_groups(config, [simulator], None, {}, {})
    entered = [""]

    def note(frame: FrameType, event: str, argument: Any) -> None:
        _, ours, file = frame.f_code.co_filename.partition("/joybridge/")
        comprehension = frame.f_code.co_name.startswith("<")  # a call in Python 3.11 only
        skipped = comprehension or file in (entered[-1], "run/profiler.py", "run/collect.py")
        if event == "call" and ours and not skipped:
            entered.append(file)

    with closing(group.session):
        policy.begin([group.session.steps])
        playing = collect(groups, [policy], Profiler(), steps=3)
        next(playing)
        try:
            sys.setprofile(note)
            next(playing)
        finally:
            sys.setprofile(None)
        list(playing)
    assert len(entered[1:]) <= 18, " ".join(entered[1:])
    assert {"client/client.py", "ppo/rollout.py", "contract/local_socket.py"} <= set(entered)
