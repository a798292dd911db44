const assert = require("node:assert/strict");
const test = require("node:test");
const {load} = require("./page_scripts.js");

const {pointsOf, heightAt, axisFrom, valueAt, placeOf, nearest, readMap, readLines} = load(
  ["dom.js", "figures.js"], ["pointsOf", "heightAt", "axisFrom", "valueAt", "placeOf", "nearest", "readMap", "readLines"],
  {embedded: {facts: {words: {script: {cell: "{speed} km/h, {position} cm: {peak} kN"}}}}},
);

test("a path of relative steps is its points", () => {
  assert.deepEqual(pointsOf("M460 2115l43 0 43-7-5 12"), [[460, 2115], [503, 2115], [546, 2108], [541, 2120]]);
});

test("between points a line is straight, beyond its ends it says nothing", () => {
  const points = [[0, 0], [10, 100], [20, 50]];
  assert.deepEqual([-1, 0, 5, 10, 15, 20, 21].map((x) => heightAt(points, x)), [null, 0, 50, 100, 75, 50, null]);
});

test("an axis goes from values to places and back", () => {
  const axis = axisFrom("-50 150 1000 3000");
  assert.equal(placeOf(axis, 0), 1500);
  assert.equal(valueAt(axis, 1500), 0);
});

test("the nearest of values", () => assert.equal(nearest([40, 60, 80], 69), 1));

const line = (attributes) => ({getAttribute: (name) => attributes[name]});

test("every named line is read where the pointer is", () => {
  const svg = {
    dataset: {x: "0 100 0 1000", along: "at", unit: "mm"},
    querySelectorAll: () => [
      line({d: "M0 0l1000 1000", "data-name": "rail", "data-unit": "µm", "data-y": "0 10 0 1000"}),
      line({d: "M600 0l400 0", "data-name": "after grinding", "data-unit": "µm", "data-y": "0 10 0 1000"}),
    ],
  };
  assert.equal(readLines(svg, 0.5).words, "at 50 mm: rail 5 µm");
  assert.equal(readLines(svg, 0.8).words, "at 80 mm: rail 8 µm, after grinding 0 µm");
});

test("a map is read by its cells", () => {
  const svg = {dataset: {values: "AABVgA//", range: "100 235", speeds: "40 80", positions: "0 30", x: "-15 45 0 100", y: "20 100 200 0"}};
  assert.equal(readMap(svg, 0.9, 0.9).words, "80 km/h, 30 cm: 235 kN");
  assert.equal(readMap(svg, 0, 0).words, "40 km/h, 0 cm: 100 kN");
  assert.equal(readMap(svg, 0, 0.9).words, "80 km/h, 0 cm: 168 kN");
});
