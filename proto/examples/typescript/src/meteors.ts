/** Meteors: a gun rolls along a town at night and shoots what falls from the sky. */

import { draw, HEIGHT, type Scene, WIDTH } from "./drawing.js";
import type { Arena, Game, Options, Parameters, TimeStep } from "./game.js";
import { keyOf, uniform } from "./random.js";
import type { Action } from "./tensors.js";

const DECISIONS = 200; // length at which an episode is truncated
const HOUSES = 3; // the episode is terminated when all are lost
const SPEED = 0.15; // of the gun at full steer, per decision; the ground reaches from -1 to 1
const REACH = 0.12; // how far beside the gun a meteor may be and still be hit
const COOLING = 3; // decisions after a shot in which the trigger is masked
const DRIFT = 0.04; // the most that wind moves a meteor sideways per decision

export const meteors: Game = {
  describe: () => ({
    name: "meteors",
    description: "Roll the gun along the town and shoot the meteors before they hit it.",
    options: [
      { name: "sky", description: "whether meteors drift", choices: ["calm", "windy"], default_choice: "calm" },
    ],
    parameters: [
      { name: "fall", description: "of meteors, skies per decision", low: 0.02, high: 0.2, default_value: 0.05 },
    ],
    behaviors: [
      {
        name: "gunner",
        description: "rolls the gun and pulls its trigger",
        agents_per_arena: 1,
        sensors: [
          { name: "gun", dtype: "DTYPE_FLOAT32", shape: [2], elements: ["x", "heat"], low: [-1, 0], high: [1] },
          {
            name: "meteor", dtype: "DTYPE_FLOAT32", shape: [3], elements: ["x", "height", "drift"],
            low: [-1], high: [1],
          },
          { name: "town", dtype: "DTYPE_FLOAT32", shape: [1], elements: ["share of houses"], low: [0], high: [1] },
        ],
        device: {
          axes: [
            { name: "steer", description: "left to right", low: -1, high: 1, kind: "AXIS_KIND_VELOCITY", way: "WAY_RIGHT" },
          ],
          branches: [{
            name: "trigger", description: "masked while the gun is hot", choices: ["released", "pulled"],
            keys: ["", "Space"],
          }],
        },
        channels: [
          { name: "hits", description: "meteors shot", default_weight: 1 },
          { name: "misses", description: "shots into the sky", default_weight: -0.2 },
          { name: "losses", description: "houses destroyed", default_weight: -1 },
        ],
        metrics: [
          { name: "accuracy", description: "hits per shot" },
          { name: "houses", description: "those that stand at the end" },
        ],
      },
    ],
    decision_interval: 1,
    tick_seconds: 0.1,
    max_episode_decisions: DECISIONS,
    max_arenas: 1024,
    picture: { width: WIDTH, height: HEIGHT },
  }),

  open: (options, parameters, seed, arena) => new Night(options, parameters, keyOf(seed, arena)),
};

/** One arena: in a decision the gun rolls and may shoot, then the meteor falls. */
class Night implements Arena, Scene {
  gun = 0; // its place
  heat = 0; // decisions until it can fire again
  x = 0; // the meteor's place, height in skies, and drift per decision
  height = 1;
  drift = 0;
  houses = HOUSES;
  private decisions = 0;
  private hits = 0;
  private shots = 0;
  private drawn = 0; // random numbers so far

  constructor(
    private readonly options: Options,
    private readonly parameters: Parameters,
    private readonly key: bigint,
  ) {
    this.begin();
  }

  begin(): void {
    this.gun = this.random(1);
    this.houses = HOUSES;
    this.heat = this.decisions = this.hits = this.shots = 0;
    this.appear();
  }

  step({ axes: [steer = 0], choices: [trigger = 0] }: Action): TimeStep {
    this.gun = clamp(this.gun + SPEED * steer);
    const shot = trigger === 1;
    const hit = shot && Math.abs(this.x - this.gun) < REACH;
    this.heat = shot ? COOLING : Math.max(0, this.heat - 1);
    this.height = Math.max(0, this.height - (this.parameters["fall"] ?? 0));
    this.x += this.drift;
    if (Math.abs(this.x) > 1) [this.x, this.drift] = [clamp(this.x), -this.drift];
    const lost = !hit && this.height === 0;
    if (hit || lost) this.appear();
    this.shots += Number(shot);
    this.hits += Number(hit);
    this.houses -= Number(lost);
    this.decisions += 1;
    return {
      rewards: [Number(hit), Number(shot && !hit), Number(lost)],
      end: this.houses === 0 ? "terminated" : this.decisions === DECISIONS ? "truncated" : null,
      metrics: [this.shots ? this.hits / this.shots : 0, this.houses],
    };
  }

  observe(): number[][] {
    return [[this.gun, this.heat / COOLING], [this.x, this.height, this.drift / DRIFT], [this.houses / HOUSES]];
  }

  masks(): boolean[][] {
    return [[true, this.heat === 0]];
  }

  draw(): Uint8Array {
    return draw(this, this.heat / COOLING, HOUSES);
  }

  /** Let the next meteor appear. */
  private appear(): void {
    this.x = this.random(1);
    this.height = 1;
    this.drift = this.options["sky"] === "windy" ? this.random(DRIFT) : 0;
  }

  /** Draw from [-most, most). */
  private random(most: number): number {
    return most * (2 * uniform(this.key, this.drawn++) - 1);
  }
}

function clamp(place: number): number {
  return Math.min(1, Math.max(-1, place));
}
