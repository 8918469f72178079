"""Beastly Rivals Onslaught: a character led by a cursor, a beast that hunts it, and a sphere that slows."""
