"""What `tools.check_mlagents` runs under the Python and the packages of ML-Agents."""
