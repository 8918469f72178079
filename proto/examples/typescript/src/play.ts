/** The arenas of a session, and what each request does to them. */

import { status } from "@grpc/grpc-js";

import { impossible, invalid, Refusal } from "./contract.js";
import type { Arena, Parameters, TimeStep } from "./game.js";
import { checkNone, checkParameters, type Chosen } from "./settings.js";
import { pack, unpackActions, zip } from "./tensors.js";
import type { CompleteAct } from "./types/joybridge/v1/Act.js";
import type { CompleteBehavior } from "./types/joybridge/v1/Behavior.js";
import type { Ended } from "./types/joybridge/v1/Ended.js";
import type { CompleteReset } from "./types/joybridge/v1/Reset.js";
import type { CompleteStart } from "./types/joybridge/v1/Start.js";
import type { Step } from "./types/joybridge/v1/Step.js";
import type { Tensor } from "./types/joybridge/v1/Tensor.js";

const MOST_PICTURES = 64; // of one Act

/** A session after its Start. Every method throws a Refusal for a request whose content is wrong. */
export class Play {
  steps = 0;
  private readonly behavior: CompleteBehavior;
  private readonly parameters: Parameters; // shared with the arenas
  private arenas: Arena[];

  constructor(
    readonly chosen: Chosen,
    private readonly start: CompleteStart,
  ) {
    const { name, behaviors, max_arenas, parameters } = chosen.spec;
    const [behavior, ...others] = behaviors;
    if (!behavior || others.length) throw new Error(`the spec has ${behaviors.length} behaviors, expected 1`);
    if (start.arenas < 1 || start.arenas > max_arenas) {
      const code = start.arenas < 1 ? status.INVALID_ARGUMENT : status.RESOURCE_EXHAUSTED;
      throw new Refusal(code, `${name}: arenas is ${start.arenas}, expected 1..${max_arenas}`);
    }
    if (start.snapshot) throw impossible(`${name} has no snapshots; start without one`);
    checkNone(chosen.spec, start.distributions);
    const defaults = Object.fromEntries(parameters.map(({ name, default_value }) => [name, default_value]));
    this.behavior = behavior;
    this.parameters = { ...defaults, ...checkParameters(chosen.spec, start.parameters) };
    this.arenas = this.open(start.seed);
  }

  /** Return the present observations, with zero rewards and no ends. */
  observe(): Step {
    const nothing: TimeStep = { rewards: this.behavior.channels.map(() => 0), end: null, metrics: [] };
    return this.step(this.arenas.map(() => nothing), null);
  }

  /** Advance every arena by one decision; an episode that ends is followed by the next one in the same step. */
  act({ behaviors, draw, distributions }: CompleteAct): Step {
    const [message, ...others] = behaviors;
    if (!message || others.length) throw invalid(`act.behaviors has ${behaviors.length} entries, expected 1`);
    const actions = unpackActions(message, this.behavior, this.arenas.map((arena) => arena.masks()));
    const drawn = this.toDraw(draw);
    checkNone(this.chosen.spec, distributions);
    this.steps += 1;
    const begin = performance.now();
    const results = zip(this.arenas, actions).map(([arena, action]) => arena.step(action));
    const ended = this.endEpisodes(results);
    const simulate_seconds = (performance.now() - begin) / 1000;
    return { ...this.step(results, ended), pictures: drawn.map((arena) => this.picture(arena)), simulate_seconds };
  }

  /** Begin new episodes everywhere; with a seed, as a new session with that seed would. */
  reset({ seed, parameters, distributions }: CompleteReset): Step {
    checkNone(this.chosen.spec, distributions);
    Object.assign(this.parameters, checkParameters(this.chosen.spec, parameters));
    if (seed !== undefined) this.arenas = this.open(seed);
    else for (const arena of this.arenas) arena.begin();
    return this.observe();
  }

  private open(seed: string): Arena[] {
    const { game, options } = this.chosen;
    const { arenas, first_arena } = this.start;
    return Array.from({ length: arenas }, (_, k) => game.open(options, this.parameters, BigInt(seed), first_arena + k));
  }

  /** Begin the next episode where one ended, and return the ends as they are sent. */
  private endEpisodes(results: TimeStep[]): Ended | null {
    const ends = zip(this.arenas, results).flatMap(([arena, result], lane) =>
      result.end ? [{ arena, result, lane }] : [],
    );
    if (ends.length === 0) return null;
    const shape = [ends.length, this.behavior.metrics.length];
    const ended = {
      lanes: pack("DTYPE_INT32", [ends.length], ends.map(({ lane }) => lane)),
      final_observations: this.observations(ends.map(({ arena }) => arena)),
      metrics: shape[1] ? pack("DTYPE_FLOAT32", shape, ends.flatMap(({ result }) => result.metrics)) : null,
    };
    for (const { arena } of ends) arena.begin();
    return ended;
  }

  private step(results: TimeStep[], ended: Ended | null): Step {
    const { channels, device } = this.behavior;
    const masks = this.arenas.map((arena) => arena.masks());
    const lanes = results.length;
    const ends = (end: string): Tensor =>
      pack("DTYPE_BOOL", [lanes], results.map((result) => Number(result.end === end)));
    const step = {
      observations: this.observations(this.arenas),
      rewards: pack("DTYPE_FLOAT32", [lanes, channels.length], results.flatMap((result) => result.rewards)),
      terminated: ends("terminated"),
      truncated: ends("truncated"),
      masks: (device?.branches ?? []).map(({ choices }, branch) =>
        pack("DTYPE_BOOL", [lanes, choices.length], masks.flatMap((mask) => mask[branch]?.map(Number) ?? [])),
      ),
      ended,
    };
    return { behaviors: [step] };
  }

  private observations(arenas: Arena[]): Tensor[] {
    const rows = arenas.map((arena) => arena.observe());
    return this.behavior.sensors.map(({ shape }, sensor) =>
      pack("DTYPE_FLOAT32", [rows.length, ...shape], rows.flatMap((row) => row[sensor] ?? [])),
    );
  }

  private picture(arena: Arena): Tensor {
    const { height = 0, width = 0 } = this.chosen.spec.picture ?? {};
    return { dtype: "DTYPE_UINT8", shape: [height, width, 3], data: arena.draw() };
  }

  private toDraw(draw: number[]): Arena[] {
    const { name, picture } = this.chosen.spec;
    const arenas = draw.flatMap((number) => this.arenas[number] ?? []);
    if (draw.length && !picture) throw impossible(`${name} cannot be drawn; leave act.draw empty`);
    if (draw.length > MOST_PICTURES || arenas.length < draw.length) {
      const wanted = `at most ${MOST_PICTURES} of arenas 0..${this.arenas.length - 1}`;
      throw invalid(`act.draw has ${draw.length} arenas, ${draw.join(", ")}; expected ${wanted}`);
    }
    return arenas;
  }
}
