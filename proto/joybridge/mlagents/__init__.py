"""The wire of Unity ML-Agents, which its players and its trainers speak: messages, versions, side channels.

communicator.proto has the messages. The modules here belong to both directions: our games under a trainer of ML-Agents
(`joybridge mlagents`), and players of ML-Agents under our trainer (`joybridge serve --unity`).
"""
