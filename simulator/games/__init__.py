"""The built-in games, one folder each. A new game is a new folder and a line in `BUILT_IN`."""

BUILT_IN = {
    "beastly_rivals": "simulator.games.beastly_rivals.game:BeastlyRivals",
    "shooting_birds": "simulator.games.shooting_birds.game:ShootingBirds",
    "ferry": "simulator.games.ferry.game:Ferry",
    "orchard": "simulator.games.orchard.game:Orchard",
    "marble": "simulator.games.marble.game:Marble",
    "archer": "simulator.games.archer.game:Archer",
    "noughts": "simulator.games.noughts.game:Noughts",
}
