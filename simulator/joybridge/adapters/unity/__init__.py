"""Players of Unity ML-Agents as games: `joybridge serve --unity BUILD`, `joybridge serve --unity-port 5004`.

adapter                the settings and a first look at a player make the spec
game                   the arenas of a session, and the players that play them
player_agents, lanes   the agents of one player; the lanes of one behavior in all players
reader                 a message's agents as arrays
sources                where players come from, and with which seed
player                 a player, from the handshake on, over the communicator
"""
