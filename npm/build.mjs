// Builds pacmo_core/figures/three.min.js: npm ci && npm run build
// The licence goes into the file, as it asks to, and so into every page that holds it.
import { build } from "esbuild";
import { copyFileSync, readFileSync } from "node:fs";
import { argv } from "node:process";

const licence = readFileSync("node_modules/three/LICENSE", "utf8");
const { version } = JSON.parse(readFileSync("node_modules/three/package.json", "utf8"));
await build({
  entryPoints: ["three_parts.js"],
  outfile: `${argv[2]}/three.min.js`,
  bundle: true,
  minify: true,
  format: "iife",
  globalName: "THREE",
  target: "es2022",
  charset: "ascii",
  legalComments: "none",
  banner: { js: `/* Parts of three.js ${version}, built by npm/build.mjs.\n\n${licence.trim()}\n*/` },
});
copyFileSync("node_modules/three/LICENSE", `${argv[2]}/three.LICENSE`);
