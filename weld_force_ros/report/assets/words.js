// What things are called and how numbers are written. Text from a recording only ever becomes a text node: see element().

/** @type {Record<string, {label: string, sign: string, order: number}>} */
const DECISIONS = {
  reject: {label: "Reject", sign: "✕", order: 0},
  grind: {label: "Grind", sign: "◐", order: 1},
  undecided: {label: "Undecided", sign: "?", order: 2},
  unusable: {label: "Unreadable", sign: "!", order: 3},
  accept: {label: "Accept", sign: "✓", order: 4},
};

/** @type {Record<string, string>} */
const CRITERIA = {
  peak_force: "Peak force",
  p2_force: "P2 force (120 Hz low-pass)",
  force_20hz: "Qmax, 20 Hz low-pass (EN 14363)",
  dynamic_factor: "Dynamic load factor",
  hertz_pressure_index: "Contact pressure ratio",
  unloading: "Wheel unloading ratio ΔQ/Q0",
  contact_loss: "Contact loss",
  quality_index: "Quality index (gradient)",
  straightedge: "Deviation under 1 m straightedge",
  straightedge_peak: "Peak under a straightedge",
  straightedge_dip: "Dip under a straightedge",
  straightedge_abs: "Peak or dip under a straightedge",
  inclination: "Inclination of the running surface",
  step: "Step in the running surface",
};

const GEOMETRY = ["quality_index", "straightedge", "straightedge_peak", "straightedge_dip", "straightedge_abs", "inclination", "step"];

/** @type {Record<string, string>} */
const ANSWERS = {reject: "Replace"};

/** @type {Record<string, string>} */
const AUTHORITIES = {
  standard: "read in the standard", quotation: "read in a publication that quotes the standard", vendor: "read in the maker's text",
  judgement: "engineering judgement, no standard",
};

// Shares are read as per cent.
const SHARES = ["unloading"];

/** @type {Record<string, [factor: number, shown: string]>} */
const UNITS = {"%": [100, "%"], N: [1e-3, "kN"], s: [1e3, "ms"], m: [1e3, "mm"], rad: [1e3, "mrad"], "1": [1, ""]};

/**
 * @param {string} name
 * @param {number} [base] length in metres of the straightedge or chord that it is measured on
 */
function criterionName(name, base) {
  const label = Object.hasOwn(CRITERIA, name) ? CRITERIA[name] : name;
  if (base === undefined) return label;
  return name.startsWith("straightedge_") ? `${label} of ${number(base)} m` : `${label}, on a base of ${number(base)} m`;
}
/**
 * Return a criterion's name as it stands inside a sentence: its first word in lower case unless that is a symbol.
 * @param {string} name
 * @param {number} [base] see `criterionName`
 */
function criterionInSentence(name, base) {
  if (!Object.hasOwn(CRITERIA, name)) return name;
  const label = criterionName(name, base);
  return /^(P2|Qmax)\b/.test(label) ? label : label[0].toLowerCase() + label.slice(1);
}
/** @param {string} name */
const decisionOf = (name) => DECISIONS[name] ?? {label: name, sign: "?", order: 9};

/** @param {number} value */
function number(value, digits = 3) {
  const rounded = Number(value.toPrecision(digits));
  return String(Math.abs(rounded) >= 100 ? Math.round(value) : rounded).replace("-", "−");
}

/**
 * @param {number} value
 * @param {string} unit
 */
function quantity(value, unit) {
  const [factor, shown] = UNITS[unit] ?? [1, unit];
  return number(value * factor) + (shown && ` ${shown}`);
}

/**
 * The unit in which a criterion's value is written.
 * @param {{name: string, unit: string}} criterion
 */
const unitOf = ({name, unit}) => (SHARES.includes(name) ? "%" : unit);

/**
 * @template T
 * @param {T[]} values of which there is one at least
 */
const lastOf = (values) => values[values.length - 1];

/**
 * An element that is in the page from the beginning.
 * @param {string} id
 */
function byId(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`this page has no element #${id}`);
  return found;
}

let ids = 0;
/** @param {string} stem */
const freshId = (stem) => `${stem}-${(ids += 1)}`;

/** @param {number} value */
const kilonewtons = (value) => quantity(value, "N");
/**
 * Write a depth of cut; no stone removes less than a hundredth.
 * @param {number} metres
 */
const hundredths = (metres) => `${(metres * 1e3).toFixed(2)} mm`;
/** @param {number} value */
const centimetres = (value) => String(Math.round(value * 100)).replace("-", "−");
/** @param {number} value */
const kmh = (value) => `${number(value, 4)} km/h`;

/**
 * "12 %" of 0.123; tenths only where a whole number would say nothing.
 * @param {number} share
 */
function percent(share) {
  const size = Math.abs(share * 100);
  return `${size > 0 && size < 1 ? size.toFixed(1) : Math.round(size)} %`;
}

/** @param {number | null | undefined} ratio */
const timesLimit = (ratio) => (ratio === undefined || ratio === null ? "limit is 0" : `${ratio.toFixed(2)} × limit`);

/**
 * @template T
 * @param {T} child
 * @returns {child is Exclude<T, null | undefined | false | "">}
 */
const isShown = (child) => child !== null && child !== undefined && child !== false && child !== "";

/**
 * An element with attributes and children; strings become text, so that nothing is ever taken for markup.
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {Record<string, string | number | boolean | null | undefined>} attributes
 * @param {...(Child | Child[])} children
 */
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== undefined && value !== null && value !== false) made.setAttribute(name, value === true ? "" : String(value));
  }
  made.append(...children.flat().filter(isShown));
  return made;
}

/**
 * @param {string} decision
 * @param {string} [words] in place of the decision's own
 */
function badge(decision, words) {
  const {label, sign} = decisionOf(decision);
  return element(
    "span", {class: `badge ${decision in DECISIONS ? decision : "undecided"}`},
    element("span", {class: "sign", "aria-hidden": "true"}, sign), words ?? label,
  );
}

/**
 * An answer to one of the two questions: what is to be done, or that nobody asked.
 * @param {string} decision
 */
function answerBadge(decision) {
  if (decision !== "not assessed") return badge(decision, ANSWERS[decision]);
  return element("span", {class: "badge none"}, element("span", {class: "sign", "aria-hidden": "true"}, "–"), "Not assessed");
}

/**
 * Text in which commands stand between backticks, as nodes.
 * @param {string} text
 */
const withCode = (text) => text.split("`").map((part, i) => (i % 2 ? element("code", {}, part) : part));

/**
 * A probability; what is neither none nor all is not shown as such.
 * @param {number} share
 */
function probability(share) {
  if (share > 0 && share < 0.01) return "below 1 %";
  return share > 0.99 && share < 1 ? "above 99 %" : percent(share);
}

/**
 * A computed speed in a sentence: rounded down to 5 km/h.
 * @param {number} value
 */
const proseKmh = (value) => kmh(Math.floor(value / 5) * 5 || value);

/**
 * On whose authority a limit stands.
 * @param {{verified: boolean, source_kind?: string}} limit
 */
function authority({verified, source_kind: kind}) {
  const words = kind === undefined ? undefined : AUTHORITIES[kind];
  if (verified) return words ? `verified, ${words}` : "verified";
  return words && kind === "judgement" ? words : "not checked against its source";
}

const unverifiedTag = () => element("strong", {class: "unverified"}, "UNVERIFIED");
