// The front table: rows that are there already are sorted, filtered and saved as they are shown.

/** @param {FlatRow} row */
const decisionOrder = (row) => Object.keys(facts.signs).indexOf(row.decision);
/** @type {(a: string | undefined, b: string | undefined) => number} */
const byText = (a = "", b = "") => a.localeCompare(b, document.documentElement.lang || "en", {numeric: true});
/** @type {(a: number | undefined, b: number | undefined) => number} */
const byNumber = (a = Infinity, b = Infinity) => (a === b ? 0 : a < b ? -1 : 1);

/** @type {Record<string, {falling?: boolean, compare: (a: FlatRow, b: FlatRow) => number}>} */
const ORDERS = {
  decision: {compare: (a, b) => decisionOrder(a) - decisionOrder(b) || byNumber(-shareOf(a), -shareOf(b))},
  geometry: {compare: (a, b) => byNumber(answerOrder(a.geometry), answerOrder(b.geometry))},
  force: {compare: (a, b) => byNumber(answerOrder(a.force), answerOrder(b.force))},
  weld: {compare: (a, b) => byText(a.weld, b.weld)},
  worst: {falling: true, compare: (a, b) => byNumber(shareOf(a), shareOf(b))},
  peak: {falling: true, compare: (a, b) => byNumber(a.peak_force_n ?? -1, b.peak_force_n ?? -1)},
  permitted: {compare: (a, b) => byNumber(a.forces_within_limits_up_to_kmh, b.forces_within_limits_up_to_kmh)},
  advice: {compare: (a, b) => byText(a.what_to_do, b.what_to_do)},
  line: {compare: (a, b) => byText(a.line, b.line) || byNumber(a.chainage_m, b.chainage_m)},
  rail: {compare: (a, b) => byText(a.rail, b.rail) || byNumber(a.chainage_m, b.chainage_m)},
  chainage: {compare: (a, b) => byNumber(a.chainage_m, b.chainage_m)},
  date: {compare: (a, b) => byText(dayOf(a.measured_on), dayOf(b.measured_on))},
  newest: {compare: () => 0},
};

/** @param {FlatRow} row */
function shareOf(row) {
  if (row.worst_criterion === undefined) return -1;
  return row.times_limit ?? Infinity;
}
/** @param {string | undefined} answer */
const answerOrder = (answer) => (answer === undefined ? 99 : [...Object.keys(facts.signs), "not assessed"].indexOf(answer));

/**
 * The day of a date as files state it, as YYYY-MM-DD; other words stay as they are.
 * @param {string | undefined} text
 */
function dayOf(text) {
  if (text === undefined) return undefined;
  const found = /^(\d{1,2})\.(\d{1,2})\.(\d{4})/.exec(text.trim());
  return found ? `${found[3]}-${found[2].padStart(2, "0")}-${found[1].padStart(2, "0")}` : text.trim();
}

const CSV_COLUMNS = ["weld", "line", "rail", "chainage_m", "measured_on", "decision", "geometry", "force", "vehicle",
  "worst_criterion", "times_limit", "peak_force_n", "forces_within_limits_up_to_kmh", "computed_up_to_kmh", "what_to_do"];

/**
 * A value as a cell that no spreadsheet takes for a formula.
 * @param {string | number | undefined} value
 */
function csvCell(value) {
  if (value === undefined) return "";
  const text = typeof value === "string" && /^[=+\-@\t\r]/.test(value) ? `'${value}` : String(value);
  return /[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

class FrontTable {
  /** @param {HTMLElement} front */
  constructor(front) {
    /** @type {Map<number, {line: HTMLElement, row: FlatRow, text: string}>} */
    this.rows = new Map();
    this.body = /** @type {HTMLElement} */ (front.querySelector(".welds tbody"));
    this.table = /** @type {HTMLElement} */ (front.querySelector(".welds"));
    this.chips = /** @type {HTMLElement} */ (front.querySelector(".chips"));
    this.count = /** @type {HTMLElement} */ (front.querySelector(".count"));
    this.decision = "";
    this.order = facts.live ? "newest" : "decision";
    this.falling = false;
    for (const line of this.body.querySelectorAll("tr")) this.take(/** @type {HTMLElement} */ (line));
    this.heads = [...front.querySelectorAll(".welds thead th")].map((head) => this.headOf(/** @type {HTMLElement} */ (head)));
    this.controls();
    this.show();
  }

  /** @param {HTMLElement} head */
  headOf(head) {
    const button = element("button", {type: "button"}, head.textContent ?? "");
    button.addEventListener("click", () => this.sortBy(head.dataset.column ?? ""));
    head.replaceChildren(button);
    return head;
  }

  controls() {
    const orders = element("optgroup", {});
    const names = {line: "order_line", rail: "order_rail", chainage: "order_chainage", date: "order_date", newest: "order_newest"};
    const select = /** @type {HTMLSelectElement} */ (byId("order"));
    orders.append(...Object.keys(ORDERS).map((id) =>
      element("option", {value: id}, id in names ? word(`script.${names[/** @type {keyof typeof names} */ (id)]}`) : word(`column.${id}`))));
    select.replaceChildren(...orders.children);
    select.addEventListener("change", () => this.sortBy(select.value));
    byId("reverse").addEventListener("click", () => this.sortBy(this.order));
    for (const id of ["search", "line", "rail", "from-km", "to-km", "from-date", "to-date"]) {
      byId(id).addEventListener("input", () => this.show());
    }
    byId("search").closest("form")?.addEventListener("submit", (event) => event.preventDefault());
    byId("csv").addEventListener("click", (event) => {
      event.preventDefault();
      this.save();
    });
  }

  /** @param {HTMLElement} line */
  take(line) {
    /** @type {FlatRow} */
    const row = JSON.parse(line.dataset.row ?? "{}");
    this.rows.set(Number(line.dataset.n), {line, row, text: (line.textContent ?? "").toLowerCase()});
    line.addEventListener("click", (event) => {
      if (event.target instanceof Element && !event.target.closest("a") && !String(window.getSelection())) location.hash = `weld-${line.dataset.n}`;
    });
  }

  /** @param {LiveRow[]} rows */
  add(rows) {
    for (const {n, html, supersedes} of rows) {
      this.drop(n);
      const line = fragment("tbody", html).firstElementChild;
      if (line instanceof HTMLElement) this.take(line);
      for (const older of supersedes ?? []) this.drop(older);
    }
    for (const n of [...this.rows.keys()].slice(0, Math.max(0, this.rows.size - (facts.newest ?? Infinity)))) this.drop(n);
    this.table.classList.toggle("answered", [...this.rows.values()].some(({row}) => row.geometry !== undefined));
    this.show();
  }

  /** @param {number} n */
  drop(n) {
    this.rows.get(n)?.line.remove();
    this.rows.delete(n);
  }

  /** @param {string} order */
  sortBy(order) {
    this.falling = order === this.order ? !this.falling : Boolean(ORDERS[order].falling);
    this.order = order;
    this.show();
  }

  /** @param {string} id */
  given(id) {
    return /** @type {HTMLInputElement | HTMLSelectElement} */ (byId(id)).value;
  }

  /** The numbers of the welds as they are shown now. */
  shown() {
    const words = this.given("search").toLowerCase().split(/\s+/).filter(Boolean);
    const [line, rail, fromDay, toDay] = ["line", "rail", "from-date", "to-date"].map((id) => this.given(id));
    const [from, to] = ["from-km", "to-km"].map((id) => (this.given(id) === "" ? null : 1000 * Number(this.given(id))));
    /** @type {(row: FlatRow) => boolean} */
    const isIn = (row) => (!this.decision || row.decision === this.decision)
      && (!line || (row.line ?? word("script.not_stated")) === line) && (!rail || (row.rail ?? word("script.not_stated")) === rail)
      && (from === null || (row.chainage_m ?? -Infinity) >= from) && (to === null || (row.chainage_m ?? Infinity) <= to)
      && (!fromDay || (dayOf(row.measured_on) ?? "") >= fromDay)
      && (!toDay || (row.measured_on !== undefined && (dayOf(row.measured_on) ?? "").slice(0, 10) <= toDay));
    const sign = this.falling ? -1 : 1;
    const {compare} = ORDERS[this.order];
    const last = this.order === "newest" ? -1 : 1;
    return [...this.rows.entries()]
      .filter(([, {row, text}]) => isIn(row) && words.every((one) => text.includes(one)))
      .sort(([n, a], [m, b]) => sign * (compare(a.row, b.row) || last * (n - m))).map(([n]) => n);
  }

  show() {
    const shown = this.shown();
    const {activeElement} = document;
    this.place(shown.flatMap((n) => this.rows.get(n)?.line ?? []));
    if (activeElement instanceof HTMLElement && this.body.contains(activeElement)) activeElement.focus({preventScroll: true});
    for (const head of this.heads) {
      if (head.dataset.column === this.order) head.setAttribute("aria-sort", this.falling ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    }
    /** @type {HTMLSelectElement} */ (byId("order")).value = this.order;
    this.count.textContent = shown.length === this.rows.size ? "" : word("script.shown", {shown: shown.length, all: this.rows.size});
    this.showChips();
    this.showChoices("line");
    this.showChoices("rail");
  }

  /**
   * Lines that are in their place stay untouched: laid out anew, two thousand take seconds.
   * @param {HTMLElement[]} lines
   */
  place(lines) {
    /** @type {Set<Element>} */
    const wanted = new Set(lines);
    for (const line of [...this.body.children]) if (!wanted.has(line)) line.remove();
    let there = this.body.firstElementChild;
    for (const line of lines) {
      if (line === there) there = there.nextElementSibling;
      else this.body.insertBefore(line, there);
    }
  }

  showChips() {
    /** @type {Map<string, number>} */
    const counts = new Map([["", this.rows.size]]);
    for (const {row} of this.rows.values()) counts.set(row.decision, (counts.get(row.decision) ?? 0) + 1);
    const order = ["", ...Object.keys(facts.signs)];
    const known = [...counts.keys()].sort((a, b) => order.indexOf(a) - order.indexOf(b));
    const focused = document.activeElement instanceof HTMLElement && this.chips.contains(document.activeElement) ? document.activeElement.dataset.decision : undefined;
    const chips = known.map((decision) => {
      const pressed = this.decision === decision;
      const label = decision ? [element("span", {class: "sign", "aria-hidden": "true"}, facts.signs[decision] ?? "?"), word(`decision.${decision}`)] : [word("script.all")];
      const chip = element("button", {type: "button", class: "chip", "aria-pressed": String(pressed), "data-decision": decision},
        element("span", {class: "number"}, String(counts.get(decision))), element("span", {class: `badge ${decision || "all"}`}, ...label));
      chip.addEventListener("click", () => {
        this.decision = pressed ? "" : decision;
        this.show();
      });
      return chip;
    });
    this.chips.replaceChildren(...chips);
    if (focused !== undefined) chips.find((chip) => chip.dataset.decision === focused)?.focus();
  }

  /** @param {"line" | "rail"} id */
  showChoices(id) {
    const select = /** @type {HTMLSelectElement} */ (byId(id));
    const values = [...new Set([...this.rows.values()].map(({row}) => row[id] ?? word("script.not_stated")))].sort(byText);
    if (select.options.length === values.length + 1 && values.every((value, i) => select.options[i + 1].value === value)) return;
    const chosen = select.value;
    select.replaceChildren(element("option", {value: ""}, word("script.any")), ...values.map((value) => element("option", {value}, value)));
    select.value = values.includes(chosen) ? chosen : "";
  }

  /** The welds that are shown, in their order, as CSV. */
  csv() {
    const lines = this.shown().map((n) => {
      /** @type {Record<string, string | number | undefined>} */
      const row = {...this.rows.get(n)?.row};
      return CSV_COLUMNS.map((name) => csvCell(row[name])).join(",");
    });
    return [CSV_COLUMNS.join(","), ...lines, ""].join("\r\n");
  }

  save() {
    const address = URL.createObjectURL(new Blob(["\ufeff", this.csv()], {type: "text/csv"}));
    const link = element("a", {href: address, download: "welds.csv"});
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
  }

  /** @param {number} n */
  focusOn(n) {
    this.rows.get(n)?.line.querySelector("a")?.focus({preventScroll: true});
  }
}
