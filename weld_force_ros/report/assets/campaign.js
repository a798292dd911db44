// A campaign's summary: decisions, forces, the network by groups and along its chainage, and the worst welds.

/** @type {CampaignFacts} */
const found = embeddedJson("facts");
/** @type {CampaignRow[]} */
const worstRows = embeddedJson("rows");
const content = byId("content");
/** @type {Record<string, string>} */
const DECISION_COLOURS = {accept: COLOURS.green, grind: "#8a5300", reject: "#a81e22", undecided: "#53429c"};
const inOrder = Object.keys(DECISION_COLOURS).sort((a, b) => decisionOf(b).order - decisionOf(a).order);
/** @param {number} value */
const whole = (value) => value.toLocaleString("en-GB").replaceAll(",", " ");

/**
 * @param {string} title
 * @param {...(Child | Child[])} children
 */
const card = (title, ...children) => element("section", {class: "card", "aria-label": title}, element("h2", {}, title), ...children);

function chips() {
  const judged = found.decisions.reduce((sum, row) => sum + row.n, 0);
  /** @type {(sign: HTMLElement, count: number, share: string) => HTMLElement} */
  const chip = (sign, count, share) => element("div", {class: "chip"}, sign, element("span", {class: "number"}, whole(count)),
    element("span", {class: "small"}, share));
  const decided = [...found.decisions].sort((a, b) => decisionOf(a.decision).order - decisionOf(b.decision).order);
  return element("div", {class: "chips", role: "group", "aria-label": "Welds by decision"},
    decided.map((row) => chip(badge(row.decision), row.n, percent(row.n / judged))),
    found.rejected > 0 && chip(badge("unusable"), found.rejected, "no verdict"));
}

function banner() {
  if (!found.unverified) return;
  const holder = byId("banner");
  holder.hidden = false;
  holder.append(element("p", {}, unverifiedTag(), ` ${found.unverified} of ${found.limits} limits were not checked against their sources.`));
}

// --- groups -----------------------------------------------------------------------------------------------------------

/** @param {CampaignGroup} group */
function shareBar({n: count, decisions, name}) {
  const words = inOrder.filter((d) => decisions[d]).map((d) => `${decisionOf(d).label} ${percent(decisions[d] / count)}`).join(", ");
  return element("div", {class: "share", role: "img", "aria-label": `${name}: ${words}`, title: words},
    inOrder.filter((d) => decisions[d]).map((d) => {
      const part = element("span", {class: d});
      part.style.flexGrow = String(decisions[d]);
      return part;
    }));
}

/** @param {CampaignFacts["groups"][number]} group */
function groupTable({by, rows}) {
  /** @param {string} text */
  const right = (text) => element("td", {class: "right"}, text);
  /** @param {CampaignGroup} group */
  const line = (group) => element("tr", {},
    element("th", {scope: "row"}, group.name), right(whole(group.n)), element("td", {}, shareBar(group)),
    inOrder.map((d) => right(group.decisions[d] ? percent(group.decisions[d] / group.n) : "–")),
    [group.median_n, group.high_n, group.most_n].map((force) => right(kilonewtons(force))));
  const headings = ["Welds", "Decisions", ...inOrder.map((d) => decisionOf(d).label), "Median peak", "95 % below", "Highest"];
  return card(`By ${by}`, element("div", {class: "scroll"}, element("table", {},
    element("thead", {}, element("tr", {}, element("th", {scope: "col"}, by[0].toUpperCase() + by.slice(1)),
      headings.map((name) => element("th", {scope: "col", class: name === "Decisions" ? undefined : "right"}, name)))),
    element("tbody", {}, rows.map(line)))));
}

// --- charts -----------------------------------------------------------------------------------------------------------

/** @param {HTMLElement} holder */
function drawForces(holder) {
  const traces = inOrder.map((decision) => {
    const rows = found.forces.filter((row) => row.decision === decision);
    return {type: "bar", name: decisionOf(decision).label, x: rows.map((row) => (row.from_n + found.bin_n / 2) / 1e3),
      y: rows.map((row) => row.n), width: found.bin_n / 1e3, marker: {color: DECISION_COLOURS[decision]},
      hovertemplate: `%{x:.0f} kN: %{y}<extra>${decisionOf(decision).label}</extra>`};
  });
  return draw(holder, traces, layout({title: "peak force, kN"}, {title: "welds"}, {barmode: "stack"}), false);
}

/**
 * @param {HTMLElement} holder
 * @param {CampaignLine} line
 */
function drawAlong(holder, line) {
  const at = line.peaks_kn[0].map((_, i) => (line.first_m + (i + 0.5) * line.stretch_m) / 1e3);
  const trace = {type: "heatmap", x: at, y: line.speeds_kmh, z: line.peaks_kn, colorscale: "Viridis", hoverongaps: false,
    colorbar: {title: {text: "peak, kN", side: "right"}, thickness: 12, outlinewidth: 0},
    hovertemplate: "km %{x:.2f}, %{y:g} km/h: %{z:.0f} kN<extra></extra>"};
  return draw(holder, [trace], layout({title: "chainage, km"}, {title: "speed, km/h"}, {showlegend: false, margin: {l: 52, r: 8, t: 10, b: 42}}), false);
}

// --- worst ------------------------------------------------------------------------------------------------------------

function worstTable() {
  /** @type {[heading: string, cell: (row: CampaignRow) => Child, side?: string][]} */
  const columns = [["Weld", (r) => r.weld_id], ["Decision", (r) => badge(r.decision)],
    ["Line", (r) => r.line], ["Section, vehicle", (r) => `${r.section}, ${r.vehicle}`],
    ["km", (r) => (r.chainage_m === undefined ? "" : (r.chainage_m / 1e3).toFixed(3)), "right"], ["Rail", (r) => r.rail ?? ""],
    ["Worst criterion", (r) => `${criterionName(r.worst_criterion)}: ${timesLimit(r.worst_ratio)}`],
    ["Peak", (r) => `${kilonewtons(r.peak_force_n)} at ${kmh(r.worst_speed_kmh)}`],
    ["Forces within limits up to", (r) => (r.permitted_speed_kmh === undefined ? "no speed" : kmh(r.permitted_speed_kmh)), "right"]];
  return card(`The worst ${worstRows.length}`, element("div", {class: "scroll"}, element("table", {},
    element("thead", {}, element("tr", {}, columns.map(([name, , side]) => element("th", {scope: "col", class: side}, name)))),
    element("tbody", {}, worstRows.map((row) => element("tr", {}, columns.map(([, cell, side], i) =>
      element(i ? "td" : "th", {class: side, scope: i ? undefined : "row"}, cell(row)))))))));
}

function rejectionTable() {
  if (!found.rejections.length) return null;
  return card("Without a verdict", element("div", {class: "scroll"}, element("table", {},
    element("thead", {}, element("tr", {}, ["Reason", "How many", "For example"].map((name) => element("th", {scope: "col"}, name)))),
    element("tbody", {}, found.rejections.map((row) => element("tr", {}, element("th", {scope: "row"}, row.reason),
      element("td", {class: "right"}, whole(row.n)), element("td", {}, row.example ?? "")))))));
}

const forces = element("div", {class: "chart"});
const lines = found.lines.map((line) => ({line, holder: element("div", {class: "chart"})}));
banner();
content.append(...[
  chips(),
  card("Peak forces", forces),
  ...lines.map(({line, holder}) => card(`Along ${line.line || "the line"}: maximum contact force by chainage and speed`, holder)),
  worstTable(),
  ...found.groups.map(groupTable),
  rejectionTable(),
].filter(isShown));
drawForces(forces);
for (const {line, holder} of lines) drawAlong(holder, line);
