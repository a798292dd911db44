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

/** @param {RowAnswer | undefined} answer */
const answerOrder = (answer) => (answer ? decisionOf(answer.decision).order - (answer.exceeding ?? 0) / 2 : 99);

/** Columns of verdicts with two answers only. */
const OF_ANSWERS = ["geometry", "force"];

/** @type {{id: string, heading: string, falling?: boolean, compare: (a: Row, b: Row) => number}[]} */
const COLUMNS = [
  {id: "n", heading: "No.", compare: byNumber((row) => row.n)},
  {id: "decision", heading: "Decision",
    compare: (a, b) => decisionOf(a.decision).order - decisionOf(b.decision).order || ratioOf(b) - ratioOf(a)},
  {id: "geometry", heading: "Geometry", compare: byNumber((row) => answerOrder(row.geometry))},
  {id: "force", heading: "Force", compare: byNumber((row) => answerOrder(row.force))},
  {id: "weld", heading: "Weld", compare: byText((row) => row.weld)},
  {id: "worst", heading: "Worst criterion", falling: true, compare: byNumber(ratioOf)},
  {id: "peak", heading: "Peak", falling: true, compare: byNumber((row) => row.peak_n ?? -1)},
  {id: "permitted", heading: "Forces within limits up to", compare: byNumber((row) => row.permitted_kmh ?? Infinity)},
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
    this.basis = element("dl", {class: "basis", "aria-label": "What the decisions rest on"});
    this.table = element(
      "table", {class: "welds"},
      element("caption", {class: "visually-hidden"}, "Welds with their decisions; headings sort"),
      element("thead", {}, element("tr", {}, ...this.heads)), this.body,
    );
    this.count = element("p", {class: "count", role: "status"});
    holder.replaceChildren(
      element("h2", {class: "visually-hidden"}, "All welds"),
      this.basis,
      this.chips,
      element(
        "div", {class: "tools screen-only"},
        element("div", {class: "field grow"}, element("label", {for: "search"}, "Find"), this.search),
        element("div", {class: "field phone-only"}, element("label", {for: "order"}, "Sort by"), this.order),
        element("div", {class: "field phone-only"}, this.direction),
        this.count,
      ),
      this.table,
    );
  }

  /** @param {Row[]} rows */
  add(rows) {
    for (const row of rows) {
      this.rows.set(row.n, row);
      this.lines.set(row.n, rowLine(row));
      for (const older of row.supersedes ?? []) this.drop(older);
    }
    this.dropOldest();
    const answered = [...this.rows.values()].filter((row) => row.basis);
    this.table.setAttribute("class", answered.length ? "welds answered" : "welds");
    this.heads.forEach((head, i) => {
      if (OF_ANSWERS.includes(COLUMNS[i].id)) head.hidden = !answered.length;
    });
    this.basis.replaceChildren(...basisParts(answered.flatMap((row) => row.basis ?? [])));
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
    answerCell("geometry", "Geometry", row.geometry),
    answerCell("force", "Force", row.force),
    element("th", {scope: "row", class: "c-weld"}, element("a", {href: `#weld-${row.n}`}, row.weld), place(row)),
    cell("worst", ...worstCell(row)),
    cell("peak", row.peak_n === undefined ? "–" : kilonewtons(row.peak_n)),
    cell("permitted", ...permittedCell(row)),
    cell("advice", ...withCode(row.advice)),
  );
  line.addEventListener("click", (event) => {
    if (event.target instanceof Element && !event.target.closest("a") && !String(window.getSelection())) location.hash = `weld-${row.n}`;
  });
  return line;
}

/**
 * @param {string} id
 * @param {string} heading
 * @param {RowAnswer | undefined} answer
 */
function answerCell(id, heading, answer) {
  if (!answer) return element("td", {class: `c-${id} empty`}, "–");
  const {decision, exceeding} = answer;
  return element("td", {class: `c-${id}`, "data-label": heading}, answerBadge(decision),
    exceeding !== undefined && element("span", {class: "small block", title: "probability that a limit is exceeded"}, `over a limit: ${probability(exceeding)}`));
}

/**
 * The distinct values among many, and for how many nothing was stated.
 * @template T
 * @param {T[]} of
 * @param {(one: T) => string | false | undefined} words
 * @param {string} [missing] what to say where none is
 */
function distinct(of, words, missing) {
  const all = of.map(words);
  const stated = [...new Set(all.filter(isShown))].sort(new Intl.Collator("en", {numeric: true}).compare);
  const lacking = all.filter((one) => !isShown(one)).length;
  const shown = stated.length > 4 ? [`${stated[0]} to ${lastOf(stated)}`] : stated;
  if (lacking && missing) shown.push(lacking === all.length ? missing : `${missing} for ${lacking} of ${all.length}`);
  return shown;
}

/**
 * What decisions rest on, for whoever signs them.
 * @param {Basis[]} of
 */
function basisParts(of) {
  if (!of.length) return [];
  const books = [...new Set(of.flatMap((one) => one.rule_books))].sort();
  /** @type {[name: string, values: string[]][]} */
  const parts = [
    ["Rule books", books.length ? books : ["none"]],
    ["Accepted risk", distinct(of, ({risk}) => risk === undefined ? undefined : `${percent(risk)} of exceeding a limit`, "not stated")],
    ["Track", distinct(of, ({track}) => track, "not known")],
    ["Vehicle", distinct(of, ({vehicle, static_n: load, unsprung_kg: mass}) => `${vehicle === undefined ? "" : `${vehicle}: `}static wheel load ${kilonewtons(load)}, ${mass === undefined ? "unsprung mass not known" : `unsprung mass ${number(mass, 4)} kg per wheel`}`)],
    ["Trains run", distinct(of, ({running}) => running, "direction not known")],
    ["Measured on", distinct(of, (one) => one.measured_on ?? (one.unknown && "not known"), "date not stated")],
    ["Line speed", distinct(of, (one) => one.line_kmh === undefined ? one.unknown && "not known" : kmh(one.line_kmh), "line speed not stated")],
  ];
  return parts.map(([name, values]) => element("div", {class: name === "Rule books" ? "wide" : ""}, element("dt", {}, name),
    ...values.map((value) => element("dd", {}, value))));
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
function worstCell({worst, basis}) {
  if (!worst) return ["–"];
  return [
    element("span", {class: "block"}, criterionName(worst.name, worst.base_m)),
    bar(worst.ratio ?? Infinity, worst.passed),
    element("span", {class: `nowrap ${worst.passed ? "" : "over"}`}, timesLimit(worst.ratio)),
    // Two answers say themselves on whose authority they stand.
    worst.verified || basis ? null : element("span", {class: "small block"}, "limit not verified"),
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
