"""Generated code of `joybridge.v1`; see bridge.proto, whose comments are the manual."""
