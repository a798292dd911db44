// A campaign's strips along the chainage: zoom by buttons, wheel and keys, and read a stretch by pressing it.

/**
 * The part of a strip that is shown, so far zoomed about a place of it.
 * @param {[first: number, last: number]} shown
 * @param {number} whole
 * @param {number} factor below 1 to see less of it
 * @param {number} about
 * @returns {[first: number, last: number]}
 */
function zoomed([first, last], whole, factor, about) {
  const breadth = Math.min(whole, Math.max(4, (last - first) * factor));
  const start = Math.min(whole - breadth, Math.max(0, about - (about - first) * (breadth / (last - first))));
  return [start, start + breadth];
}

/** @param {HTMLElement} line a section with a strip */
function makeZoomable(line) {
  const strip = /** @type {SVGElement | null} */ (line.querySelector("svg.strip"));
  const ends = line.querySelectorAll(".ends span");
  if (!strip) return;
  const [, , whole, height] = (strip.getAttribute("viewBox") ?? "").split(" ").map(Number);
  const [from, to] = [Number(line.dataset.from), Number(line.dataset.to)];
  /** @type {[first: number, last: number]} */
  let shown = [0, whole];
  /** @type {(next: [first: number, last: number]) => void} */
  const show = (next) => {
    shown = next;
    strip.setAttribute("viewBox", `${shown[0]} 0 ${shown[1] - shown[0]} ${height}`);
    shown.forEach((at, i) => { ends[i].textContent = `${(from + (at / whole) * (to - from)).toFixed(3)} km`; });
  };
  const middle = () => (shown[0] + shown[1]) / 2;
  /** @type {[label: string, sign: string, next: () => [first: number, last: number]][]} */
  const buttons = [["zoom_in", "+", () => zoomed(shown, whole, 0.5, middle())], ["zoom_out", "−", () => zoomed(shown, whole, 2, middle())],
    ["whole_line", "↔", () => [0, whole]]];
  line.querySelector(".zoom")?.append(...buttons.map(([label, sign, next]) => {
    const button = element("button", {type: "button", class: "button", "aria-label": word(`script.${label}`)}, sign);
    button.addEventListener("click", () => show(next()));
    return button;
  }));
  strip.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.shiftKey && shown[0] === 0 && shown[1] === whole && event.deltaY > 0) return;
    event.preventDefault();
    const {left, width} = strip.getBoundingClientRect();
    const at = shown[0] + ((event.clientX - left) / width) * (shown[1] - shown[0]);
    show(zoomed(shown, whole, event.deltaY < 0 ? 0.8 : 1.25, at));
  }, {passive: false});
  strip.addEventListener("click", (event) => {
    const link = event.target instanceof Element ? event.target.closest("a") : null;
    const row = document.getElementById(link?.getAttribute("href")?.slice(1) ?? "");
    if (!row) return;
    event.preventDefault();
    choose(line, row, link?.getAttribute("aria-label") ?? "");
  });
}

/**
 * Show a stretch's row below the strip.
 * @param {HTMLElement} line
 * @param {HTMLElement} row
 * @param {string} words
 */
function choose(line, row, words) {
  const worst = [...(row.lastElementChild?.childNodes ?? [])].map((node) => node.cloneNode(true));
  line.querySelector(".chosen")?.replaceChildren(element("strong", {}, words), ...worst);
}

document.documentElement.classList.add("js");
for (const line of document.querySelectorAll("section.line")) makeZoomable(/** @type {HTMLElement} */ (line));
