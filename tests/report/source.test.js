const assert = require("node:assert/strict");
const test = require("node:test");
const {gzipSync} = require("node:zlib");
const {load} = require("./page_scripts.js");

const SCRIPTS = ["words.js", "source.js"];
const packed = (content) => gzipSync(JSON.stringify(content));

test("details are unpacked from the page", async () => {
  const embedded = {rows: [{n: 1}], "data-1": packed({verdict: 7}).toString("base64"), plotly: ""};
  const {embeddedSource} = load(SCRIPTS, ["embeddedSource"], {embedded});
  embeddedSource.start((rows) => assert.deepEqual(rows, [{n: 1}]));
  assert.deepEqual(await embeddedSource.detail(1), {verdict: 7});
  await assert.rejects(embeddedSource.detail(2), /weld 2 is not in this page/);
});

test("a live page asks for what came after its last row, and says when nobody answers", async () => {
  const answers = [[{n: 3}, {n: 4}], [], null, [{n: 5}]];
  const [asked, got, states, polls] = [[], [], [], []];
  const {liveSource} = load(SCRIPTS, ["liveSource"], {
    embedded: {rows: [{n: 2}]},
    setTimeout: (poll) => polls.push(poll),
    fetch: async (url) => {
      asked.push(url);
      const rows = answers.shift();
      if (!rows) throw new Error("refused");
      return {ok: true, json: async () => rows};
    },
  });
  liveSource.start((rows) => got.push(rows.map(({n}) => n)), (state) => states.push(state));
  for (let turn = 0; turn < 4; turn++) {
    while (polls.length === 0) await new Promise(setImmediate);
    if (turn < 3) polls.shift()();
  }
  assert.deepEqual(asked, ["rows?after=2", "rows?after=4", "rows?after=4", "rows?after=4"]);
  assert.deepEqual(got, [[2], [3, 4], [5]]);
  assert.deepEqual(states, ["live", "live", "connection lost, trying again", "live"]);
});

test("details of a live page come packed or not, and an answer that is none is said", async () => {
  const answer = (bytes) => ({ok: true, arrayBuffer: async () => new Uint8Array(bytes).buffer});
  const answers = [answer(packed({verdict: 1})), answer(Buffer.from('{"verdict": 2}')), {ok: false, status: 404}];
  const {liveSource} = load(SCRIPTS, ["liveSource"], {fetch: async () => answers.shift()});
  assert.equal((await liveSource.detail(1)).verdict, 1);
  assert.equal((await liveSource.detail(1)).verdict, 2);
  await assert.rejects(liveSource.detail(1), /the server answered 404/);
});
