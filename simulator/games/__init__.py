"""The built-in games, one folder each. A new game is a new folder and a line in `BUILT_IN`."""

BUILT_IN = {
    "shooting_birds": "simulator.games.shooting_birds.game:ShootingBirds",
}
