// What stands beside the picture: the device and what was pressed, the scores, and the episodes that have ended.

import { chipCode } from "./device.js";

const $ = (id) => document.getElementById(id);

// Returns a new element with properties and children.
export function element(kind, properties = {}, ...children) {
  const { dataset = {}, aria = {}, ...rest } = properties;
  const made = Object.assign(document.createElement(kind), rest);
  Object.assign(made.dataset, dataset);
  for (const [name, value] of Object.entries(aria)) made.setAttribute(`aria-${name}`, value);
  made.append(...children);
  return made;
}

// Returns a number as text that is not longer than it needs to be.
export function number(value) {
  const size = Math.abs(value);
  if (Number.isInteger(value)) return String(value);
  return size >= 0.1 ? value.toFixed(size >= 100 ? 1 : 2) : value.toPrecision(2); // 0.0003 is no 0.00
}

export class Panel {
  // onChip: called with a control and a choice that was selected with its button.
  constructor(state, inputs, onChip) {
    Object.assign(this, { state, inputs, onChip });
    this.forbidden = this.forbidden.bind(this);
  }

  begin() {
    const { game } = this.state;
    const names = game.seats.map(({ behavior, agent }) => {
      const { name } = game.behaviors[behavior];
      return game.seats.filter((seat) => seat.behavior === behavior).length > 1 ? `${name} ${agent + 1}` : name;
    });
    this.names = names;
    $("seat").replaceChildren(element("option", { value: "" }, "all seats"),
      ...names.map((name, index) => element("option", { value: index }, name)));
    $("seat").value = this.state.seat ?? "";
    $("seat-label").hidden = names.length < 2;
    $("seat").disabled = game.fixed;
    this.channels = game.seats.map((seat) => game.behaviors[seat.behavior].channels.map(() => 0));
    this.ended = [];
    $("rival-ended").textContent = "";
    $("episodes").replaceChildren(element("p", { className: "faint" }, "None has ended yet."));
    this.build();
    this.buildScores();
  }

  // Makes the elements of the device.
  build() {
    const { game, controls } = this.state;
    this.sticks = [];
    this.chips = new Map(); // control -> the buttons of its choices
    $("device").replaceChildren(...game.behaviors.map((behavior, index) => {
      const own = [...controls.entries()].filter(([, control]) => control.behavior === index);
      const parts = own.map(([place, control]) => ("axes" in control ? this.stick(control, behavior) : this.branch(place, control, behavior)));
      const title = game.behaviors.length > 1 ? [element("h3", {}, behavior.name)] : [];
      return element("div", { className: "agent", dataset: { behavior: index } }, ...title, ...parts);
    }));
  }

  stick(control, behavior) {
    const dot = element("i");
    const shape = control.axes[1] === null ? "pad flat" : control.axes[0] === null ? "pad tall" : control.span ? "pad" : "pad square";
    const values = control.axes.map((axis) => (axis === null ? null : element("span", { className: "value" })));
    this.sticks.push({ control, dot, values });
    const rows = control.axes.flatMap((axis, place) => (axis === null ? []
      : [element("span", { title: behavior.axes[axis].description }, behavior.axes[axis].name), values[place]]));
    return element("div", { className: "stick" }, element("div", { className: shape }, dot), element("div", { className: "values" }, ...rows));
  }

  branch(place, control, behavior) {
    const branch = behavior.branches[control.branch];
    const button = branch.choices.length === 2;
    const chips = branch.choices.map((label, choice) => {
      if (button && choice === control.rest) return null;
      const chip = element("button", { type: "button", className: "chip", title: branch.description, aria: { pressed: "false" } },
        element("span", {}, button ? branch.name : label), element("kbd"));
      const code = chipCode(place, choice);
      chip.addEventListener("mousedown", (event) => event.preventDefault()); // keys stay with the game
      chip.addEventListener("pointerdown", (event) => { chip.setPointerCapture(event.pointerId); this.inputs.press(code, event.timeStamp); });
      for (const kind of ["pointerup", "pointercancel"]) chip.addEventListener(kind, (event) => this.inputs.release(code, event.timeStamp));
      chip.addEventListener("click", (event) => {
        if (event.detail === 0) { this.inputs.press(code, event.timeStamp); this.inputs.release(code, event.timeStamp); } // of a key
        this.onChip(place, choice);
      });
      return chip;
    });
    this.chips.set(place, chips);
    const label = button ? [] : [element("span", { className: "label", title: branch.description }, branch.name)];
    return element("div", { className: "branch" }, ...label, element("div", { className: "chips" }, ...chips.filter(Boolean)));
  }

  // Writes the keys of each choice on its button.
  showKeys() {
    for (const [place, chips] of this.chips) {
      for (const [choice, chip] of chips.entries()) {
        const codes = this.state.controls[place].keys[choice];
        if (chip) Object.assign(chip.querySelector("kbd"), { textContent: this.short(codes), hidden: !codes.length });
      }
    }
  }

  short(codes) {
    const shown = codes.find((code) => !/^(Mouse|Pad|Arrow)/.test(code)) ?? codes[0] ?? "";
    return shown.replace(/^Key|^Digit/, "").replace("Space", "␣")
      .replace(/^Mouse0/, "click").replace(/^Mouse1/, "middle click").replace(/^Mouse2/, "right click").replace(/^Mouse/, "mouse ");
  }

  // Returns what the curtain says about the controls.
  legend(keyName) {
    const { game, controls } = this.state;
    return controls.flatMap((control) => {
      const behavior = game.behaviors[control.behavior];
      if (!("axes" in control)) {
        const branch = behavior.branches[control.branch];
        if (branch.choices.length > 6) return [element("li", {}, element("kbd", {}, "1 … 9"), ` ${branch.name}`)];
        return control.keys.flatMap((codes, choice) => (codes.length && choice !== control.rest
          ? [element("li", {}, element("kbd", {}, keyName(codes[0])), ` ${branch.choices.length === 2 ? branch.name : branch.choices[choice]}`)] : []));
      }
      const names = control.axes.filter((axis) => axis !== null).map((axis) => behavior.axes[axis].name).join(", ");
      const pointer = control.pointer === "off" ? "" : "pointer or ";
      const keys = control.keys.map((codes) => codes[0]).filter(Boolean).map((code) => keyName(code)).join(" ");
      return [element("li", {}, element("kbd", {}, `${pointer}${keys}`), ` ${names}`)];
    });
  }

  // Returns the agent of a behavior that the person decides for now.
  agent(behavior) {
    const { game, seat, turn } = this.state;
    if (seat !== null && game.seats[seat].behavior === behavior) return game.seats[seat].agent;
    return Math.max(0, turn.behaviors[behavior].deciding.indexOf(true));
  }

  // Returns whether the person decides next.
  decides() {
    const { game, seat, turn } = this.state;
    if (seat === null) return true;
    return turn.behaviors[game.seats[seat].behavior].deciding[game.seats[seat].agent];
  }

  // Returns the choices of a branch that are forbidden in the next decision.
  forbidden(behavior, branch) {
    return new Set(this.state.turn?.behaviors[behavior].forbidden[this.agent(behavior)][branch] ?? []);
  }

  // Takes a turn; it is shown with the next frame of the browser.
  take(turn) {
    const { game } = this.state;
    for (const [index, { behavior, agent }] of game.seats.entries()) {
      const ended = turn.ended.some((end) => end.seat === index);
      const paid = turn.behaviors[behavior].channels[agent];
      this.channels[index] = this.channels[index].map((sum, place) => (ended || !turn.turn ? 0 : sum + paid[place]));
    }
    this.showEpisodes(turn.ended);
    const ended = turn.rival?.ended.map((end) => `score ${number(end.score)}`) ?? [];
    if (ended.length) $("rival-ended").textContent = `Its last episode: ${ended.join(", ")}.`;
    this.show();
  }

  // Shows how the policy beside the person does.
  showRival(rival) {
    $("rival").hidden = !rival;
    if (!rival) return;
    $("rival-title").textContent = `Beside you: ${rival.title}`;
    $("rival-score").textContent = rival.scores.flat().map(number).join(" · ");
  }

  show() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      if (this.state.turn) this.showNow(this.state.turn);
    });
  }

  showNow(turn) {
    const { game, seat } = this.state;
    for (const { control, dot, values } of this.sticks) this.showStick(control, dot, values, turn);
    for (const [place, chips] of this.chips) {
      const control = this.state.controls[place], agent = this.agent(control.behavior);
      const played = turn.behaviors[control.behavior].choices[agent][control.branch];
      const not = this.forbidden(control.behavior, control.branch);
      for (const [choice, chip] of chips.entries()) {
        chip?.classList.toggle("forbidden", not.has(choice));
        chip?.setAttribute("aria-disabled", not.has(choice));
        const pressed = game.interval ? turn.turn > 0 && played === choice : this.state.chosen.get(place) === choice;
        chip?.setAttribute("aria-pressed", pressed);
      }
    }
    for (const group of document.querySelectorAll(".agent")) {
      const behavior = Number(group.dataset.behavior);
      const held = seat === null || game.seats[seat].behavior === behavior;
      group.classList.toggle("waiting", !held || !turn.behaviors[behavior].deciding[this.agent(behavior)]);
    }
    $("decision").textContent = `decision ${turn.turn} since the start`;
    this.showScores(turn);
    this.showRival(turn.rival);
  }

  showStick(control, dot, values, turn) {
    const axes = this.state.game.behaviors[control.behavior].axes;
    const now = turn.behaviors[control.behavior].axes[this.agent(control.behavior)];
    const share = control.axes.map((axis) => (axis === null ? 0 : ((now[axis] - axes[axis].low) / (axes[axis].high - axes[axis].low)) * 2 - 1));
    for (const [place, axis] of control.axes.entries()) if (axis !== null) values[place].textContent = now[axis].toFixed(2);
    let [x, y] = [control.invert[0] ? -share[0] : share[0], control.invert[1] ? -share[1] : share[1]];
    if (control.span) {
      const angle = (share[0] * control.span * Math.PI) / 180, speed = axes[control.axes[1]].low < 0 ? share[1] : (share[1] + 1) / 2;
      [x, y] = [Math.cos(angle) * speed, Math.sin(angle) * speed];
    }
    dot.style.left = `${50 + 42 * x}%`;
    dot.style.top = `${50 - 42 * y}%`;
  }

  // Makes the elements of the scores.
  buildScores() {
    const { game, seat } = this.state;
    this.scores = [...game.seats.entries()].filter(([index]) => seat === null || index === seat).map(([index, { behavior }]) => {
      const channels = game.behaviors[behavior].channels.filter((_, __, all) => all.length > 1);
      return { index, score: element("b"), values: channels.map(() => element("span", { className: "value" })) };
    });
    $("scores").replaceChildren(...this.scores.flatMap(({ index, score, values }) => {
      const { channels } = game.behaviors[game.seats[index].behavior];
      const rows = values.flatMap((value, place) => [element("span", { title: channels[place].description }, channels[place].name), value]);
      return [element("div", { className: "score" }, score, element("span", { className: "faint" }, game.seats.length > 1 ? this.names[index] : "this episode")),
        element("div", { className: "channels" }, ...rows)];
    }));
  }

  showScores(turn) {
    const { game } = this.state;
    for (const { index, score, values } of this.scores) {
      const { behavior, agent } = game.seats[index];
      score.textContent = number(turn.behaviors[behavior].scores[agent]);
      for (const [place, value] of values.entries()) {
        const amount = this.channels[index][place] * game.behaviors[behavior].channels[place].weight;
        value.textContent = number(amount);
        value.className = `value ${amount > 0 ? "up" : amount < 0 ? "down" : ""}`;
      }
    }
  }

  showEpisodes(ended) {
    if (!ended.length) return;
    const { game } = this.state;
    for (const end of ended) this.ended.unshift({ number: this.ended.length + 1, ...end });
    const metrics = [...new Set(this.ended.flatMap((end) => Object.keys(end.metrics)))];
    const seats = game.seats.length > 1;
    const head = ["", ...(seats ? ["seat"] : []), "score", "decisions", ...metrics];
    const rows = this.ended.slice(0, 100).map((end) => [end.number, ...(seats ? [this.names[end.seat]] : []), number(end.score), end.length,
      ...metrics.map((metric) => (metric in end.metrics ? number(end.metrics[metric]) : ""))]);
    $("episodes").replaceChildren(element("div", { className: "scroll" }, element("table", {},
      element("thead", {}, element("tr", {}, ...head.map((text) => element("th", { scope: "col" }, text)))),
      element("tbody", {}, ...rows.map((row) => element("tr", {}, ...row.map((text) => element("td", {}, String(text)))))))));
  }

  // Returns a sentence about episodes that have ended.
  summary(ended) {
    return ended.map((end) => {
      const name = this.state.game.seats.length > 1 ? `${this.names[end.seat]}: ` : "";
      const metrics = Object.entries(end.metrics).map(([metric, value]) => `${metric} ${number(value)}`);
      return [`${name}score ${number(end.score)}`, `${end.length} decisions`, ...metrics].join(", ");
    }).join("; ") + ". Click or press Enter for the next one.";
  }

  // Shows that choices are pressed and forbidden.
  refuse(choices) {
    for (const [place, choice] of choices) {
      const chip = this.chips.get(place)?.[choice];
      if (!chip || chip.classList.contains("refused")) continue;
      chip.classList.add("refused");
      setTimeout(() => chip.classList.remove("refused"), 400);
    }
  }
}
