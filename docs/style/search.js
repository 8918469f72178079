// Where no page has all words of a question, the site's search finds those with some: Sphinx alone would find nothing.
// A word counts the more, the fewer pages have it.

addEventListener("DOMContentLoaded", () => {
  if (typeof Search === "undefined") return; // this page does not search
  const search = Search._performSearch;
  Search._performSearch = (query, ...terms) => {
    const found = search(query, ...terms);
    if (found.length) return found;
    const pages = new Map(); // the place of a result -> [weight, result]
    for (const word of splitQuery(query)) {
      const results = search(...Search._parseQuery(word));
      for (const result of results) {
        const place = result[0] + result[2];
        pages.set(place, [(pages.get(place)?.[0] ?? 0) + 1 / results.length, result]);
      }
    }
    return [...pages.values()].sort((one, other) => one[0] - other[0]).map(([, result]) => result); // the last is the best
  };
});
