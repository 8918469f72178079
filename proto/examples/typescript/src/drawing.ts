/** Pictures of Meteors, painted with rectangles: rows of pixels from the top, three bytes each. */

import { uniform } from "./random.js";

export const WIDTH = 320;
export const HEIGHT = 240;
const GROUND = 212; // the row on which the town stands
const HOUSE = [26, 44, 34, 52, 22]; // heights of its parts, each 12 pixels wide

type Colour = readonly [red: number, green: number, blue: number];
const ZENITH: Colour = [9, 10, 36];
const DUSK: Colour = [128, 64, 104];
const EARTH: Colour = [26, 21, 42];
const STEEL: Colour = [176, 190, 214];
const STAR: Colour = [240, 234, 208];
const GLOW: Colour = [255, 205, 96];
const EMBER: Colour = [232, 84, 44];
const BEAM: Colour = [150, 240, 255];

const NIGHT = night();

/** What a picture shows: places from -1 to 1, the height of the meteor from 0 to 1, and the houses that stand. */
export interface Scene {
  gun: number;
  x: number; // of the meteor
  height: number;
  drift: number;
  houses: number;
}

/** Return a picture. `heat` is 1 in the moment of a shot; `most` is the houses of a whole town. */
export function draw({ gun, x, height, drift, houses }: Scene, heat: number, most: number): Uint8Array {
  const pixels = NIGHT.slice();
  const across = (place: number): number => WIDTH / 2 + place * (WIDTH / 2 - 14);

  for (let house = 0; house < most; house += 1) {
    for (const [index, tall] of HOUSE.entries()) {
      const left = Math.round(across((2 * house + 1) / most - 1)) + 12 * index - 30;
      const top = GROUND - (house < houses ? tall : 2 + (tall % 9));
      paint(pixels, left, top, 12, GROUND - top, EARTH);
      for (let row = top + 5; row < GROUND - 6; row += 8) {
        for (const side of [2, 7]) if ((row + index + side) % 3) paint(pixels, left + side, row, 3, 4, GLOW);
      }
    }
  }

  const [column, row] = [across(x), 10 + (1 - height) * (GROUND - 10)];
  for (let puff = 14; puff > 0; puff -= 1) {
    const [left, top, size] = [column - 40 * drift * puff, row - 4 * puff, 13 - 0.7 * puff];
    paint(pixels, left - size / 2, top - size / 2, size, size, puff < 6 ? GLOW : EMBER, 0.5 - puff / 32);
  }
  for (const [size, color] of [[14, EMBER], [9, GLOW], [4, STAR]] as const) {
    paint(pixels, column - size / 2, row - size / 2, size, size, color);
  }

  for (const [width, share] of [[12, 0.15], [6, 0.4], [2, 1]] as const) {
    if (heat === 1) paint(pixels, across(gun) - width / 2, 0, width, GROUND, BEAM, share);
  }
  paint(pixels, across(gun) - 3, GROUND - 16, 6, 16, STEEL);
  paint(pixels, across(gun) - 3, GROUND - 16, 6, 12, EMBER, heat);
  paint(pixels, across(gun) - 10, GROUND - 2, 20, 10, STEEL);
  return pixels;
}

/** Return what is behind every picture. */
function night(): Uint8Array {
  const pixels = new Uint8Array(3 * WIDTH * HEIGHT);
  paint(pixels, 0, 0, WIDTH, HEIGHT, ZENITH);
  for (let row = 0; row < GROUND; row += 1) paint(pixels, 0, row, WIDTH, 1, DUSK, (row / GROUND) ** 2);
  for (let star = 0; star < 80; star += 1) {
    const [place, height, light] = [uniform(1n, star), uniform(2n, star), uniform(3n, star)];
    paint(pixels, place * WIDTH, 0.7 * height * GROUND, 1 + light, 1 + light, STAR, light);
  }
  for (const cut of [0, 2, 5]) paint(pixels, 261 - cut, 26 + cut, 14 + 2 * cut, 24 - 2 * cut, STAR); // the moon
  paint(pixels, 0, GROUND, WIDTH, HEIGHT - GROUND, EARTH);
  paint(pixels, 0, GROUND + 8, WIDTH, 2, STEEL, 0.4); // the rail
  return pixels;
}

/** Blend a rectangle, cut at the edges, with a color; a share of 1 covers what was there. */
function paint(
  pixels: Uint8Array, left: number, top: number, width: number, height: number, color: Colour, share = 1,
): void {
  const [first, end] = [Math.max(0, Math.round(left)), Math.min(WIDTH, Math.round(left + width))];
  for (let row = Math.max(0, Math.round(top)); row < Math.min(HEIGHT, Math.round(top + height)); row += 1) {
    for (let at = 3 * (row * WIDTH + first); at < 3 * (row * WIDTH + end); at += 1) {
      pixels[at] = (1 - share) * (pixels[at] ?? 0) + share * (color[at % 3] ?? 0);
    }
  }
}
