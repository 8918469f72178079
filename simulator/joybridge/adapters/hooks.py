"""What a hook of a pygame program may import.

`look_up("main.player")` returns what a variable of the program holds at the moment, also one that only a running
function has, and None if there is no such variable.
"""

from joybridge.adapters.pygame_programs.inside.variables import look_up

__all__ = ["look_up"]
