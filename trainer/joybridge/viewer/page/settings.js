// The form with the seed, the options and the parameters of the game.

import { element } from "./panel.js";

// Fills the form; start is called with the settings to play from the beginning.
export function editSettings(form, game, start) {
  const field = (one, input) => element("label", { className: "field" }, element("span", {}, one.name), input,
    ...(one.description ? [element("small", {}, one.description)] : []));
  const seed = element("input", { name: "seed", value: game.seed, inputMode: "numeric", pattern: "[0-9]{1,20}", required: true, autocomplete: "off" });
  const options = game.options.map((option) => {
    const choices = option.choices.map((choice) => element("option", { selected: choice === option.value }, choice));
    return [option, element("select", {}, ...choices)];
  });
  const parameters = game.parameters.map((parameter) => [parameter, element("input", {
    type: "number", min: parameter.low, max: parameter.high, step: "any", value: parameter.value, required: true,
  })]);
  const random = element("button", { type: "button" }, "Random seed");
  random.addEventListener("click", () => { seed.value = crypto.getRandomValues(new Uint32Array(1))[0]; });
  form.replaceChildren(
    field({ name: "seed", description: "the same seed gives the same game" }, seed),
    ...[...options, ...parameters].map(([one, input]) => field(one, input)),
    element("div", { className: "row" }, element("button", { className: "primary", type: "submit" }, "Play from the beginning"), random),
  );
  form.onsubmit = (event) => {
    event.preventDefault();
    start({
      seed: seed.value,
      options: Object.fromEntries(options.map(([option, input]) => [option.name, input.value])),
      parameters: Object.fromEntries(parameters.map(([parameter, input]) => [parameter.name, input.valueAsNumber])),
    });
  };
}
