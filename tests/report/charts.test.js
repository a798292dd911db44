const assert = require("node:assert/strict");
const test = require("node:test");
const {load} = require("./page_scripts.js");

const names = ["edgesOf", "gridOf", "holdsAt", "limitSteps", "nearest", "outline", "seriesOf", "speedMarks", "worstCellOf"];
const {edgesOf, gridOf, holdsAt, limitSteps, nearest, outline, seriesOf, speedMarks, worstCellOf} = load(["words.js", "source.js", "charts.js"], names);

const MAP = {
  speeds_kmh: [100, 120, 140], positions_m: [0, 0.2, 0.4], span_m: 0.6, static_load_n: 1e5,
  peak_n: [1, 2, 3, 4, 9, 5, 6, 7, 10], hollow: "000010000",
};

const rounded = (values) => values.map((value) => Number(value.toFixed(6)));

test("edges lie midway between centres, and about a single one", () => {
  assert.deepEqual(rounded(edgesOf([1, 2, 4])), [0.5, 1.5, 3, 5]);
  assert.deepEqual(rounded(edgesOf([0])), [-0.02, 0.02]);
  assert.deepEqual(rounded(edgesOf([100])), [98, 102]);
});

test("a map of a whole span shows its first position again at the next sleeper", () => {
  const grid = gridOf(MAP);
  assert.deepEqual(rounded(grid.positions), [0, 0.2, 0.4, 0.6]);
  assert.deepEqual(grid.peaks, [[1, 2, 3, 1], [4, 9, 5, 4], [6, 7, 10, 6]]);
  assert.deepEqual(grid.hollow[1], [false, true, false, false]);
  assert.deepEqual(gridOf({...MAP, span_m: 0.7}).peaks[0], [1, 2, 3]);
});

test("a local minimum is outlined by its four sides", () => {
  const rim = outline(gridOf(MAP));
  assert.equal(rim.x.filter((x) => x === null).length, 4);
  assert.deepEqual([...new Set(rim.y.filter((y) => y !== null))].sort(), [110, 130]);
});

test("the worst cell lies below the line's speed, or in the first row", () => {
  const grid = gridOf(MAP);
  assert.deepEqual(worstCellOf(grid, undefined), [2, 2]);
  assert.deepEqual(worstCellOf(grid, 120), [1, 1]);
  assert.deepEqual(worstCellOf(grid, 50), [0, 2]);
});

test("a limit holds above one speed and up to another", () => {
  const limit = {limit: 1, verified: true, above_kmh: 100, to_kmh: 160};
  assert.deepEqual([100, 101, 160, 161].map((speed) => holdsAt(limit, speed)), [false, true, true, false]);
});

test("a limit holds from one speed and below another", () => {
  const limit = {limit: 1, verified: true, from_kmh: 100, below_kmh: 160};
  assert.deepEqual([99, 100, 159, 160].map((speed) => holdsAt(limit, speed)), [false, true, true, false]);
  assert.deepEqual(limitSteps({limits: [{...limit, from_kmh: 110, below_kmh: 130}]}, MAP.speeds_kmh, "limit"), [{from: 110, to: 130, value: 1, verified: true}]);
});

test("limits become steps within the speeds shown", () => {
  const limits = [
    {limit: 5, verified: true, to_kmh: 110}, {limit: 4, reject_limit: 6, verified: false, above_kmh: 110},
    {limit: 3, verified: true, above_kmh: 300},
  ];
  assert.deepEqual(limitSteps({limits}, MAP.speeds_kmh, "limit"), [
    {from: 100, to: 110, value: 5, verified: true}, {from: 110, to: 140, value: 4, verified: false},
  ]);
  assert.deepEqual(limitSteps({limits}, MAP.speeds_kmh, "reject_limit"), [{from: 110, to: 140, value: 6, verified: false}]);
});

test("the nearest value is found, and a curve by its criterion", () => {
  assert.equal(nearest([100, 120, 140], 129), 1);
  assert.equal(seriesOf({series: [{name: "p2_force"}]}, "p2_force").name, "p2_force");
  assert.throws(() => seriesOf({series: []}, "p2_force"), /p2_force/);
});

test("highest speed within limits and line speed are marked where they bound something", () => {
  const verdict = {judged_speed_kmh: 140, permitted_speed_kmh: 120, avoid: [{from_kmh: 105, to_kmh: 105}]};
  const marks = speedMarks(verdict, {line_speed_kmh: 130}, MAP.speeds_kmh);
  assert.deepEqual(marks.annotations.map(({text}) => text), ["avoid", "within limits to 120", "line 130"]);
  assert.deepEqual([marks.shapes[0].x0, marks.shapes[0].x1], [105, 105.5]);
  assert.equal(speedMarks({...verdict, permitted_speed_kmh: 140, avoid: []}, undefined, MAP.speeds_kmh).shapes.length, 0);
});
