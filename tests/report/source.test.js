const assert = require("node:assert/strict");
const test = require("node:test");
const {gzipSync} = require("node:zlib");
const {load} = require("./page_scripts.js");

const words = {script: {answered: "the server answered {status}"}};
const embedded = {facts: {live: true, words}};

test("a live page asks for what came after its last row and for the header, and says when nobody answers", async () => {
  const answers = [[{n: 3}, {n: 4}], [], null, [{n: 5}]];
  const [asked, got, states, polls] = [[], [], [], []];
  const {poll} = load(["dom.js", "source.js"], ["poll"], {
    embedded,
    setTimeout: (next) => polls.push(next),
    fetch: async (url) => {
      if (url === "header") return {ok: true, text: async () => "<p>"};
      asked.push(url);
      const rows = answers.shift();
      if (!rows) throw new Error("refused");
      return {ok: true, json: async () => rows};
    },
  });
  poll((rows, header) => got.push([rows.map(({n}) => n), header]), (state) => states.push(state));
  for (let turn = 0; turn < 4; turn++) {
    while (polls.length === 0) await new Promise(setImmediate);
    if (turn < 3) polls.shift()();
  }
  assert.deepEqual(asked, ["rows?after=0", "rows?after=4", "rows?after=4", "rows?after=4"]);
  assert.deepEqual(got, [[[3, 4], "<p>"], [[5], "<p>"]]);
  assert.deepEqual(states, [true, true, false, true]);
});

test("the part of a weld is unpacked, and an answer that is none is said", async () => {
  const answers = [{ok: true, arrayBuffer: async () => new Uint8Array(gzipSync("<h2>7</h2>")).buffer}, {ok: false, status: 404}];
  const {partOf} = load(["dom.js", "source.js"], ["partOf"], {embedded, fetch: async () => answers.shift()});
  const part = await partOf(7);
  assert.deepEqual([part.innerHTML, part.dataset.number], ["<h2>7</h2>", "7"]);
  await assert.rejects(partOf(8), /the server answered 404/);
});
