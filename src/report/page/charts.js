// Line charts as SVG.
function niceTicks(low, high, count) {
  const span = high - low || 1;
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => span / s <= count) || 10 * power;
  const ticks = [];
  for (let tick = Math.ceil(low / step) * step; tick <= high + 1e-9 * span; tick += step) ticks.push(+tick.toPrecision(10));
  return ticks;
}

// series: [{index, name, points: [[x, y], ...]}]; options: {x, y (titles), yMin, yMax, log}
function lineChart(series, options) {
  const [width, height, left, right, top, bottom] = [460, 270, 50, 12, 12, 42];
  const points = series.flatMap((line) => line.points);
  if (points.length === 0) return element("p", { class: "soft" }, "Nothing is known here.");
  const toX = (x) => (options.log ? Math.log10(Math.max(x, 1e-12)) : x);
  const xs = points.map((p) => toX(p[0]));
  const ys = points.map((p) => p[1]);
  const x0 = Math.min(...xs), x1 = Math.max(...xs, x0 + 1e-9);
  const y0 = options.yMin !== undefined ? options.yMin : Math.min(0, ...ys);
  const y1 = options.yMax !== undefined ? options.yMax : Math.max(...ys, y0 + 1e-9) * 1.05;
  const px = (x) => left + ((toX(x) - x0) / (x1 - x0)) * (width - left - right);
  const py = (y) => top + (1 - (y - y0) / (y1 - y0)) * (height - top - bottom);
  let svg = "";
  for (const tick of niceTicks(y0, y1, 5)) {
    svg += `<line class="axis" x1="${left}" x2="${width - right}" y1="${py(tick)}" y2="${py(tick)}"/>`;
    svg += `<text x="${left - 6}" y="${py(tick) + 4}" text-anchor="end">${+tick.toPrecision(4)}</text>`;
  }
  const xTicks = options.log
    ? [-3, -2, -1, 0, 1, 2].flatMap((power) => (x1 - x0 < 2.2 ? [1, 2, 5] : [1]).map((k) => k * 10 ** power)).filter((t) => toX(t) >= x0 - 1e-9 && toX(t) <= x1 + 1e-9)
    : niceTicks(x0, x1, 6);
  for (const tick of xTicks) {
    svg += `<text x="${px(tick)}" y="${height - bottom + 16}" text-anchor="middle">${+tick.toPrecision(4)}</text>`;
  }
  svg += `<text x="${(left + width) / 2}" y="${height - 6}" text-anchor="middle">${options.x}</text>`;
  for (const line of series) {
    const { color, dash } = styleOf(line.index);
    const path = line.points.map((p) => `${px(p[0]).toFixed(1)},${py(p[1]).toFixed(1)}`).join(" ");
    svg += `<polyline fill="none" stroke="${color}" stroke-width="2.2" stroke-dasharray="${dash}" points="${path}"/>`;
    if (line.points.length <= 20) {
      for (const p of line.points) {
        svg += `<circle cx="${px(p[0]).toFixed(1)}" cy="${py(p[1]).toFixed(1)}" r="2.6" fill="${color}"><title>${number(p[0])}: ${number(p[1])}</title></circle>`;
      }
    }
  }
  const drawing = element("div");
  drawing.innerHTML = `<svg viewBox="0 0 ${width} ${height}" role="img">${svg}</svg>`;
  drawing.firstChild.setAttribute("aria-label", `${options.y} over ${options.x}`);
  return element("div", { class: "panel chart" }, element("h3", {}, options.y), drawing,
    element("div", { class: "legend" }, ...series.map((line) => element("span", {}, swatch(line.index), line.name))));
}

function histogram(counts) {
  const most = Math.max(1, ...counts);
  const bars = counts.map((count, i) =>
    `<rect x="${i * 4}" y="${(30 * (1 - count / most)).toFixed(1)}" width="3.4" height="${((30 * count) / most).toFixed(1)}" fill="var(--soft)"/>`);
  const node = element("div");
  const middle = counts.length * 2;
  node.innerHTML = `<svg viewBox="0 0 ${counts.length * 4} 32" preserveAspectRatio="none" style="height:34px" role="img" aria-label="histogram of errors">${bars.join("")}<line x1="${middle}" x2="${middle}" y1="0" y2="32" stroke="var(--link)" stroke-width="0.7"/></svg>`;
  return node;
}

// The share of queries within a position error, for rotations within `maxDeg`.
function recallCurve(queries, maxDeg) {
  const errors = queries.filter((q) => q.position !== null && q.rotation_deg <= maxDeg).map((q) => q.position).sort((a, b) => a - b);
  const points = [];
  for (let k = -24; k <= 8; ++k) {
    const x = 10 ** (k / 8);
    points.push([x, (100 * errors.filter((e) => e <= x).length) / queries.length]);
  }
  return points;
}
