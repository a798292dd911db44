// The front table: one row a weld; sorted by any column, filtered by decision and by text.

/** @param {Row} row */
const ratioOf = (row) => (row.worst ? row.worst.ratio ?? Infinity : -1);
/**
 * @param {(row: Row) => string} pick
 * @returns {(a: Row, b: Row) => number}
 */
const byText = (pick) => (a, b) => pick(a).localeCompare(pick(b), "en", {numeric: true});
/**
 * @param {(row: Row) => number} pick
 * @returns {(a: Row, b: Row) => number}
 */
const byNumber = (pick) => (a, b) => pick(a) - pick(b);

/** @type {{id: string, heading: string, falling?: boolean, compare: (a: Row, b: Row) => number}[]} */
const COLUMNS = [
  {id: "n", heading: "No.", compare: byNumber((row) => row.n)},
  {id: "decision", heading: "Decision",
    compare: (a, b) => decisionOf(a.decision).order - decisionOf(b.decision).order || ratioOf(b) - ratioOf(a)},
  {id: "weld", heading: "Weld", compare: byText((row) => row.weld)},
  {id: "worst", heading: "Worst criterion", falling: true, compare: byNumber(ratioOf)},
  {id: "peak", heading: "Peak", falling: true, compare: byNumber((row) => row.peak_n ?? -1)},
  {id: "permitted", heading: "Speed within limits", compare: byNumber((row) => row.permitted_kmh ?? Infinity)},
  {id: "advice", heading: "What to do", compare: byText((row) => row.advice)},
];

class FrontTable {
  /**
   * @param {HTMLElement} holder
   * @param {boolean} live
   * @param {number | null} newest
   */
  constructor(holder, live, newest) {
    this.newest = newest ?? Infinity;
    /** @type {Map<number, Row>} */
    this.rows = new Map();
    /** @type {Map<number, HTMLElement>} */
    this.lines = new Map();
    /** @type {string | null} */
    this.decision = null;
    /** @type {string[]} */
    this.words = [];
    this.column = live ? COLUMNS[0] : COLUMNS[1];
    this.falling = live;
    this.chips = element("div", {class: "chips", role: "group", "aria-label": "Show only one decision"});
    this.search = element("input", {id: "search", type: "search", autocomplete: "off", spellcheck: "false"});
    this.search.addEventListener("input", () => {
      this.words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
      this.show();
    });
    this.order = element("select", {id: "order"}, ...COLUMNS.map((c) => element("option", {value: c.id}, c.heading)));
    this.order.addEventListener("change", () => this.sortBy(COLUMNS[this.order.selectedIndex]));
    this.direction = element("button", {type: "button", class: "button"}, "Reverse");
    this.direction.addEventListener("click", () => this.sortBy(this.column));
    this.heads = COLUMNS.map((column) => {
      const button = element("button", {type: "button"}, column.heading);
      button.addEventListener("click", () => this.sortBy(column));
      return element("th", {scope: "col", class: `c-${column.id}`}, button);
    });
    this.body = element("tbody");
    this.count = element("p", {class: "count", role: "status"});
    holder.replaceChildren(
      element("h2", {class: "visually-hidden"}, "All welds"),
      this.chips,
      element(
        "div", {class: "tools screen-only"},
        element("div", {class: "field grow"}, element("label", {for: "search"}, "Find"), this.search),
        element("div", {class: "field phone-only"}, element("label", {for: "order"}, "Sort by"), this.order),
        element("div", {class: "field phone-only"}, this.direction),
        this.count,
      ),
      element(
        "table", {class: "welds"},
        element("caption", {class: "visually-hidden"}, "Welds with their decisions; headings sort"),
        element("thead", {}, element("tr", {}, ...this.heads)), this.body,
      ),
    );
  }

  /** @param {Row[]} rows */
  add(rows) {
    for (const row of rows) {
      this.rows.set(row.n, row);
      this.lines.set(row.n, rowLine(row));
      if (row.supersedes !== undefined) this.drop(row.supersedes);
    }
    this.dropOldest();
    this.show();
  }

  // A page that stays open keeps as much as its server does.
  dropOldest() {
    for (const n of this.rows.keys()) {
      if (this.rows.size <= this.newest) return;
      this.drop(n);
    }
  }

  /** @param {number} n */
  drop(n) {
    this.rows.delete(n);
    this.lines.delete(n);
  }

  /** @param {typeof COLUMNS[number]} column */
  sortBy(column) {
    this.falling = column === this.column ? !this.falling : Boolean(column.falling);
    this.column = column;
    this.show();
  }

  // The welds as they are shown now, for going from one to the next.
  shown() {
    const sign = this.falling ? -1 : 1;
    return [...this.rows.values()]
      .filter((row) => !this.decision || row.decision === this.decision)
      .filter((row) => this.words.every((word) => textOf(row).includes(word)))
      .sort((a, b) => sign * this.column.compare(a, b) || a.n - b.n);
  }

  show() {
    const shown = this.shown();
    const {activeElement} = document;
    this.place(shown.flatMap((row) => this.lines.get(row.n) ?? []));
    if (activeElement instanceof HTMLElement && this.body.contains(activeElement)) activeElement.focus({preventScroll: true});
    this.heads.forEach((head, i) => {
      if (COLUMNS[i] === this.column) head.setAttribute("aria-sort", this.falling ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    });
    this.order.value = this.column.id;
    this.count.textContent = shown.length === this.rows.size ? "" : `${shown.length} of ${this.rows.size} shown`;
    this.showChips();
  }

  /**
   * Lines that are in their place stay untouched: laid out anew, two thousand take seconds.
   * @param {HTMLElement[]} lines
   */
  place(lines) {
    /** @type {Set<Element>} */
    const wanted = new Set(lines);
    for (const line of [...this.body.children]) if (!wanted.has(line)) line.remove();
    let there = this.body.firstChild;
    for (const line of lines) {
      if (line === there) there = there.nextSibling;
      else this.body.insertBefore(line, there);
    }
  }

  showChips() {
    /** @type {Map<string, number>} */
    const counts = new Map();
    for (const {decision} of this.rows.values()) counts.set(decision, (counts.get(decision) ?? 0) + 1);
    const {activeElement} = document;
    const had = activeElement instanceof HTMLElement && this.chips.contains(activeElement) ? activeElement.dataset.decision : undefined;
    const known = [...counts.keys()].sort((a, b) => decisionOf(a).order - decisionOf(b).order);
    const chips = ["", ...known].map((decision) => {
      const label = decision ? badge(decision) : element("span", {class: "badge all"}, "All");
      const count = element("span", {class: "number"}, String(decision ? counts.get(decision) : this.rows.size));
      const pressed = (this.decision ?? "") === decision;
      const chip = element(
        "button", {type: "button", class: "chip", "aria-pressed": String(pressed), "data-decision": decision}, count, label,
      );
      chip.addEventListener("click", () => {
        this.decision = decision && !pressed ? decision : null;
        this.show();
      });
      return chip;
    });
    this.chips.replaceChildren(...chips);
    if (had !== undefined) chips.find((chip) => chip.dataset.decision === had)?.focus();
  }

  /** @param {number} n */
  focusOn(n) {
    this.lines.get(n)?.querySelector("a")?.focus({preventScroll: true});
  }
}

/** @param {Row} row */
function textOf(row) {
  row.text ??= [
    row.weld, row.rail, decisionOf(row.decision).label, row.advice, row.worst && criterionName(row.worst.name),
    row.chainage_m,
  ].filter((part) => part !== undefined).join(" ").toLowerCase();
  return row.text;
}

/** @param {Row} row */
function rowLine(row) {
  /**
   * @param {string} id
   * @param {...Child} children
   */
  const cell = (id, ...children) => element("td", {class: `c-${id}`}, ...children);
  const line = element(
    "tr", {},
    cell("n", String(row.n)),
    cell("decision", badge(row.decision)),
    element("th", {scope: "row", class: "c-weld"}, element("a", {href: `#weld-${row.n}`}, row.weld), place(row)),
    cell("worst", ...worstCell(row)),
    cell("peak", row.peak_n === undefined ? "–" : kilonewtons(row.peak_n)),
    cell("permitted", ...permittedCell(row)),
    cell("advice", row.advice),
  );
  line.addEventListener("click", (event) => {
    if (event.target instanceof Element && !event.target.closest("a") && !String(window.getSelection())) location.hash = `weld-${row.n}`;
  });
  return line;
}

/** @param {Row} row */
function place(row) {
  const parts = [row.rail, row.chainage_m !== undefined && `km ${(row.chainage_m / 1000).toFixed(3)}`].filter(Boolean);
  return parts.length ? element("span", {class: "small block"}, parts.join(" · ")) : null;
}

/**
 * @param {Row} row
 * @returns {Child[]}
 */
function worstCell({worst}) {
  if (!worst) return ["–"];
  return [
    element("span", {class: "block"}, criterionName(worst.name)),
    bar(worst.ratio ?? Infinity, worst.passed),
    element("span", {class: `nowrap ${worst.passed ? "" : "over"}`}, timesLimit(worst.ratio)),
    worst.verified ? null : element("span", {class: "small block"}, "unverified limit"),
  ];
}

/**
 * How far a value goes towards its limit, the mark, and beyond.
 * @param {number} ratio
 * @param {boolean} passed
 */
function bar(ratio, passed) {
  const filled = element("span");
  filled.style.width = `${Math.min(100, Math.max(0, ratio) * 50)}%`;
  return element("span", {class: `meter ${passed ? "within" : "beyond"}`, "aria-hidden": "true"}, filled);
}

/**
 * @param {Row} row
 * @returns {Child[]}
 */
function permittedCell(row) {
  if (row.permitted_kmh === undefined || row.judged_kmh === undefined) return ["–"];
  if (row.permitted_kmh === 0) return [element("strong", {class: "over"}, "none")];
  if (row.permitted_kmh >= row.judged_kmh) return [kmh(row.judged_kmh), element("span", {class: "small block"}, "all speeds judged")];
  return [element("strong", {}, kmh(row.permitted_kmh)), element("span", {class: "small block"}, `of ${kmh(row.judged_kmh)}`)];
}
