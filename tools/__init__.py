"""Programs around the project: checks, benchmarks, plots, the paper's experiments."""
