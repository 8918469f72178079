"""Scripts with the limits of a person play programs through the page of `joybridge play`."""
