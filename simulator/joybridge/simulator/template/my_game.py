"""My game: sail over the fish, then cast the net. It trains as it stands; change it into your own."""

from joybridge.simulator.game import Game, axis, behavior, button, sensor, spec, termination, transition, truncation

DECISIONS = 100  # an episode is cut after so many
SPEED = 0.2  # of the boat per decision; the sea reaches from -1 to 1
REACH = 0.15  # of the net, to either side of the boat
HOLES = 5  # with so many the net is lost; each empty cast tears one


class MyGame(Game):
    """One arena. The server plays many of them at once, so keep all that changes in `self`."""

    name = "my_game"
    description = "Sail over the fish, then cast the net."

    @classmethod
    def describe(cls, options):
        """Say what the agent sees and holds. Begin your changes here: everything below follows from it."""
        player = behavior(
            "player",
            # What it sees: of each sensor a name, a shape, the bounds of its numbers, and words for people.
            sensors=[sensor("fish", [1], -2, 2, "seen from the boat"), sensor("net", [1], 0, 1, "what is left")],
            # What it holds: axes are numbers from -1 to 1, buttons are 0 or 1; a `branch` has more choices than two.
            axes=[axis("sail")],
            branches=[button("cast")],
            # What is reported of each episode, beside its reward and length.
            metrics=["caught"],
        )
        # tick_seconds: how long a decision is for those who watch. picture: width and height of what `draw` returns.
        return spec(cls, [player], max_episode_decisions=DECISIONS, tick_seconds=0.1, picture=(480, 320))

    def reset(self):
        """Begin an episode. All chance must come from `self.rng`: then the same seed plays the same game."""
        self.decisions, self.caught, self.holes = 0, 0, 0
        self.boat, self.fish, self.cast = 0.0, self.rng.uniform(-1, 1), False
        return transition(self.observe())

    def observe(self):
        """Return what each sensor shows: its name, and a list or an array of its shape."""
        return {"fish": [self.fish - self.boat], "net": [1 - self.holes / HOLES]}

    def step(self, action):
        """Play one decision; `action` has the number of each axis and button by name."""
        self.boat = min(1.0, max(-1.0, self.boat + SPEED * action["sail"]))
        self.cast = action["cast"] == 1
        hit = self.cast and abs(self.fish - self.boat) < REACH
        if hit:
            self.caught += 1
            self.fish = self.rng.uniform(-1, 1)
        elif self.cast:
            self.holes += 1
        # What you pay for is what you get: the agent learns to make the sum of its rewards as large as it can.
        rewards, metrics = {"reward": 1.0 if hit else -0.25 * self.cast}, {"caught": self.caught}
        self.decisions += 1
        if self.holes == HOLES:  # lost: nothing can follow
            return termination(self.observe(), rewards, metrics)
        if self.decisions == DECISIONS:  # merely cut off: it could have gone on
            return truncation(self.observe(), rewards, metrics)
        return transition(self.observe(), rewards)

    def draw(self):
        """Return a picture, uint8 [height, width, 3]. Leave this and `picture=` out if nobody is to watch."""
        import pygame  # here, because only pictures need it

        from joybridge.simulator.render import FINE, block, ellipse, fade, fit, picture, shape, write

        canvas = pygame.Surface((480 * FINE, 320 * FINE))  # painted too large and then shrunk: smooth edges
        world = fit(*canvas.get_size(), 1.2, 0.8)  # half of what is seen of the world: x to the right, y up
        fade(canvas, world.box(-1.2, 0.1, 1.2, 0.8), (98, 170, 222), (250, 226, 190))
        shape(canvas, world, ellipse(0.75, 0.45, 0.1, 0.1), (255, 246, 205))
        fade(canvas, world.box(-1.2, -0.8, 1.2, 0.1), (46, 134, 170), (10, 40, 80))
        boat, fish = world.placed(self.boat, 0.1), world.placed(self.fish, -0.4)  # frames: (0, 0) is where they are
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
