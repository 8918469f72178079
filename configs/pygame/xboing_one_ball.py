"""A hook for xboing: an episode ends when its first ball is lost."""

from joybridge.adapters.hooks import look_up


def done(program):
    """Return whether one of the three balls is lost."""
    state = look_up("run.self.game_state")
    return state is not None and state.lives < 3
