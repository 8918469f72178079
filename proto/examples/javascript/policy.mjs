/**
 * Play a policy that `joybridge export RUN policy.json` wrote. Copy this file into your program; it needs nothing else,
 * in Node.js or in a browser. TypeScript finds its types in policy.d.mts.
 *
 *   const policy = new Policy(await (await fetch("policy.json")).json());
 *   let state = policy.begin();
 *   const action = policy.act({ target: [0.1, -0.3], bow: [1] }, state, { draw: [true, false] });
 *   state = action.state; // begin() again for the next episode
 *
 * It plays one agent. Decide only when the game lets the agent decide; if it waits with the first observation of an
 * episode, call `watch` with it.
 */

const CLIP = 3; // samples of a Gaussian beyond ±CLIP act like ±CLIP
const FAINT = 0.1; // what has this mass is placed half way between where it is and the middle
const MAX_NUMBERS = 2 ** 24; // that a network remembers, and of an image
const FORMAT = "joybridge.policy.v5";
const sigmoid = (x) => 1 / (1 + Math.exp(-x));
const clip = (value, low, high) => Math.min(Math.max(value, low), high);
const ACTIVATIONS = {
  swish: (x) => x * sigmoid(x),
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
    const sizes = new Map(this.sensors.map(({ name, shape }) => [name, shape.reduce((a, b) => a * b, 1)]));
    const count = (names) => names.reduce((sum, name) => sum + sizes.get(name), 0);
    this.networks = document.policies.map(decoded).map((network) => ({
      ...network,
      sizes: [count(network.sensors), ...network.images.map(({ sensor }) => count([sensor]))],
      memory: network.memory && new Memory(network.memory),
    }));
    if (!this.axes.every(({ low, high }) => low <= high)) throw new Error("the policy is damaged");
    for (const { sizes, frame_stack, memory } of this.networks) {
      const numbers = frame_stack * sizes.reduce((sum, size) => sum + size, memory?.numbers ?? 0);
      if (!(numbers <= MAX_NUMBERS)) throw new Error("the policy is damaged");
    }
  }

  /** Return the state of a new episode: for each network, its last frames and pictures, and its memory; all zero. */
  begin() {
    return this.networks.map(({ sizes, frame_stack, memory }) =>
      [...sizes.map((n) => (frame_stack - 1) * n), memory?.numbers ?? 0].map((numbers) => new Float32Array(numbers)),
    );
  }

  /** Return the state after an observation with which the agent waits, the first of an episode. */
  watch(sensors, state) {
    return this.networks.map((network, index) => {
      const { newest, seen } = see(network, sensors, state[index]);
      return [...seen.map((values, part) => values.slice(newest[part].length)), state[index].at(-1)];
    });
  }

  /**
   * Return { axes, choices, state }: the values of the device, and the state of the next decision.
   * @param {Object<string, ArrayLike<number | boolean>>} sensors by name, each flat, row-major
   * @param {Float32Array[][]} state of `begin`, or of the last decision
   * @param {Object<string, ArrayLike<number | boolean>>} masks by name of a branch, true: allowed; those that are left
   *   out allow all choices
   * @param {{ uniform: () => number, normal: () => number }} noise
   */
  act(sensors, state, masks = {}, noise = noiseFrom(Math.random)) {
    const allowed = this.branches.map(({ name, choices }) => masks[name] ?? choices.map(() => true));
    const axes = new Float32Array(this.axes.length);
    const choices = new Int32Array(this.branches.length);
    const next = this.networks.map((network, index) => {
      const { newest, seen } = see(network, sensors, state[index]);
      const images = network.images.map((image, k) => encode(image, seen[k + 1], ACTIVATIONS[network.activation]));
      const features = network.images.flatMap(({ moments: found = [] }, k) => [
        images[k].at(-1).values,
        ...found.map(({ step, grid }) => moments(images[k][step], grid)),
      ]);
      const inputs = Float32Array.from([seen[0], ...features].flatMap((part) => Array.from(part)));
      const { values, memory } = dense(network, inputs, state[index].at(-1));
      const outputs = finite(point(network, Array.from(values), images));
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
      return [...seen.map((values, part) => values.slice(newest[part].length)), memory];
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

/** A recurrent layer. `numbers`: of what it remembers. */
class Memory {
  constructor({ kind, input, state }) {
    [this.kind, this.input, this.state] = [kind, input, state];
    this.size = this.state.bias.length / (kind === "lstm" ? 4 : 3);
    this.numbers = this.size * (kind === "lstm" ? 2 : 1);
  }

  /** Return { values, memory }: what it puts out for some features, and what it remembers next. */
  remember(features, memory) {
    const [last, cells] = [memory.slice(0, this.size), memory.slice(this.size)];
    const [given, kept] = [linear(this.input, features), linear(this.state, last)];
    const gate = (gates, number) => (k) => gates[number * this.size + k];
    if (this.kind === "gru") {
      const [[reset, update, fresh], [byReset, byUpdate, byFresh]] = [given, kept].map((gates) =>
        [0, 1, 2].map((number) => gate(gates, number)),
      );
      const values = last.map((before, k) => {
        const fresher = Math.tanh(fresh(k) + sigmoid(reset(k) + byReset(k)) * byFresh(k));
        const share = sigmoid(update(k) + byUpdate(k));
        return (1 - share) * fresher + share * before;
      });
      return { values, memory: values };
    }
    const [write, keep, fresh, show] = [0, 1, 2, 3].map((n) => gate(given.map((sum, row) => sum + kept[row]), n));
    const next = cells.map((cell, k) => sigmoid(keep(k)) * cell + sigmoid(write(k)) * Math.tanh(fresh(k)));
    const values = next.map((cell, k) => sigmoid(show(k)) * Math.tanh(cell));
    return { values, memory: Float32Array.from([...values, ...next]) };
  }
}

/** Return what a network sees now, `newest`, and with it what it saw before, `seen`: a frame, then each picture. */
function see(network, sensors, state) {
  const frame = scale(network, network.sensors.flatMap((name) => Array.from(sensors[name], Number)));
  const newest = [frame, ...network.images.map(({ sensor }) => Array.from(sensors[sensor], Number))];
  return { newest, seen: newest.map((values, part) => Float32Array.from([...state[part], ...values])) };
}

/** Return a frame as the network was trained with it. */
function scale({ scaling: { shift, scale, limit = Infinity } = {} }, frame) {
  if (!shift) return frame;
  return frame.map((x, index) => clip((x - shift[index]) * scale[index], -limit, limit));
}

/** Return an image, its last pictures, after each step of its encoder. */
function encode({ shape: [height, width, channels], white, steps }, stack, activate) {
  const size = height * width * channels;
  const values = new Float32Array(stack.length); // [frames * channels, height, width]
  stack.forEach((byte, k) => {
    const [frame, pixel, channel] = [Math.floor(k / size), Math.floor((k % size) / channels), k % channels];
    values[(frame * channels + channel) * height * width + pixel] = byte / white;
  });
  let image = { channels: stack.length / (height * width), height, width, values };
  return steps.map((step) => (image = take(step, image, activate)));
}

/** Return x, then y, then mass of what each channel of an image finds. */
function moments({ channels, values }, grid) {
  const [size, masses] = [grid.length / 2, values.map((x) => x * x)];
  if (masses.length !== channels * size) throw new Error("the policy is damaged");
  const sums = [(k) => grid[k], (k) => grid[size + k], () => 1].map((share) =>
    Array.from({ length: channels }, (_, channel) =>
      masses.slice(channel * size, (channel + 1) * size).reduce((sum, mass, k) => sum + mass * share(k), 0),
    ),
  );
  return sums.flatMap((sum, part) => sum.map((value, k) => value / (sums[2][k] + (part < 2 ? FAINT : 1))));
}

/** Return outputs in which what a map looks for, a weight for each channel, has become the logits of its cells. */
function point({ discrete }, outputs, images) {
  const take = (count) => outputs.splice(0, count);
  const logits = discrete.flatMap(({ places, values: cells }) => {
    if (!places) return take(cells.length);
    const sums = cells.map(() => 0);
    for (const { image, step, channels, weight } of places) {
      const [wanted, { height, width, values }] = [take(channels), images[image][step]];
      const size = height * width;
      for (let k = 0; k < size; k++) {
        const found = wanted.reduce((sum, share, channel) => sum + share * values[channel * size + k], 0);
        for (let cell = 0; cell < sums.length; cell++) sums[cell] += weight[cell * size + k] * found;
      }
    }
    return sums;
  });
  return [...logits, ...outputs];
}

/** Return an image after a step of an encoder. */
function take(step, image, activate) {
  if (step.kind === "activation") return { ...image, values: image.values.map(activate) };
  if (step.kind !== "residual") return slide(step, image);
  const { values } = step.steps.reduce((before, inner) => take(inner, before, activate), image);
  return { ...image, values: image.values.map((x, k) => x + values[k]) };
}

/** Return the weighted sum of all channels in each window of an image, or without weights each channel's maximum. */
function slide({ size: [rows, columns], stride, padding, weight, bias }, { channels, height, width, values }) {
  const [down, across] = [height - rows, width - columns].map((room) => Math.floor((room + 2 * padding) / stride) + 1);
  const outputs = weight ? bias.length : channels;
  if (!(outputs * down * across <= MAX_NUMBERS)) throw new Error("the policy is damaged");
  const result = new Float32Array(outputs * down * across);
  for (let place = 0; place < result.length; place++) {
    const output = Math.floor(place / (down * across));
    const [top, left] = [Math.floor(place / across) % down, place % across].map((at) => at * stride - padding);
    let total = weight ? bias[output] : -Infinity;
    for (let channel = weight ? 0 : output; channel < (weight ? channels : output + 1); channel++) {
      for (let y = Math.max(top, 0); y < Math.min(top + rows, height); y++) {
        for (let x = Math.max(left, 0); x < Math.min(left + columns, width); x++) {
          const value = values[(channel * height + y) * width + x];
          if (!weight) total = Math.max(total, value);
          else total += weight[((output * channels + channel) * rows + y - top) * columns + x - left] * value;
        }
      }
    }
    result[place] = total;
  }
  return { channels: outputs, height: down, width: across, values: result };
}

/** Return what the dense layers of a network put out, with its activation between them, and its next memory. */
function dense({ layers, activation, memory: recurrent }, inputs, before) {
  let [values, memory] = [inputs, before];
  layers.forEach((layer, number) => {
    if (number) values = values.map(ACTIVATIONS[activation]);
    if (recurrent && number === layers.length - 1) ({ values, memory } = recurrent.remember(values, memory));
    values = linear(layer, values);
  });
  return { values, memory };
}

function linear({ weight, bias }, given) {
  if (weight.length !== bias.length * given.length) throw new Error("the policy is damaged");
  return bias.map((sum, row) => {
    for (let column = 0; column < given.length; column++) sum += weight[row * given.length + column] * given[column];
    return sum;
  });
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

/** Return a part of the file with its arrays as numbers. */
function decoded(part) {
  if (part === null || typeof part !== "object") return part;
  if (part.float32 !== undefined) return floats(part);
  if (Array.isArray(part)) return part.map(decoded);
  return Object.fromEntries(Object.entries(part).map(([key, value]) => [key, decoded(value)]));
}

/** Return the numbers of an array of the file: little-endian floats of 32 bits, as base64. */
function floats({ float32 }) {
  const bytes = Uint8Array.from(atob(float32), (character) => character.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Float32Array.from({ length: bytes.length / 4 }, (_, index) => view.getFloat32(4 * index, true));
}
