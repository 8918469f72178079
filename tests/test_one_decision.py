"""The path of one decision through the trainer, from the step that arrives to the actions that leave."""

import sys
from contextlib import closing
from pathlib import Path
from types import FrameType
from typing import Any

from joybridge.trainer.actor import make_actors
from joybridge.trainer.config import load_config
from joybridge.trainer.pipeline import collect, group_bounds, open_groups
from joybridge.trainer.policy import Policy
from joybridge.trainer.profiler import Profiler
from joybridge.trainer.wire.client import describe

CONFIG = Path(__file__).parents[1] / "configs" / "shooting_birds" / "bucket-11.yaml"


def test_one_decision_enters_18_files(simulator):
    """Calls in turn into one file count once. The profiler only measures, and so does not count."""
    config = load_config(CONFIG, ["arenas=2", "groups=1"])
    spec = describe(simulator, config.game, config.options)
    (actor,) = make_actors(config, spec)
    policy = Policy(actor, spec.behaviors[actor.behavior], group_bounds(config))
    (group,) = groups = open_groups(config, [simulator], None, {}, {})
    entered = [""]

    def note(frame: FrameType, event: str, argument: Any) -> None:
        _, ours, file = frame.f_code.co_filename.partition("/joybridge/")
        comprehension = frame.f_code.co_name.startswith("<")  # a call in Python 3.11 only
        skipped = comprehension or file in (entered[-1], "trainer/profiler.py", "trainer/pipeline.py")
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
    assert len(entered[1:]) <= 18, entered[1:]
    assert {"trainer/wire/client.py", "trainer/ppo/rollout.py", "contract/local_socket.py"} <= set(entered)
