/** bridge.proto, loaded at run time: its service, and requests that are checked while they are read. */

import { fileURLToPath } from "node:url";

import { status } from "@grpc/grpc-js";
import { loadSync, type MessageTypeDefinition } from "@grpc/proto-loader";
import protobuf from "protobufjs";

import type { CompleteGameSpec, GameSpec } from "./types/joybridge/v1/GameSpec.js";
import type { SimulatorServiceDefinition } from "./types/joybridge/v1/SimulatorService.js";

export const SERVICE = "joybridge.v1.SimulatorService";
const FILE = fileURLToPath(new URL("../../../joybridge/v1/bridge.proto", import.meta.url));
// keepCase: else reflection tells camelCase names, which the contract does not have. longs: a number holds no seed.
const OPTIONS = { keepCase: true, longs: String, enums: String, defaults: true, oneofs: true } as const;

export const proto = loadSync(FILE, OPTIONS);
const methods = proto[SERVICE] as unknown as SimulatorServiceDefinition;
const root = new protobuf.Root().loadSync(FILE, OPTIONS);
root.resolveAll();

/** An error that ends its call with a gRPC status; the text says what came, what was wanted and what to do. */
export class Refusal extends Error {
  constructor(
    readonly code: status,
    text: string,
  ) {
    // A status travels in a header of 8 KiB, where a character takes up to 12 bytes and half of one cannot stand.
    super((text.length <= 600 ? text : `${text.slice(0, 400)} … ${text.slice(-200)}`).toWellFormed());
  }
}

/** Return a Refusal that blames the content of a message. */
export function invalid(text: string): Refusal {
  return new Refusal(status.INVALID_ARGUMENT, text);
}

/** The service as gRPC is to run it: it hands on bytes, since what its own decoding refuses is INTERNAL. */
export const service = Object.fromEntries(
  Object.entries(methods).map(([name, method]) => [name, { ...method, requestDeserialize: (data: Buffer) => data }]),
);

/** A function per method that decodes its requests. It throws a Refusal for what is none or has unknown fields. */
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
  const type = root.lookupType(`joybridge.v1.${name}`);
  return (data) => {
    try {
      refuseUnknown(data, type, name);
      return method.requestDeserialize(data);
    } catch (error) {
      throw error instanceof Refusal ? error : invalid(`not a ${name}: ${(error as Error).message}`);
    }
  };
}

/** Throw a Refusal if a message has a field that the contract has not: ignored, it would be a broken promise. */
function refuseUnknown(data: Uint8Array, type: protobuf.Type, path: string): void {
  const bytes = protobuf.Reader.create(data);
  while (bytes.pos < bytes.len) {
    const tag = bytes.uint32();
    const [number, wire] = [tag >>> 3, tag & 7];
    const field = type.fieldsById[number];
    if (field === undefined || !wires(field).includes(wire)) {
      throw invalid(`${path}: field ${number} is unknown to this server or of another type; keep to bridge.proto`);
    }
    if (field.resolvedType instanceof protobuf.Type && !field.map) {
      refuseUnknown(bytes.bytes(), field.resolvedType, `${path}.${field.name}`);
    } else {
      bytes.skipType(wire);
    }
  }
}

/** Return the wire types that a field may have: its own and, where numbers are repeated, that of packed ones. */
function wires(field: protobuf.Field): number[] {
  const basic: Record<string, number> = protobuf.types.basic;
  const own = field.resolvedType instanceof protobuf.Enum ? 0 : field.map ? 2 : (basic[field.type] ?? 2);
  return field.repeated ? [own, 2] : [own];
}
