"""Demonstrations in the formats of others: datasets of Minari, and files of ML-Agents."""
