"""What a run prints while it goes on: its heading once, rows of metrics, and a line by time where rows are rare."""

import pytest

from joybridge.config.metrics import ACTIVITIES
from joybridge.run import progress

LIVE = {"timesteps_per_second": 3.25, **dict.fromkeys(ACTIVITIES, 0.25)}
ROW = LIVE | {"timesteps": 800, "seconds": 9.0, "episodes": 2, "reward": 1.5, "length": 7.0, "hits": 3.0}


@pytest.mark.parametrize("silence", [-1.0, 1e9])
def test_a_game_too_slow_for_rows_gets_a_line_by_time_where_output_is_no_terminal(silence, capsys, monkeypatch):
    monkeypatch.setattr(progress, "SILENCE_SECONDS", silence)
    with progress.Display("run x: 0 of 900 timesteps done", "hybrid", 900, 0) as display:
        assert capsys.readouterr().out == ""  # what the run refuses comes without the heading
        for timesteps in (0, 80):
            display.report(timesteps, LIVE, None)
        for timesteps in (400, 800):
            display.report(timesteps, ROW, ROW)
    heading, *lines, first, row = capsys.readouterr().out.splitlines()
    assert heading == "run x: 0 of 900 timesteps done"
    if silence < 0:
        assert lines[1] == "         80  3.2 timesteps/s  (simulate 25 % wire 25 % act 25 % learn 25 %)"
    else:
        assert lines == []
    assert row.startswith("        800  reward 1.5  length 7  hits 3  ") and "seconds" not in row
    assert "min left" not in first and row.endswith("learn 25 %); about 1 min left")  # it had compiled something


@pytest.mark.parametrize(
    ("reward", "text"), [(0.0, "0.0"), (0.0312, "0.031"), (-0.004, "-0.004"), (0.25, "0.2"), (137.62, "137.6")]
)
def test_a_small_reward_does_not_read_as_nothing(reward, text):
    row = ROW | {"reward": reward, "held_out_reward": reward}
    assert progress.row_text(row).startswith(f"reward {text}  length 7  held out {text}  ")
