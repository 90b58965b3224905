// Bundles the viewer into the package: `make viewer`. The sum of its sources goes along, by which a test sees that they are those.
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { build } from "esbuild";

const SOURCES = ["build.js", "msgpack.js", "package.json", "three.js", "tree.js", "viewer.js"];
const sum = createHash("sha256");
for (const name of SOURCES) sum.update(readFileSync(name));

await build({
  entryPoints: ["viewer.js"],
  outfile: "../web/viewer/viewer.min.js",
  bundle: true,
  minify: true,
  format: "iife",
  globalName: "MeshCat",
  target: "es2020",
  charset: "utf8",
  legalComments: "inline",
  banner: { js: `/*! The viewer of rbd's pages, bundled from rbd/visual/pages/viewer, sources ${sum.digest("hex")}. Licences: LICENSE beside it. */` },
});
