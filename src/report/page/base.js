// Small helpers: elements, numbers, colors, sortable tables.
const data = JSON.parse(document.getElementById("data").textContent);

function element(tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

function number(value, digits) {
  if (value === null || value === undefined) return "–";
  return digits === undefined ? String(+value.toPrecision(4)) : value.toFixed(digits);
}

// Okabe and Ito's colors, told apart by the color blind, with a dash pattern as a second sign.
const palette = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const dashes = ["", "7 4", "2 3", "9 3 2 3"];
function styleOf(index) {
  return { color: palette[index % palette.length], dash: dashes[Math.floor(index / palette.length) % dashes.length] };
}
function swatch(index) {
  const { color, dash } = styleOf(index);
  const node = element("span", { class: "swatch" });
  node.innerHTML = `<svg viewBox="0 0 22 12"><line x1="1" y1="7" x2="21" y2="7" stroke="${color}" stroke-width="3" stroke-dasharray="${dash}"/></svg>`;
  return node;
}

function section(id, title, text) {
  const node = element("section", { id }, element("h2", {}, title));
  if (text) node.append(element("p", { class: "soft" }, text));
  document.getElementById("page").append(node);
  return node;
}

// columns: {title, value(row), text(row), better: "low"|"high"|"neither"}. Clicking a title sorts.
function sortableTable(columns, rows, options) {
  const { medals, tall, onRow } = options || {};
  const body = element("tbody");
  const heads = columns.map((column, index) =>
    element("th", { scope: "col" }, element("button", { type: "button", onclick: () => sortBy(index) }, column.title)));
  let sorted = { index: -1, up: true };
  const places = columns.map((column) => {
    if (!medals || !column.better || column.better === "neither") return new Map();
    const values = rows.filter((row) => !row.unranked).map(column.value).filter((v) => typeof v === "number");
    const ranking = [...new Set(values)].sort((a, b) => (column.better === "low" ? a - b : b - a)).slice(0, 3);
    return ranking.length > 1 ? new Map(ranking.map((value, place) => [value, place + 1])) : new Map();
  });
  function fill() {
    body.replaceChildren(...rows.map((row) => {
      const cells = columns.map((column, index) => {
        const value = column.value(row);
        const place = row.unranked ? undefined : places[index].get(value);
        const cell = element("td", { class: place ? `place${place}` : column.class || null });
        if (column.node) cell.append(column.node(row));
        else cell.append(column.text ? column.text(row) : String(value));
        if (place) cell.append(element("sup", { title: ["best", "second", "third"][place - 1] }, String(place)));
        return cell;
      });
      const line = element("tr", {}, ...cells);
      if (onRow) line.addEventListener("click", () => onRow(row));
      return line;
    }));
  }
  function sortBy(index) {
    const up = sorted.index === index ? !sorted.up : columns[index].better !== "high";
    sorted = { index, up };
    const known = (value) => value !== null && value !== undefined;
    rows.sort((a, b) => {
      const [x, y] = [columns[index].value(a), columns[index].value(b)];
      if (!known(x) || !known(y)) return (known(y) ? 1 : 0) - (known(x) ? 1 : 0);
      const order = typeof x === "number" ? x - y : String(x).localeCompare(String(y));
      return up ? order : -order;
    });
    heads.forEach((head, i) => {
      if (i === index) head.setAttribute("aria-sort", up ? "ascending" : "descending");
      else head.removeAttribute("aria-sort");
    });
    fill();
  }
  fill();
  return scrolling(element("table", {}, element("thead", {}, element("tr", {}, ...heads)), body), tall);
}

// A table in a frame of its own, which says so where it goes on to the right.
function scrolling(table, tall) {
  const frame = element("div", { class: tall ? "scroll tall" : "scroll", tabindex: "0" }, table);
  const more = element("p", { class: "more soft", hidden: "" }, "more columns to the right \u2192");
  const look = () => { more.hidden = frame.scrollWidth - frame.clientWidth - frame.scrollLeft < 4; };
  frame.addEventListener("scroll", look);
  const observer = new ResizeObserver(look);
  observer.observe(frame);
  observer.observe(table);
  return element("div", {}, frame, more);
}

// A sortable table of the rows whose name holds what is typed above it.
function searchableTable(label, columns, rows, nameOf) {
  const place = element("div");
  const draw = (text) => {
    const found = rows.filter((row) => nameOf(row).toLowerCase().includes(text.toLowerCase()));
    place.replaceChildren(sortableTable(columns, found, { tall: found.length > 14 }),
      element("p", { class: "soft" }, text ? `${found.length} of ${rows.length}` : ""));
  };
  draw("");
  return element("div", {}, element("div", { class: "controls" }, element("input", { type: "search", placeholder: label,
    "aria-label": label, oninput: (event) => draw(event.target.value) })), place);
}

function choice(label, names, onchange, selected) {
  const select = element("select", { "aria-label": label, onchange: () => onchange(select.selectedIndex) },
    ...names.map((name, index) => element("option", { selected: index === selected ? "" : null }, name)));
  return element("label", {}, `${label} `, select);
}
