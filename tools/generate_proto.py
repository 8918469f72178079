"""Generate the Python code and the descriptor set of the contract from `proto/joybridge/v1/bridge.proto`.

    python -m tools.generate_proto            rewrite them in place
    python -m tools.generate_proto --output D  write them under D instead (the staleness test does)

The protoc in the pinned grpcio-tools is an old one of the supported range on purpose: generated code runs
on its own protobuf release and newer ones, never on older ones.
"""

import argparse
from importlib.resources import files
from pathlib import Path

from grpc_tools import protoc

PROTO = Path(__file__).resolve().parents[1] / "proto"
SOURCE = "joybridge/v1/bridge.proto"


def generate(output: Path) -> None:
    """Write bridge_pb2.py, bridge_pb2.pyi, bridge_pb2_grpc.py and bridge.binpb under `output`."""
    (output / SOURCE).parent.mkdir(parents=True, exist_ok=True)
    arguments = [
        "protoc",
        f"--proto_path={PROTO}",
        f"--proto_path={files('grpc_tools') / '_proto'}",
        f"--python_out={output}",
        f"--pyi_out={output}",
        f"--grpc_python_out={output}",
        f"--descriptor_set_out={(output / SOURCE).with_suffix('.binpb')}",
        SOURCE,
    ]
    if protoc.main(arguments) != 0:
        raise SystemExit(f"protoc could not compile {SOURCE}; see its message above")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Generate the contract's Python code.")
    parser.add_argument("--output", type=Path, default=PROTO, help="folder to write under (default: proto)")
    generate(parser.parse_args().output)


if __name__ == "__main__":
    main()
