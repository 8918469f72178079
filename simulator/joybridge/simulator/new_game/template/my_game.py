"""My game: sail over the fish, then cast the net. It can be trained as it is; change it into your own game."""

from joybridge.simulator import Game, axis, behavior, button, sensor, spec, termination, transition, truncation

DECISIONS = 100  # per episode, at most
SPEED = 0.2  # of the boat per decision; the sea reaches from -1 to 1
REACH = 0.15  # of the net, to the left and right of the boat
HOLES = 5  # each cast that misses tears a hole; with this many the net is lost


class MyGame(Game):
    """One arena. The server runs many of them at once, so keep all state in `self`."""

    name = "my_game"
    description = "Sail over the fish, then cast the net."

    @classmethod
    def describe(cls, options):
        """Return the spec: what the agent observes and what it can do. Start your changes here."""
        player = behavior(
            "player",
            # Observation. Each sensor has a name, a shape, bounds and a description.
            sensors=[sensor("fish", [1], -2, 2, "seen from the boat"), sensor("net", [1], 0, 1, "what is left")],
            # Action. An axis is a number from -1 to 1, a button is 0 or 1. Use a `branch` for more than two choices.
            axes=[axis("sail")],
            branches=[button("cast")],
            # Numbers that are reported for each episode, in addition to its reward and length.
            metrics=["caught"],
        )
        # tick_seconds sets the speed of videos; picture is the width and height of what `draw` returns.
        return spec(cls, [player], max_episode_decisions=DECISIONS, tick_seconds=0.1, picture=(480, 320))

    def reset(self):
        """Begin an episode. Draw random numbers from `self.rng` only, so that a seed reproduces the episode."""
        self.decisions, self.caught, self.holes = 0, 0, 0
        self.boat, self.fish, self.cast = 0.0, self.rng.uniform(-1, 1), False
        return transition(self.observe())

    def observe(self):
        """Return the observation: for each sensor its name and a list or array of its shape."""
        return {"fish": [self.fish - self.boat], "net": [1 - self.holes / HOLES]}

    def step(self, action):
        """Advance by one decision. `action` holds the value of each axis and button by name."""
        self.boat = min(1.0, max(-1.0, self.boat + SPEED * action["sail"]))
        self.cast = action["cast"] == 1
        hit = self.cast and abs(self.fish - self.boat) < REACH
        if hit:
            self.caught += 1
            self.fish = self.rng.uniform(-1, 1)
        elif self.cast:
            self.holes += 1
        # The agent learns to maximize the sum of its rewards.
        rewards, metrics = {"reward": 1.0 if hit else -0.25 * self.cast}, {"caught": self.caught}
        self.decisions += 1
        if self.holes == HOLES:  # a terminal state: the game is lost
            return termination(self.observe(), rewards, metrics)
        if self.decisions == DECISIONS:  # a time limit: the game could have continued
            return truncation(self.observe(), rewards, metrics)
        return transition(self.observe(), rewards)

    def draw(self):
        """Return a picture, uint8 [height, width, 3]. Without pictures, delete this method and `picture=`."""
        import pygame  # imported here because only pictures need it

        from joybridge.simulator.render import FINE, block, ellipse, fade, fit, picture, shape, write

        canvas = pygame.Surface((480 * FINE, 320 * FINE))  # drawn larger, then scaled down: smooth edges
        world = fit(*canvas.get_size(), 1.2, 0.8)  # x from -1.2 to 1.2 to the right, y from -0.8 to 0.8 upwards
        fade(canvas, world.box(-1.2, 0.1, 1.2, 0.8), (98, 170, 222), (250, 226, 190))
        shape(canvas, world, ellipse(0.75, 0.45, 0.1, 0.1), (255, 246, 205))
        fade(canvas, world.box(-1.2, -0.8, 1.2, 0.1), (46, 134, 170), (10, 40, 80))
        boat, fish = world.placed(self.boat, 0.1), world.placed(self.fish, -0.4)  # frames with their own (0, 0)
        if self.cast:
            shape(canvas, boat, [(-0.02, 0), (-REACH, -0.6), (REACH, -0.6), (0.02, 0)], (86, 156, 180), (205, 225, 225))
        shape(canvas, fish, [(-0.06, 0), (-0.15, 0.06), (-0.15, -0.06)], (226, 100, 40))
        shape(canvas, fish, ellipse(0, 0, 0.1, 0.055), (250, 140, 60))
        shape(canvas, fish, ellipse(0.06, 0.015, 0.012, 0.012), (30, 30, 40))
        block(canvas, boat, (-0.01, 0, 0.01, 0.4), (90, 60, 40))
        shape(canvas, boat, [(0.02, 0.4), (0.02, 0.1), (0.22, 0.12)], (250, 245, 230))
        shape(canvas, boat, [(-0.2, 0.06), (0.22, 0.06), (0.14, -0.05), (-0.14, -0.05)], (150, 60, 50))
        write(canvas, f"caught {self.caught}   holes {self.holes}", 44, (40, 60, 90), 30, 40)
        return picture(canvas)
