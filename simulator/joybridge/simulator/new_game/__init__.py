"""`joybridge new`: write.py copies the game in template/ under the author's name."""
