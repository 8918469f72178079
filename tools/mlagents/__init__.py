"""What `tools.check_mlagents` and `tools.train_mlagents` run under the Python and the packages of ML-Agents."""
