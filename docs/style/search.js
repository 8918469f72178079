// The site's search also finds pages with some of the words of a question: Sphinx alone finds those that have them all.
// These come first. A word counts the more, the fewer pages have it, and most where docs/find.md leads it.

addEventListener("DOMContentLoaded", () => {
  if (typeof Search === "undefined") return; // this page does not search
  const search = Search._performSearch;
  Search._performSearch = (query, ...terms) => { // results from the worst to the best, as Sphinx shows them
    const found = search(query, ...terms);
    const known = new Set(found.map((result) => result[0]));
    const pages = new Map(); // the name of a page -> [weight, its best result]
    for (const word of splitQuery(query)) {
      const results = search(...Search._parseQuery(word)), sum = results.reduce((sum, result) => sum + result[4], 0);
      for (const result of results.filter((result) => !known.has(result[0]))) {
        pages.set(result[0], [(pages.get(result[0])?.[0] ?? 0) + result[4] / sum, result]);
      }
    }
    return [...[...pages.values()].sort((one, other) => one[0] - other[0]).map(([, result]) => result), ...found];
  };
});
