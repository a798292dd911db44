// Where rows and parts of welds come from: this page itself, or the server that it was loaded from.

const POLL_MS = 500;

/**
 * The part of a weld in this page: a noscript element's text, or null; one that was not read yet is waited for.
 * @param {number} n
 */
async function embeddedPart(n) {
  if (document.readyState === "loading" && !document.getElementById(`card-${n}`)?.nextElementSibling) {
    await new Promise((done) => document.addEventListener("DOMContentLoaded", done, {once: true}));
  }
  const holder = document.getElementById(`card-${n}`);
  return holder ? fragment("div", holder.textContent ?? "").firstElementChild : null;
}

/**
 * The part of a weld, asked for where the page does not hold it.
 * @param {number} n
 */
async function partOf(n) {
  const found = await embeddedPart(n);
  if (found || !facts.live) return found;
  const answer = await fetch(`weld/${n}`, {cache: "no-store"});
  if (!answer.ok) throw new Error(word("script.answered", {status: answer.status}));
  const stream = new Blob([await answer.arrayBuffer()]).stream().pipeThrough(new DecompressionStream("gzip"));
  const part = fragment("article", await new Response(stream).text());
  part.className = "weld";
  part.dataset.number = String(n);
  return part;
}

/**
 * Ask a live page's server for what came after the last row, and for the front's header when something did.
 * @param {(rows: LiveRow[], header: string) => void} onRows
 * @param {(isLive: boolean) => void} onState
 */
function poll(onRows, onState) {
  let last = 0;
  const ask = async () => {
    try {
      const answer = await fetch(`rows?after=${last}`, {cache: "no-store"});
      if (!answer.ok) throw new Error(String(answer.status));
      /** @type {LiveRow[]} */
      const rows = await answer.json();
      if (rows.length) {
        const header = await fetch("header", {cache: "no-store"});
        onRows(rows, header.ok ? await header.text() : "");
        last = rows.reduce((most, row) => Math.max(most, row.n), last);
      }
      onState(true);
    } catch {
      onState(false);
    }
    setTimeout(ask, POLL_MS);
  };
  ask();
}
