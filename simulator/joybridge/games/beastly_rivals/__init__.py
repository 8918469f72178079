"""Beastly Rivals Onslaught: lead a character with a cursor, away from a beast."""
