"""What `python -m simulator new` writes, under the name that its author gives it."""
