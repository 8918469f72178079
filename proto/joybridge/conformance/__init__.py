"""The conformance kit of joybridge.v1: a check for every rule of bridge.proto that a client can observe.

The kit uses the network only, so it tests a server written in any language. `rules/` has one module per family of
checks; the modules in this folder are the tools that the checks are written with. The kit imports the contract
(`joybridge.v1`, `joybridge.contract`) and what ends and reports any command; only `joybridge doctor` asks the trainer,
where it is installed, whether a configuration fits.
"""
