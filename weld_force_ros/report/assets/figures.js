// Reading values off figures: pointer, finger and arrow keys end in the line of words below them.

const SVG = "http://www.w3.org/2000/svg";
const DIGITS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/**
 * Values and places, in the figure's units, at both ends of an axis.
 * @param {string | null | undefined} text
 * @returns {[low: number, high: number, start: number, end: number]}
 */
function axisFrom(text) {
  const [low, high, start, end] = (text ?? "").split(" ").map(Number);
  return [low, high, start, end];
}
/** @type {(axis: ReturnType<typeof axisFrom>, at: number) => number} */
const valueAt = ([low, high, start, end], at) => low + ((at - start) / (end - start)) * (high - low);
/** @type {(axis: ReturnType<typeof axisFrom>, value: number) => number} */
const placeOf = ([low, high, start, end], value) => start + ((value - low) / (high - low)) * (end - start);

/** @param {number} value */
const shortNumber = (value) => (Math.abs(value) >= 100 ? Math.round(value) : Number(value.toPrecision(3))).toString().replace("-", "−");

/**
 * The points of a path of relative steps.
 * @param {string} path
 * @returns {[x: number, y: number][]}
 */
function pointsOf(path) {
  const numbers = (path.match(/-?\d+/g) ?? []).map(Number);
  /** @type {[x: number, y: number][]} */
  const points = [];
  for (let i = 0, x = 0, y = 0; i + 1 < numbers.length; i += 2) {
    x += numbers[i];
    y += numbers[i + 1];
    points.push([x, y]);
  }
  return points;
}

/**
 * What a line says at a place along the figure, between its points; null beyond its ends.
 * @param {[x: number, y: number][]} points
 * @param {number} x
 */
function heightAt(points, x) {
  const after = points.findIndex(([at]) => at >= x);
  if (after < 0 || (after === 0 && points[0][0] > x)) return null;
  if (after === 0) return points[0][1];
  const [[x0, y0], [x1, y1]] = [points[after - 1], points[after]];
  return x1 === x0 ? y1 : y0 + ((x - x0) / (x1 - x0)) * (y1 - y0);
}

/**
 * Read lines at a place along a figure.
 * @param {SVGElement} svg
 * @param {number} share of the figure's breadth
 */
function readLines(svg, share) {
  const axis = axisFrom(svg.dataset.x);
  const at = axis[2] + share * (axis[3] - axis[2]);
  const said = [...svg.querySelectorAll("path[data-name]")].flatMap((line) => {
    const height = heightAt(pointsOf(line.getAttribute("d") ?? ""), at);
    if (height === null) return [];
    const value = valueAt(axisFrom(line.getAttribute("data-y")), height);
    return [`${line.getAttribute("data-name")} ${shortNumber(value)} ${line.getAttribute("data-unit")}`.trim()];
  });
  return {at, words: `${svg.dataset.along} ${shortNumber(valueAt(axis, at))} ${svg.dataset.unit}: ${said.join(", ")}`};
}

/**
 * The cell of a map and its force.
 * @param {SVGElement} svg
 * @param {number} right share of the breadth
 * @param {number} up share of the height
 */
function readMap(svg, right, up) {
  const [speeds, positions, [low, high]] = [svg.dataset.speeds, svg.dataset.positions, svg.dataset.range].map((text) => (text ?? "").split(" ").map(Number));
  const [x, y] = [axisFrom(svg.dataset.x), axisFrom(svg.dataset.y)];
  const c = nearest(positions, x[0] + right * (x[1] - x[0]));
  const r = nearest(speeds, y[0] + up * (y[1] - y[0]));
  const cell = 2 * (r * positions.length + c);
  const [tens, ones] = [...(svg.dataset.values ?? "").slice(cell, cell + 2)].map((digit) => DIGITS.indexOf(digit));
  const peak = low + ((64 * tens + ones) / 4095) * (high - low);
  return {at: placeOf(x, positions[c]), high: placeOf(y, speeds[r]),
    words: word("script.cell", {speed: shortNumber(speeds[r]), position: shortNumber(positions[c]), peak: shortNumber(peak)})};
}

/**
 * @param {number[]} values
 * @param {number} wanted
 */
function nearest(values, wanted) {
  return values.reduce((best, value, i) => (Math.abs(value - wanted) < Math.abs(values[best] - wanted) ? i : best), 0);
}

/**
 * Show where a figure is read.
 * @param {SVGElement} svg
 * @param {{at: number, high?: number}} place
 */
function markReading(svg, {at, high}) {
  let cursor = svg.querySelector(".cursor");
  if (!cursor) {
    cursor = document.createElementNS(SVG, "path");
    cursor.setAttribute("class", "cursor");
    svg.append(cursor);
  }
  const [, , right, bottom] = (svg.getAttribute("viewBox") ?? "").split(" ");
  cursor.setAttribute("d", `M${at} 0V${bottom}${high === undefined ? "" : `M0 ${high}H${right}`}`);
}

/** @param {Element} holder with figures */
function makeReadable(holder) {
  for (const figure of holder.querySelectorAll("figure")) {
    const svg = /** @type {SVGElement | null} */ (figure.querySelector("svg"));
    if (!svg) continue;
    const label = word("script.read", {heading: figure.querySelector("h3")?.textContent ?? ""});
    const plot = element("div", {class: "plot", tabindex: "0", role: "group", "aria-label": label});
    const readout = element("output", {class: "readout screen-only", "aria-live": "polite"}, word("script.point"));
    svg.replaceWith(plot, readout);
    plot.append(svg);
    let [right, up] = [0.5, 0.5];
    const read = () => {
      const found = svg.dataset.values ? readMap(svg, right, up) : readLines(svg, right);
      readout.textContent = found.words;
      markReading(svg, found);
    };
    /** @param {PointerEvent} event */
    const point = (event) => {
      const {left, top, width} = svg.getBoundingClientRect();
      const [x, y, scale] = [axisFrom(svg.dataset.x), axisFrom(svg.dataset.y), Number(svg.getAttribute("viewBox")?.split(" ")[2]) / width];
      right = Math.min(1, Math.max(0, ((event.clientX - left) * scale - x[2]) / (x[3] - x[2])));
      up = Math.min(1, Math.max(0, ((event.clientY - top) * scale - y[2]) / (y[3] - y[2]))) || 0;
      read();
    };
    svg.addEventListener("pointermove", point);
    svg.addEventListener("pointerdown", point);
    /** @type {Record<string, [right: number, up: number]>} */
    const steps = {ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]};
    plot.addEventListener("keydown", (event) => {
      const step = steps[/** @type {KeyboardEvent} */ (event).key];
      if (!step || (step[1] && !svg.dataset.values)) return;
      event.preventDefault();
      right = Math.min(1, Math.max(0, right + step[0] / 50));
      up = Math.min(1, Math.max(0, up + step[1] / 50));
      read();
    });
  }
}
