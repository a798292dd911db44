// The section of one weld: what to do and why first, then what it rests on.

/** @type {Record<string, string>} */
const ACTIONS = {
  accept: "Leave this weld as it is.",
  grind: "Grind this weld.",
  reject: "Replace this weld (re-weld).",
};

/**
 * @param {string} heading
 * @param {...(Child | Child[])} children
 */
const card = (heading, ...children) => element("section", {class: "card"}, heading && element("h3", {}, heading), ...children);
/** @param {string} words */
const chart = (words, size = "") => element("div", {class: `chart ${size}`, role: "img", "aria-label": words});

/**
 * Builds the section and returns it with a function that draws its charts once it stands in the page.
 * @param {Row} row
 * @param {Detail} content
 * @param {boolean} still
 */
function weldSection(row, content, still) {
  /** @type {(() => unknown)[]} */
  const tasks = [];
  /** @param {() => unknown} task */
  const later = (task) => tasks.push(task);
  const body = content.rejection ? rejectionParts(content) : verdictParts(content, still, later);
  const heading = element("h2", {tabindex: "-1"}, row.weld);
  const section = element(
    "article", {class: "weld", "data-number": row.n},
    element("div", {}, heading, element("p", {class: "meta"}, metaOf(row, content))),
    ...body.filter(Boolean),
  );
  return {section, heading, async draw() { for (const task of tasks) await task(); }};
}

/**
 * @param {Row} row
 * @param {Detail} content
 */
function metaOf(row, content) {
  const parts = [row.rail, row.chainage_m !== undefined && `km ${(row.chainage_m / 1000).toFixed(3)}`];
  if (!content.rejection && content.map) {
    const {map, verdict} = content;
    parts.push(map.line_speed_kmh === undefined ? `judged up to ${kmh(verdict.judged_speed_kmh)} (line speed not stated)` : `line speed ${kmh(map.line_speed_kmh)}`);
    if (content.basis && content.profile) parts.push(content.basis.measured_on === undefined ? "date of measurement not stated" : `measured on ${content.basis.measured_on}`);
    parts.push(map.weld_position_m === undefined ? "position between the sleepers unknown" : `weld ${centimetres(map.weld_position_m)} cm after the sleeper`);
    parts.push(map.running && `trains ${map.running}${map.running.includes("both") && verdict.worst_running ? `, worst ${verdict.worst_running === "against" ? "against" : "towards"} rising x` : ""}`);
  }
  return parts.filter(Boolean).join(" · ");
}

/** @param {RejectionDetail} content */
function rejectionParts({rejection, provenance}) {
  return [
    element("section", {class: "card headline"}, badge("unusable"),
      element("p", {class: "do"}, sentence(rejection.remedy)), element("p", {}, `Because: ${rejection.reason}`)),
    rejection.raw_text && card("What came in", element("pre", {class: "raw", tabindex: "0", "aria-label": "the text that came in"}, rejection.raw_text), rejection.truncated && element("p", {class: "hint"}, "Cut short.")),
    provenancePart(provenance, true),
  ];
}

/**
 * @param {WeldDetail} content
 * @param {boolean} still
 * @param {(task: () => unknown) => void} later
 */
function verdictParts(content, still, later) {
  return [
    ...answersPart(content),
    headline(content),
    facts(content),
    element("div", {class: "grid"},
      content.map && mapPart(content.map, content.verdict, still, later), content.curves && curvePart(content.curves, content, still, later),
      content.profile && geometryPart(content.profile, content.grinding, still, later), content.history && historyPart(content.history, content, still, later)),
    positionsPart(content),
    supportPart(content),
    criteriaPart(content),
    content.grinding && grindingPart(content.grinding),
    provenancePart(content.provenance, still),
  ];
}

/** @param {WeldDetail} content */
function supportPart({support}) {
  return support?.length ? card("Sleepers beside the weld", element("ul", {}, ...support.map((words) => element("li", {}, sentence(words))))) : null;
}

/** @param {string} text */
const sentence = (text) => (text ? text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".") : "");

// --- two answers ------------------------------------------------------------------------------------------------------

/** @param {WeldDetail} content */
function answersPart({verdict: {decision, geometry, force, measure_next: next}}) {
  if (!geometry || !force) return [];
  // Where the whole is undecided, its headline says what decides.
  const toDecide = decision === "undecided" ? undefined : next;
  return [element("div", {class: "answers"},
    answerPart("Geometry, by standard", geometry, toDecide), answerPart("Force, by model", force, toDecide))];
}

/**
 * @param {string} question
 * @param {Answer} answer
 * @param {string} [next] what would decide it
 */
function answerPart(question, answer, next) {
  const {decision, nearest, doubts, exceeding, to_choose: toChoose} = answer;
  /** @type {(name: string, ...children: Child[]) => HTMLElement} */
  const line = (name, ...children) => element("div", {}, element("dt", {}, name), element("dd", {}, ...children));
  const part = element("section", {class: `card question ${decision === "not assessed" ? "none" : decision}`, "aria-label": question},
    element("div", {class: "choice"}, element("h3", {}, question), answerBadge(decision)));
  if (decision === "not assessed") {
    part.append(element("p", {}, "No limit of this kind was chosen. To have it assessed, ", ...withCode(`${toChoose ?? "choose a rule book"}.`)));
    return part;
  }
  part.append(element("dl", {},
    line("Rule book", answer.rule_books?.join(", ") || "none"),
    exceeding !== undefined && line("Probability of exceeding a limit", element("strong", {}, probability(exceeding))),
    nearest && line(nearest.passed ? "Nearest to its limit" : "Farthest beyond its limit", `${criterionName(nearest.name, nearest.base_m)}: `,
      element("strong", {class: nearest.passed ? "" : "over"}, quantity(nearest.value, unitOf(nearest))), ` of ${quantity(nearest.limit, unitOf(nearest))}`),
    line("Margin", marginWords(answer)),
    next !== undefined && decision === "undecided" && line("To decide", ...withCode(sentence(next))),
    nearest && line("That limit is", !nearest.verified && unverifiedTag(), !nearest.verified && " ", authority(nearest), element("span", {class: "small block source"}, nearest.source))));
  if (doubts.length) part.append(element("ul", {}, ...doubts.map((words) => element("li", {}, sentence(words)))));
  return part;
}

/** @param {Answer} answer */
function marginWords({margin, nearest}) {
  if (margin === undefined) return nearest?.passed ? "within a limit of 0" : "over a limit of 0";
  return margin < 0 ? element("span", {class: "over"}, `${percent(-margin)} beyond the limit`) : `${percent(margin)} of the limit is left`;
}

// --- what to do and why -----------------------------------------------------------------------------------------------

/** @param {WeldDetail} content */
function headline({verdict, grinding, map}) {
  const until = untilWords(verdict, map);
  const answered = verdict.geometry && verdict.force;
  return element(
    "section", {class: `card headline ${verdict.decision}`, "aria-label": "What to do"},
    badge(verdict.decision),
    answered && element("span", {class: "small risk"}, riskWords(verdict)),
    element("p", {class: "do"}, ...withCode(whatToDo(verdict, grinding))),
    until && element("p", {class: "until"}, until),
    element("p", {}, why(verdict)),
    !answered && verdict.criteria.some((c) => !c.verified) && element("p", {}, unverifiedTag(), " Compared with limits that nobody has checked against their source."),
    element("details", {class: "reason", open: verdict.decision === "undecided"}, element("summary", {}, "Full reasoning"), element("p", {}, ...withCode(sentence(verdict.reason))),
      verdict.advice?.length ? element("ul", {}, ...verdict.advice.map((words) => element("li", {}, sentence(words)))) : null),
  );
}

/** @param {Verdict} verdict */
function riskWords({accepted_risk: risk, geometry, force}) {
  const asked = geometry?.decision === "not assessed" || force?.decision === "not assessed" ? "; accepted only where both questions are answered" : "";
  return risk === undefined ? "" : `Overall, at an accepted risk of ${percent(risk)}${asked}`;
}

/**
 * @param {Verdict} verdict
 * @param {Grinding | undefined} grinding
 */
function whatToDo(verdict, grinding) {
  if (verdict.decision === "undecided" && verdict.geometry) return sentence(verdict.measure || verdict.reason);
  if (verdict.decision === "undecided") return `Further measurement required: ${verdict.measure || verdict.reason}.`;
  const action = ACTIONS[verdict.decision] ?? sentence(verdict.decision);
  if (!grinding || verdict.decision === "accept") return action;
  const removed = hundredths(grinding.most_removed_m);
  if (grinding.reached) {
    return verdict.decision === "grind" ? `Grind this weld: remove at most ${removed}.` : `Replace this weld (re-weld), or grind off at most ${removed}.`;
  }
  return verdict.decision === "grind" ? "No grinding was found that helps: replace this weld (re-weld)." : `${action} Grinding does not help.`;
}

/**
 * @param {Verdict} verdict
 * @param {ForceMap | undefined} map
 */
function untilWords(verdict, map) {
  const {permitted_speed_kmh: permitted, judged_speed_kmh: judged, decision} = verdict;
  if (verdict.advice_step_kmh === undefined && permitted === undefined) return "";
  const top = map?.line_speed_kmh === undefined ? kmh(judged) : `the line's ${kmh(map.line_speed_kmh)}`;
  if (verdict.geometry && permitted !== undefined && permitted < judged) {
    return `Highest computed speed with all forces within limits: ${proseKmh(permitted)} (computed up to ${kmh(judged)}).`;
  }
  if (permitted === undefined) return "No speed is within the limits on force.";
  if (permitted >= judged) return decision === "accept" ? `Every speed up to ${top} is within limits.` : `Forces are within limits at every speed up to ${top}.`;
  return `${decision === "accept" ? "Run" : "Until then, run"} at most ${kmh(permitted)} (judged up to ${kmh(judged)}).`;
}

/** @param {Criterion} c */
const ratioOfCriterion = (c) => c.ratio ?? (c.passed ? 0 : Infinity);

/** @param {{criteria: Criterion[]}} verdict */
function why({criteria}) {
  const deciding = criteria.filter((c) => c.decides !== false);
  const worst = [...deciding].sort((a, b) => ratioOfCriterion(b) - ratioOfCriterion(a))[0];
  if (!worst) return "";
  const failed = deciding.filter((c) => !c.passed && c !== worst).map((c) => criterionInSentence(c.name, c.base_m));
  const {reject_limit: rejectLimit} = worst;
  const reject = rejectLimit !== undefined && worst.value > rejectLimit;
  const limit = reject ? rejectLimit : worst.limit;
  const value = quantity(worst.value, unitOf(worst));
  const at = worst.speed_kmh === undefined ? "" : ` at ${kmh(worst.speed_kmh)}${worst.position_m === undefined ? "" : ` with the weld ${centimetres(worst.position_m)} cm after a sleeper`}`;
  if (worst.passed) return `Nearest to its limit: ${criterionInSentence(worst.name, worst.base_m)}, ${value} of ${quantity(limit, unitOf(worst))}${at}.`;
  const beyond = limit > 0 ? `, ${percent(worst.value / limit - 1)} over its ${reject ? "reject limit" : "limit"} of ${quantity(limit, unitOf(worst))}` : `; its limit is ${quantity(limit, unitOf(worst))}`;
  return `${criterionName(worst.name, worst.base_m)} reaches ${value}${at}${beyond}.${failed.length ? ` Also over the limit: ${failed.join(", ")}.` : ""}`;
}

/** @param {WeldDetail} content */
function facts({verdict, map}) {
  /** @type {(name: string, value: string, more?: string) => HTMLElement} */
  const fact = (name, value, more) => element("div", {}, element("dt", {}, name), element("dd", {}, value, more && element("span", {class: "small block"}, more)));
  const permitted = verdict.permitted_speed_kmh;
  const said = permitted !== undefined || verdict.advice_step_kmh !== undefined;
  const {measures} = map ?? {};
  const riskiest = verdict.criteria.filter((c) => c.decides !== false)
    .flatMap(({name, exceeding}) => (exceeding === undefined ? [] : [{name, exceeding}])).sort((a, b) => b.exceeding - a.exceeding)[0];
  return element(
    "dl", {class: "facts"},
    fact("Peak force", kilonewtons(verdict.peak_force_n), [`${(verdict.peak_force_n / verdict.static_load_n).toFixed(2)} × static`, map?.model_error && `fit error ± ${kilonewtons(map.model_error * (verdict.peak_force_n - verdict.static_load_n))}`].filter(Boolean).join(", ")),
    fact("Worst at", kmh(verdict.worst_speed_kmh), `weld ${centimetres(verdict.worst_position_m)} cm after the sleeper`),
    said && fact("Highest computed speed with all forces within limits", permitted === undefined ? "none" : verdict.geometry ? proseKmh(permitted) : kmh(permitted), `computed up to ${kmh(verdict.judged_speed_kmh)}`),
    !verdict.geometry && riskiest && fact("Probability of exceedance", percent(riskiest.exceeding), `of ${verdict.samples} samples: ${criterionInSentence(riskiest.name)}`),
    measures && fact(measures.kind === "dip" ? "Dipped weld" : "Peaked weld", quantity(measures.kind === "dip" ? measures.dip_m : measures.protrusion_m, "m"), `steepest ${number(measures.gradient_rad * 1e3)} mrad`),
    verdict.curve_class && fact("Force over speed", ...curveWords(verdict)),
  );
}

/**
 * @param {Verdict} verdict
 * @returns {[string, string]}
 */
function curveWords({curve_class: curve, geometry}) {
  if (curve === "hollow") return ["has a local minimum", "slower can be worse"];
  return geometry ? ["no local minimum", "that exceeds fit error and model uncertainty"] : ["rises", "slower is never worse"];
}

// --- charts -----------------------------------------------------------------------------------------------------------

/**
 * @param {ForceMap} map
 * @param {Verdict} verdict
 * @param {boolean} still
 * @param {(task: () => unknown) => void} later
 */
function mapPart(map, verdict, still, later) {
  const holder = chart(`Map of peak force over speed and the weld's position; the worst is ${kilonewtons(verdict.peak_force_n)} at ${kmh(verdict.worst_speed_kmh)}. Arrow keys read other cells.`, "high");
  const readout = element("output", {class: "readout", "aria-live": "polite"});
  if (!still) holder.setAttribute("tabindex", "0");
  later(() => drawMap(holder, readout, map, verdict, still));
  return card("Peak force by speed and position", holder, !still && readout,
    element("p", {class: "hint"}, `${map.hollow.includes("1") ? `Outlined: local minima over speed${verdict.geometry ? " deeper than fit error and model uncertainty" : ""}, where a lower speed reached more. ` : ""}✕: worst. Dashed: sleepers.${still ? "" : " Point, tap, or use the arrow keys."}`));
}

/**
 * @param {Curves} curves
 * @param {WeldDetail} content
 * @param {boolean} still
 * @param {(task: () => unknown) => void} later
 */
function curvePart(curves, content, still, later) {
  const {verdict} = content;
  const worst = [...verdict.criteria].filter((c) => c.decides !== false && curves.series.some((s) => s.name === c.name))
    .sort((a, b) => ratioOfCriterion(b) - ratioOfCriterion(a))[0];
  // The force itself is what people know; another criterion only where that one alone is beyond its limit.
  const first = worst && !worst.passed && verdict.criteria.some((c) => c.name === "peak_force" && c.passed) ? worst.name : "peak_force";
  const holder = chart("Curve over speed at the worst position, with its limits.");
  const id = freshId("criterion");
  const choice = element("select", {id}, ...curves.series.map(({name}) => element("option", {value: name, selected: name === first}, criterionName(name))));
  /** @type {(speed: number) => void} */
  let mark = () => {};
  const redraw = async () => { mark = await drawCurve(holder, curves, content, choice.value, still); };
  choice.addEventListener("change", redraw);
  later(redraw);
  return card(
    "", element("div", {class: "choice"}, element("h3", {}, "Force against speed"),
      !still && element("div", {class: "field"}, element("label", {for: id}, "Criterion"), choice)),
    holder, !still && restrictionPart(curves, verdict, (speed) => mark(speed)), still && restrictionTable(verdict, curves),
  );
}

// --- what would a restriction do? -------------------------------------------------------------------------------------

/**
 * @param {Curves} curves
 * @param {Verdict} verdict
 * @param {(speed: number) => void} onSpeed
 */
function restrictionPart(curves, verdict, onSpeed) {
  const judged = curves.speeds_kmh.filter((speed) => speed <= verdict.judged_speed_kmh * (1 + 1e-9));
  if (judged.length < 2) return null;
  const start = verdict.permitted_speed_kmh ?? judged[Math.floor(judged.length / 2)];
  const id = freshId("restrict");
  const slider = element("input", {id, type: "range", min: "0", max: String(judged.length - 1), step: "1", value: String(nearest(judged, start))});
  const caption = element("label", {for: id});
  const answer = element("p", {class: "answer", role: "status"});
  /** @param {boolean} byHand */
  const showAnswer = (byHand) => {
    const speed = judged[Number(slider.value)];
    caption.textContent = `What would a restriction to ${kmh(speed)} do?`;
    slider.setAttribute("aria-valuetext", kmh(speed));
    answer.replaceChildren(...restrictionWords(curves, judged, Number(slider.value)));
    if (byHand) onSpeed(speed);
  };
  slider.addEventListener("input", () => showAnswer(true));
  showAnswer(false);
  return element("div", {class: "restrict"}, caption, slider, answer);
}

/**
 * Criteria that are beyond their limit at one of the first speeds, each with the speeds from and to which it is.
 * @param {Curves} curves
 * @param {number} count
 */
function beyondUpTo({speeds_kmh: speeds, series}, count) {
  return series.filter(({within}) => within[count - 1] === "0").map(({name, values, limits}) => {
    const limit = limits.find((one) => one.decides !== false && holdsAt(one, speeds[count - 1]))?.limit;
    const over = speeds.slice(0, count).filter((_, i) => limit !== undefined && values[i] >= limit);
    return {name, from: over[0] ?? speeds[count - 1], to: over.at(-1) ?? speeds[count - 1]};
  });
}

/**
 * Trains at the restricted speed, and the worst of all that may run then: force is not monotonic in speed.
 * @param {Curves} curves
 * @param {number[]} judged
 * @param {number} index
 */
function restrictionWords(curves, judged, index) {
  const peaks = seriesOf(curves, "peak_force").values.slice(0, judged.length);
  const [speed, top] = [kmh(judged[index]), kmh(lastOf(judged))];
  const worst = Math.max(...peaks.slice(0, index + 1));
  const beyond = beyondUpTo(curves, index + 1).map(({name, from, to}) =>
    `${criterionInSentence(name)} at ${from === to ? "" : `${number(from, 4)} to `}${kmh(to)}`);
  return [
    element("span", {class: beyond.length ? "big over" : "big"}, beyond.length ? "✕ Still beyond limits" : `✓ Within limits at every speed up to ${speed}`),
    element("span", {class: "block"}, beyond.join(", ")),
    element("span", {class: "block"}, `Trains at ${speed}: ${kilonewtons(peaks[index])}`, ...changeWords(peaks[index], lastOf(peaks), `than at ${top}`, curves)),
    element("span", {class: "block"}, `Worst of all speeds up to ${speed}: ${kilonewtons(worst)}`, ...changeWords(worst, Math.max(...peaks), "than without it", curves)),
  ];
}

/**
 * @param {number} force
 * @param {number} from
 * @param {string} than
 * @param {{error_share?: number, static_n?: number}} curves
 * @returns {Child[]}
 */
function changeWords(force, from, than, {error_share: share = 0, static_n: atRest = 0}) {
  const change = force / from - 1;
  if (Math.abs(change) < 5e-4) return [];
  if (Math.abs(force - from) < share * (Math.max(force, from) - atRest)) return [", no difference beyond fit error and model uncertainty"];
  return [", ", element("strong", {}, `${percent(change)} ${change > 0 ? "MORE" : "less"}`), ` ${than}`];
}

/**
 * @param {Verdict} verdict
 * @param {{error_share?: number, static_n?: number}} curves
 */
function restrictionTable({restrictions}, {error_share: share = 0, static_n: atRest = 0}) {
  if (!restrictions?.length) return null;
  const top = restrictions[0].peak_force_n;
  /** @type {(r: {change: number, peak_force_n: number}) => string} */
  const changed = (r) => (Math.abs(r.peak_force_n - top) < share * (Math.max(r.peak_force_n, top) - atRest)
    ? "no difference beyond fit error and model uncertainty" : `${r.change > 0 ? "+" : "−"}${percent(Math.abs(r.change))}`);
  return element("p", {class: "hint"}, "Restricted to: " + restrictions.slice(1, 9).map((r) =>
    `${number(r.speed_kmh, 4)} km/h ${changed(r)}${r.within_limits ? " (within limits)" : ""}`).join(", "));
}

/**
 * @param {Profile} profile
 * @param {Grinding | undefined} grinding
 * @param {boolean} still
 * @param {(task: () => unknown) => void} later
 */
function geometryPart(profile, grinding, still, later) {
  const noise = profile.noise_m === undefined ? "" : ` Measurement noise of ${number(profile.noise_m * 1e6, 2)} µm is taken out.`;
  const worst = profile.index?.length ? ` Its quality index along the rail, ${number(Math.max(...profile.index))} at most, above it.` : "";
  const bridged = profile.bridged_m === undefined ? "" : `Shaded: ${number(profile.bridged_m * 1e3)} mm of the rail that the wheel bridges and does not meet.`;
  const holder = chart(`Height of the rail over the weld, and the wheel centre's path.${worst}${noise}`, worst ? "" : "low");
  later(() => drawGeometry(holder, profile, grinding, still));
  return card("Geometry", holder, bridged && element("p", {class: "hint"}, bridged));
}

/**
 * @param {ForceHistory} history
 * @param {WeldDetail} content
 * @param {boolean} still
 * @param {(task: () => unknown) => void} later
 */
function historyPart(history, content, still, later) {
  const holder = chart("Contact force along the track in this passage.", "low");
  later(() => drawHistory(holder, history, content, still));
  return card(`Force along the track at ${kmh(history.speed_kmh)}, weld ${centimetres(history.position_m)} cm after the sleeper`, holder);
}

// --- decision by position ---------------------------------------------------------------------------------------------

/**
 * Neighbouring positions of one decision: [decision, from, to] in metres.
 * @param {PositionOutcome[]} outcomes
 * @param {number} span
 * @returns {[decision: string, from: number, to: number][]}
 */
function stretches(outcomes, span) {
  const edges = edgesOf(outcomes.map((o) => o.position_m)).map((x) => Math.min(span, Math.max(0, x)));
  /** @type {[decision: string, from: number, to: number][]} */
  const found = [];
  outcomes.forEach(({decision}, i) => {
    const last = found.at(-1);
    if (last?.[0] === decision) last[2] = edges[i + 1];
    else found.push([decision, edges[i], edges[i + 1]]);
  });
  // What lies just before the next sleeper belongs to the first position again.
  if (outcomes.length > 1 && span - lastOf(edges) > 1e-6) {
    const {decision} = outcomes[0];
    const last = lastOf(found);
    if (last[0] === decision) last[2] = span;
    else found.push([decision, lastOf(edges), span]);
  }
  return found;
}

/** @param {WeldDetail} content */
function positionsPart({verdict, map}) {
  const outcomes = verdict.by_position ?? [];
  if (!outcomes.length || !map) return null;
  const runs = stretches(outcomes, map.span_m);
  const parts = runs.map(([decision, from, to]) => {
    const part = element("span", {class: decision}, to - from > 0.16 * map.span_m ? `${decisionOf(decision).sign} ${decisionOf(decision).label}` : decisionOf(decision).sign);
    part.style.flex = `${(100 * (to - from)) / map.span_m} 1 0`;
    return part;
  });
  const words = runs.length === 1
    ? `${decisionOf(runs[0][0]).label} at every position in the sleeper bay.`
    : runs.map(([decision, from, to]) => `${decisionOf(decision).label} at ${centimetres(from)} to ${centimetres(to)} cm`).join(" · ");
  return card("Decision by position in the sleeper bay",
    element("div", {class: "strip", "aria-hidden": "true"}, ...parts),
    element("p", {class: "ends", "aria-hidden": "true"}, element("span", {}, "▮ sleeper, 0 cm"), element("span", {}, `next sleeper, ${centimetres(map.span_m)} cm ▮`)),
    element("p", {}, words),
    verdict.geometry && element("p", {class: "hint"}, "By computed values alone, without the probabilities that decide."));
}

// --- criteria ---------------------------------------------------------------------------------------------------------

/** @param {WeldDetail} content */
function criteriaPart({verdict}) {
  const sampled = verdict.criteria.some((c) => c.exceeding !== undefined);
  const headings = ["Criterion", "Value", "Limit", "Margin", "Where", ...(sampled ? ["Probability of exceedance"] : []), "Why and by which source"];
  const table = element(
    "table", {class: "criteria"}, element("caption", {class: "visually-hidden"}, "Criteria with their limits"),
    element("thead", {}, element("tr", {}, ...headings.map((heading) => element("th", {scope: "col"}, heading)))),
    element("tbody", {}, ...[...verdict.criteria].map((c) => criterionLine(c, sampled))),
  );
  const part = card("Criteria", element("div", {class: "scroll"}, table),
    verdict.unjudged?.length ? element("p", {}, element("strong", {}, "Not judged: "), `${verdict.unjudged.map(criterionName).join(", ")} (not computed).`) : null);
  part.classList.add("long");
  return part;
}

/**
 * @param {Criterion} c
 * @param {boolean} sampled
 */
function criterionLine(c, sampled) {
  /**
   * @param {string} name
   * @param {...Child} children
   */
  const cell = (name, ...children) => element("td", {"data-label": name}, element("div", {}, ...children));
  const margin = c.margin ?? c.limit - c.value;
  const state = c.passed ? ["ok", "✓ within"] : c.reject_limit !== undefined && c.value > c.reject_limit ? ["over", "✕ beyond reject limit"] : ["over", "✕ over limit"];
  return element(
    "tr", {class: !c.passed && c.decides !== false ? "failed" : ""},
    element("th", {scope: "row"}, criterionName(c.name, c.base_m), c.rule_book !== undefined && element("span", {class: "small block"}, c.rule_book), element("span", {class: `tag block ${state[0]}`}, state[1]),
      c.decides === false && element("span", {class: "tag block aside"}, "informative only")),
    cell("Value", element("strong", {class: "nowrap"}, quantity(c.value, unitOf(c))), element("span", {class: "block"}, bar(ratioOfCriterion(c), c.passed)), element("span", {class: "small nowrap"}, timesLimit(c.ratio)), c.low !== undefined && c.high !== undefined && element("span", {class: "small block"}, `90 %: ${quantity(c.low, unitOf(c))} to ${quantity(c.high, unitOf(c))}`)),
    cell("Limit", element("span", {class: "nowrap"}, quantity(c.limit, unitOf(c))), c.reject_limit !== undefined && element("span", {class: "small block"}, `reject above ${quantity(c.reject_limit, unitOf(c))}`)),
    cell("Margin", element("span", {class: margin < 0 ? "over nowrap" : "nowrap"}, quantity(margin, unitOf(c)))),
    element("td", {class: "c-where", "data-label": "Where"}, element("div", {}, ...whereOf(c))),
    sampled && element("td", {class: "c-chance", "data-label": "Probability of exceedance"}, element("div", {}, ...chanceOf(c))),
    element("td", {class: "c-why"}, c.applies && element("span", {class: "block"}, sentence(c.applies)), element("span", {class: c.verified ? "ok" : ""}, `${authority(c)}: `), element("span", {class: "small"}, c.source)),
  );
}

/**
 * @param {Criterion} c
 * @returns {Child[]}
 */
function whereOf(c) {
  if (c.speed_kmh === undefined) return [GEOMETRY.includes(c.name) ? "geometry" : "–"];
  return [element("span", {class: "nowrap"}, kmh(c.speed_kmh)), c.position_m !== undefined && element("span", {class: "small block"}, `weld at ${centimetres(c.position_m)} cm`), c.x_m !== undefined && element("span", {class: "small block"}, `wheel at ${centimetres(c.x_m)} cm`)];
}

/**
 * @param {Criterion} c
 * @returns {Child[]}
 */
function chanceOf(c) {
  if (c.exceeding === undefined) return ["–"];
  const shown = c.rule_book === undefined ? percent : probability;
  return [
    element("strong", {}, shown(c.exceeding)),
    c.exceeding_reject ? element("span", {class: "small block"}, `${shown(c.exceeding_reject)} to reject`) : null,
    c.driver !== undefined && element("span", {class: "small block"}, `most by ${c.driver}${c.driver_share === undefined ? "" : ` (${percent(c.driver_share)} of variance)`}`),
  ];
}

// --- grinding and provenance ------------------------------------------------------------------------------------------

/** @param {Grinding} g */
function grindingPart(g) {
  const changed = g.after.map((c) => [criterionName(c.name, c.base_m), quantity(c.value, unitOf(c)), c.passed ? "✓ within" : "✕ over limit"]);
  const found = g.reached ? `Remove at most ${hundredths(g.most_removed_m)}.` : "No removal of metal was found that brings this weld within its limits by hand.";
  const spots = [["Grind, mm from the weld's centre", "side", "at most"], ...g.spots.map((s) => [`${number(s.from_m * 1e3, 3)} to ${number(s.to_m * 1e3, 3)}`, s.side, `${hundredths(s.depth_m)}, at ${number(s.deepest_m * 1e3, 3)} mm`])];
  return card("Grinding",
    element("p", {}, element("strong", {}, found), ` ${sentence(g.reason)}`),
    g.spots.length ? element("div", {class: "changes"}, ...spots.flat().map((text) => element("span", {}, text))) : null,
    element("p", {}, "Before ", badge(g.decision_before), " after ", badge(g.decision_after)),
    changed.length ? element("div", {class: "changes"}, ...changed.flat().map((text) => element("span", {}, text))) : null,
    element("p", {class: "hint"}, `${g.hand_margin_m === undefined ? "" : `Within limits though the depth come out ${hundredths(g.hand_margin_m)} too large or too small${g.peak_by_hand_n === undefined ? "" : ` (peak up to ${kilonewtons(g.peak_by_hand_n)})`}. `}Waves longer than ${quantity(g.band_limit_m, "m")}, hollows no sharper than a stone of radius ${number(g.stone_radius_m)} m. ` +
      (g.reference_checked ? `Simulated again by the reference engine: ${g.reference_within} of ${g.reference_checked} passages within limits${g.reference_peak_n === undefined ? "" : `, peak ${kilonewtons(g.reference_peak_n)}`}.` : "Not simulated again by the reference engine.")));
}

/**
 * @param {Provenance} provenance
 * @param {boolean} open
 */
function provenancePart(provenance, open) {
  return element("details", {class: "card long", open}, element("summary", {}, "Inputs, model and software version"),
    element("dl", {class: "provenance"}, ...provenance.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)])));
}
