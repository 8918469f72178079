/** Who may call the server: TLS, the token, and the addresses that need both. See SECURITY in bridge.proto. */

import { createHash, timingSafeEqual } from "node:crypto";
import { readFileSync } from "node:fs";

import {
  ResponderBuilder,
  ServerCredentials,
  ServerInterceptingCall,
  type ServerInterceptor,
  ServerListenerBuilder,
  status,
} from "@grpc/grpc-js";

const HEALTH = "/grpc.health.v1.Health/"; // load balancers call it without a token
const LOCAL = /^(unix:|127\.|localhost:|\[::1\]:)/; // addresses that only programs of this machine can reach

/** The files of the command line. */
export interface Files {
  "tls-cert"?: string | undefined;
  "tls-key"?: string | undefined;
  "token-file"?: string | undefined;
}

/** How a server is protected. */
export interface Protection {
  credentials: ServerCredentials;
  interceptors: ServerInterceptor[];
}

/** Read the files. Throws an Error if one cannot be used, or if other machines can reach the address without them. */
export function protection(address: string, files: Files): Protection {
  const { "tls-cert": certificate, "tls-key": key, "token-file": token } = files;
  if ((certificate === undefined) !== (key === undefined)) throw new Error("TLS needs both --tls-cert and --tls-key");
  if (!LOCAL.test(address) && (certificate === undefined || token === undefined)) {
    throw new Error(
      `${address} can be reached from other machines, which needs --tls-cert, --tls-key and --token-file; ` +
        "give them, or listen on 127.0.0.1 or unix:PATH",
    );
  }
  const pair =
    certificate !== undefined && key !== undefined
      ? [{ cert_chain: readFileSync(certificate), private_key: readFileSync(key) }]
      : undefined;
  return {
    credentials: pair ? ServerCredentials.createSsl(null, pair) : ServerCredentials.createInsecure(),
    interceptors: token === undefined ? [] : [door(readToken(token))],
  };
}

/** Return an interceptor that refuses every call but health without the token. */
function door(token: string): ServerInterceptor {
  const wanted = digest(`Bearer ${token}`);
  return (method, call) => {
    const listener = new ServerListenerBuilder().withOnReceiveMetadata((metadata, next) => {
      const sent = metadata.get("authorization").join(",");
      if (method.path.startsWith(HEALTH) || timingSafeEqual(digest(sent), wanted)) return next(metadata);
      const details = "this server requires a token; give the client its file with --token-file";
      call.sendStatus({ code: status.UNAUTHENTICATED, details });
    });
    const responder = new ResponderBuilder().withStart((next) => next(listener.build()));
    return new ServerInterceptingCall(call, responder.build());
  };
}

/** Return a hash: texts of different lengths have hashes of one length, which can be compared in constant time. */
function digest(text: string): Buffer {
  return createHash("sha256").update(text).digest();
}

/** Return the token in a file. Throws an Error, which never shows it. */
function readToken(path: string): string {
  const token = readFileSync(path, "utf-8").trim();
  if (/^[!-~]{16,1000}$/.test(token)) return token;
  throw new Error(`${path} holds no token, expected one line of 16 to 1000 ASCII characters without spaces`);
}
