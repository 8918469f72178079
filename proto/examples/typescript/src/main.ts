/** The command line: serve until SIGINT or SIGTERM. */

import { parseArgs } from "node:util";

import { protection } from "./doors.js";
import { meteors } from "./meteors.js";
import { serve } from "./server.js";

const GAMES = new Map([["meteors", meteors]]);
const OPTIONS = {
  address: { type: "string", default: "127.0.0.1:5005" }, // HOST:PORT (port 0: any free one) or unix:PATH
  sessions: { type: "string", default: "64" }, // the largest number at once
  "tls-cert": { type: "string" }, // PEM files; other machines can reach the server only with these and a token
  "tls-key": { type: "string" },
  "token-file": { type: "string" },
} as const;

try {
  const { address, sessions, ...files } = parseArgs({ options: OPTIONS }).values;
  const most = Number(sessions);
  if (!Number.isInteger(most) || most < 1) throw new Error(`--sessions is '${sessions}', expected a number from 1`);
  const running = await serve(GAMES, address, most, protection(address, files));
  console.log(`joybridge simulator listening on ${running.address}`);
  for (const signal of ["SIGINT", "SIGTERM"]) process.once(signal, () => void running.stop());
} catch (error) {
  console.error(`error: ${(error as Error).message}`);
  process.exitCode = 2;
}
