/** The command line: serve until SIGINT or SIGTERM, or let a policy play. */

import { readFileSync } from "node:fs";
import { parseArgs } from "node:util";

import { meteors } from "./meteors.js";
import { scores } from "./scores.js";

const GAMES = new Map([["meteors", meteors]]);
const OPTIONS = {
  address: { type: "string", default: "127.0.0.1:5005" }, // HOST:PORT (port 0: any free one) or unix:PATH
  sessions: { type: "string", default: "64" }, // the largest number at once
  "tls-cert": { type: "string" }, // PEM files; other machines can reach the server only with these and a token
  "tls-key": { type: "string" },
  "token-file": { type: "string" },
  policy: { type: "string" }, // of `joybridge export RUN policy.json`: it plays here, and nothing is served
  episodes: { type: "string", default: "20" }, // that it plays
  seed: { type: "string", default: "0" },
} as const;

try {
  const { address, sessions, policy, episodes, seed, ...files } = parseArgs({ options: OPTIONS }).values;
  if (policy) {
    const document: unknown = JSON.parse(readFileSync(policy, "utf8"));
    console.log(scores(meteors, document, count("episodes", episodes, 1), BigInt(count("seed", seed, 0))));
  } else {
    const most = count("sessions", sessions, 1);
    const [{ protection }, { serve }] = await Promise.all([import("./authentication.js"), import("./server.js")]); // need gRPC
    const running = await serve(GAMES, address, most, protection(address, files));
    console.log(`joybridge simulator listening on ${running.address}`);
    for (const signal of ["SIGINT", "SIGTERM"]) process.once(signal, () => void running.stop());
  }
} catch (error) {
  console.error(`error: ${(error as Error).message}`);
  process.exitCode = 2;
}

function count(option: string, given: string, least: number): number {
  const value = Number(given);
  if (Number.isInteger(value) && value >= least) return value;
  throw new Error(`--${option} is '${given}', expected a number from ${least}`);
}
