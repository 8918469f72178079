/** What a policy scores in a game, as text. */

import type { Game } from "./game.js";
import { Player } from "./player.js";

/** Play so many episodes; return means with half the width of their 95 % confidence intervals. */
export function scores(game: Game, document: unknown, episodes: number, seed: bigint): string {
  const player = new Player(game, document, seed);
  const names = ["reward", "length", ...player.metrics];
  const rows = Array.from({ length: episodes }, (_, number) => row(player, number));
  const lines = names.map((name, column) => {
    const values = rows.map((row) => row[column] ?? NaN);
    const mean = values.reduce((sum, value) => sum + value, 0) / episodes;
    const squares = values.reduce((sum, value) => sum + (value - mean) ** 2, 0);
    const half = 1.96 * Math.sqrt(squares / Math.max(episodes - 1, 1) / episodes);
    return `  ${name.padEnd(16)} ${mean.toFixed(3).padStart(10)} ± ${half.toFixed(3)}`;
  });
  return [`${episodes} episodes, mean and 95 % confidence`, ...lines].join("\n");
}

/** Play an episode; return its reward, its length and its metrics. */
function row(player: Player, number: number): number[] {
  if (number) player.begin();
  while (!player.episode.end) player.step();
  const { reward, length, metrics } = player.episode;
  return [reward, length, ...metrics];
}
