const assert = require("node:assert/strict");
const test = require("node:test");
const {load} = require("./page_scripts.js");

const {zoomed} = load(["dom.js", "campaign.js"], ["zoomed"], {embedded: {facts: {words: {}}}});

test("zooming in keeps the place under the pointer", () => {
  const [first, last] = zoomed([0, 100], 100, 0.5, 20);
  assert.equal(last - first, 50);
  assert.equal((20 - first) / (last - first), 0.2);
});

test("a strip is never shown beyond its ends, nor less than a few stretches of it", () => {
  assert.deepEqual(zoomed([40, 60], 100, 10, 50), [0, 100]);
  assert.deepEqual(zoomed([90, 100], 100, 2, 99), [80, 100]);
  const [first, last] = zoomed([10, 15], 100, 0.1, 12);
  assert.equal(last - first, 4);
});
