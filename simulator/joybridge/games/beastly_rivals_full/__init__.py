"""The complete Beastly Rivals Onslaught: two to eight players pass a ball, and a beast hunts who has it."""
