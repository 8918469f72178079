"""The connection to simulators: client, event loop, sessions over several simulators, starting a simulator."""
