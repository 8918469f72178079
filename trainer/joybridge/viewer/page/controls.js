// The controls: remembered by the browser for each game, and changed in the page.

import { keyName } from "./inputs.js";
import { element } from "./panel.js";

const POINTERS = { movement: "its movement", position: "its position in the picture", stick: "its offset from the center", off: "nothing" };
const WAYS = ["left", "right", "down", "up"];

// Returns the remembered controls of a game, or those that were made from its spec.
export function loadControls(game) {
  try {
    const { device, controls } = JSON.parse(localStorage.getItem(place(game)));
    if (device === signature(game)) return controls;
  } catch { /* nothing is remembered */ }
  return structuredClone(game.controls);
}

function place(game) {
  return `joybridge.controls.${game.name}.${signature(game)}`;
}

// Returns what must be the same for controls to fit: an option of a game may change its device.
function signature(game) {
  return JSON.stringify(game.behaviors.map(({ axes, branches }) => [axes.map(({ name }) => name), branches.map(({ name, choices }) => [name, choices.length])]));
}

// Fills the editor. changed is called after each change of state.controls.
export function editControls(editor, state, inputs, changed) {
  const { game } = state;
  const save = () => {
    localStorage.setItem(place(game), JSON.stringify({ device: signature(game), controls: state.controls }));
    changed();
  };
  const again = () => editControls(editor, state, inputs, changed);

  const bindings = (control, index, label) => {
    const remove = (code) => () => {
      control.keys[index] = control.keys[index].filter((one) => one !== code);
      save();
      again();
    };
    const keys = control.keys[index].map((code) => {
      const key = element("button", { type: "button", title: "Remove", aria: { label: `Remove ${keyName(code)} from ${label}` } }, `${keyName(code)} ×`);
      key.addEventListener("click", remove(code));
      return key;
    });
    const add = element("button", { type: "button", aria: { label: `Add a key for ${label}` } }, "+");
    add.addEventListener("click", async () => {
      add.classList.add("capturing");
      add.textContent = "press a key or button, Esc: none";
      const code = await capture(inputs);
      if (code) {
        for (const other of state.controls) other.keys = other.keys.map((codes) => codes.filter((one) => one !== code));
        control.keys[index] = [...control.keys[index], code];
        save();
      }
      again();
    });
    return element("div", { className: "binding" }, element("span", {}, label), element("span", { className: "keys" }, ...keys, add));
  };

  const check = (label, checked, set) => {
    const box = element("input", { type: "checkbox", checked });
    box.addEventListener("change", () => { set(box.checked); save(); });
    return element("label", { className: "row" }, box, label);
  };

  const select = (label, value, choices, set) => {
    const list = element("select", {}, ...Object.entries(choices).map(([key, text]) => element("option", { value: key, selected: key === String(value) }, text)));
    list.addEventListener("change", () => { set(list.value); save(); });
    return element("label", { className: "field" }, label, list);
  };

  const stick = (control, behavior) => {
    const shown = [0, 1].filter((axis) => control.axes[axis] !== null);
    const names = shown.map((axis) => behavior.axes[control.axes[axis]].name).join(", ");
    const range = element("input", { type: "range", min: -2, max: 2, step: 0.1, value: Math.log2(control.sensitivity) });
    range.addEventListener("input", () => { control.sensitivity = 2 ** range.valueAsNumber; save(); });
    const ways = WAYS.map((way, index) => [way, index]).filter(([, index]) => control.axes[index < 2 ? 0 : 1] !== null || control.span);
    return element("fieldset", {}, element("legend", {}, names),
      select("the pointer acts with", control.pointer, POINTERS, (value) => { control.pointer = value; }),
      element("label", { className: "field" }, "sensitivity of the pointer's movement", range),
      select("stick of the gamepad", control.pad, { 0: "left", 1: "right", "-1": "none" }, (value) => { control.pad = Number(value); }),
      ...ways.map(([way, index]) => bindings(control, index, way)),
      element("div", { className: "row" },
        ...shown.map((axis) => check(axis ? "up is down" : "left is right", control.invert[axis], (value) => { control.invert[axis] = value; }))));
  };

  const choice = (control, behavior) => {
    const branch = behavior.branches[control.branch];
    const rows = branch.choices.slice(0, 40).map((label, index) => [label, index]).filter(([, index]) => branch.choices.length > 2 || index !== control.rest);
    return element("fieldset", {}, element("legend", {}, branch.name),
      ...rows.map(([label, index]) => bindings(control, index, label)),
      ...(game.interval ? [check("a press lasts for one decision, not until it is released", control.once, (value) => { control.once = value; })] : []));
  };

  const reset = element("button", { type: "button" }, "As at first");
  reset.addEventListener("click", () => {
    localStorage.removeItem(place(game));
    state.controls = structuredClone(game.controls);
    changed();
    again();
  });
  editor.replaceChildren(
    element("p", { className: "note" }, "Made from the names in the game's spec. Changes are remembered by this browser."),
    ...state.controls.map((control) => ("axes" in control ? stick : choice)(control, game.behaviors[control.behavior])),
    element("div", { className: "row" }, reset));
}

// Returns the code of the next key, button of the pointer or button of the gamepad; null for Escape.
function capture(inputs) {
  return new Promise((resolve) => {
    const stop = new AbortController();
    const done = (code) => { stop.abort(); resolve(code); };
    const options = { signal: stop.signal, capture: true };
    addEventListener("keydown", (event) => { event.preventDefault(); event.stopPropagation(); done(event.code === "Escape" ? null : event.code); }, options);
    addEventListener("pointerdown", (event) => { event.preventDefault(); done(`Mouse${event.button}`); }, options);
    const look = () => {
      if (stop.signal.aborted) return;
      const button = inputs.pad()?.buttons.findIndex((one) => one.pressed) ?? -1;
      if (button >= 0) done(`Pad${button}`);
      else requestAnimationFrame(look);
    };
    look();
  });
}
