/** The types of policy.mjs, which describes them. */

export type Values = Record<string, ArrayLike<number | boolean>>; // by name of a sensor or a branch
export type State = Float32Array[][];

export interface Noise {
  uniform(): number;
  normal(): number;
}

export interface Action {
  axes: Float32Array;
  choices: Int32Array;
  state: State;
}

export function noiseFrom(uniform: () => number): Noise;

export class Policy {
  constructor(document: unknown);

  readonly game: string;
  readonly options: Record<string, string>;
  readonly sensors: { name: string; dtype: string; shape: number[] }[];
  readonly axes: { name: string; low: number; high: number }[];
  readonly branches: { name: string; choices: string[] }[];
  readonly deterministic: boolean;

  begin(): State;
  watch(sensors: Values, state: State): State;
  act(sensors: Values, state: State, masks?: Values, noise?: Noise): Action;
}
