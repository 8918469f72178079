"""`python -m joybridge`: the same as the command `joybridge`."""

from joybridge.cli import run

run()
