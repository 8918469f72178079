"""The trainer's side of the wire: client, event loop, sessions at several simulators, starting a simulator."""
