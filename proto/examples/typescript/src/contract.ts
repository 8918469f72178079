/** bridge.proto, loaded at run time: its service, its version, and the decoding of requests. */

import { fileURLToPath } from "node:url";

import { status } from "@grpc/grpc-js";
import { loadSync, type MessageTypeDefinition } from "@grpc/proto-loader";

import type { CompleteGameSpec, GameSpec } from "./types/joybridge/v1/GameSpec.js";
import type { SimulatorServiceDefinition } from "./types/joybridge/v1/SimulatorService.js";
import type { CompleteVersion } from "./types/joybridge/v1/Version.js";

export const SERVICE = "joybridge.v1.SimulatorService";
const FILE = fileURLToPath(new URL("../../../joybridge/v1/bridge.proto", import.meta.url));
// keepCase: otherwise reflection has camelCase names, unlike the contract. longs: a seed does not fit into a number.
const OPTIONS = { keepCase: true, longs: String, enums: String, defaults: true, oneofs: true } as const;

/** The version of this server: its product, and the revision of bridge.proto that it implements. */
export const VERSION = { product: "meteors 0.1.0", revision: 2 };

export const proto = loadSync(FILE, OPTIONS);
const methods = proto[SERVICE] as unknown as SimulatorServiceDefinition;

/** An error that ends its call with a gRPC status; the text states what was received, expected, and what to do. */
export class Refusal extends Error {
  constructor(
    readonly code: status,
    text: string,
  ) {
    // A status is sent in a header of 8 KiB. A character takes up to 12 bytes there and must not be cut in two.
    super((text.length <= 600 ? text : `${text.slice(0, 400)} … ${text.slice(-200)}`).toWellFormed());
  }
}

/** Return a Refusal with INVALID_ARGUMENT: the content of a message is wrong. */
export function invalid(text: string): Refusal {
  return new Refusal(status.INVALID_ARGUMENT, text);
}

/** Return a Refusal with FAILED_PRECONDITION: the message is not possible now or for this game. */
export function impossible(text: string): Refusal {
  return new Refusal(status.FAILED_PRECONDITION, text);
}

/** Throw a Refusal if a client needs a newer revision of bridge.proto. A client that states none is served. */
export function checkVersion(client: CompleteVersion | null): void {
  const { product, revision } = VERSION;
  if (!client || client.revision <= revision) return;
  throw new Refusal(
    status.FAILED_PRECONDITION,
    `the client (${client.product || "unnamed"}) needs contract revision ${client.revision}, the simulator ` +
      `(${product}) has revision ${revision}; update the simulator, or use a client of its version`,
  );
}

/** The service for gRPC. Its methods pass bytes through, because gRPC answers what it cannot decode with INTERNAL. */
export const service = Object.fromEntries(
  Object.entries(methods).map(([name, method]) => [name, { ...method, requestDeserialize: (data: Buffer) => data }]),
);

/** A function per method that decodes its requests. It throws a Refusal for bytes that are not a request. */
export const read = {
  ListGames: reader(methods.ListGames),
  DescribeGame: reader(methods.DescribeGame),
  Play: reader(methods.Play),
};

/** Return a spec with defaults in place of what was left out, and its floats as they are on the wire. */
export function complete(spec: GameSpec): CompleteGameSpec {
  const type = proto["joybridge.v1.GameSpec"] as MessageTypeDefinition<GameSpec, CompleteGameSpec>;
  return type.deserialize(type.serialize(spec));
}

interface Method<Request> {
  requestType: { type: object };
  requestDeserialize(data: Buffer): Request;
}

function reader<Request>(method: Method<Request>): (data: Buffer) => Request {
  const { name } = method.requestType.type as { name: string };
  return (data) => {
    try {
      return method.requestDeserialize(data);
    } catch (error) {
      throw invalid(`not a ${name}: ${(error as Error).message}`);
    }
  };
}
