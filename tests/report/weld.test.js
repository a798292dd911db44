const assert = require("node:assert/strict");
const test = require("node:test");
const {load} = require("./page_scripts.js");

const names = ["answerPart", "beyondUpTo", "changeWords", "curveWords", "geometryPart", "grindingPart", "marginWords", "restrictionTable", "riskWords", "restrictionWords", "sentence", "stretches", "untilWords", "whatToDo", "why"];
const page = load(["words.js", "source.js", "table.js", "charts.js", "weld.js"], names);

const criterion = (more) => ({name: "peak_force", value: 210e3, limit: 200e3, unit: "N", passed: false, verified: true, ratio: 1.05, ...more});

test("a clause becomes a sentence", () => {
  assert.deepEqual(["", "measure again", "Done!"].map(page.sentence), ["", "Measure again.", "Done!"]);
});

test("what to do follows the decision and the advice on grinding", () => {
  const advice = {reached: true, most_removed_m: 1.23e-4};
  assert.equal(page.whatToDo({decision: "accept"}, advice), "Leave this weld as it is.");
  assert.equal(page.whatToDo({decision: "grind"}, advice), "Grind this weld: remove at most 0.12 mm.");
  assert.equal(page.whatToDo({decision: "reject"}, advice), "Replace this weld (re-weld), or grind off at most 0.12 mm.");
  assert.equal(page.whatToDo({decision: "grind"}, {...advice, reached: false}), "No grinding was found that helps: replace this weld (re-weld).");
  assert.equal(page.whatToDo({decision: "undecided", measure: "measure its position"}), "Further measurement required: measure its position.");
});

test("the card of grinding lists the spots with side and depth, and the margin", () => {
  const spots = [{from_m: -0.418, to_m: -0.042, depth_m: 3.74e-4, deepest_m: -0.282, side: "against rising chainage"}];
  const advice = {reached: true, reason: "it helps", most_removed_m: 3.74e-4, spots, hand_margin_m: 3e-5, peak_by_hand_n: 154e3, band_limit_m: 0.1, stone_radius_m: 0.15, decision_before: "grind", decision_after: "accept", after: [], reference_checked: 0};
  const words = page.grindingPart(advice).textContent;
  for (const part of ["−418 to −42", "against rising chainage", "0.37 mm, at −282 mm", "0.03 mm too large or too small (peak up to 154 kN)"]) assert.ok(words.includes(part), `${part} in ${words}`);
  assert.ok(!page.grindingPart({...advice, spots: [], hand_margin_m: undefined}).textContent.includes("too large"));
});

test("the highest speed within limits is said only where it was searched for", () => {
  const verdict = {decision: "grind", judged_speed_kmh: 160, advice_step_kmh: 1};
  assert.equal(page.untilWords({...verdict, advice_step_kmh: undefined}), "");
  assert.equal(page.untilWords(verdict), "No speed is within the limits on force.");
  assert.equal(page.untilWords({...verdict, permitted_speed_kmh: 120}), "Until then, run at most 120 km/h (judged up to 160 km/h).");
  assert.equal(page.untilWords({...verdict, permitted_speed_kmh: 160}, {line_speed_kmh: 160}), "Forces are within limits at every speed up to the line's 160 km/h.");
});

test("the reason names the criterion farthest beyond its limit", () => {
  const beside = criterion({name: "unloading", decides: false, ratio: 9});
  assert.equal(page.why({criteria: [criterion({speed_kmh: 120, position_m: 0.13}), beside]}),
    "Peak force reaches 210 kN at 120 km/h with the weld 13 cm after a sleeper, 5 % over its limit of 200 kN.");
  assert.equal(page.why({criteria: [criterion({reject_limit: 205e3}), criterion({name: "p2_force", ratio: 1.01})]}),
    "Peak force reaches 210 kN, 2 % over its reject limit of 205 kN. Also over the limit: P2 force (120 Hz low-pass).");
  assert.equal(page.why({criteria: [criterion({passed: true, value: 180e3, ratio: 0.9})]}), "Nearest to its limit: peak force, 180 kN of 200 kN.");
  assert.equal(page.why({criteria: []}), "");
});

const CURVES = {
  speeds_kmh: [100, 120, 140],
  series: [{name: "peak_force", unit: "N", values: [150e3, 210e3, 190e3], limits: [{limit: 200e3, verified: true}], within: "100"}],
};

test("a restriction is still beyond limits where a lower speed is", () => {
  assert.deepEqual(page.beyondUpTo(CURVES, 1), []);
  assert.deepEqual(page.beyondUpTo(CURVES, 3), [{name: "peak_force", from: 120, to: 120}]);
  const words = (index) => page.restrictionWords(CURVES, CURVES.speeds_kmh, index).map((part) => part.textContent);
  assert.deepEqual(words(0), [
    "✓ Within limits at every speed up to 100 km/h", "",
    "Trains at 100 km/h: 150 kN, 21 % less than at 140 km/h", "Worst of all speeds up to 100 km/h: 150 kN, 29 % less than without it",
  ]);
  assert.equal(words(1)[2], "Trains at 120 km/h: 210 kN, 11 % MORE than at 140 km/h");
});

test("a change too small to print is not said", () => {
  assert.equal(page.changeWords(100.04e3, 100e3, "than before", {}).length, 0);
});

test("no difference below fit error and model uncertainty is an advantage of slowing down", () => {
  const error = {error_share: 0.2, static_n: 100e3};
  assert.deepEqual(page.changeWords(141e3, 150e3, "than before", error), [", no difference beyond fit error and model uncertainty"]);
  assert.equal(page.changeWords(139e3, 150e3, "than before", error)[1].textContent, "7 % less");
  const restrictions = [[160, 150e3], [140, 141e3], [120, 130e3]].map(([speed_kmh, peak_force_n]) => ({speed_kmh, peak_force_n, change: peak_force_n / 150e3 - 1, within_limits: true}));
  assert.equal(page.restrictionTable({restrictions}, error).textContent,
    "Restricted to: 140 km/h no difference beyond fit error and model uncertainty (within limits), 120 km/h −13 % (within limits)");
});

const EDGE = criterion({name: "straightedge_dip", value: 0.19e-3, limit: 0.05e-3, unit: "m", base_m: 1, rule_book: "banenor-531", source_kind: "standard", source: "TRV"});

test("an answer names criterion, margin, probability and authority", () => {
  const words = page.answerPart("Geometry, by standard", {decision: "grind", rule_books: ["banenor-531"], margin: -2.8, exceeding: 0.999, doubts: ["the record is short"], nearest: EDGE, source: "TRV", verified: true}).textContent;
  for (const part of ["◐Grind", "Rule bookbanenor-531", "above 99 %", "Dip under a straightedge of 1 m: 0.19 mm of 0.05 mm", "280 % beyond the limit", "verified, read in the standard", "TRV", "The record is short."]) {
    assert.ok(words.includes(part), part);
  }
  assert.ok(!words.includes("UNVERIFIED"));
});

test("a limit by judgement says so, and a margin to a limit of nothing has no share", () => {
  const judgement = {decision: "undecided", exceeding: 0.5, margin: 0.2, doubts: [], nearest: criterion({passed: true, verified: false, source_kind: "judgement", source: "anchored"})};
  assert.ok(page.answerPart("Force, by model", judgement).textContent.includes("UNVERIFIED engineering judgement, no standard"));
  const next = page.answerPart("Force, by model", judgement, "measure it again").textContent;
  assert.ok(next.includes("To decideMeasure it again."), next);
  assert.ok(!page.answerPart("Force, by model", {...judgement, decision: "grind"}, "measure it again").textContent.includes("To decide"));
  assert.equal(page.marginWords({margin: 0.2}), "20 % of the limit is left");
  assert.equal(page.marginWords({nearest: {passed: false}}), "over a limit of 0");
});

test("what was not assessed says how to choose a rule book", () => {
  const words = page.answerPart("Geometry, by standard", {decision: "not assessed", doubts: [], to_choose: "choose one: `--limits force,NAME`"}).textContent;
  assert.ok(words.includes("–Not assessedNo limit of this kind was chosen. To have it assessed, choose one: --limits force,NAME."));
});

test("the overall decision carries its risk, and speeds in sentences are rounded down", () => {
  const verdict = {decision: "undecided", geometry: {decision: "not assessed"}, force: {decision: "accept"}, accepted_risk: 0.05, measure: "choose a rule book", judged_speed_kmh: 160, permitted_speed_kmh: 109, advice_step_kmh: 1};
  assert.equal(page.riskWords(verdict), "Overall, at an accepted risk of 5 %; accepted only where both questions are answered");
  assert.equal(page.whatToDo(verdict), "Choose a rule book.");
  assert.equal(page.untilWords(verdict), "Highest computed speed with all forces within limits: 105 km/h (computed up to 160 km/h).");
  assert.deepEqual(page.curveWords({...verdict, curve_class: "rises"}), ["no local minimum", "that exceeds fit error and model uncertainty"]);
  assert.deepEqual(page.curveWords({curve_class: "rises"}), ["rises", "slower is never worse"]);
});

test("neighbouring positions of one decision become one stretch that ends at the next sleeper", () => {
  const outcomes = [[0, "accept"], [0.2, "grind"], [0.4, "grind"]].map(([position_m, decision]) => ({position_m, decision}));
  const found = page.stretches(outcomes, 0.6).map(([decision, from, to]) => [decision, from.toFixed(2), to.toFixed(2)]);
  assert.deepEqual(found, [["accept", "0.00", "0.10"], ["grind", "0.10", "0.50"], ["accept", "0.50", "0.60"]]);
});

test("how much of the rail the wheel bridges is said below its picture", () => {
  const profile = {x_m: [0, 1], z_m: [0, 0]};
  const words = (more) => page.geometryPart({...profile, ...more}, undefined, true, () => undefined).textContent;
  assert.ok(words({bridged_m: 0.0124}).includes("12.4 mm of the rail that the wheel bridges"), words({bridged_m: 0.0124}));
  assert.ok(!words({}).includes("bridges"));
});
