/** Numbers <-> Tensor: all conversions between arrays and messages. */

import { invalid } from "./contract.js";
import type { CompleteBehavior } from "./types/joybridge/v1/Behavior.js";
import type { CompleteBehaviorAct } from "./types/joybridge/v1/BehaviorAct.js";
import type { CompleteTensor, Tensor } from "./types/joybridge/v1/Tensor.js";

/** What one agent does in one decision: a value per axis, and the index of a choice per branch. */
export interface Action {
  axes: number[];
  choices: number[];
}

/** Return a tensor of numbers, row-major. Throws an Error for values that are not allowed in a tensor. */
export function pack(dtype: "DTYPE_FLOAT32" | "DTYPE_INT32" | "DTYPE_BOOL", shape: number[], values: number[]): Tensor {
  const size = dtype === "DTYPE_BOOL" ? 1 : 4;
  const data = Buffer.alloc(shape.reduce((product, length) => product * length, size));
  if (data.length !== size * values.length) throw new Error(`${values.length} numbers for shape [${shape.join(", ")}]`);
  for (const [index, value] of values.entries()) {
    if (!Number.isFinite(Math.fround(value))) throw new Error(`a number is ${value}, expected a finite one`);
    if (dtype === "DTYPE_FLOAT32") data.writeFloatLE(value, 4 * index);
    else data.writeIntLE(value, size * index, size);
  }
  return { dtype, shape, data };
}

/** Return the action of every lane. Throws a Refusal naming the field, axis or branch that is wrong. */
export function unpackActions(act: CompleteBehaviorAct, kind: CompleteBehavior, masks: boolean[][][]): Action[] {
  const { axes = [], branches = [] } = kind.device ?? {};
  const values = unpack(act.axes, "DTYPE_FLOAT32", [masks.length, axes.length], `${kind.name}.axes`);
  const choices = unpack(act.choices, "DTYPE_INT32", [masks.length, branches.length], `${kind.name}.choices`);
  const actions = zip(values, choices).map(([axes, choices]) => ({ axes, choices }));
  for (const [lane, action] of actions.entries()) {
    for (const [index, { name, low, high }] of axes.entries()) {
      const value = action.axes[index] ?? NaN; // is in no range
      if (!(value >= low && value <= high)) {
        throw invalid(`${kind.name}.axes: axis '${name}' got ${value} in lane ${lane}, expected ${low}..${high}`);
      }
    }
    for (const [index, { name, choices: labels }] of branches.entries()) {
      const choice = action.choices[index] ?? NaN;
      if (!masks[lane]?.[index]?.[choice]) {
        const wanted = choice in labels ? "what its mask allows in this step" : `0..${labels.length - 1}`;
        throw invalid(`${kind.name}.choices: branch '${name}' got ${choice} in lane ${lane}, expected ${wanted}`);
      }
    }
  }
  return actions;
}

type Dtype = "DTYPE_FLOAT32" | "DTYPE_INT32"; // of actions
type Shape = [rows: number, columns: number];

/** Return the rows of a tensor. Throws a Refusal unless it is there, or absent where it has no columns. */
function unpack(tensor: CompleteTensor | null, dtype: Dtype, shape: Shape, field: string): number[][] {
  const [rows, columns] = shape;
  const wanted = columns ? `${dtype} [${shape}] of ${4 * rows * columns} bytes` : "absent";
  const came = tensor ? `${tensor.dtype} [${tensor.shape}] of ${tensor.data.length} bytes` : "absent";
  if (came !== wanted) throw invalid(`${field} is ${came}, expected ${wanted}`);
  const data = tensor?.data ?? Buffer.alloc(0);
  const at = (dtype === "DTYPE_FLOAT32" ? data.readFloatLE : data.readInt32LE).bind(data);
  const row = (lane: number): number[] => Array.from({ length: columns }, (_, k) => at(4 * (lane * columns + k)));
  return Array.from({ length: rows }, (_, lane) => row(lane));
}

/** Return pairs of what stands at the same places of two lists of one length. */
export function zip<One, Other>(ones: One[], others: Other[]): [One, Other][] {
  return ones.map((one, index) => [one, others[index] as Other]);
}
