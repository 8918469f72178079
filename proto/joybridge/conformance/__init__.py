"""The conformance kit of joybridge.v1: every rule of bridge.proto that can be observed from outside, as a check.

The kit talks to a server over the wire only, so it tests a server in any language. It imports the contract and
nothing else. `rules/` holds one module per family of rules; the modules beside it are what the rules are written with.
"""
