"""A hook for xboing: an episode is one ball, and a paddle that is below the ball while it falls is paid."""

from joybridge.adapters.hooks import look_up

REACH = 120  # pixels, beyond which nothing is paid


def done(program):
    """Return whether one of the three balls is lost."""
    state = look_up("run.self.game_state")
    return state is not None and state.lives < 3


def reward(program):
    """Return up to 1 for a paddle below a ball; nothing while the ball lies on it."""
    balls, paddle = look_up("run.self.ball_manager"), look_up("run.self.paddle")
    falling = [ball for ball in balls.balls if ball.vy > 0 and not ball.stuck_to_paddle] if balls else []
    apart = min((abs(ball.x - paddle.rect.centerx) for ball in falling), default=REACH)
    return {"near": max(0.0, 1.0 - apart / REACH)}
