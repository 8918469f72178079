"""The ground floor: keys of configurations and their files, columns of metrics, whole files, exceptions.

It imports the contract alone, and no torch. `config.py` has all keys of a run.
"""
