/** One session: the order of its messages, and the status of each error. It does not use gRPC's connections. */

import { status } from "@grpc/grpc-js";

import { checkVersion, impossible, invalid, Refusal, VERSION } from "./contract.js";
import { Play } from "./play.js";
import { choose, type Games } from "./settings.js";
import type { CompletePlayRequest } from "./types/joybridge/v1/PlayRequest.js";
import type { PlayResponse } from "./types/joybridge/v1/PlayResponse.js";

/** The requests of one stream. */
export class Session {
  private play: Play | undefined;

  constructor(private readonly games: Games) {}

  /** Return the response to one request. Throws a Refusal; the session must then end. */
  answer(request: CompletePlayRequest): PlayResponse {
    try {
      return this.respond(request);
    } catch (error) {
      if (error instanceof Refusal) throw error;
      const moment = this.play ? `step ${this.play.steps}` : "start";
      console.error(`${moment} of a session failed:`, error);
      const name = this.play?.chosen.spec.name ?? request.start?.game;
      throw new Refusal(status.INTERNAL, `${name} failed in ${moment}: ${error}; the server's log has more`);
    }
  }

  private respond({ request, start, act, reset, save }: CompletePlayRequest): PlayResponse {
    if (!this.play) {
      if (!start) throw request ? early(`${request} came before start`) : empty();
      checkVersion(start.version);
      this.play = new Play(choose(this.games, start.game, start.options), start);
      return { started: { spec: this.play.chosen.spec, step: this.play.observe(), version: VERSION } };
    }
    if (start) throw early("start came a second time");
    if (act) return { step: this.play.act(act) };
    if (reset) return { step: this.play.reset(reset) };
    if (save) throw impossible("there are no snapshots here; begin new episodes instead");
    throw empty();
  }
}

function early(what: string): Refusal {
  return impossible(`${what}; open a new stream and begin with start`);
}

function empty(): Refusal {
  return invalid("an empty PlayRequest, or a request that this server does not know; send start, act, reset or save");
}
