/** What a client chooses by name: a game, its options and its parameters. */

import { status } from "@grpc/grpc-js";

import { complete, impossible, invalid, Refusal } from "./contract.js";
import type { Game, Options, Parameters } from "./game.js";
import type { CompleteGameSpec } from "./types/joybridge/v1/GameSpec.js";

export type Games = ReadonlyMap<string, Game>; // by name

/** A game under the options that were chosen. */
export interface Chosen {
  game: Game;
  options: Options;
  spec: CompleteGameSpec;
}

/** Return the named game under the given options, defaults filled in. Throws a Refusal for a name that is not there. */
export function choose(games: Games, name: string, given: Options): Chosen {
  const game = games.get(name);
  if (!game) {
    throw new Refusal(status.NOT_FOUND, `no game named '${name}'; this server has ${[...games.keys()].join(", ")}`);
  }
  const known = complete(game.describe()).options;
  for (const [key, choice] of Object.entries(given)) {
    const { choices } = find(known, key, `${name}: unknown option`);
    if (!choices.includes(choice)) {
      throw invalid(`${name}: option '${key}' got '${choice}', expected one of ${choices.join(", ")}`);
    }
  }
  const defaults = Object.fromEntries(known.map(({ name, default_choice }) => [name, default_choice]));
  const options = { ...defaults, ...given };
  return { game, options, spec: complete(game.describe(options)) };
}

/** Return the given parameters, checked. Throws a Refusal for an unknown name or a value out of range. */
export function checkParameters(spec: CompleteGameSpec, given: Parameters): Parameters {
  for (const [key, value] of Object.entries(given)) {
    const { low, high } = find(spec.parameters, key, `${spec.name}: unknown parameter`);
    const within = value >= low && value <= high; // false for NaN
    if (!within) throw invalid(`${spec.name}: parameter '${key}' got ${value}, expected ${low}..${high}`);
  }
  return given;
}

/** Throw a Refusal if there are distributions: this server does not draw parameters per episode. */
export function checkNone(spec: CompleteGameSpec, distributions: object): void {
  for (const name of Object.keys(distributions)) {
    throw impossible(`${spec.name}: parameter '${name}' cannot be drawn per episode; give it a value`);
  }
}

function find<Thing extends { name: string }>(things: Thing[], name: string, unknown: string): Thing {
  const thing = things.find((thing) => thing.name === name);
  if (thing) return thing;
  throw invalid(`${unknown} '${name}', expected one of ${things.map((thing) => thing.name).join(", ") || "none"}`);
}
