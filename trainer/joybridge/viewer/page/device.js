// From inputs to the axes and choices of a device, by the controls.

const CROSSING = 0.8; // seconds in which a pointer at full speed crosses the picture, at sensitivity 1
const TURN_BASED = 0.1; // seconds that a decision of a game without a clock stands for
const CARRIED = 10; // decisions of movement that are made up for if the pointer is too fast
const CENTER = 0.08; // offset of the pointer, of half the picture, that is no deflection yet

// Returns { axes, choices, presses, movement, refused }: a list per behavior of each; what was used of the inputs; and
// the choices that are pressed and forbidden, as [control, choice]. chosen: control -> choice, in a game without a clock,
// where keys are held for no time. forbidden(behavior, branch) returns a set.
export function makeAct(game, controls, inputs, chosen, forbidden) {
  const act = {
    axes: game.behaviors.map((behavior) => behavior.axes.map((axis) => axis.rest)),
    choices: game.behaviors.map((behavior) => behavior.branches.map(() => 0)),
    presses: inputs.presses, movement: { x: 0, y: 0 }, refused: [],
  };
  for (const [number, control] of controls.entries()) {
    if ("axes" in control) moveAxes(game, control, inputs, act);
    else act.choices[control.behavior][control.branch] = choose(game, number, control, inputs, chosen, forbidden, act);
  }
  return act;
}

function moveAxes(game, control, inputs, act) {
  const stick = deflect(game, control, inputs, act);
  const [first, second] = control.axes.map((axis) => (axis === null ? null : game.behaviors[control.behavior].axes[axis]));
  const set = (place, value) => { if (control.axes[place] !== null) act.axes[control.behavior][control.axes[place]] = value; };
  const x = control.invert[0] ? -stick.x : stick.x, y = control.invert[1] ? -stick.y : stick.y;
  if (control.span === 0) {
    const value = (axis, d) => (stick.place ? axis.low + ((d + 1) / 2) * (axis.high - axis.low) : away(axis, d));
    if (first) set(0, value(first, x));
    if (second) set(1, value(second, y));
    return;
  }
  let angle = (Math.atan2(y, x) * 180) / Math.PI, speed = Math.min(1, Math.hypot(x, y));
  if (speed === 0) angle = 0;
  if (control.span <= 90 && Math.abs(angle) > 90) { // the other half of the circle is a negative speed
    angle -= Math.sign(angle) * 180;
    speed = -speed;
  }
  set(0, first.low >= 0 ? first.low + (((angle + 360) % 360) / 360) * (first.high - first.low) : away(first, angle / control.span));
  set(1, away(second, speed));
}

// Returns the value of an axis at a deflection of -1..1 away from its rest.
function away(axis, d) {
  return d >= 0 ? axis.rest + d * (axis.high - axis.rest) : axis.rest + d * (axis.rest - axis.low);
}

// Returns the deflection of a control, x and y of -1..1, y upwards; place: it is one of the picture. Keys come first,
// then a gamepad, then the pointer.
function deflect(game, control, inputs, act) {
  const [left, right, down, up] = control.keys.map((codes) => inputs.pressed(codes));
  const way = (less, more) => (less || more ? (more > less ? 1 : -1) : 0);
  const keys = { x: way(left, right), y: way(down, up) };
  if (keys.x || keys.y) return shorten(keys, control.span > 0);
  const pad = inputs.padStick(control.pad);
  if (pad.x || pad.y) return shorten(pad, control.span > 0);
  if (control.pointer === "movement") return follow(game, control, inputs, act);
  const place = inputs.place;
  if (control.pointer === "position" && (place || control.last)) return (control.last = place ? { ...place, place: true } : control.last);
  if (control.pointer !== "stick" || !place) return { x: 0, y: 0 };
  const offset = (value) => (Math.abs(value) < CENTER ? 0 : (value - Math.sign(value) * CENTER) / (1 - CENTER));
  return shorten({ x: offset(place.x), y: offset(place.y) }, control.span > 0);
}

// Returns the deflection that follows the movement of the pointer. What is too fast for one decision is left for the next.
function follow(game, control, inputs, act) {
  const full = (game.interval || TURN_BASED) / CROSSING / control.sensitivity; // widths of the picture per decision
  for (const axis of ["x", "y"]) inputs.moved[axis] = Math.max(-CARRIED * full, Math.min(CARRIED * full, inputs.moved[axis]));
  const stick = shorten({ x: inputs.moved.x / full, y: -inputs.moved.y / full }, control.span > 0);
  act.movement = { x: stick.x * full, y: -stick.y * full };
  return stick;
}

// Returns a deflection in the same direction that lies in the circle, or in the square.
function shorten(stick, circle) {
  const length = Math.max(1, circle ? Math.hypot(stick.x, stick.y) : Math.max(Math.abs(stick.x), Math.abs(stick.y)));
  return { x: stick.x / length, y: stick.y / length };
}

function choose(game, number, control, inputs, chosen, forbidden, act) {
  const not = forbidden(control.behavior, control.branch);
  const allowed = not.has(control.rest) ? control.keys.findIndex((_, choice) => !not.has(choice)) : control.rest;
  let choice = chosen.get(number) ?? null, newest = 0;
  for (const [index, codes] of (game.interval ? control.keys : []).entries()) {
    const press = inputs.pressed([...codes, chipCode(number, index)], control.once);
    if (press > newest) [choice, newest] = [index, press];
  }
  if (choice === null) return allowed;
  if (!not.has(choice)) return choice;
  act.refused.push([number, choice]);
  return allowed;
}

// Returns the code of a choice's button in the page.
export function chipCode(control, choice) {
  return `Chip${control}.${choice}`;
}

// Returns the codes that act on the game.
export function gameCodes(controls) {
  return new Set(controls.flatMap((control) => control.keys.flat()));
}
