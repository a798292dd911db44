// Which part of the page is shown: the table, one weld (#weld-3), or all of them as on paper (#print).

document.documentElement.classList.add("js");
const front = byId("front");
const one = byId("weld");
const all = byId("all");
const table = new FrontTable(front);
let scrolled = 0;
/** @type {number | null} */
let opened = null;
let turn = 0;

const wanted = () => Number(/^#weld-(\d+)$/.exec(location.hash)?.[1] ?? 0);

/** @param {HTMLElement} part */
function showOnly(part) {
  for (const other of [front, one, all]) other.hidden = other !== part;
}

function showFront() {
  const from = opened;
  opened = null;
  one.replaceChildren();
  showOnly(front);
  document.title = facts.title;
  if (from !== null) {
    table.focusOn(from);
    window.scrollTo(0, scrolled);
  }
}

/** @param {number} n */
async function showWeld(n) {
  const found = table.rows.get(n);
  if (!found) {
    // Of a live page, it may still come.
    if (!facts.live) showFront();
    return;
  }
  const mine = ++turn;
  if (opened === null) scrolled = window.scrollY;
  opened = n;
  one.replaceChildren(barOf(n), element("p", {role: "status"}, word("script.opening")));
  showOnly(one);
  document.title = `${found.row.weld} – ${facts.title}`;
  window.scrollTo(0, 0);
  try {
    const part = await partOf(n);
    if (mine !== turn || !part) return;
    // Its own id would make the browser scroll below the bar.
    part.removeAttribute("id");
    one.lastChild?.replaceWith(part);
    makeReadable(part);
    part.querySelector("h2")?.focus({preventScroll: true});
  } catch (error) {
    if (mine !== turn) return;
    one.append(element("p", {class: "banner", role: "alert"}, word("script.cannot", {why: error instanceof Error ? error.message : String(error)})));
  }
}

/** @param {number} n */
function barOf(n) {
  const shown = table.shown();
  const at = shown.indexOf(n);
  /** @type {(text: string, to: number | undefined) => HTMLElement} */
  const step = (text, to) => (to === undefined
    ? element("span", {class: "button", "aria-disabled": "true"}, text)
    : element("a", {class: "button", href: `#weld-${to}`}, text));
  return element("nav", {class: "bar", "aria-label": word("script.welds_nav")},
    element("a", {class: "button", href: "#"}, word("script.all_welds")), element("span", {class: "push"}),
    step(word("script.previous"), shown[at - 1]), step(word("script.next"), at < 0 ? undefined : shown[at + 1]));
}

async function showAll() {
  const mine = ++turn;
  opened = null;
  document.body.classList.add("paper");
  all.replaceChildren();
  front.hidden = all.hidden = false;
  one.hidden = true;
  for (const n of table.shown()) {
    const part = await partOf(n);
    if (mine !== turn) return;
    if (part) all.append(part);
  }
  document.body.dataset.printed = "ready";
  if (!navigator.webdriver) window.print();
}

function route() {
  if (location.hash === "#print") {
    showAll();
    return;
  }
  document.body.classList.remove("paper");
  delete document.body.dataset.printed;
  all.replaceChildren();
  turn++;
  if (wanted()) showWeld(wanted());
  else showFront();
}

/** @param {string} html */
function replaceHeader(html) {
  const holder = byId("header");
  const open = Boolean(holder.querySelector("details[open]"));
  holder.innerHTML = html;
  holder.querySelector("details")?.toggleAttribute("open", open);
}

if (facts.live) {
  const state = byId("live");
  poll((rows, header) => {
    const waited = wanted() && !table.rows.has(wanted());
    table.add(rows);
    if (header) replaceHeader(header);
    if (waited) route();
  }, (isLive) => {
    const said = word(isLive ? "script.live" : "script.lost");
    if (state.textContent !== said) state.textContent = said;
    state.classList.toggle("lost", !isLive);
  });
}
window.addEventListener("hashchange", route);
route();
// When it could be used, for whoever measures.
document.documentElement.dataset.ready = performance.now().toFixed(0);
