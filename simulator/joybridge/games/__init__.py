"""The built-in games, one folder each. To add one, add its folder and a line in `BUILT_IN`."""

BUILT_IN = {
    "beastly_rivals": "joybridge.games.beastly_rivals.game:BeastlyRivals",
    "beastly_rivals_full": "joybridge.games.beastly_rivals_full.game:BeastlyRivalsFull",
    "shooting_birds": "joybridge.games.shooting_birds.game:ShootingBirds",
    "ferry": "joybridge.games.ferry.game:Ferry",
    "orchard": "joybridge.games.orchard.game:Orchard",
    "marble": "joybridge.games.marble.game:Marble",
    "archer": "joybridge.games.archer.game:Archer",
    "noughts": "joybridge.games.noughts.game:Noughts",
}
