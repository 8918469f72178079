"""Write a configuration for a game of a running server, in any language, with values that suit its spec.

The values are those of the small games' configurations, which learn within 300 000 timesteps.
"""

import json
import re
import shlex
from pathlib import Path

import grpc

from joybridge.contract.credentials import credentials_of
from joybridge.contract.limits import element_count
from joybridge.contract.spec import SpecError, check_spec
from joybridge.contract.versions import mismatch, own_version
from joybridge.simulator.new_game.write import NewGameError, check_new, command, write_new
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

SECONDS = 10.0  # deadline of each call
LANES = 64  # that learn from each update together, about
ROLLOUT = 60  # decisions, at most


def write_config(address: str, game: str | None, folder: Path) -> str:
    """Write NAME.yaml for a game of the server at an address; return the commands to type next.

    game: may be None if the server has only one. Raises NewGameError.
    """
    spec = _describe(address, game)
    path = folder / (re.sub(r"[^\w.-]", "_", spec.name) + ".yaml")
    check_new([path])
    write_new({path: starter_config(spec)})
    joybridge, run = shlex.quote(command(folder)), shlex.quote(f"runs/{path.stem}")
    go = "" if folder.resolve() == Path.cwd() else f"  {shlex.join(['cd', str(folder)])}\n"
    return f"""Created {path}, the training of {spec.name}.

Train it, evaluate the policy and record a video:

{go}  {joybridge} train {shlex.quote(path.name)} --simulator {address} --run {run}
  {joybridge} evaluate {run}
  {joybridge} record {run} {shlex.quote(path.stem)}.mp4"""


def starter_config(spec: pb.GameSpec) -> str:
    """Return the text of a configuration that suits a spec."""
    name, behaviors = json.dumps(spec.name, ensure_ascii=False), spec.behaviors
    numbers = max(sum(element_count(sensor) for sensor in behavior.sensors) for behavior in behaviors)
    units = 32 if numbers <= 8 else 64 if numbers <= 64 else 128
    rollout = min(ROLLOUT, spec.max_episode_decisions or ROLLOUT)
    lanes = max(behavior.agents_per_arena for behavior in behaviors)
    arenas = max(1, min(LANES // lanes, spec.max_arenas))
    return f"""\
# A start for {name}. The config.yaml in a run's folder lists all keys with their values.
game: {name}
layout: hybrid            # how the policy controls axes and buttons; others: bucket-5, threshold-0.0, multiagent
arenas: {arenas:<18}# played in parallel
total_timesteps: 300000   # a harder game needs more
log_interval: 30000       # timesteps between two rows of metrics
policy:
  frame_stack: 1          # observations per network input; more if one observation does not show how things move
  hidden_sizes: {f"[{units}, {units}]":<10}# units per hidden layer; an observation has {numbers} numbers
  rollout_steps: {rollout:<9}# decisions of every arena between two updates
  time_horizon: {rollout:<10}# decisions after which the return is bootstrapped from the value
  gamma: 0.99             # discount per decision; closer to 1 if rewards come late
  minibatch_size: 256
  learning_rate: 2.0e-3   # lower if the reward fluctuates
  entropy_coef: 0.003     # higher for more exploration; lower if the policy does not converge
"""


def _describe(address: str, game: str | None) -> pb.GameSpec:
    """Return the spec of a game of a server, of its only game for None. Raises NewGameError."""
    version, credentials = own_version(), credentials_of(address)
    try:
        with credentials.channel(address) as channel:
            stub = rpc.SimulatorServiceStub(channel)
            listed = stub.ListGames(
                pb.ListGamesRequest(version=version), timeout=SECONDS, metadata=credentials.metadata
            )
            names = [summary.name for summary in listed.games]
            if game is None and len(names) == 1:
                game = names[0]
            if game not in names:
                missing = "choose one with --game" if game is None else f"--game {game} is none of them"
                raise NewGameError(f"the server at {address} has {', '.join(names)}; {missing}")
            request = pb.DescribeGameRequest(game=game, version=version)
            response: pb.DescribeGameResponse = stub.DescribeGame(
                request, timeout=SECONDS, metadata=credentials.metadata
            )
    except grpc.RpcError as error:
        raise NewGameError(
            f"no answer from a server at {address}: {error.details()} ({error.code().name}); start it, or check the "
            "address"
        ) from error
    if text := mismatch(version, response.version):
        raise NewGameError(f"{address}: {text}")
    try:
        check_spec(response.spec)
    except SpecError as error:
        raise NewGameError(
            f"the server at {address} sent a spec that breaks the contract: {error}; run `joybridge check {address}`"
        ) from error
    return response.spec
