// What is pressed, and what the pointer and a gamepad do. Knows no game.

const DEAD_ZONE = 0.15; // of the sticks of gamepads, of their range

export class Inputs {
  // stage: the element of the game. changed: called with the time of each event that may change what is played.
  constructor(stage, picture, changed) {
    this.stage = stage;
    this.picture = picture;
    this.changed = changed;
    this.held = new Map(); // code -> the number of its press
    this.tapped = new Map(); // the same, also of what was released before it was played
    this.presses = 0;
    this.moved = { x: 0, y: 0 }; // of the pointer since the last played act, in widths of the picture, y downwards
    this.place = null; // of the pointer in the picture, -1..1 each, y upwards; null: it is not over the picture
    this.game = new Set(); // codes that the game uses: the browser does not get them
    this.active = false; // whether the game takes input
    this.last = new Map(); // pointer -> its last place, in pixels
    this.listen();
  }

  press(code, time) {
    if (!this.active || this.held.has(code)) return;
    this.presses += 1;
    this.held.set(code, this.presses);
    this.tapped.set(code, this.presses);
    this.changed(time, code);
  }

  release(code, time) {
    if (this.held.delete(code)) this.changed(time);
  }

  releaseAll() {
    this.held.clear();
    this.tapped.clear();
    this.moved = { x: 0, y: 0 };
  }

  // Returns the number of the newest press among these codes that began after the last act or, unless `once`, is held;
  // 0: none.
  pressed(codes, once = false) {
    return Math.max(0, ...codes.map((code) => Math.max(this.tapped.get(code) ?? 0, once ? 0 : this.held.get(code) ?? 0)));
  }

  // Forgets what has been played: presses up to a number, and a movement.
  consume(presses, movement) {
    for (const [code, number] of this.tapped) if (number <= presses) this.tapped.delete(code);
    this.moved.x -= movement.x;
    this.moved.y -= movement.y;
  }

  pad() {
    return [...(navigator.getGamepads?.() ?? [])].find((pad) => pad?.connected) ?? null;
  }

  // Returns the deflection of a stick of the gamepad, y upwards.
  padStick(number) {
    const axes = this.pad()?.axes.slice(2 * number, 2 * number + 2) ?? [];
    if (number < 0 || axes.length < 2 || Math.hypot(...axes) < DEAD_ZONE) return { x: 0, y: 0 };
    return { x: axes[0], y: -axes[1] };
  }

  listen() {
    addEventListener("keydown", (event) => {
      if (!this.active || !this.game.has(event.code) || !isFree(event, this.game)) return;
      event.preventDefault();
      if (!event.repeat) this.press(event.code, event.timeStamp);
    });
    addEventListener("keyup", (event) => this.release(event.code, event.timeStamp));
    addEventListener("blur", () => this.held.clear());
    this.stage.addEventListener("contextmenu", (event) => event.preventDefault());
    // A tap of a finger arrives as these events, too.
    this.stage.addEventListener("mousedown", (event) => {
      if (this.active && event.button === 1) event.preventDefault(); // no scrolling
      this.press(`Mouse${event.button}`, event.timeStamp);
    });
    addEventListener("mouseup", (event) => this.release(`Mouse${event.button}`, event.timeStamp));
    this.stage.addEventListener("pointermove", (event) => this.move(event));
    this.stage.addEventListener("pointerleave", (event) => {
      this.last.delete(event.pointerId);
      this.place = null;
      if (this.active) this.changed(event.timeStamp);
    });
    addEventListener("gamepadconnected", () => this.poll());
  }

  move(event) {
    const box = this.picture.getBoundingClientRect();
    const last = this.last.get(event.pointerId) ?? event;
    const by = document.pointerLockElement === this.stage ? { x: event.movementX, y: event.movementY }
      : { x: event.clientX - last.clientX, y: event.clientY - last.clientY };
    this.last.set(event.pointerId, { clientX: event.clientX, clientY: event.clientY });
    if (!this.active) return;
    const end = (value) => Math.min(1, Math.max(-1, value));
    this.moved.x += by.x / box.width;
    this.moved.y += by.y / box.width;
    this.place = {
      x: end(((event.clientX - box.left) / box.width) * 2 - 1),
      y: end(1 - ((event.clientY - box.top) / box.height) * 2),
    };
    this.changed(event.timeStamp);
  }

  // Gamepads send no events.
  poll() {
    let last = "";
    const look = (time) => {
      const pad = this.pad();
      if (!pad) return;
      for (const [index, button] of pad.buttons.entries()) {
        if (button.pressed) this.press(`Pad${index}`, time);
        else this.release(`Pad${index}`, time);
      }
      const axes = pad.axes.map((axis) => axis.toFixed(2)).join();
      if (axes !== last && this.active) this.changed(time);
      last = axes;
      requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
  }
}

// Returns whether a key is free for the game: it is not for a field or a button of the page, or for the browser.
// game: the codes that it has; of a modifier among them, holding it is a part of the game.
export function isFree(event, game = new Set()) {
  const taken = event.target.closest?.("input, select") || (event.target.closest?.("button, summary") && ["Space", "Enter"].includes(event.code));
  const ours = (name) => game.has(`${name}Left`) || game.has(`${name}Right`);
  return !taken && !(event.ctrlKey && !ours("Control")) && !(event.metaKey && !ours("Meta")) && !(event.altKey && !ours("Alt"));
}

const NAMES = { Mouse0: "left button", Mouse1: "middle button", Mouse2: "right button", Space: "space", ShiftLeft: "shift",
  ShiftRight: "right shift", ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓" };

// Returns what a code is called.
export function keyName(code) {
  return NAMES[code] ?? code.replace(/^Key|^Digit/, "").replace(/^Pad(?=\d)/, "pad ").replace(/^Numpad/, "num ");
}
