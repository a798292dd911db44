// Where rows and details come from: this page itself, or the server it was loaded from. Both answer
//   start(onRows, onState)   rows as they come, and what is to be said about the connection
//   detail(n)                a promise of everything about weld n

const POLL_MS = 500;

/** @param {string} id */
const embeddedJson = (id) => JSON.parse(byId(id).textContent ?? "");

/**
 * @param {string} base64
 * @returns {Uint8Array<ArrayBuffer>}
 */
function bytesOf(base64) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(base64.trim());
  return Uint8Array.from(atob(base64.trim()), (character) => character.charCodeAt(0));
}

/** @param {Uint8Array<ArrayBuffer>} bytes */
function unpacked(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

/**
 * An element further down may not have been read yet when a weld is opened at once.
 * @param {string} id
 */
async function laterElement(id) {
  if (document.readyState === "loading" && !document.getElementById("plotly")) {
    await new Promise((done) => document.addEventListener("DOMContentLoaded", done, {once: true}));
  }
  return document.getElementById(id);
}

/**
 * @param {number} n
 * @returns {Promise<Detail | null>}
 */
async function embeddedDetail(n) {
  const holder = await laterElement(`data-${n}`);
  return holder && JSON.parse(await unpacked(bytesOf(holder.textContent ?? "")));
}

/** @type {Source} */
const embeddedSource = {
  start(onRows) {
    onRows(embeddedJson("rows"));
  },
  async detail(n) {
    const found = await embeddedDetail(n);
    if (!found) throw new Error(`weld ${n} is not in this page`);
    return found;
  },
};

/** @type {Source} */
const liveSource = {
  start(onRows, onState) {
    /** @type {Row[]} */
    const first = embeddedJson("rows");
    onRows(first);
    let last = first.reduce((most, row) => Math.max(most, row.n), 0);
    const poll = async () => {
      try {
        const answer = await fetch(`rows?after=${last}`, {cache: "no-store"});
        if (!answer.ok) throw new Error(`${answer.status}`);
        /** @type {Row[]} */
        const rows = await answer.json();
        last = rows.reduce((most, row) => Math.max(most, row.n), last);
        if (rows.length) onRows(rows);
        onState("live");
      } catch {
        onState("connection lost, trying again");
      }
      setTimeout(poll, POLL_MS);
    };
    poll();
  },
  async detail(n) {
    const found = await embeddedDetail(n);
    if (found) return found;
    const answer = await fetch(`weld/${n}`, {cache: "no-store"});
    if (!answer.ok) throw new Error(`the server answered ${answer.status}`);
    const bytes = new Uint8Array(await answer.arrayBuffer());
    const packed = bytes[0] === 0x1f && bytes[1] === 0x8b;
    return JSON.parse(packed ? await unpacked(bytes) : new TextDecoder().decode(bytes));
  },
};

/** @type {Promise<PlotlyLibrary> | null} */
let plotlyPromise = null;

/**
 * Plotly, unpacked when the first weld is opened; the policy allows this very text and no other.
 * @returns {Promise<PlotlyLibrary>}
 */
function loadPlotly() {
  return (plotlyPromise ??= (async () => {
    const holder = await laterElement("plotly");
    const text = await unpacked(bytesOf(holder?.textContent ?? ""));
    document.head.append(element("script", {}, text));
    if (!window.Plotly) throw new Error("this page's Plotly does not run");
    return window.Plotly;
  })());
}
