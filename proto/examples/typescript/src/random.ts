/** Random numbers per arena: the n-th number of an arena is a pure function of the seed, the arena and n. */

const STEP = 0x9e3779b97f4a7c15n; // 2^64 over the golden ratio, which is odd: multiples of it spread over all 64 bits

/** Return the key of one arena's numbers. */
export function keyOf(seed: bigint, arena: number): bigint {
  return mix(mix(seed + STEP) + BigInt(arena) * STEP);
}

/** Return the n-th number of a key, in [0, 1). */
export function uniform(key: bigint, n: number): number {
  const bits = mix(key + BigInt(n) * STEP) >> 11n; // 53 remain: as many as a number holds
  return Number(bits) / 2 ** 53;
}

/** Scramble 64 bits: the finalizer of SplitMix64 (Steele, Lea and Flood, 2014). */
function mix(value: bigint): bigint {
  let bits = BigInt.asUintN(64, value);
  bits = BigInt.asUintN(64, (bits ^ (bits >> 30n)) * 0xbf58476d1ce4e5b9n);
  bits = BigInt.asUintN(64, (bits ^ (bits >> 27n)) * 0x94d049bb133111ebn);
  return bits ^ (bits >> 31n);
}
