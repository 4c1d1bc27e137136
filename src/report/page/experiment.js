// An experiment: its tables, its curves over the thinning, and what its claims come to.
function pivotTable(table) {
  const marked = (value) => element("span", { class: value.place ? `place${value.place}` : null }, value.text,
    value.place ? element("sup", { title: ["best", "second", "third"][value.place - 1] }, String(value.place)) : null);
  const cells = (cell) => cell === null ? ["–"]
    : cell.flatMap((value, index) => (index ? [" / ", marked(value)] : [marked(value)]));
  const head = [...table.row_axes, ...table.columns].map((title) => element("th", { scope: "col" }, title));
  const lines = table.rows.map((row) => element("tr", {},
    ...row.titles.map((title, index) => element("td", {}, title + (index === 0 && row.uses_ground_truth ? " *" : ""))),
    ...row.cells.map((cell) => element("td", {}, ...cells(cell)))));
  return scrolling(element("table", {}, element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...lines)), false);
}

function experimentTables(tables) {
  const node = section("tables", "Tables", "1, 2, 3: best, second and third of the column. Rows marked * were chosen with the ground truth.");
  for (const table of tables) {
    node.append(element("h3", {}, table.title), element("p", { class: "soft" }, table.value_names.join(" / ")), pivotTable(table), element("p", {}));
  }
}

function experimentFigures(figures) {
  const node = section("figures", "Over the thinning", "The references are every N-th image.");
  for (const figure of figures) {
    node.append(element("h3", {}, figure.title), element("div", { class: "grid" }, ...figure.panels.map((panel) =>
      lineChart(panel.lines.map((line, index) => ({ index, ...line })),
        { x: "every N-th reference (log)", y: panel.title, yMin: 0, log: true, ...(figure.percent ? { yMax: 100 } : {}) }))), element("p", {}));
  }
}

function experimentClaims(claims) {
  const node = section("claims", "Claims", "Differences of means over the queries with their 95 % intervals (paired bootstrap). Shown: the interval is above 0; "
    + "holds: not worse, within the noise; noise: it contains 0; contradicted: it is below 0.");
  const titles = ["where", "first", "second", "measure", "first %", "second %", "difference", "low", "high", "verdict"];
  for (const claim of claims) {
    node.append(element("h3", {}, `${claim.name}. ${claim.text}`), claim.lines.length
      ? sortableTable(titles.map((title, index) => ({ title, value: (row) => row[index] })), claim.lines, { tall: claim.lines.length > 14 })
      : element("p", { class: "soft" }, "Nothing to compare."), element("p", {}));
  }
}
