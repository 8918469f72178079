/**
 * Play a policy that `joybridge export RUN policy.json` wrote. Copy this file into your program; it needs nothing else,
 * in Node.js or in a browser. TypeScript finds its types in policy.d.mts.
 *
 *   const policy = new Policy(await (await fetch("policy.json")).json());
 *   let state = policy.begin();
 *   const action = policy.act({ target: [0.1, -0.3], bow: [1] }, state, { draw: [true, false] });
 *   state = action.state; // begin() again for the next episode
 *
 * It plays one agent. Decide only when the game lets the agent decide, and also for the first observation of each
 * episode, whose action may be ignored.
 */

const CLIP = 3; // samples of a Gaussian beyond ±CLIP act like ±CLIP
const FORMAT = "joybridge.policy.v3";
const ACTIVATIONS = {
  swish: (x) => x / (1 + Math.exp(-x)),
  tanh: Math.tanh,
  relu: (x) => Math.max(x, 0),
  elu: (x) => (x > 0 ? x : Math.expm1(x)),
};

/** Return where a policy that is not deterministic takes its noise: uniform in [0, 1), and standard normal. */
export function noiseFrom(uniform) {
  return { uniform, normal: () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform()) };
}

export class Policy {
  /** @param {object} document the parsed file. Throws an Error if it is no policy of this format. */
  constructor(document) {
    if (document?.format !== FORMAT) {
      throw new Error(`this is no ${FORMAT}; write it with \`joybridge export RUN policy.json\``);
    }
    this.game = document.game;
    this.options = document.options; // of the game, a choice for each
    this.sensors = document.sensors; // name, dtype and shape of each
    this.axes = document.axes; // name, low and high of each, in the order of Action.axes
    this.branches = document.branches; // name and choices of each, in the order of Action.choices
    this.deterministic = document.deterministic;
    this.networks = document.policies.map((network) => ({
      ...network,
      layers: network.layers.map(({ weight, bias }) => ({ weight: floats(weight), bias: floats(bias) })),
      deviations: floats(network.deviations),
      shift: network.scaling && floats(network.scaling.shift),
      scale: network.scaling && floats(network.scaling.scale),
    }));
  }

  /** Return the state of a new episode: for each network, the frames that it remembers, of which there are none yet. */
  begin() {
    return this.networks.map(({ layers, frame_stack }) => {
      const numbers = layers[0].weight.length / layers[0].bias.length;
      return new Float32Array(numbers - numbers / frame_stack);
    });
  }

  /**
   * Return { axes, choices, state }: the values of the device, and the state of the next decision.
   * @param {Object<string, ArrayLike<number | boolean>>} sensors by name, each flat, row-major
   * @param {Float32Array[]} state of `begin`, or of the last decision
   * @param {Object<string, ArrayLike<number | boolean>>} masks by name of a branch, true: allowed; those that are left
   *   out allow all choices
   * @param {{ uniform: () => number, normal: () => number }} noise
   */
  act(sensors, state, masks = {}, noise = noiseFrom(Math.random)) {
    const allowed = this.branches.map(({ name, choices }) => masks[name] ?? choices.map(() => true));
    const axes = new Float32Array(this.axes.length);
    const choices = new Int32Array(this.branches.length);
    const next = this.networks.map((network, index) => {
      const frame = scale(network, network.sensors.flatMap((name) => Array.from(sensors[name], Number)));
      const seen = Float32Array.from([...state[index], ...frame]);
      const outputs = finite(dense(network, seen));
      let begin = 0;
      for (const table of network.discrete) {
        const logits = outputs.slice(begin, begin + table.values.length);
        const row = this.#choose(table, logits, allowed, noise);
        begin += table.values.length;
        if (table.axis !== undefined) axes[table.axis] = table.values[row];
        else table.branches.forEach((branch, column) => (choices[branch] = table.values[row][column]));
        table.axes?.forEach((axis, column) => (axes[axis] = table.positions[row][column]));
      }
      network.continuous.forEach((target, column) => {
        let sample = outputs[begin + column];
        if (!this.deterministic) sample += network.deviations[column] * noise.normal();
        const share = target.squashed ? Math.tanh(sample) : clip(sample, -CLIP, CLIP) / CLIP;
        if (target.axis !== undefined) {
          const { low, high } = this.axes[target.axis];
          axes[target.axis] = clip((low + high) / 2 + ((high - low) / 2) * share, low, high);
        } else {
          const mask = Array.from(allowed[target.branch], Boolean);
          const pressed = press(share, target.threshold, mask.length);
          choices[target.branch] = mask[pressed] ? pressed : mask.indexOf(true);
        }
      });
      return seen.slice(frame.length);
    });
    return { axes: finite(axes), choices, state: next };
  }

  /** Return a row of a table, never one that contains a masked choice. */
  #choose(table, logits, allowed, noise) {
    const fits = (row) => table.branches.every((branch, column) => allowed[branch][row[column]]);
    const masked = table.axis !== undefined ? logits : logits.map((x, row) => (fits(table.values[row]) ? x : -1e9));
    const highest = Math.max(...masked);
    if (this.deterministic) return masked.indexOf(highest);
    let total = 0;
    const sums = masked.map((logit) => (total += Math.exp(logit - highest)));
    const level = noise.uniform() * total;
    const row = sums.findIndex((sum) => sum > level);
    return row < 0 ? masked.indexOf(highest) : row; // the level was rounded up to the total
  }
}

/** Return a frame as the network was trained with it. */
function scale({ scaling, shift, scale }, frame) {
  if (!scaling) return frame;
  const { limit = Infinity } = scaling;
  return frame.map((x, index) => clip((x - shift[index]) * scale[index], -limit, limit));
}

/** Return the outputs of the dense layers of a network, with its activation between them. */
function dense({ layers, activation }, inputs) {
  let values = inputs;
  layers.forEach(({ weight, bias }, number) => {
    const given = number ? values.map(ACTIVATIONS[activation]) : values;
    values = bias.map((sum, row) => {
      for (let column = 0; column < given.length; column++) sum += weight[row * given.length + column] * given[column];
      return sum;
    });
  });
  return Array.from(values);
}

/** Return numbers. Throws an Error if one is none. */
function finite(numbers) {
  if (!numbers.every(Number.isFinite)) throw new Error("a sensor is not finite, or the policy is damaged");
  return numbers;
}

/** Return the choice of a branch of `count` choices at a share in -1..1. */
function press(share, threshold, count) {
  if (threshold === undefined) return Math.min(Math.floor(((share + 1) / 2) * count), count - 1);
  return Number(threshold === 0 ? share > 0 : Math.abs(share) < threshold);
}

function clip(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

/** Return the numbers of an array of the file: little-endian floats of 32 bits, as base64. */
function floats({ float32 }) {
  const bytes = Uint8Array.from(atob(float32), (character) => character.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Float32Array.from({ length: bytes.length / 4 }, (_, index) => view.getFloat32(4 * index, true));
}
