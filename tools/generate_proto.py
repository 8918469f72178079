"""Generate the Python code of the messages in `proto`, and the descriptor set of the contract.

    python -m tools.generate_proto            rewrite them in place
    python -m tools.generate_proto --output D  write them under D instead (the staleness test does)

`proto/joybridge/mlagents/communicator.proto`, the wire of ML-Agents, is generated as well; it has no service.

The protoc in the pinned grpcio-tools is an old one of the supported range on purpose: generated code runs
on its own protobuf release and newer ones, never on older ones.
"""

import argparse
from importlib.resources import files
from pathlib import Path

from grpc_tools import protoc

PROTO = Path(__file__).resolve().parents[1] / "proto"
SOURCE = "joybridge/v1/bridge.proto"
MLAGENTS = "joybridge/mlagents/communicator.proto"


def generate(output: Path) -> None:
    """Write bridge_pb2.py, bridge_pb2.pyi, bridge_pb2_grpc.py, bridge.binpb, communicator_pb2.py and its .pyi."""
    contract = [f"--grpc_python_out={output}", f"--descriptor_set_out={(output / SOURCE).with_suffix('.binpb')}"]
    for source, further in ((SOURCE, contract), (MLAGENTS, [])):
        (output / source).parent.mkdir(parents=True, exist_ok=True)
        arguments = [
            "protoc",
            f"--proto_path={PROTO}",
            f"--proto_path={files('grpc_tools') / '_proto'}",
            f"--python_out={output}",
            f"--pyi_out={output}",
            *further,
            source,
        ]
        if protoc.main(arguments) != 0:
            raise SystemExit(f"protoc could not compile {source}; see its message above")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Generate the contract's Python code.")
    parser.add_argument("--output", type=Path, default=PROTO, help="folder to write under (default: proto)")
    generate(parser.parse_args().output)


if __name__ == "__main__":
    main()
