// Runs the page's own scripts, which share one scope and know no modules, against as much of a document as they ask for.

const {readFileSync} = require("node:fs");
const {join} = require("node:path");

const ASSETS = join(__dirname, "..", "..", "weld_force_ros", "report", "assets");

// The named values of the scripts. `embedded` is what stands in elements of the page as JSON, by their ids.
function load(scripts, names, {embedded = {}, ...globals} = {}) {
  const document = {
    createElement: () => ({dataset: {}}),
    getElementById: (id) => (id in embedded ? {textContent: JSON.stringify(embedded[id])} : null),
    readyState: "complete",
    querySelectorAll: () => [],
    documentElement: {lang: "en", classList: {add() {}}},
  };
  const shared = {document, ...globals};
  const text = scripts.map((name) => readFileSync(join(ASSETS, name), "utf-8")).join("\n");
  return new Function(...Object.keys(shared), `"use strict";\n${text}\nreturn {${names.join(", ")}};`)(...Object.values(shared));
}

module.exports = {load};
