"""`joybridge mlagents`: a game under a trainer of ML-Agents. It plays the part of the Unity player. No torch."""
