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
    "recall": "joybridge.games.recall.game:Recall",
    "platform": "joybridge.games.hybrid_suite.platform:Platform",
    "goal": "joybridge.games.hybrid_suite.goal:Goal",
    "hard_goal": "joybridge.games.hybrid_suite.goal:HardGoal",
    "catch_point": "joybridge.games.hybrid_suite.catch_point:CatchPoint",
    "hard_move": "joybridge.games.hybrid_suite.hard_move:HardMove",
    "moving": "joybridge.games.hybrid_suite.moving:Moving",
    "sliding": "joybridge.games.hybrid_suite.moving:Sliding",
}
