// What things are called and how numbers are written. Text from a recording only ever becomes a text node: see element().

const DECISIONS = {
  reject: {label: "Reject", sign: "✕", order: 0},
  grind: {label: "Grind", sign: "◐", order: 1},
  undecided: {label: "Undecided", sign: "?", order: 2},
  unusable: {label: "Unusable", sign: "!", order: 3},
  accept: {label: "Accept", sign: "✓", order: 4},
};

const CRITERIA = {
  peak_force: "Peak force",
  p2_force: "Force below 120 Hz (P2)",
  force_20hz: "Force below 20 Hz",
  dynamic_factor: "Dynamic factor",
  hertz_pressure_index: "Contact pressure index",
  unloading: "Wheel unloading",
  contact_loss: "Contact loss",
  quality_index: "Quality index (gradient)",
  straightedge: "1 m straightedge",
};

const GEOMETRY = ["quality_index", "straightedge"];

// Shares are read as per cent.
const SHARES = ["unloading"];

const UNITS = {"%": [100, "%"], N: [1e-3, "kN"], s: [1e3, "ms"], m: [1e3, "mm"], "1": [1, ""]};

const criterionName = (name) => CRITERIA[name] ?? name;
const decisionOf = (name) => DECISIONS[name] ?? {label: name, sign: "?", order: 9};

function number(value, digits = 3) {
  const rounded = Number(value.toPrecision(digits));
  return String(Math.abs(rounded) >= 100 ? Math.round(value) : rounded).replace("-", "−");
}

function scaled(unit) {
  return UNITS[unit] ?? [1, unit];
}

function quantity(value, unit) {
  const [factor, shown] = scaled(unit);
  return number(value * factor) + (shown && ` ${shown}`);
}

// The unit in which a criterion's value is written.
const unitOf = ({name, unit}) => (SHARES.includes(name) ? "%" : unit);

let ids = 0;
const freshId = (stem) => `${stem}-${(ids += 1)}`;

const kilonewtons = (value) => quantity(value, "N");
// Of metal, no stone takes off less.
const hundredths = (metres) => `${(metres * 1e3).toFixed(2)} mm`;
const centimetres = (value) => String(Math.round(value * 100)).replace("-", "−");
const kmh = (value) => `${number(value, 4)} km/h`;

// "12 %" of 0.123; tenths only where a whole number would say nothing.
function percent(share) {
  const size = Math.abs(share * 100);
  return `${size > 0 && size < 1 ? size.toFixed(1) : Math.round(size)} %`;
}

const timesLimit = (ratio) => (ratio === undefined || ratio === null ? "limit is 0" : `${ratio.toFixed(2)} × limit`);

// An element with attributes and children; strings become text, so that nothing is ever taken for markup.
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== undefined && value !== null && value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false && child !== ""));
  return made;
}

function badge(decision) {
  const {label, sign} = decisionOf(decision);
  return element(
    "span", {class: `badge ${decision in DECISIONS ? decision : "undecided"}`},
    element("span", {class: "sign", "aria-hidden": "true"}, sign), label,
  );
}

const unverifiedTag = () => element("strong", {class: "unverified"}, "UNVERIFIED");
