// The page: its connection, what state it is in, and what it sends.
//
// After each message `turn` the page answers with an act, and again after each event until that act is played. So every
// decision is one that the page has seen, presses between two decisions are not lost, and movement is played once.

import { gameCodes, makeAct } from "./device.js";
import { Inputs, isFree, keyName } from "./inputs.js";
import { editControls, loadControls } from "./controls.js";
import { Panel } from "./panel.js";
import { editSettings } from "./settings.js";

const $ = (id) => document.getElementById(id);
const RETRY_MS = 1000;
const OTHERS_MS = 500; // before others decide in a game without a clock
const TAKEN = 4001; // the code with which the server closes the socket of a page that has found no place
const NEVER = "Trying again. If you have started joybridge play again, open the URL that it printed.";

const state = {
  socket: null, game: null, controls: [], turn: null, wanted: null, // settings that this page asked for
  running: false, ready: false, // ready: the curtain may be opened
  chosen: new Map(), // control -> choice, in a game without a clock
  acts: new Map(), // id -> { presses, movement }
  id: 0, events: [], // times of events that are not shown yet, as [id, time]
  step: 0, // the last id that is to be played while the game is held
  seat: null,
};
const inputs = new Inputs($("stage"), $("picture"), onInput);
const panel = new Panel(state, inputs, onChip);
const figures = { turns: [], pictures: [], latencies: [] };
let drawing = Promise.resolve(); // pictures are shown in their order
let opening = null; // the first picture of the next episode, while people look at the end of theirs
let awaited = []; // of the pictures that follow: which canvas, and which tick of the decision
let began = 0; // when the first picture of the turn came
let first = null; // time of the first event that no act contains yet
let timer = 0;
let locked = false; // whether the browser holds the pointer

function connect() {
  const socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
  socket.binaryType = "blob";
  state.socket = socket;
  socket.onmessage = (event) => (typeof event.data === "string" ? take(JSON.parse(event.data)) : draw(event.data));
  socket.onclose = ({ code, reason }) => {
    hold();
    if (code === TAKEN) curtain("Somebody else plays", reason);
    else curtain("Not connected", NEVER, { trouble: true });
    setTimeout(connect, RETRY_MS);
  };
}

function send(message) {
  if (state.socket?.readyState === WebSocket.OPEN) state.socket.send(JSON.stringify(message));
}

function take(message) {
  if (message.type === "game") begin(message);
  else if (message.type === "turn") takeTurn(message);
  else if (message.type === "recorded") {
    $("recorded").hidden = $("discard").hidden = false;
    $("recorded").textContent = `● recorded in ${message.folder}`;
    $("discard").disabled = message.discarded;
    $("discard").textContent = message.discarded ? "Episode discarded" : "Discard episode";
  } else if (message.type === "people") $("people").textContent = message.text;
  else if (message.type === "waiting") {
    hold();
    curtain("Waiting for others", message.text);
  } else if (message.type === "lost") {
    hold();
    curtain("The simulator is gone", `${message.text}. Trying again …`, { trouble: true });
  } else if (message.type === "refused") {
    hold();
    state.ready = message.playing && state.turn !== null; // the game before goes on with a click
    curtain("That cannot be played", message.text, { trouble: true });
    $("settings-card").open = true;
  }
}

function begin(game) {
  const wanted = state.wanted;
  if (wanted && !game.fixed && state.game?.name === game.name && !same(wanted, game)) { // a new connection: the page's settings again
    send({ type: "start", ...wanted });
    state.wanted = null;
    return;
  }
  Object.assign(state, { game, controls: loadControls(game), running: false, turn: null, seat: game.seat });
  state.chosen.clear();
  opening = null; // it is of the game before
  clearTimeout(timer);
  forget();
  document.title = `${game.name} · Joybridge`;
  $("name").textContent = game.name;
  $("description").textContent = game.description;
  const [width, height] = game.picture ?? [640, 240];
  for (const id of ["picture", "rival-picture"]) Object.assign($(id), { width, height }).style.setProperty("--ratio", width / height);
  $("stage").classList.add("empty");
  $("step").textContent = game.interval ? "Step" : "Decide";
  panel.begin();
  controlsChanged();
  editControls($("controls"), state, inputs, controlsChanged);
  editSettings($("settings"), game, (settings) => {
    state.wanted = settings;
    send({ type: "start", ...settings });
    $("stage").focus();
  });
}

function same(settings, game) {
  const now = (list) => JSON.stringify(Object.fromEntries(list.map((one) => [one.name, one.value])));
  return settings.seed === game.seed && JSON.stringify(settings.options) === now(game.options)
    && JSON.stringify(settings.parameters) === now(game.parameters);
}

function controlsChanged() {
  inputs.game = gameCodes(state.controls);
  panel.showKeys();
}

function takeTurn(turn) {
  const played = state.acts.get(turn.played);
  if (played) inputs.consume(played.presses, played.movement);
  for (const id of state.acts.keys()) if (id <= turn.played) state.acts.delete(id);
  state.turn = turn;
  awaited = [["picture", turn.pictures], ["rival-picture", turn.rival?.pictures ?? 0]]
    .flatMap(([id, count]) => [...Array(count).keys()].map((tick) => [id, tick]));
  state.chosen.clear();
  panel.take(turn);
  figures.turns.push(performance.now());
  const own = turn.ended.filter((end) => state.seat === null || end.seat === state.seat);
  if (own.length) {
    turn.over = true;
    hold();
    state.ready = true;
    curtain("The episode is over", panel.summary(own), { keys: false });
  } else if (state.running) {
    answer();
  } else if (state.step > turn.played) { // a single decision that was asked for while this turn was on its way
    answer(true);
  } else if (turn.turn === 0) {
    state.ready = true;
    const { interval, picture } = state.game;
    curtain("Click or press Enter to begin", [interval ? "" : "The game waits for your decisions.", picture ? "" : "It has no picture."].join(" "),
      { keys: true });
  }
}

function answer(decide = false) {
  if (!state.turn) return;
  const act = makeAct(state.game, state.controls, inputs, state.chosen, panel.forbidden);
  panel.refuse(act.refused);
  state.id += 1;
  state.acts.set(state.id, { presses: act.presses, movement: act.movement });
  if (decide && !state.running) state.step = state.id;
  if (first !== null) state.events.push([state.id, first]);
  first = null;
  const others = !state.game.interval && state.running && !panel.decides();
  send({ type: "act", turn: state.turn.turn, id: state.id, seat: state.seat, axes: act.axes, choices: act.choices, decide });
  clearTimeout(timer);
  if (others && !decide) timer = setTimeout(() => answer(true), OTHERS_MS);
}

function onInput(time, code) {
  first ??= time;
  if (!state.running) return;
  if (!state.game.interval && code) {
    for (const [number, control] of state.controls.entries()) {
      const choice = "branch" in control ? control.keys.findIndex((codes) => codes.includes(code)) : -1;
      if (choice >= 0) return onChip(number, choice);
    }
  }
  answer();
}

// In a game without a clock a choice stays until the decision; if it is all there is to decide, it is the decision.
function onChip(number, choice) {
  if (!state.running || state.game.interval) return;
  const control = state.controls[number];
  if (panel.forbidden(control.behavior, control.branch).has(choice)) return panel.refuse([[number, choice]]);
  if (!panel.decides()) return;
  if (state.chosen.get(number) === choice) state.chosen.delete(number);
  else state.chosen.set(number, choice);
  panel.show();
  answer(state.controls.length === 1);
}

// The pictures that a turn has announced follow it: of the arena, one per tick in their pace, then of the rival. At the end
// of an episode the last one is of the next episode: people first see how theirs ended.
function draw(blob) {
  const turn = state.turn, [id, tick] = awaited.shift() ?? ["picture", 0], canvas = $(id);
  if (canvas.id === "picture") {
    opening = turn.over && awaited[0]?.[0] !== "picture" ? blob : null;
    if (opening) return;
  }
  if (tick === 0) began = performance.now();
  const due = began + 1000 * state.game.tick * tick;
  drawing = drawing.then(async () => {
    const bitmap = await createImageBitmap(blob), early = due - performance.now();
    if (turn === state.turn && early > 0) await new Promise((shown) => setTimeout(shown, early)); // else a newer one waits
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    bitmap.close();
    if (canvas.id !== "picture") return;
    $("stage").classList.remove("empty");
    const now = performance.now();
    figures.pictures.push(now);
    while (state.events.length && state.events[0][0] <= turn.played) figures.latencies.push(now - state.events.shift()[1]);
    figures.latencies.splice(0, figures.latencies.length - 500);
  }).catch((error) => console.error(error));
}

function run() {
  if (!state.ready || !state.turn) return;
  state.turn.over = false; // its last picture is drawn, also if it is still on its way
  if (opening) {
    awaited.unshift(["picture", 0]);
    draw(opening);
  }
  forget();
  state.running = inputs.active = true;
  $("curtain").className = "";
  $("stage").classList.add("playing");
  $("pause").disabled = $("step").disabled = false;
  $("pause").textContent = "Pause";
  send({ type: "clock", running: true });
  answer();
  $("stage").focus({ preventScroll: true });
  if (state.controls.some((control) => control.pointer === "movement")) lock();
}

// Forgets what was pressed and is not played yet.
function forget() {
  inputs.releaseAll();
  state.acts.clear();
  state.events = [];
  first = null;
}

// The pointer stays in the picture while its movement is played. Browsers may refuse.
function lock() {
  if (matchMedia("(pointer: fine)").matches) $("stage").requestPointerLock?.()?.catch?.(() => {});
}

function hold() {
  state.running = inputs.active = false;
  state.ready = false;
  state.step = 0;
  clearTimeout(timer);
  forget();
  $("stage").classList.remove("playing");
  $("pause").disabled = $("step").disabled = true;
  if (document.pointerLockElement) document.exitPointerLock();
  send({ type: "clock", running: false });
}

function pause() {
  hold();
  state.ready = true;
  $("pause").disabled = $("step").disabled = false;
  $("pause").textContent = "Continue";
  curtain("Paused", state.game.interval ? "Click or press Enter to continue, . for a single decision." : "Click or press Enter to continue.",
    { keys: true });
}

function step() {
  if (!state.game.interval && (!state.running || (state.controls.length === 1 && "branch" in state.controls[0]))) return;
  if (state.game.interval) { // keys that are held count
    if (state.running) pause();
    $("curtain").className = "";
    inputs.active = true;
  }
  answer(true);
}

function curtain(title, text, { trouble = false, keys = false } = {}) {
  $("curtain").className = trouble ? "shown trouble" : "shown";
  $("curtain-title").textContent = title;
  $("curtain-text").textContent = text;
  $("curtain-keys").replaceChildren(...(keys ? panel.legend(keyName) : []));
}

$("stage").addEventListener("click", () => (state.running ? null : run()));
$("pause").addEventListener("click", () => (state.running ? pause() : run()));
$("step").addEventListener("click", step);
$("discard").addEventListener("click", () => { send({ type: "discard" }); $("stage").focus(); });
$("seat").addEventListener("change", () => {
  state.seat = $("seat").value === "" ? null : Number($("seat").value);
  panel.buildScores();
  panel.show();
  if (state.running) answer();
  $("stage").focus();
});
$("theme").addEventListener("click", () => {
  const dark = getComputedStyle(document.documentElement).colorScheme === "dark"
    || (!document.documentElement.dataset.theme && matchMedia("(prefers-color-scheme: dark)").matches);
  localStorage.setItem("joybridge.theme", (document.documentElement.dataset.theme = dark ? "light" : "dark"));
});
addEventListener("keydown", (event) => {
  if (!isFree(event)) return;
  if (event.code === "Space") event.preventDefault(); // it would scroll the page
  if (event.repeat || !state.game) return;
  if (event.code === "Enter" && !state.running) run();
  else if (event.code === "Enter" && !state.game.interval) step();
  else if (event.code === "Escape" && state.running) pause();
  else if (inputs.active && inputs.game.has(event.code)) return;
  else if (event.code === "KeyP" && (state.running || state.ready)) state.running ? pause() : run();
  else if (event.code === "Period" && (state.running || state.ready)) step();
  else return;
  event.preventDefault();
});
document.addEventListener("pointerlockchange", () => {
  if (locked && !document.pointerLockElement && state.running) pause(); // Escape ends the lock
  locked = document.pointerLockElement !== null;
});
// The game of several people goes on, as their tabs may be in one window.
document.addEventListener("visibilitychange", () => { if (document.hidden && state.running && !state.game.fixed) pause(); });

setInterval(() => {
  const now = performance.now(), sorted = figures.latencies.toSorted((a, b) => a - b);
  const rate = (times) => {
    while (times.length && times[0] < now - 2000) times.shift();
    return state.running ? Math.round(times.length / 2) : "–";
  };
  const part = (share) => (sorted.length ? Math.round(sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))]) : "–");
  $("pace").textContent = rate(figures.turns);
  $("rate").textContent = rate(figures.pictures);
  $("latency").textContent = part(0.5);
  $("latency95").textContent = part(0.95);
}, 500);

const theme = localStorage.getItem("joybridge.theme");
if (theme) document.documentElement.dataset.theme = theme;
connect();
