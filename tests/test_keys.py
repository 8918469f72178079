"""`joybridge keys` lists every key as it is written, and finds a key by a word or by its name in another library."""

import re

import pytest
from pydantic import BaseModel

from joybridge.cli import main
from joybridge.config.config import Config, load_config
from joybridge.config.keys import INDENT, WIDTH, listing
from joybridge.config.wrong_keys import FORMS

LINES = list(listing())
WRITTEN = [line[:INDENT].strip() for line in LINES if line[0] != " "]


def keys(word):
    return [line.partition("=")[0] for line in listing(word) if line[0] != " "]


def dotted(model, prefix=""):
    for name, value in model:
        yield from dotted(value, f"{prefix}{name}.") if isinstance(value, BaseModel) else [f"{prefix}{name}"]


def test_every_key_is_listed_once_and_no_line_is_too_long():
    known = set(dotted(Config(game="NAME")))
    by_name = {form.partition("=")[0]: key for key, form in FORMS.items()} | {
        "policy.reward_weights.CHANNEL": "policy.reward_weights",
        "opponents.shares.NAME": "opponents.shares",
    }
    listed = [by_name.get(key, key) for key in (written.partition("=")[0] for written in WRITTEN)]
    assert len(listed) == len(set(listed)) and set(listed) == known
    assert max(map(len, LINES)) <= WIDTH


def test_what_is_listed_can_be_written_and_is_the_default(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text("game: NAME")
    overrides = [
        written for written in WRITTEN if written.partition("=")[2] not in ("CHOICE", "VALUE", "WEIGHT", "SHARE")
    ]
    assert load_config(path, overrides) == Config(game="NAME")


@pytest.mark.parametrize(
    ("word", "found"),
    [
        ("minibatch", ["policy.minibatch_size"]),
        ("ent_coef", ["policy.entropy_coef"]),
        ("Schedules", ["total_timesteps", "stop_at"]),
        ("lstm", ["policy.memory.kind", "policy.memory.size", "policy.memory.length"]),
        ("wandb", ["log_to"]),
        ("nothing of the kind", []),
    ],
)
def test_a_word_finds_keys_by_name_by_meaning_and_by_the_name_of_another_library(word, found):
    assert keys(word) == found


@pytest.mark.parametrize(
    ("key", "kind"),
    [
        ("policy.clip_range=0.2", "(number > 0, < 1)"),
        ("policy.hidden_sizes=[100, 100]", "(list of integer ≥ 1, ≤ 65536)"),
        ("policy.autograd=false", "(true or false)"),
        ("accelerator=cpu", "(cpu or cuda)"),
        ("stop_at=null", "(integer ≥ 1 or null)"),
        ("evaluate_during=null", "(keys or null)"),
        ("curriculum=[]", "(list of lessons)"),
        ("parameters.NAME=VALUE", "(number or distribution by name)"),
    ],
)
def test_type_and_range_are_listed(key, kind):
    (entry,) = [entry for entry in re.sub("\n +", " ", "\n".join(LINES)).splitlines() if entry.startswith(f"{key} ")]
    assert entry.endswith(kind)


def test_a_word_that_no_key_has_is_an_error(capsys):
    assert main(["keys", "sensors"]) == 0
    assert capsys.readouterr().out.startswith("policy.sensors=null ")
    assert main(["keys", "tstep"]) == 1
    assert "'tstep' is in the name and meaning of no key" in capsys.readouterr().err
