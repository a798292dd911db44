// The charts of a weld. Whatever is drawn here is a number or a word of this page: Plotly reads markup in its texts, so
// no name from a recording goes into one.

const COLOURS = {ink: "#16191d", soft: "#4d555e", blue: "#0072b2", orange: "#b36b00", red: "#b3261e", green: "#00694d"};

const AXIS = {fixedrange: true, zeroline: false, gridcolor: "#e3e6ea", linecolor: "#7a828b", ticks: "outside", ticklen: 4,
  automargin: true};

/**
 * @param {{title: string, [setting: string]: unknown}} x
 * @param {{title: string, [setting: string]: unknown}} y
 */
function layout(x, y, more = {}) {
  return {
    margin: {l: 52, r: 14, t: 10, b: 42},
    font: {family: "system-ui, DejaVu Sans, sans-serif", size: 12, color: COLOURS.ink},
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "#fff",
    hoverlabel: {bgcolor: "#16191d", bordercolor: "#16191d", font: {color: "#fff", size: 13}},
    dragmode: false,
    showlegend: true,
    legend: {orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: {size: 11}, itemclick: false, itemdoubleclick: false},
    ...more,
    xaxis: {...AXIS, ...x, title: {text: x.title, standoff: 8}},
    yaxis: {...AXIS, ...y, title: {text: y.title, standoff: 6}},
  };
}

/**
 * @param {HTMLElement} holder
 * @param {object[]} traces
 * @param {ReturnType<typeof layout>} how
 * @param {boolean} still
 */
async function draw(holder, traces, how, still) {
  const plotly = await loadPlotly();
  const config = {displayModeBar: false, responsive: !still, staticPlot: still, doubleClick: false};
  if (still) Object.assign(how, {width: holder.clientWidth, height: holder.clientHeight, font: {...how.font, size: 10}, legend: {...how.legend, font: {size: 9}}});
  return {plotly, drawn: await plotly.newPlot(holder, traces, how, config)};
}

/**
 * @param {number} x
 * @param {object} line
 */
const vertical = (x, line, more = {}) => ({type: "line", xref: "x", yref: "paper", x0: x, x1: x, y0: 0, y1: 1, line, ...more});
/**
 * @param {number} x
 * @param {string} text
 */
const label = (x, text, more = {}) => ({x, text, xref: "x", yref: "paper", y: 1, yanchor: "top", showarrow: false,
  bgcolor: "rgba(255,255,255,.85)", font: {size: 11}, ...more});

// --- geometry ---------------------------------------------------------------------------------------------------------

/**
 * @param {HTMLElement} holder
 * @param {Profile} profile
 * @param {Grinding | undefined} grinding
 * @param {boolean} still
 */
function drawGeometry(holder, profile, grinding, still) {
  const hover = "%{x:.0f} mm: %{y:.0f} µm<extra></extra>";
  /**
   * @param {number[]} x
   * @param {number[]} z
   * @param {string} name
   * @param {object} line
   */
  const trace = (x, z, name, line) => ({x: x.map((v) => v * 1e3), y: z.map((v) => v * 1e6), name, mode: "lines", line,
    hovertemplate: hover});
  /** @type {object[]} */
  const traces = [];
  if (profile.low_m && profile.high_m) {
    traces.push(
      {...trace(profile.x_m, profile.low_m, "90 % band", {width: 0}), hoverinfo: "skip", hovertemplate: undefined, showlegend: false},
      {...trace(profile.x_m, profile.high_m, "90 % band", {width: 0}), hoverinfo: "skip", hovertemplate: undefined, fill: "tonexty", fillcolor: "rgba(0, 114, 178, 0.18)"},
    );
  }
  /** @type {(x: number[], z: number[], name: string, marker: object) => object} */
  const dots = (x, z, name, marker) => ({...trace(x, z, name, {}), mode: "markers", line: undefined, marker});
  if (profile.measured_x_m && profile.measured_z_m) {
    traces.push(dots(profile.measured_x_m, profile.measured_z_m, "samples", {color: COLOURS.soft, size: 3}));
  }
  if (profile.wrong_x_m?.length && profile.wrong_z_m) {
    traces.push(dots(profile.wrong_x_m, profile.wrong_z_m, "set aside", {color: COLOURS.red, size: 8, symbol: "x"}));
  }
  const name = profile.measured_x_m ? "rail, estimated" : "rail as measured";
  traces.push(trace(profile.x_m, profile.z_m, name, {color: COLOURS.blue, width: 2}));
  if (profile.underside_m) {
    traces.push({...trace(profile.x_m, profile.underside_m, "bridged", {width: 0}), hoverinfo: "skip", hovertemplate: undefined, fill: "tonexty", fillcolor: "rgba(213, 94, 0, 0.35)"});
  }
  if (profile.wheel_x_m && profile.wheel_m) {
    traces.push(trace(profile.wheel_x_m, profile.wheel_m, "wheel centre", {color: COLOURS.orange, width: 1.5, dash: "dash"}));
  }
  if (grinding?.ground_m && grinding.most_removed_m > 0) {
    traces.push(trace(grinding.x_m, grinding.ground_m, "rail after grinding", {color: COLOURS.green, width: 2, dash: "dot"}));
  }
  const {shapes, annotations} = grinding?.spots.length ? spotMarks(grinding) : {shapes: [], annotations: []};
  const x = {title: "distance from the weld's centre, mm"};
  const {index, index_from_m: from = 0, index_step_m: step = 0} = profile;
  if (!index || profile.norm_rad === undefined) {
    return draw(holder, traces, layout(x, {title: "height, µm"}, {shapes, annotations}), still);
  }
  traces.push({x: index.map((_, i) => (from + i * step) * 1e3), y: index, yaxis: "y2", mode: "lines", name: "quality index", showlegend: false,
    line: {color: COLOURS.blue, width: 1.5}, hovertemplate: "%{x:.0f} mm: quality index %{y:.2f}<extra></extra>"});
  const norm = `quality index 1: ${number(profile.norm_rad * 1e3)} mrad${profile.norm_kmh === undefined ? "" : ` at ${kmh(profile.norm_kmh)}`}`;
  const yaxis2 = {...AXIS, domain: [0.72, 1], rangemode: "tozero", range: [0, 1.15 * Math.max(1.3, ...index)], anchor: "x", title: {text: "QI", standoff: 6}};
  const more = {yaxis2, shapes: [...shapes, {type: "line", xref: "paper", yref: "y2", x0: 0, x1: 1, y0: 1, y1: 1, line: {color: COLOURS.red, width: 1.5, dash: "dash"}}],
    annotations: [...annotations, {xref: "paper", yref: "y2", x: 1, y: 1, xanchor: "right", yanchor: "bottom", text: norm, showarrow: false, font: {size: 11, color: COLOURS.red}}]};
  return draw(holder, traces, layout(x, {title: "height, µm", domain: [0, 0.64]}, more), still);
}

/**
 * The spots that are ground as bands with their depth, and the names of the sides.
 * @param {Grinding} grinding
 */
function spotMarks({spots, ends: [falling, rising]}) {
  const shapes = spots.map(({from_m: from, to_m: to}) => ({type: "rect", xref: "x", yref: "paper", x0: from * 1e3, x1: to * 1e3, y0: 0, y1: 1,
    fillcolor: "rgba(230, 159, 0, .16)", line: {width: 0}, layer: "below"}));
  const depths = spots.map(({deepest_m: at, depth_m: depth}) => label(at * 1e3, `grind ${hundredths(depth)}`, {yref: "y domain", yanchor: "bottom", bgcolor: "rgba(255,255,255,0)"}));
  const side = {xref: "paper", y: 0.06, yanchor: "bottom", font: {size: 10}};
  return {shapes, annotations: [...depths, label(0, `← ${falling}`, {...side, xanchor: "left"}), label(1, `${rising} →`, {...side, xanchor: "right"})]};
}

// --- force map --------------------------------------------------------------------------------------------------------

/** @param {number[]} centres */
function edgesOf(centres) {
  if (centres.length === 1) return [centres[0] - Math.max(0.02, centres[0] * 0.02), centres[0] + Math.max(0.02, centres[0] * 0.02)];
  const inner = centres.slice(1).map((value, i) => (value + centres[i]) / 2);
  return [2 * centres[0] - inner[0], ...inner, 2 * lastOf(centres) - lastOf(inner)];
}

/**
 * A map as rows of cells; over a whole span, what lies at its first sleeper stands again at the next one.
 * @param {ForceMap} map
 * @returns {Grid}
 */
function gridOf(map) {
  const columns = map.positions_m.length;
  const rows = map.speeds_kmh.map((_, i) => map.peak_n.slice(i * columns, (i + 1) * columns));
  const hollow = map.speeds_kmh.map((_, i) => [...map.hollow.slice(i * columns, (i + 1) * columns)].map((cell) => cell === "1"));
  const positions = [...map.positions_m];
  const edges = edgesOf(positions);
  if (columns > 1 && Math.abs(lastOf(edges) - edges[0] - map.span_m) < 1e-6) {
    positions.push(positions[0] + map.span_m);
    for (const row of rows) row.push(row[0]);
    for (const row of hollow) row.push(row[0]);
  }
  return {speeds: map.speeds_kmh, positions, peaks: rows, hollow, x: edgesOf(positions).map((v) => v * 100), y: edgesOf(map.speeds_kmh)};
}

/**
 * The outline of cells as line segments with gaps between them.
 * @param {Grid} grid
 */
function outline({hollow, x, y}) {
  /** @type {(number | null)[]} */
  const px = [];
  /** @type {(number | null)[]} */
  const py = [];
  /** @type {(x0: number, y0: number, x1: number, y1: number) => void} */
  const segment = (x0, y0, x1, y1) => { px.push(x0, x1, null); py.push(y0, y1, null); };
  /** @type {(r: number, c: number) => boolean} */
  const inside = (r, c) => Boolean(hollow[r]?.[c]);
  for (let r = 0; r <= hollow.length; r++) {
    for (let c = 0; c <= hollow[0].length; c++) {
      if (inside(r, c) !== inside(r - 1, c) && c < hollow[0].length) segment(x[c], y[r], x[c + 1], y[r]);
      if (inside(r, c) !== inside(r, c - 1) && r < hollow.length) segment(x[c], y[r], x[c], y[r + 1]);
    }
  }
  return {x: px, y: py};
}

/**
 * @param {Grid} grid
 * @param {number | undefined} lineKmh
 */
function worstCellOf(grid, lineKmh) {
  /** @type {[row: number, column: number]} */
  let worst = [0, 0];
  grid.peaks.forEach((row, r) => row.forEach((peak, c) => {
    if ((r === 0 || lineKmh === undefined || grid.speeds[r] <= lineKmh * (1 + 1e-9)) && peak > grid.peaks[worst[0]][worst[1]]) worst = [r, c];
  }));
  return worst;
}

/**
 * @param {Grid} grid
 * @param {number} r
 * @param {number} c
 */
const cellWords = (grid, r, c) =>
  `${kmh(grid.speeds[r])}, weld ${centimetres(grid.positions[c])} cm after the sleeper: peak ${kilonewtons(grid.peaks[r][c])}` +
  (grid.hollow[r][c] ? " (local minimum: a lower speed reached more)" : "");

/**
 * @param {HTMLElement} holder
 * @param {HTMLElement} readout
 * @param {ForceMap} map
 * @param {Verdict} verdict
 * @param {boolean} still
 */
async function drawMap(holder, readout, map, verdict, still) {
  const grid = gridOf(map);
  /** @type {[row: number, column: number]} */
  const worst = map.weld_position_m === undefined
    ? worstCellOf(grid, map.line_speed_kmh)
    : [nearest(grid.speeds, verdict.worst_speed_kmh), nearest(grid.positions, verdict.worst_position_m)];
  const rim = outline(grid);
  /** @type {(color: string, width: number, shown: boolean) => object} */
  const rimTrace = (color, width, shown) => ({...rim, mode: "lines", line: {color, width}, hoverinfo: "skip", name: "local minimum", showlegend: shown});
  const traces = [
    {type: "heatmap", x: grid.x, y: grid.y, z: grid.peaks.map((row) => row.map((peak) => peak / 1e3)), colorscale: "Viridis",
      colorbar: {title: {text: "peak, kN", side: "right"}, thickness: 12, outlinewidth: 0},
      text: grid.peaks.map((row, r) => row.map((_, c) => `${kmh(grid.speeds[r])}, weld at ${centimetres(grid.positions[c])} cm<br><b>${kilonewtons(grid.peaks[r][c])}</b>${grid.hollow[r][c] ? "<br>local minimum" : ""}`)),
      hovertemplate: "%{text}<extra></extra>"},
    rimTrace("#000", 4, false),
    rimTrace("#fff", 2, false),
    {x: [grid.positions[worst[1]] * 100], y: [grid.speeds[worst[0]]], mode: "markers", hoverinfo: "skip", name: "worst", showlegend: false,
      marker: {symbol: "x", size: 12, color: COLOURS.red, line: {color: "#fff", width: 2}}},
  ];
  const [left, right] = [grid.x[0], lastOf(grid.x)];
  const sleepers = [0, map.span_m * 100].filter((x) => x >= left && x <= right);
  /** @type {object[]} */
  const shapes = sleepers.map((x) => vertical(x, {color: "#fff", width: 2, dash: "dash"}));
  /** @type {object[]} */
  const annotations = sleepers.map((x) => label(x, "sleeper", {y: 1.005, yanchor: "bottom"}));
  annotations.push({x: grid.positions[worst[1]] * 100, y: grid.speeds[worst[0]], text: `worst ${kilonewtons(grid.peaks[worst[0]][worst[1]])}`, showarrow: false,
    yshift: worst[0] > grid.speeds.length / 8 ? -18 : 18, xanchor: worst[1] > grid.positions.length / 2 ? "right" : "left", bgcolor: "rgba(255,255,255,.9)", borderpad: 2, font: {size: 12}});
  if (map.line_speed_kmh !== undefined && map.line_speed_kmh < lastOf(grid.speeds)) {
    shapes.push({type: "line", xref: "paper", x0: 0, x1: 1, y0: map.line_speed_kmh, y1: map.line_speed_kmh, line: {color: "#fff", width: 2, dash: "dot"}});
    annotations.push({xref: "paper", x: 0.5, y: map.line_speed_kmh, yanchor: "bottom", text: `line speed ${kmh(map.line_speed_kmh)}`, showarrow: false, bgcolor: "rgba(255,255,255,.85)", font: {size: 11}});
  }
  if (map.weld_position_m !== undefined) shapes.push(vertical(map.weld_position_m * 100, {color: "#fff", width: 2}));
  const how = layout({title: "weld's centre after the sleeper, cm", range: [left, right]}, {title: "speed, km/h", range: [grid.y[0], lastOf(grid.y)]},
    {shapes, annotations, showlegend: false, margin: {l: 52, r: 8, t: 22, b: 42}});
  const {plotly, drawn} = await draw(holder, traces, how, still);
  if (!still) readByPointerAndKeys(plotly, drawn, readout, grid, worst, shapes);
}

/**
 * Pointer, finger and arrow keys all end in the line of words below the map.
 * @param {PlotlyLibrary} plotly
 * @param {PlotlyElement} holder
 * @param {HTMLElement} readout
 * @param {Grid} grid
 * @param {[row: number, column: number]} worst
 * @param {object[]} shapes
 */
function readByPointerAndKeys(plotly, holder, readout, grid, worst, shapes) {
  let [r, c] = worst;
  readout.textContent = cellWords(grid, r, c);
  /** @param {{points: PlotlyCell[]}} event */
  const point = (event) => {
    const at = event.points[0];
    if (at.data.type !== "heatmap") return;
    [r, c] = at.pointNumber;
    readout.textContent = cellWords(grid, r, c);
  };
  holder.on("plotly_hover", point);
  holder.on("plotly_click", point);
  /** @type {Record<string, [rows: number, columns: number]>} */
  const steps = {ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowRight: [0, 1], ArrowLeft: [0, -1]};
  holder.addEventListener("keydown", (event) => {
    const step = steps[event.key];
    if (!step) return;
    event.preventDefault();
    r = Math.min(grid.speeds.length - 1, Math.max(0, r + step[0]));
    c = Math.min(grid.positions.length - 1, Math.max(0, c + step[1]));
    readout.textContent = cellWords(grid, r, c);
    const cell = {type: "rect", x0: grid.x[c], x1: grid.x[c + 1], y0: grid.y[r], y1: grid.y[r + 1], line: {color: "#000", width: 3}};
    plotly.relayout(holder, {shapes: [...shapes, cell, {...cell, line: {color: "#fff", width: 1}}]});
  });
}

/**
 * @param {number[]} values
 * @param {number} wanted
 */
function nearest(values, wanted) {
  return values.reduce((best, value, i) => (Math.abs(value - wanted) < Math.abs(values[best] - wanted) ? i : best), 0);
}

// --- force against speed ----------------------------------------------------------------------------------------------

/**
 * @param {SpeedLimit} limit
 * @param {number} speed
 */
const holdsAt = (limit, speed) => speed > (limit.above_kmh ?? 0) && speed >= (limit.from_kmh ?? 0)
  && speed < (limit.below_kmh ?? Infinity) && speed <= (limit.to_kmh ?? Infinity);

/**
 * The limits over speed as steps.
 * @param {Series} series
 * @param {number[]} speeds
 * @param {"limit" | "reject_limit"} field
 */
function limitSteps(series, speeds, field) {
  const [first, last] = [speeds[0], lastOf(speeds)];
  return series.limits.flatMap((limit) => {
    const {[field]: value, verified} = limit;
    const from = Math.max(first, limit.above_kmh ?? 0, limit.from_kmh ?? 0);
    const to = Math.min(last, limit.to_kmh ?? Infinity, limit.below_kmh ?? Infinity);
    return value !== undefined && to > from ? [{from, to, value, verified}] : [];
  });
}

/** @type {{field: "limit" | "reject_limit", legend: string, color: string}[]} */
const LIMIT_LINES = [
  {field: "limit", legend: "limit", color: COLOURS.orange},
  {field: "reject_limit", legend: "reject limit", color: COLOURS.red},
];

/**
 * @param {Curves} curves
 * @param {string} name of a criterion
 */
function seriesOf(curves, name) {
  const found = curves.series.find((one) => one.name === name);
  if (!found) throw new Error(`there is no curve of ${name}`);
  return found;
}

/**
 * @param {HTMLElement} holder
 * @param {Curves} curves
 * @param {WeldDetail} content
 * @param {string} name
 * @param {boolean} still
 */
async function drawCurve(holder, curves, {verdict, map, grinding}, name, still) {
  const series = seriesOf(curves, name);
  // A unit that this page does not know is text from outside.
  const [factor, unit] = UNITS[unitOf(series)] ?? [1, ""];
  /** @param {number[]} values */
  const inUnit = (values) => values.map((value) => value * factor);
  const speeds = curves.speeds_kmh;
  /** @type {object[]} */
  const traces = [];
  if (name === "peak_force" && curves.best) {
    const upto = lastOf(curves.best.speeds_kmh);
    const judged = speeds.map((speed, i) => [speed, series.values[i]]).filter(([speed]) => speed <= upto);
    traces.push(
      {x: curves.best.speeds_kmh, y: inUnit(curves.best.peak_n), mode: "lines", line: {width: 0}, hoverinfo: "skip", showlegend: false},
      {x: judged.map(([speed]) => speed), y: inUnit(judged.map(([, value]) => value)), mode: "lines", line: {width: 0}, fill: "tonexty", fillcolor: "rgba(0,114,178,.16)",
        hoverinfo: "skip", name: "best to worst position"},
    );
  }
  traces.push({x: speeds, y: inUnit(series.values), mode: "lines", line: {color: COLOURS.blue, width: 2.5}, name: "worst position",
    hovertemplate: `%{x:.0f} km/h: <b>%{y:.4~g}${unit && ` ${unit}`}</b><extra></extra>`});
  if (name === "peak_force" && grinding?.peak_after_n && grinding.most_removed_m > 0) {
    traces.push({x: grinding.speeds_kmh, y: inUnit(grinding.peak_after_n), mode: "lines", line: {color: COLOURS.green, width: 2, dash: "dot"}, name: "after grinding",
      hovertemplate: "after grinding, %{x:.0f} km/h: %{y:.4~g}<extra></extra>"});
  }
  for (const {field, legend, color} of LIMIT_LINES) {
    const steps = limitSteps(series, speeds, field);
    if (!steps.length) continue;
    const doubt = steps.some(({verified}) => !verified) ? " (not verified)" : "";
    traces.push({x: steps.flatMap(({from, to}) => [from, to, null]), y: steps.flatMap(({value}) => [value * factor, value * factor, null]), mode: "lines",
      line: {color, width: 1.5, dash: field === "limit" ? "dash" : "longdash"}, name: legend + doubt, hoverinfo: "skip"});
  }
  const {shapes, annotations} = speedMarks(verdict, map, speeds);
  const how = layout({title: "speed, km/h", range: [speeds[0], lastOf(speeds)]}, {title: criterionName(name) + (unit && `, ${unit}`), rangemode: unit === "kN" ? "normal" : "tozero"},
    {shapes, annotations, hovermode: "x", margin: {l: 56, r: 14, t: 34, b: 42}});
  const {plotly} = await draw(holder, traces, how, still);
  return (/** @type {number} */ speed) => plotly.relayout(holder, {shapes: [...shapes, vertical(speed, {color: COLOURS.ink, width: 2})]});
}

/**
 * @param {Verdict} verdict
 * @param {ForceMap | undefined} map
 * @param {number[]} speeds
 */
function speedMarks(verdict, map, speeds) {
  /** @type {object[]} */
  const shapes = (verdict.avoid ?? []).map(({from_kmh: from, to_kmh: to}) => ({type: "rect", xref: "x", yref: "paper", x0: from, x1: Math.max(to, from + 0.5), y0: 0, y1: 1, fillcolor: "#b3261e", opacity: 0.12, line: {width: 0}, layer: "below"}));
  const annotations = (verdict.avoid ?? []).slice(0, 3).map(({from_kmh: from, to_kmh: to}) => label((from + to) / 2, "avoid", {y: 0.02, yanchor: "bottom", font: {size: 11, color: COLOURS.red}}));
  const line = map?.line_speed_kmh;
  const permitted = verdict.permitted_speed_kmh;
  if (permitted !== undefined && permitted < verdict.judged_speed_kmh) {
    shapes.push(vertical(permitted, {color: COLOURS.green, width: 2.5}));
    annotations.push(label(permitted, `within limits to ${number(permitted, 4)}`, {font: {size: 12, color: COLOURS.green}, ...side(permitted, speeds)}));
  }
  if (line !== undefined && line < lastOf(speeds)) {
    shapes.push(vertical(line, {color: COLOURS.soft, width: 1.5, dash: "dot"}));
    annotations.push(label(line, `line ${number(line, 4)}`, {y: 0.93, ...side(line, speeds)}));
  }
  return {shapes, annotations};
}

/**
 * @param {number} x
 * @param {number[]} speeds
 */
const side = (x, speeds) => ({xanchor: x > (speeds[0] + lastOf(speeds)) / 2 ? "right" : "left"});

// --- one passage ------------------------------------------------------------------------------------------------------

/**
 * @param {HTMLElement} holder
 * @param {ForceHistory} history
 * @param {WeldDetail} content
 * @param {boolean} still
 */
function drawHistory(holder, history, {map, verdict}, still) {
  const x = history.x_m.map((value) => value * 100);
  const traces = [
    {x, y: history.irregularity_m.map((v) => v * 1e6), yaxis: "y2", mode: "lines", line: {color: COLOURS.orange, width: 1.5, dash: "dash"}, name: "wheel centre's path over the weld",
      hovertemplate: "%{y:.0f} µm<extra></extra>"},
    {x, y: history.force_n.map((v) => v / 1e3), mode: "lines", line: {color: COLOURS.blue, width: 2}, name: "contact force",
      hovertemplate: "%{x:.0f} cm: <b>%{y:.0f} kN</b><extra></extra>"},
  ];
  /** @type {object[]} */
  const shapes = [];
  /** @type {object[]} */
  const annotations = [];
  if (map) {
    for (let at = Math.ceil(x[0] / 100 / map.span_m) * map.span_m; at * 100 <= lastOf(x); at += map.span_m) {
      shapes.push(vertical(at * 100, {color: "#9aa2ab", width: 1, dash: "dash"}));
    }
    shapes.push({type: "line", xref: "paper", x0: 0, x1: 1, y0: map.static_load_n / 1e3, y1: map.static_load_n / 1e3, line: {color: COLOURS.soft, width: 1, dash: "dot"}});
    annotations.push({xref: "paper", x: 0, xanchor: "left", y: map.static_load_n / 1e3, yanchor: "bottom", text: "static", showarrow: false, font: {size: 11, color: COLOURS.soft}});
  }
  annotations.push({x: verdict.worst_x_m * 100, y: verdict.peak_force_n / 1e3, text: kilonewtons(verdict.peak_force_n), ax: 28, ay: -6, arrowsize: 0.7, arrowcolor: COLOURS.soft, font: {size: 12}});
  const how = layout({title: "distance after the sleeper, cm", range: [x[0], lastOf(x)]}, {title: "force, kN"},
    {shapes, annotations, hovermode: "x", margin: {l: 52, r: 52, t: 30, b: 42},
      yaxis2: {title: {text: "path, µm", standoff: 6}, overlaying: "y", side: "right", tickmode: "auto", nticks: 5, showgrid: false, zeroline: false, fixedrange: true, automargin: true}});
  return draw(holder, traces, how, still);
}
