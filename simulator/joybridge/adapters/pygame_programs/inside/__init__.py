"""What surrounds a pygame program in its process: clock, hands, frames, sounds, chance and fences, all virtual.

Each module has a class whose constructor puts functions in the place of those of pygame and Python, so all of them are
made before the program is imported.
"""
