/** Write dist/meteors.html: the game, the runtime and the page in one file. Argument: a policy that it begins with. */

import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";

import { buildSync } from "esbuild";

const file = (name) => new URL(name, import.meta.url);
const [policy] = process.argv.slice(2);
const { outputFiles } = buildSync({
  entryPoints: [fileURLToPath(file("page.ts"))], bundle: true, minify: true, write: false, target: "es2022",
});
const parts = {
  script: outputFiles[0].text.replaceAll("</script", "<\\/script"),
  policy: policy ? JSON.stringify(JSON.parse(readFileSync(policy, "utf8"))).replaceAll("<", "\\u003c") : "null",
};
const page = readFileSync(file("page.html"), "utf8").replace(/\/\*(script|policy)\*\//g, (_, part) => parts[part]);
mkdirSync(file("../dist"), { recursive: true });
writeFileSync(file("../dist/meteors.html"), page);
