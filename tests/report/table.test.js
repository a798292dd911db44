const assert = require("node:assert/strict");
const test = require("node:test");
const {FakeElement, load} = require("./page_scripts.js");

const {FrontTable, COLUMNS, basisParts, permittedCell} = load(["words.js", "table.js"], ["FrontTable", "COLUMNS", "basisParts", "permittedCell"]);

const row = (n, more = {}) => ({n, weld: `weld-${n}`, decision: "accept", advice: "Leave it as it is", ...more});

function table(rows, {live = false, newest = null} = {}) {
  const made = new FrontTable(new FakeElement("section"), live, newest);
  made.add(rows);
  return made;
}

const shown = (made) => made.shown().map(({n}) => n);
const column = (id) => COLUMNS.find((one) => one.id === id);

test("the worst comes first, of one decision the one farthest beyond its limit", () => {
  const worst = (ratio) => ({worst: {name: "peak_force", ratio, passed: false, verified: true}, decision: "grind"});
  assert.deepEqual(shown(table([row(1), row(2, worst(1.1)), row(3, worst(null)), row(4, {decision: "reject"})])), [4, 3, 2, 1]);
});

test("a live page shows the newest first and drops the oldest", () => {
  const made = table([1, 2, 3].map((n) => row(n)), {live: true, newest: 3});
  assert.deepEqual(shown(made), [3, 2, 1]);
  made.add([row(4), row(5)]);
  assert.deepEqual(shown(made), [5, 4, 3]);
  assert.deepEqual([...made.lines.keys()], [3, 4, 5]);
  assert.equal(made.body.children.length, 3);
});

test("a newer version of a file takes the place of the older", () => {
  const made = table([row(1), row(2)], {live: true});
  made.add([row(3, {weld: "weld-1", supersedes: [1]}), row(4, {supersedes: [99]})]);
  assert.deepEqual(shown(made), [4, 3, 2]);
});

test("without a number all are kept", () => {
  assert.equal(table(Array.from({length: 3000}, (_, i) => row(i + 1))).rows.size, 3000);
});

test("a heading sorts, and the same again the other way round", () => {
  const made = table([row(1, {peak_n: 2e5}), row(2, {peak_n: 3e5}), row(3)]);
  made.sortBy(column("peak"));
  assert.deepEqual(shown(made), [2, 1, 3]);
  made.sortBy(column("peak"));
  assert.deepEqual(shown(made), [3, 1, 2]);
  assert.equal(made.heads[COLUMNS.indexOf(column("peak"))].attributes.get("aria-sort"), "ascending");
});

test("names sort by the numbers in them", () => {
  const made = table([row(1, {weld: "km 10"}), row(2, {weld: "km 9"})]);
  made.sortBy(column("weld"));
  assert.deepEqual(shown(made), [2, 1]);
});

test("every word typed must be found, and a decision pressed twice is let go", () => {
  const made = table([row(1, {rail: "left"}), row(2, {rail: "right", decision: "grind"}), row(3, {rail: "left", decision: "grind"})]);
  made.search.value = "  GRIND left ";
  made.search.fire("input");
  assert.deepEqual(shown(made), [3]);
  assert.equal(made.count.textContent, "1 of 3 shown");
  made.search.value = "";
  made.search.fire("input");
  const press = (decision) => made.chips.children.find((chip) => chip.dataset.decision === decision).fire("click");
  press("grind");
  assert.deepEqual(shown(made), [2, 3]);
  press("grind");
  assert.equal(shown(made).length, 3);
});

test("a line that stays in its place is not touched", () => {
  const made = table([row(1), row(2)]);
  const [first] = made.body.children;
  first.remove = () => assert.fail("the line was taken out");
  made.add([row(3)]);
  assert.equal(made.body.children[0], first);
});

test("the highest speed within limits is none, part, or all of what was judged", () => {
  const words = (permitted) => permittedCell({judged_kmh: 160, permitted_kmh: permitted}).map((part) => part.textContent ?? part);
  assert.deepEqual(words(undefined), ["–"]);
  assert.deepEqual(words(0), ["none"]);
  assert.deepEqual(words(120), ["120 km/h", "of 160 km/h"]);
  assert.deepEqual(words(200), ["160 km/h", "all speeds judged"]);
});

const BASIS = {rule_books: ["force: Forces by model"], risk: 0.05, track: "bilbao", running: "in both directions", vehicle: "passenger", static_n: 100e3, unsprung_kg: 600, measured_on: "2026-11-20", line_kmh: 160};

test("columns of the two answers show where a verdict has them", () => {
  const hidden = (made) => COLUMNS.filter((_, i) => made.heads[i].hidden).map(({id}) => id);
  const made = table([row(1)]);
  assert.deepEqual(hidden(made), ["geometry", "force"]);
  made.add([row(2, {basis: BASIS, geometry: {decision: "not assessed"}, force: {decision: "reject", exceeding: 1}})]);
  assert.deepEqual(hidden(made), []);
  const words = made.lines.get(2).textContent;
  assert.ok(words.includes("–Not assessed✕Replaceover a limit: 100 %"), words);
  made.sortBy(column("force"));
  assert.deepEqual(shown(made), [2, 1]);
});

test("the front says what decisions rest on, and what nobody stated", () => {
  const other = {...BASIS, measured_on: undefined, line_kmh: undefined, unsprung_kg: undefined};
  const words = Object.fromEntries(basisParts([BASIS, other]).map((part) => part.children.map((child) => child.textContent)).map(([name, ...values]) => [name, values]));
  assert.deepEqual(words["Rule books"], ["force: Forces by model"]);
  assert.deepEqual(words["Accepted risk"], ["5 % of exceeding a limit"]);
  assert.deepEqual(words.Vehicle, ["passenger: static wheel load 100 kN, unsprung mass 600 kg per wheel", "passenger: static wheel load 100 kN, unsprung mass not known"]);
  assert.deepEqual(words["Trains run"], ["in both directions"]);
  assert.deepEqual(words["Measured on"], ["2026-11-20", "date not stated for 1 of 2"]);
  assert.deepEqual(words["Line speed"], ["160 km/h", "line speed not stated for 1 of 2"]);
  const verdictAlone = basisParts([{...other, unknown: true}]).map((part) => part.textContent);
  assert.deepEqual(verdictAlone.slice(-2), ["Measured onnot known", "Line speednot known"]);
  assert.deepEqual(basisParts([]), []);
});

test("many values are a range", () => {
  const speeds = [80, 100, 120, 140, 200].map((line_kmh) => ({...BASIS, line_kmh}));
  assert.ok(basisParts(speeds).at(-1).textContent.includes("80 km/h to 200 km/h"));
});
