const assert = require("node:assert/strict");
const test = require("node:test");
const {load} = require("./page_scripts.js");

const SIGNS = {reject: "✕", grind: "◐", undecided: "?", unusable: "!", accept: "✓"};
const {ORDERS, dayOf, csvCell, CSV_COLUMNS, answerOrder, shareOf} = load(
  ["dom.js", "table.js"], ["ORDERS", "dayOf", "csvCell", "CSV_COLUMNS", "answerOrder", "shareOf"], {embedded: {facts: {signs: SIGNS, words: {}}}},
);
const sorted = (order, rows) => [...rows].sort(ORDERS[order].compare).map(({weld}) => weld);

test("the worst decision comes first, of one decision the one farthest beyond its limit", () => {
  const worst = {worst_criterion: "peak_force"};
  assert.deepEqual(sorted("decision", [
    {weld: "a", decision: "accept"}, {weld: "b", decision: "grind", ...worst, times_limit: 1.1},
    {weld: "c", decision: "grind", ...worst}, {weld: "d", decision: "reject"},
  ]), ["d", "c", "b", "a"]);
});

test("names sort by the numbers in them, chainages as numbers, what is not stated last", () => {
  assert.deepEqual(sorted("weld", [{weld: "km 10"}, {weld: "km 9"}]), ["km 9", "km 10"]);
  assert.deepEqual(sorted("chainage", [{weld: "a"}, {weld: "b", chainage_m: 900}, {weld: "c", chainage_m: 12}]), ["c", "b", "a"]);
  assert.deepEqual(sorted("line", [{weld: "a", line: "2", chainage_m: 2}, {weld: "b", line: "10"}, {weld: "c", line: "2", chainage_m: 1}]), ["c", "a", "b"]);
});

test("dates of files are days", () => {
  assert.deepEqual(["2026-11-20", "13.5.2026", "13.05.2026 08:30", "spring", undefined].map(dayOf),
    ["2026-11-20", "2026-05-13", "2026-05-13", "spring", undefined]);
});

test("answers sort from the gravest to none", () => {
  const order = ["reject", "grind", "undecided", "accept", "not assessed", undefined].map(answerOrder);
  assert.deepEqual(order, [...order].sort((a, b) => a - b));
  assert.equal(shareOf({}), -1);
});

test("no cell of the CSV is a formula to a spreadsheet, and quotes and commas stay in it", () => {
  assert.deepEqual(['=HYPERLINK("x")', "-3", -3, 'a "b", c', undefined, "@x"].map(csvCell),
    ['"\'=HYPERLINK(""x"")"', "'-3", "-3", '"a ""b"", c"', "", "'@x"]);
  assert.equal(new Set(CSV_COLUMNS).size, CSV_COLUMNS.length);
});
