const assert = require("node:assert/strict");
const test = require("node:test");
const {load} = require("./page_scripts.js");

const {answerBadge, authority, badge, byId, criterionInSentence, criterionName, element, kmh, lastOf, number, percent, probability, proseKmh, quantity, timesLimit, unitOf, withCode} = load(
  ["words.js"],
  ["answerBadge", "authority", "badge", "byId", "criterionInSentence", "criterionName", "element", "kmh", "lastOf", "number", "percent", "probability", "proseKmh", "quantity", "timesLimit", "unitOf", "withCode"],
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

test("a criterion names the straightedge or chord that it is measured on", () => {
  assert.equal(criterionName("straightedge_peak", 1), "Peak under a straightedge of 1 m");
  assert.equal(criterionName("quality_index", 1), "Quality index (gradient), on a base of 1 m");
  assert.equal(criterionInSentence("straightedge_dip", 0.1), "dip under a straightedge of 0.1 m");
  assert.equal(quantity(1.2e-3, "rad"), "1.2 mrad");
});

test("probabilities that are neither none nor all are not shown as such", () => {
  assert.deepEqual([0, 1e-10, 0.5, 0.999, 1].map(probability), ["0 %", "below 1 %", "50 %", "above 99 %", "100 %"]);
});

test("speeds in sentences are rounded down to 5 km/h", () => {
  assert.deepEqual([109, 105, 3].map(proseKmh), ["105 km/h", "105 km/h", "3 km/h"]);
});

test("an answer is what is to be done, or that nobody asked", () => {
  assert.equal(answerBadge("reject").textContent, "✕Replace");
  assert.equal(answerBadge("not assessed").attributes.get("class"), "badge none");
});

test("a limit stands on somebody's authority", () => {
  assert.equal(authority({verified: true, source_kind: "quotation"}), "verified, read in a publication that quotes the standard");
  assert.equal(authority({verified: false, source_kind: "judgement"}), "engineering judgement, no standard");
  assert.equal(authority({verified: false, source_kind: "standard"}), "not checked against its source");
  assert.equal(authority({verified: true}), "verified");
});

test("commands between backticks become code, and only text", () => {
  const [before, code] = withCode("say `<b>`");
  assert.deepEqual([before, code.tag, code.textContent], ["say ", "code", "<b>"]);
});
