"""Simulators and grids of runs on the nodes of a Ray cluster. Only it imports ray.

It imports `client`, `config` and `compare`. Start with `simulators.py`.
"""
