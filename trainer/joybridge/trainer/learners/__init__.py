"""Learners beside the trainer: processes that share its updates, here or on the nodes of a Ray cluster."""
