const assert = require("node:assert/strict");
const test = require("node:test");
const {load} = require("./page_scripts.js");

const {badge, byId, criterionInSentence, element, kmh, lastOf, number, percent, quantity, timesLimit, unitOf} = load(
  ["words.js"],
  ["badge", "byId", "criterionInSentence", "element", "kmh", "lastOf", "number", "percent", "quantity", "timesLimit", "unitOf"],
);

test("numbers keep their significant digits and whole hundreds", () => {
  assert.equal(number(0.012345), "0.0123");
  assert.equal(number(1234.5), "1235");
  assert.equal(number(-2.5), "−2.5");
  assert.equal(kmh(159.96), "160 km/h");
});

test("quantities are written in the unit people read", () => {
  assert.equal(quantity(123456, "N"), "123 kN");
  assert.equal(quantity(0.00025, "m"), "0.25 mm");
  assert.equal(quantity(1.5, "1"), "1.5");
  assert.equal(quantity(3, "furlong"), "3 furlong");
  assert.equal(quantity(0.6, unitOf({name: "unloading", unit: "1"})), "60 %");
});

test("per cent have tenths only below one", () => {
  assert.deepEqual([0, 0.004, -0.004, 0.123, 1].map(percent), ["0 %", "0.4 %", "0.4 %", "12 %", "100 %"]);
});

test("a limit of 0 has no multiple", () => {
  assert.equal(timesLimit(null), "limit is 0");
  assert.equal(timesLimit(0.456), "0.46 × limit");
});

test("an element takes text as text and leaves out what says nothing", () => {
  const made = element("p", {class: "a", hidden: false, open: true, title: undefined}, "<b>", null, false, undefined, "", ["x"]);
  assert.deepEqual([...made.attributes], [["class", "a"], ["open", ""]]);
  assert.deepEqual(made.children, ["<b>", "x"]);
});

test("a decision of a later release is shown by its own name", () => {
  const made = badge("postponed");
  assert.equal(made.attributes.get("class"), "badge undecided");
  assert.equal(made.textContent, "?postponed");
});

test("a criterion inside a sentence keeps its symbols", () => {
  assert.equal(criterionInSentence("peak_force"), "peak force");
  assert.equal(criterionInSentence("p2_force"), "P2 force (120 Hz low-pass)");
  assert.equal(criterionInSentence("force_20hz"), "Qmax, 20 Hz low-pass (EN 14363)");
  assert.equal(criterionInSentence("unloading"), "wheel unloading ratio ΔQ/Q0");
  assert.deepEqual(["of_a_later_release", "constructor"].map(criterionInSentence), ["of_a_later_release", "constructor"]);
});

test("an element that a page lacks is named", () => {
  assert.throws(() => byId("nowhere"), /#nowhere/);
  assert.equal(lastOf([1, 2]), 2);
});
