"""What `joybridge new` writes, under the name that its author gives it."""
