// Asks questions of a site that Sphinx has built, with the search of its pages: node search.mjs SITE '["pygame", …]'.
// Prints an object: question -> the pages that are found, best first.
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { createContext, runInContext } from "node:vm";

const [site, questions] = process.argv.slice(2);
const element = { dataset: { content_root: "" }, replaceChildren() {}, childNodes: [] };
const page = {
  console, Set, Map, SPHINX_HIGHLIGHT_ENABLED: false,
  DOCUMENTATION_OPTIONS: { SHOW_SEARCH_SUMMARY: false },
  document: {
    readyState: "loading", documentElement: element, addEventListener() {},
    getElementById: () => element, createElement: () => element,
  },
  _ready() {}, addEventListener: (event, listen) => listen(),
};
page.window = page;
createContext(page);
for (const file of ["_static/base-stemmer.js", "_static/language_data.js", "_static/searchtools.js", "_static/search.js", "searchindex.js"]) {
  runInContext(readFileSync(join(site, file), "utf8"), page, { filename: file });
}
page.questions = JSON.parse(questions);
const found = runInContext(`
  Object.fromEntries(questions.map((question) => {
    const results = Search._performSearch(...Search._parseQuery(question));
    return [question, results.map((result) => result[0]).reverse()];
  }))
`, page);
process.stdout.write(JSON.stringify(found));
