/** The interface of a game. To serve your own game, write it like meteors.ts and name it in main.ts. */

import type { Action } from "./tensors.js";
import type { GameSpec } from "./types/joybridge/v1/GameSpec.js";

export type Options = Record<string, string>; // a choice for every option
export type Parameters = Record<string, number>; // a value for every parameter

/** A game of one behavior with one agent per arena, whose sensors are FLOAT32. */
export interface Game {
  /** Return the spec under some choices; without them, under the defaults. */
  describe(options?: Options): GameSpec;

  /** Begin an arena. All its randomness comes from the seed and its number; `parameters` may change at a reset. */
  open(options: Options, parameters: Parameters, seed: bigint, arena: number): Arena;
}

/** One copy of a game. Its actions are already checked. */
export interface Arena {
  /** Begin a new episode. */
  begin(): void;

  /** Play one decision. After an end, `observe` returns the last observation until `begin`. */
  step(action: Action): TimeStep;

  /** Return the numbers of each sensor, row-major. */
  observe(): number[][];

  /** Return which choices are allowed now, per branch. */
  masks(): boolean[][];

  /** Return a picture: rows of pixels from the top, three bytes each. */
  draw(): Uint8Array;
}

/** What an agent gets after one decision. */
export interface TimeStep {
  rewards: number[]; // per channel
  end: "terminated" | "truncated" | null; // null: the episode continues
  metrics: number[]; // used where the episode ended
}
