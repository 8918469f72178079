/** A policy that `joybridge export` wrote plays one arena of a game: without a server, and without gRPC. */

import { type Noise, noiseFrom, Policy, type State } from "../../javascript/policy.mjs";
import type { Arena, Game, TimeStep } from "./game.js";
import { keyOf, uniform } from "./random.js";
import type { Action } from "./tensors.js";

/** What has happened in an episode. */
export interface Episode {
  reward: number; // of the channels with their default weights
  length: number; // in decisions
  end: TimeStep["end"];
  metrics: number[];
}

const NOTHING: Episode = { reward: 0, length: 0, end: null, metrics: [] };

export class Player {
  readonly metrics: string[]; // their names
  readonly arena: Arena;
  episode = NOTHING; // the present one
  action: Action = { axes: [], choices: [] }; // the last one
  private readonly policy: Policy;
  private readonly noise: Noise;
  private readonly sensors: string[]; // names, in the order of the game
  private readonly weights: number[]; // of the reward channels
  private state: State;

  /** Begin with a policy, which is the parsed file. Throws an Error if it is for another game. */
  constructor(game: Game, document: unknown, seed: bigint) {
    this.policy = new Policy(document);
    const { name = "", behaviors: [behavior] = [], parameters = [] } = game.describe(this.policy.options);
    if (this.policy.game !== name) {
      throw new Error(`the policy plays ${this.policy.game}, expected ${name}; export a run of ${name}`);
    }
    this.sensors = (behavior?.sensors ?? []).map((sensor) => sensor.name ?? "");
    this.metrics = (behavior?.metrics ?? []).map((metric) => metric.name ?? "");
    this.weights = (behavior?.channels ?? []).map((channel) => Number(channel.default_weight));
    const defaults = parameters.map(({ name = "", default_value }) => [name, Number(default_value)]);
    this.arena = game.open(this.policy.options, Object.fromEntries(defaults), seed, 0);
    this.state = this.policy.begin();
    const [key, drawn] = [keyOf(seed, 1), { count: 0 }];
    this.noise = noiseFrom(() => uniform(key, drawn.count++));
  }

  /** Begin the next episode. */
  begin(): void {
    this.arena.begin();
    this.state = this.policy.begin();
    this.episode = NOTHING;
  }

  /** Play one decision. After an end, `begin` comes next. */
  step(): void {
    const { rewards, end, metrics } = this.arena.step(this.decide());
    const reward = rewards.reduce((sum, each, channel) => sum + each * (this.weights[channel] ?? 0), this.episode.reward);
    this.episode = { reward, length: this.episode.length + 1, end, metrics };
  }

  private decide(): Action {
    const sensors = named(this.sensors, this.arena.observe());
    const masks = named(this.policy.branches.map((branch) => branch.name), this.arena.masks());
    const { axes, choices, state } = this.policy.act(sensors, this.state, masks, this.noise);
    this.state = state;
    this.action = { axes: [...axes], choices: [...choices] };
    return this.action;
  }
}

function named<T>(names: string[], values: T[]): Record<string, T> {
  return Object.fromEntries(names.map((name, index) => [name, values[index] as T]));
}
