// The page of a training that runs: its newest policies at play, what they think, and the learning curves. Or of a game
// without a run: random play.

import { Panel, element, number } from "./panel.js";

const $ = (id) => document.getElementById(id);
const RETRY_MS = 1000;
const COLORS = ["#d2601a", "#3f7fbf", "#3f9a5c", "#a35fc0", "#b8a020", "#c0506a"];
const state = { socket: null, game: null, controls: [], turn: null, seat: null, chosen: new Map() };
const panel = new Panel(state, { press() {}, release() {} }, () => {});
let drawing = Promise.resolve(); // pictures are shown in their order
let curves = {}; // policy -> metric -> [[timesteps, value], …]
let running = true;

function connect() {
  const socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
  socket.binaryType = "blob";
  state.socket = socket;
  socket.onopen = clock;
  socket.onmessage = (event) => (typeof event.data === "string" ? take(JSON.parse(event.data)) : draw(event.data));
  socket.onclose = () => {
    curtain("Not connected", "Trying again. If you have started joybridge watch again, open the URL that it printed.");
    setTimeout(connect, RETRY_MS);
  };
}

function take(message) {
  if (message.type === "game") begin(message);
  else if (message.type === "turn") takeTurn(message);
  else if (message.type === "curves") takeCurves(message.policies);
  else if (message.type === "lost") curtain("Nothing can be played yet", `${message.text}. Trying again …`);
}

function begin(game) {
  // Keys press nothing here, so none is shown.
  const controls = game.controls.map((control) => ({ ...control, keys: control.keys.map(() => []) }));
  Object.assign(state, { game, controls, turn: null, seat: null });
  document.title = `${game.name} · Joybridge`;
  $("name").textContent = game.name;
  $("description").textContent = game.description;
  const [width, height] = game.picture ?? [640, 240];
  Object.assign($("picture"), { width, height }).style.setProperty("--ratio", width / height);
  $("stage").classList.add("empty");
  $("stage").hidden = !game.picture;
  panel.begin();
  panel.showKeys();
  $("seat-label").hidden = game.seats.length < 2;
  $("curtain").className = "";
}

function takeTurn(turn) {
  state.turn = turn;
  state.chosen = new Map(state.controls.flatMap((control, place) => ("branch" in control
    ? [[place, turn.behaviors[control.behavior].choices[panel.agent(control.behavior)][control.branch]]] : [])));
  panel.take(turn);
  const random = !("outputs" in turn); // a game without a run
  $("curves-card").hidden = $("outputs-card").hidden = random;
  $("trained").textContent = random ? "random decisions" : `after ${turn.timesteps.toLocaleString("en")} timesteps`;
  $("outputs").replaceChildren(...(turn.outputs ?? []).flatMap(showOutputs));
}

// Returns the elements of what one policy thinks: of the first of its agents.
function showOutputs({ policy, lanes }) {
  const { value, branches, axes } = lanes[0];
  const bar = (label, share, text) => [element("span", {}, label), element("progress", { max: 1, value: share }),
    element("span", { className: "value" }, text)];
  return [
    element("h3", {}, `${policy} · value ${number(value)}`),
    ...branches.map(({ name, choices, map }) => (map ? heatMap(name, map) : element("div", { className: "chances" },
      element("b", {}, name),
      ...choices.flatMap(({ label, chance }) => bar(label, chance, `${(100 * chance).toFixed(0)} %`))))),
    ...(axes.length ? [element("div", { className: "chances" }, ...axes.flatMap(({ name, mean, deviation }) =>
      bar(name, (Math.max(-1, Math.min(1, mean)) + 1) / 2, `${mean.toFixed(2)} ± ${deviation.toFixed(2)}`)))] : []),
  ];
}

// Returns a picture of the chances of all places that a policy may point at, the likeliest in full color.
function heatMap(name, { height, width, chances }) {
  const canvas = element("canvas", { className: "map", width, height, role: "img" }), context = canvas.getContext("2d");
  const most = Math.max(...chances);
  context.fillStyle = COLORS[0];
  for (const [cell, chance] of chances.entries()) {
    context.globalAlpha = chance / most;
    context.fillRect(cell % width, Math.floor(cell / width), 1, 1);
  }
  const label = `${name}: ${width} × ${height} places, the likeliest has ${(100 * most).toFixed(0)} %`;
  canvas.ariaLabel = label;
  return element("div", {}, element("b", {}, label), canvas);
}

function draw(blob) {
  drawing = drawing.then(async () => {
    const bitmap = await createImageBitmap(blob), canvas = $("picture"), { width, height } = bitmap;
    // Images that the policy sees make the picture wider than the game's.
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height }).style.setProperty("--ratio", width / height);
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    bitmap.close();
    $("stage").classList.remove("empty");
  }).catch((error) => console.error(error));
}

function takeCurves(policies) {
  curves = policies;
  const metrics = [...new Set(Object.values(policies).flatMap((own) => Object.keys(own)))];
  const now = $("metric").value || "reward";
  $("metric").replaceChildren(...metrics.map((name) => element("option", { value: name }, name)));
  $("metric").value = metrics.includes(now) ? now : metrics[0] ?? "";
  showCurves();
}

function showCurves() {
  const metric = $("metric").value, canvas = $("curves"), context = canvas.getContext("2d");
  const lines = Object.entries(curves).map(([policy, own]) => [policy, own[metric] ?? []]).filter(([, points]) => points.length);
  const { width, height } = canvas, [left, right, top, bottom] = [110, 20, 20, 50];
  context.clearRect(0, 0, width, height);
  const points = lines.flatMap(([, own]) => own);
  if (!points.length) return;
  const values = points.map(([, value]) => value), last = Math.max(...points.map(([time]) => time));
  let [low, high] = [Math.min(...values), Math.max(...values)];
  if (low === high) [low, high] = [low - 1, high + 1];
  const x = (time) => left + (time / last) * (width - left - right);
  const y = (value) => height - bottom - ((value - low) / (high - low)) * (height - top - bottom);
  const ink = getComputedStyle(document.body).color;
  Object.assign(context, { font: "22px system-ui", fillStyle: ink, strokeStyle: ink, lineWidth: 1, globalAlpha: 0.7 });
  for (const share of [0, 0.5, 1]) {
    const value = low + share * (high - low);
    context.textAlign = "right";
    context.fillText(number(value), left - 12, y(value) + 8);
    context.beginPath();
    context.moveTo(left, y(value));
    context.lineTo(width - right, y(value));
    context.stroke();
    context.textAlign = share ? "right" : "left";
    if (share !== 0.5) context.fillText((share * last).toLocaleString("en"), x(share * last), height - 14);
  }
  context.globalAlpha = 1;
  for (const [index, [, own]] of lines.entries()) {
    Object.assign(context, { strokeStyle: COLORS[index % COLORS.length], lineWidth: 4, lineJoin: "round" });
    context.beginPath();
    for (const [time, value] of own) context.lineTo(x(time), y(value));
    if (own.length === 1) context.lineTo(x(own[0][0]) + 2, y(own[0][1]));
    context.stroke();
  }
  $("newest").replaceChildren(...lines.map(([policy, own], index) => {
    const label = element("span", {}, `${policy}: ${metric} ${number(own.at(-1)[1])} after ${own.at(-1)[0].toLocaleString("en")} timesteps  `);
    label.style.color = COLORS[index % COLORS.length];
    return label;
  }));
}

function curtain(title, text) {
  $("stage").hidden = false;
  $("curtain").className = "shown trouble";
  $("curtain-title").textContent = title;
  $("curtain-text").textContent = text;
}

// Lets the game run, unless nobody sees it: the processor belongs to the training.
function clock() {
  $("pause").textContent = running ? "Pause" : "Continue";
  if (state.socket?.readyState !== WebSocket.OPEN) return;
  state.socket.send(JSON.stringify({ type: "clock", running: running && !document.hidden }));
}

$("pause").addEventListener("click", () => {
  running = !running;
  clock();
});
document.addEventListener("visibilitychange", clock);
$("metric").addEventListener("change", showCurves);
$("seat").addEventListener("change", () => {
  state.seat = $("seat").value === "" ? null : Number($("seat").value);
  panel.buildScores();
  panel.show();
});
$("theme").addEventListener("click", () => {
  const dark = getComputedStyle(document.documentElement).colorScheme === "dark"
    || (!document.documentElement.dataset.theme && matchMedia("(prefers-color-scheme: dark)").matches);
  localStorage.setItem("joybridge.theme", (document.documentElement.dataset.theme = dark ? "light" : "dark"));
  showCurves();
});

const theme = localStorage.getItem("joybridge.theme");
if (theme) document.documentElement.dataset.theme = theme;
connect();
