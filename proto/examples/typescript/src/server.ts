/** The gRPC server: the three calls, health, reflection, limits and shutdown. */

import {
  type sendUnaryData,
  Server,
  type ServerDuplexStream,
  type ServerUnaryCall,
  status,
} from "@grpc/grpc-js";
import { ReflectionService } from "@grpc/reflection";
import { HealthImplementation } from "grpc-health-check";

import { checkVersion, proto, read, Refusal, SERVICE, service, VERSION } from "./contract.js";
import type { Protection } from "./authentication.js";
import { Session } from "./session.js";
import { choose, type Games } from "./settings.js";
import type { PlayResponse } from "./types/joybridge/v1/PlayResponse.js";

const GRACE_MILLISECONDS = 2000; // time for clients to receive the status

type Call = ServerDuplexStream<Buffer, PlayResponse>;

/** A server that listens. */
export interface Running {
  address: string;
  stop(): Promise<void>; // ends every session with UNAVAILABLE
}

/** Serve these games to at most `most` sessions at once. Rejects with an Error if it cannot listen at `address`. */
export async function serve(
  games: Games,
  address: string,
  most: number,
  { credentials, interceptors }: Protection,
): Promise<Running> {
  const server = new Server({
    interceptors,
    "grpc.max_receive_message_length": Math.max(...[...games.keys()].map((name) => requestBytes(games, name))),
    "grpc.keepalive_time_ms": 30_000, // detects clients that are lost
    "grpc.keepalive_timeout_ms": 20_000,
  });
  const sessions = new Set<Call>();
  server.addService(service, {
    ListGames: unary(read.ListGames, ({ version }) => {
      checkVersion(version);
      const summaries = [...games].map(([name, game]) => ({ name, description: game.describe().description ?? "" }));
      return { games: summaries, version: VERSION };
    }),
    DescribeGame: unary(read.DescribeGame, ({ game, options, version }) => {
      checkVersion(version);
      return { spec: choose(games, game, options).spec, version: VERSION };
    }),
    Play: (call: Call) => play(games, call, sessions, most),
  });
  const health = new HealthImplementation({ "": "SERVING", [SERVICE]: "SERVING" });
  health.addToServer(server);
  new ReflectionService(proto).addToServer(server);
  const port = await new Promise<number>((resolve, reject) =>
    server.bindAsync(address, credentials, (error, port) => {
      if (error) reject(new Error(`cannot listen on ${address}: ${error.message}`));
      else resolve(port);
    }),
  );
  return {
    address: address.startsWith("unix:") ? address : address.replace(/:\d+$/, `:${port}`),
    stop: () =>
      new Promise((resolve) => {
        for (const name of ["", SERVICE]) health.setStatus(name, "NOT_SERVING");
        for (const call of sessions) call.emit("error", new Refusal(status.UNAVAILABLE, "the server is shutting down"));
        setTimeout(() => server.forceShutdown(), GRACE_MILLISECONDS).unref();
        server.tryShutdown(() => resolve());
      }),
  };
}

/** Run one session until either side ends it. An error that is emitted on a call ends it with that status. */
function play(games: Games, call: Call, sessions: Set<Call>, most: number): void {
  if (sessions.size >= most) {
    const text = `${most} sessions are open already; close one or start the server with --sessions`;
    call.emit("error", new Refusal(status.RESOURCE_EXHAUSTED, text));
    return;
  }
  sessions.add(call);
  call.on("close", () => sessions.delete(call));
  const session = new Session(games);
  call.on("data", (data: Buffer) => {
    if (call.writableEnded) return; // after an error, later requests are not answered
    try {
      const taken = call.write(session.answer(read.Play(data)));
      if (!taken) call.pause().once("drain", () => call.resume()); // the client is slower than the game
    } catch (error) {
      call.emit("error", error);
    }
  });
  call.on("end", () => call.end());
}

/** Return the handler of a call with one request and one response. */
function unary<Request, Response>(read: (data: Buffer) => Request, answer: (request: Request) => Response) {
  return (call: ServerUnaryCall<Buffer, Response>, callback: sendUnaryData<Response>): void => {
    let response: Response;
    try {
      response = answer(read(call.request));
    } catch (error) {
      callback(error instanceof Refusal ? error : { code: status.INTERNAL, details: String(error) });
      return;
    }
    callback(null, response);
  };
}

/** Return the most bytes of a request of a game: 4 MiB, and the actions of all arenas. */
function requestBytes(games: Games, name: string): number {
  const { max_arenas, behaviors } = choose(games, name, {}).spec;
  const row = behaviors.map(({ device }) => 4 * ((device?.axes.length ?? 0) + (device?.branches.length ?? 0)));
  return 2 ** 22 + max_arenas * row.reduce((sum, size) => sum + size, 0);
}
