// Which part of the page is shown: the table, one weld (#weld-3), or all of them as on paper (#print).

/** @type {PageFacts} */
const given = embeddedJson("facts");
const source = given.live ? liveSource : embeddedSource;
const front = byId("front");
const one = byId("weld");
const all = byId("all");
const table = new FrontTable(front, given.live, given.newest);

const viewport = /** @type {HTMLMetaElement} */ (document.querySelector("meta[name=viewport]"));

const PAPER_PX = 900;

let scrolled = 0;
/** @type {number | null} */
let opened = null;
let turn = 0;

/** @param {unknown} error */
const messageOf = (error) => (error instanceof Error ? error.message : String(error));

const wanted = () => Number(/^#weld-(\d+)$/.exec(location.hash)?.[1] ?? 0);

/** @param {HTMLElement} part */
function showOnly(part) {
  for (const other of [front, one, all]) other.hidden = other !== part;
}

/** @param {HTMLElement} holder */
function clear(holder) {
  if (window.Plotly) for (const drawn of holder.querySelectorAll(".js-plotly-plot")) window.Plotly.purge(drawn);
  holder.replaceChildren();
}

function showFront() {
  const from = opened;
  opened = null;
  showBanner();
  clear(one);
  showOnly(front);
  document.title = given.title;
  if (from !== null) {
    table.focusOn(from);
    window.scrollTo(0, scrolled);
  }
}

/** @param {number} n */
async function showWeld(n) {
  const row = table.rows.get(n);
  if (!row) {
    // Of a live page, it may still come.
    if (!given.live) showFront();
    return;
  }
  const mine = ++turn;
  if (opened === null) scrolled = window.scrollY;
  opened = n;
  showBanner();
  clear(one);
  one.append(barOf(n), element("p", {role: "status"}, "Opening…"));
  showOnly(one);
  document.title = `${row.weld} – ${given.title}`;
  window.scrollTo(0, 0);
  try {
    const built = weldSection(row, await source.detail(n), false);
    if (mine !== turn) return;
    one.lastChild?.replaceWith(built.section);
    built.heading.focus({preventScroll: true});
    await built.draw();
  } catch (error) {
    if (mine !== turn) return;
    one.append(element("p", {class: "banner", role: "alert"}, `This weld cannot be shown: ${messageOf(error)}`));
  }
}

/** @param {number} n */
function barOf(n) {
  const shown = table.shown().map((row) => row.n);
  const at = shown.indexOf(n);
  /** @type {(text: string, to: number | undefined) => HTMLElement} */
  const step = (text, to) => (to === undefined
    ? element("span", {class: "button", "aria-disabled": "true"}, text)
    : element("a", {class: "button", href: `#weld-${to}`}, text));
  return element("nav", {class: "bar", "aria-label": "Welds"},
    element("a", {class: "button", href: "#"}, "← All welds"),
    element("span", {class: "push"}), step("‹ Previous", shown[at - 1]), step("Next ›", at < 0 ? undefined : shown[at + 1]));
}

async function showAll() {
  const mine = ++turn;
  opened = null;
  clear(all);
  document.body.classList.add("printing");
  // A phone lays out as if it were as wide as paper.
  viewport.content = `width=${PAPER_PX}`;
  all.hidden = false;
  front.hidden = false;
  one.hidden = true;
  for (const row of table.shown()) {
    try {
      const built = weldSection(row, await source.detail(row.n), true);
      if (mine !== turn) return;
      all.append(built.section);
      await built.draw();
    } catch (error) {
      all.append(element("p", {class: "banner"}, `${row.weld} cannot be shown: ${messageOf(error)}`));
    }
  }
  document.body.dataset.printed = "ready";
}

function route() {
  if (location.hash === "#print") {
    showAll();
    return;
  }
  document.body.classList.remove("printing");
  viewport.content = "width=device-width, initial-scale=1";
  delete document.body.dataset.printed;
  clear(all);
  if (wanted()) {
    showWeld(wanted());
  } else {
    turn++;
    showFront();
  }
}

function showBanner() {
  const rows = [...table.rows.values()].filter((row) => row.unverified);
  const banner = byId("banner");
  // Two answers say themselves on whose authority they stand.
  banner.hidden = rows.length === 0 || (opened !== null && table.rows.get(opened)?.basis !== undefined);
  if (!rows.length) return;
  banner.replaceChildren(element("p", {}, element("strong", {}, "Limits not verified. "),
    rows.every((row) => row.basis)
      ? "Some are engineering judgement: each weld says which."
      : `Nobody has checked them against their source${rows.length === table.rows.size ? "" : ` (${rows.length} of ${table.rows.size} welds)`}. State your own with --limits before you act on a decision.`));
}

// A page of many welds is long in coming: the first rows are shown before it is all there.
source.start((rows) => {
  const waited = wanted() && !table.rows.has(wanted());
  table.add(rows);
  showBanner();
  if (waited) route();
}, (state) => {
  const status = byId("live");
  if (status.textContent !== state) status.textContent = state;
  status.classList.toggle("lost", state !== "live");
});

window.addEventListener("hashchange", route);
window.addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("details")) details.open = true;
  for (const drawn of one.querySelectorAll(".js-plotly-plot")) window.Plotly?.Plots.resize(drawn);
});
route();
// When it could be used, for whoever measures.
document.documentElement.dataset.ready = performance.now().toFixed(0);
