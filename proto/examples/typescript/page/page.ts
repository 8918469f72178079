/** The page: a policy plays Meteors here, without a server and without a network. */

import { HEIGHT, WIDTH } from "../src/drawing.js";
import { meteors } from "../src/meteors.js";
import { Player } from "../src/player.js";

const TICK = 100; // ms per decision at speed 1
const MOST = 50; // decisions per picture, after a time in which the page was not seen

const picture = find<HTMLCanvasElement>("picture");
const context = picture.getContext("2d") as CanvasRenderingContext2D;
const file = find<HTMLInputElement>("file");
const pause = find<HTMLButtonElement>("pause");
const again = find<HTMLButtonElement>("again");
[picture.width, picture.height] = [WIDTH, HEIGHT];

let policy: unknown = JSON.parse(find("policy").textContent);
let player: Player | undefined;
let rewards: number[] = []; // of the nights that are over
let paused = false;
let last = 0; // ms, when the last decision was due

/** Let the policy play from a random seed, or say why it cannot. */
function begin(): void {
  player = undefined;
  rewards = [];
  try {
    player = new Player(meteors, policy, BigInt(Math.floor(Math.random() * 2 ** 32)));
    pause.disabled = again.disabled = false;
    show(player);
  } catch (error) {
    refuse(error);
  }
}

/** Let nothing play, and say why. */
function refuse(error: unknown): void {
  player = undefined;
  pause.disabled = again.disabled = true;
  tell((error as Error).message);
}

/** Play the decisions that are due. */
function play(now: number): void {
  requestAnimationFrame(play);
  const tick = TICK / Number(find<HTMLSelectElement>("speed").value);
  const due = Math.floor((now - last) / tick);
  if (due < 1) return;
  last += due * tick;
  if (!player || paused) return;
  try {
    for (let decision = 0; decision < Math.min(due, MOST); decision += 1) {
      if (player.episode.end) {
        rewards.push(player.episode.reward);
        player.begin();
      }
      player.step();
    }
    show(player);
  } catch (error) {
    refuse(error);
  }
}

/** Show what the player sees and does. */
function show({ arena, action, episode }: Player): void {
  const pixels = context.createImageData(WIDTH, HEIGHT);
  for (const [index, color] of arena.draw().entries()) pixels.data[index + Math.floor(index / 3)] = color;
  for (let alpha = 3; alpha < pixels.data.length; alpha += 4) pixels.data[alpha] = 255;
  context.putImageData(pixels, 0, 0);
  find("prompt").hidden = true;

  const [accuracy = 0, houses = 3] = episode.metrics;
  const mean = rewards.reduce((sum, reward) => sum + reward, 0) / rewards.length;
  write("score", episode.reward.toFixed(1));
  write("houses", `${houses} of 3`);
  write("accuracy", `${Math.round(100 * accuracy)} %`);
  write("nights", `${rewards.length}`);
  write("mean", rewards.length ? mean.toFixed(1) : "–");
  write("trigger", action.choices[0] ? "pulled" : "released");
  find("trigger").classList.toggle("pulled", action.choices[0] === 1);
  find<HTMLInputElement>("steer").value = `${action.axes[0] ?? 0}`;
}

/** Take another policy. */
async function open(chosen: File | undefined): Promise<void> {
  if (!chosen) return;
  try {
    policy = JSON.parse(await chosen.text());
  } catch {
    policy = null;
  }
  begin();
}

function tell(what: string): void {
  write("prompt", what);
  find("prompt").hidden = false;
}

function write(id: string, text: string): void {
  find(id).textContent = text;
}

function find<Element extends HTMLElement>(id: string): Element {
  return document.getElementById(id) as Element;
}

file.addEventListener("change", () => void open(file.files?.[0]));
document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", (event) => {
  event.preventDefault();
  void open(event.dataTransfer?.files[0]);
});
again.addEventListener("click", begin);
pause.addEventListener("click", () => {
  paused = !paused;
  pause.textContent = paused ? "Go on" : "Pause";
});
if (policy) begin();
requestAnimationFrame(play);
