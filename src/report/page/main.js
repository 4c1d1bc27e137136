// The page itself.
function header() {
  const page = document.getElementById("page");
  page.append(element("h1", {}, data.title),
    element("p", { class: "soft" }, data.subtitle), element("nav", { "aria-label": "Sections" }));
}

function fillNavigation() {
  document.querySelector("nav").append(...[...document.querySelectorAll("section[id]")].map((node) =>
    element("a", { href: `#${node.id}` }, node.querySelector("h2").textContent)));
}

// What an error is measured in belongs to its column's title.
function titleOf(metric) {
  return /(^|_)(sq_rel|rmse|mae|median_signed_error|median_depth)$/.test(metric.key) ? `${metric.title}, units` : metric.title;
}

// Sources by what they do to localization: the best row of each by its recalls and then its median
// position error; where nothing was localized, by their matches, and else by their errors.
function rankSources() {
  const sources = data.sources.map((source, index) => ({ source, index }));
  const compare = (a, b) => {
    for (let i = 0; i < a.length; ++i) if (a[i] !== b[i]) return a[i] - b[i];
    return 0;
  };
  let by = "";
  let keyOf = null;
  const rows = (data.rows || []).filter((row) => !row.uses_ground_truth);
  const best = sources.map(({ source }) => rows.filter((row) => row.geometry === source.name)
    .map((row) => [...row.recalls.map((recall) => -recall.percent), row.median_position === null ? Infinity : row.median_position]).sort(compare)[0]);
  const known = (key) => sources.filter(({ source }) => source.means[key] !== null).length > 1;
  if (best.filter(Boolean).length > 1) {
    by = "localization";
    keyOf = ({ index }) => best[index];
  } else if (known("match_median_px")) {
    by = "match error";
    keyOf = ({ source }) => source.means.match_median_px === null ? null : [source.means.match_median_px];
  } else if (known("abs_rel")) {
    by = "AbsRel";
    keyOf = ({ source }) => source.means.abs_rel === null ? null : [source.means.abs_rel];
  }
  const ranked = keyOf ? sources.filter(keyOf).sort((a, b) => compare(keyOf(a), keyOf(b))) : [];
  const places = new Map();
  ranked.forEach((entry, place) => {
    const isTie = place > 0 && compare(keyOf(entry), keyOf(ranked[place - 1])) === 0;
    places.set(entry.index, isTie ? places.get(ranked[place - 1].index) : place + 1);
  });
  const rest = sources.filter(({ index }) => !places.has(index));
  return { by, places, count: ranked.length, worstFirst: [...ranked.reverse(), ...rest] };
}

// How much a finding is beyond the least that is reported, by length, the gravest at the top.
function findingList(findings) {
  const gravest = Math.max(...findings.map((finding) => finding.severity));
  return element("ol", { class: "findings" }, ...findings.map((finding) => element("li", {}, finding.text,
    element("i", { style: `width:${Math.max(3, (100 * finding.severity) / gravest)}%`, title: `${number(finding.severity)} times the least that is reported` }))));
}

function sourceSummary() {
  const node = section("summary", "Summary", data.truth
    ? `Errors are against ${data.truth}; means over the images, medians over all matches. 1, 2, 3: best, second, third.`
    : "There is no truth: sources are judged by overlapping views and by all matches together. 1, 2, 3: best, second, third.");
  const ranks = rankSources();
  node.append(element("div", { class: "grid" }, ...ranks.worstFirst.map(({ source, index }) =>
    element("article", { class: "panel" }, element("h3", {}, swatch(index), source.name + (source.is_truth ? " (truth)" : "")),
      ranks.places.has(index) ? element("p", { class: "soft" }, `place ${ranks.places.get(index)} of ${ranks.count} by ${ranks.by}`) : null,
      source.findings.length
        ? findingList(source.findings)
        : element("span", { class: "soft" }, source.is_truth ? "taken for the truth" : "nothing to complain of")))));
  node.append(element("p", {}));
  const wanted = ["coverage_percent", "abs_rel", "median_abs_rel", "rmse", "delta1_percent", "mae", "edge_accuracy_px",
    "edge_completeness_px", "normal_median_deg", "consistent_2_percent", "contradicted_percent", "match_median_px", "match_count", "match_within_4px_percent"];
  const columns = data.metrics.filter((metric) => wanted.includes(metric.key) && data.sources.some((s) => s.means[metric.key] !== null));
  const rows = data.sources.map((source, index) => ({ source, index, unranked: source.is_truth }));
  node.append(sortableTable([
    { title: "source", value: (row) => row.source.name, better: "neither",
      node: (row) => element("span", {}, swatch(row.index), row.source.name) },
    ...columns.map((metric) => ({ title: titleOf(metric), better: metric.better,
      value: (row) => row.source.means[metric.key], text: (row) => number(row.source.means[metric.key], metric.digits) })),
  ], rows, { medals: true }));
  const scored = data.sources.filter((source) => source.surface.length);
  if (scored.length) {
    node.append(element("p", {}), element("h3", {}, "Surfaces against the mesh, % within a distance"), sortableTable([
      { title: "source", value: (s) => s.name },
      ...scored[0].surface.flatMap((score, k) => ["accuracy", "completeness", "f"].map((what) => ({
        title: `${what === "f" ? "F" : what} % within ${number(score.threshold)} units`, better: "high",
        value: (s) => s.surface[k][`${what}_percent`], text: (s) => number(s.surface[k][`${what}_percent`], 1) }))),
    ], scored, { medals: true }));
  }
}

function sourceCurves() {
  const kinds = [["distance", "distance"], ["incidence_deg", "incidence angle, degrees"], ["edge_distance_px", "distance to a depth edge, px"]];
  const node = section("curves", "Where the errors are");
  const measures = [["abs_rel", "AbsRel"], ["mae", "MAE"], ["bias", "relative bias"]];
  const charts = element("div", { class: "grid" });
  function draw(which) {
    const [key, title] = measures[which];
    charts.replaceChildren();
    for (const [kind, label] of data.truth ? kinds : []) {
      const series = data.sources.map((source, index) => ({ index, name: source.name,
        points: (source.curves[kind] || []).filter((bin) => bin.count > 0).map((bin) => [(bin.from + bin.to) / 2, bin[key]]) }))
        .filter((line) => line.points.length);
      charts.append(lineChart(series, { x: label, y: `${title} over ${label}` }));
    }
    const matched = data.sources.map((source, index) => ({ index, name: source.name,
      points: (source.curves.reprojection_px || []).map((bin) => [bin.to, bin.percent]) })).filter((line) => line.points.length);
    if (matched.length) {
      charts.append(lineChart(matched, { x: "reprojection error, px (log)", y: "Matches within an error, %", yMin: 0, yMax: 100, log: true }));
    }
  }
  if (data.truth) node.append(element("div", { class: "controls" }, choice("measure", measures.map((m) => m[1]), draw)));
  node.append(charts);
  draw(0);
}

function recallSection(rows, thresholds) {
  const node = section("localization", "Localization", "Recalls with 95 % intervals (bootstrap over the queries, paired for differences). "
    + "“noise”: the difference to the best row may be luck. Rows marked * were chosen with the ground truth.");
  const degrees = [...new Set([...thresholds.map((t) => t.rotation_deg), 2, 5])].sort((a, b) => a - b);
  const plain = (name) => name.replace(/, off, off( \*)?$/, "$1");
  const charts = element("div", { class: "grid" });
  const shown = rows.filter((row) => (row.align || "off") === "off" && (row.filter || "off") === "off").slice(0, 12);
  function draw(which) {
    charts.replaceChildren(lineChart(shown.map((row, index) => ({ index, name: plain(row.name), points: recallCurve(row.queries, degrees[which]) })),
      { x: "position error (log)", y: `Recall over position error, rotation within ${degrees[which]}°`, yMin: 0, yMax: 100, log: true }));
  }
  node.append(element("div", { class: "controls" }, choice("rotation within, degrees", degrees.map(String), draw, degrees.length - 1)), charts, element("p", {}));
  draw(degrees.length - 1);
  node.append(sortableTable([
    { title: "method", value: (row) => plain(row.name) },
    ...thresholds.flatMap((threshold, t) => [
      { title: `${number(threshold.position)}, ${number(threshold.rotation_deg)}° %`, better: "high",
        value: (row) => row.recalls[t].percent,
        text: (row) => number(row.recalls[t].percent, 1) + (row.recalls[t].interval ? ` [${number(row.recalls[t].interval[0], 0)}, ${number(row.recalls[t].interval[1], 0)}]` : "") },
      ...(rows[0].recalls[t].verdict ? [{ title: "to the best", value: (row) => row.recalls[t].verdict }] : []),
    ]),
    { title: "median position", better: "low", value: (row) => row.median_position, text: (row) => number(row.median_position) },
  ], rows.map((row) => ({ ...row, unranked: row.uses_ground_truth })), { medals: true, tall: rows.length > 16 }));
}

function funnel(query) {
  const stages = [["retrieved", query.retrieved], ["matched", query.matched], ["hit", query.hit], ["consistent", query.consistent],
    ["inliers 2D-3D", query.inliers_2d3d], ["inliers 2D-2D", query.inliers_2d2d]];
  const most = Math.max(1, ...stages.slice(1).map((stage) => stage[1] || 0));
  return element("div", { class: "funnel" }, ...stages.flatMap(([name, count]) => [element("span", {}, name),
    element("i", { style: `width:${Math.min(100, (100 * (count || 0)) / most)}%` }), element("span", {}, String(count ?? "–"))]));
}

function querySection(rows) {
  const names = rows[0].queries.map((query) => query.query);
  const node = section("queries", "Query by query", rows[0].queries[0].verdict
    ? "The worst first. A click on a line, or on a camera of the scene below, shows the query."
    : "What every stage left of the matches, and how far the pose is off.");
  const place = element("div", { class: "grid" });
  const first = Math.max(0, rows.findIndex((row) => row.queries[0].candidates), rows.findIndex((row) => row.queries[0].keypoints));
  const worst = rows[first].queries.map((query, index) => ({ query, index }))
    .sort((a, b) => worseFirst(a.query, b.query))[0];
  const chosen = { query: rows[first].queries[0].verdict ? worst.index : 0, row: first, search: "" };
  function draw() {
    const row = rows[chosen.row];
    const query = row.queries[chosen.query];
    const facts = [query.reason ? `not localized: ${query.reason}` : null];
    if (query.position !== null) facts.push(`position error ${number(query.position)} units, rotation error ${number(query.rotation_deg)}°`);
    else if (!query.verdict && !query.reason) facts.push("no pose");
    facts.push(...verdictFacts(query));
    if (query.walk) facts.push(`the walk: ${query.walk.means}`);
    if (query.walk && query.walk.single_confidence !== undefined) {
      facts.push(`by itself wrong with probability ${number(1 - query.walk.single_confidence)}`);
    }
    if (query.solver) facts.push(`the pose comes from ${query.solver}`);
    if (query.position_sigma !== undefined) {
      facts.push(`expected error: position ${number(query.position_sigma)} units, rotation ${number(query.rotation_sigma_deg)}° (one standard deviation)`);
    }
    for (const candidate of query.candidates || []) {
      facts.push(`${candidate.solver} candidate: position ${number(candidate.position)} units, rotation ${number(candidate.rotation_deg)}°, `
        + `${candidate.inliers_2d2d} 2D-2D inliers${candidate.chosen ? " (chosen)" : ""}`);
    }
    if ((query.candidates || []).length === 2) {
      facts.push(`Select keeps P3P's pose where it has more than ${row.method.split(":")[1]} times the 2D-2D inliers of E5+1's`);
    }
    const cards = [element("article", { class: "panel wide" }, element("h3", {}, `${query.query}, ${row.name}`),
      element("div", { class: "facts" }, element("ul", {}, ...facts.filter(Boolean).map((fact) => element("li", {}, fact))),
        query.retrieved !== undefined ? funnel(query) : null))];
    const photo = (data.query_photos || {})[query.query];
    if (photo && Array.isArray(query.keypoints)) {
      const drawing = element("div", { class: "photo" }, element("img", { src: photo.uri, alt: `photograph ${query.query}` }));
      const circles = query.keypoints.map(([x, y, inlier]) => inlier
        ? `<circle cx="${x}" cy="${y}" r="${photo.width / 130}" fill="none" stroke="#ffab4a" stroke-width="${photo.width / 320}"/>`
        : `<path d="M${x - photo.width / 200} ${y}h${photo.width / 100}M${x} ${y - photo.width / 200}v${photo.width / 100}" stroke="#56b4e9" stroke-width="${photo.width / 420}"/>`);
      drawing.insertAdjacentHTML("beforeend", `<svg viewBox="0 0 ${photo.width} ${photo.height}" preserveAspectRatio="none">${circles.join("")}</svg>`);
      cards.push(element("article", { class: "panel" }, element("h3", {}, "Lifted keypoints: circles are inliers, crosses are not"), drawing));
    }
    cards.push(...queryPictures(query));
    loadPictures(query, () => { if (rows[chosen.row].queries[chosen.query] === query) draw(); });
    place.replaceChildren(...cards);
  }
  const list = element("div");
  const columns = [["retrieved", "retrieved"], ["matched", "matched"], ["hit", "hit"], ["consistent", "consistent"],
    ["inliers_2d3d", "inliers 2D-3D"], ["inliers_2d2d", "inliers 2D-2D"], ["wrong", "probability of being wrong"],
    ["position", "position error, units"], ["position_sigma", "position ±, units"], ["rotation_deg", "rotation error, °"], ["rotation_sigma_deg", "rotation ±, °"]];
  function drawList() {
    const queries = rows[chosen.row].queries.filter((query) => query.query.toLowerCase().includes(chosen.search));
    if (queries.some((query) => query.verdict)) queries.sort(worseFirst);
    for (const query of queries) if (query.verdict && query.verdict !== "failed") query.wrong = 1 - query.confidence;
    const known = columns.filter(([key]) => queries.some((query) => query[key] !== undefined && query[key] !== null));
    list.replaceChildren(element("p", {}), sortableTable([
      { title: "query", value: (query) => query.query,
        node: (query) => element("a", { href: "#queries" }, query.query) },
      ...(queries.some((query) => query.verdict) ? [{ title: "verdict", value: (query) => verdicts.indexOf(query.verdict),
        node: (query) => element("span", { class: `verdict ${query.verdict}` }, query.verdict) }] : []),
      ...(queries.some((query) => query.walk) ? [{ title: "walk", value: (query) => query.walk.role }] : []),
      ...known.map(([key, title]) => ({ title, value: (query) => query[key], text: (query) => number(query[key]) })),
      ...(queries.some((query) => query.reason !== undefined)
        ? [{ title: "why not", value: (query) => query.reason, class: "text" }] : []),
    ], queries, { tall: true, onRow: (query) => show(query.query) }),
    ...(chosen.search ? [element("p", { class: "soft" }, `${queries.length} of ${names.length} queries`)] : []));
  }
  function show(name) {
    chosen.query = names.indexOf(name);
    select.selectedIndex = chosen.query;
    draw();
  }
  const queryChoice = choice("query", names, (index) => { chosen.query = index; draw(); }, chosen.query);
  const select = queryChoice.querySelector("select");
  node.append(element("div", { class: "controls" },
    queryChoice,
    rows.length > 1 ? choice("method", rows.map((row) => row.name), (index) => { chosen.row = index; draw(); drawList(); }, first) : null,
    names.length > 1 ? element("input", { type: "search", placeholder: "search queries", "aria-label": "search queries",
      oninput: (event) => { chosen.search = event.target.value.toLowerCase(); drawList(); } }) : null), place, list);
  drawList();
  draw();
  return (name) => {
    if (names.includes(name)) show(name);
    return names.includes(name);
  };
}

// How bad an image of a source is, by the first of these that it has.
function badness(image) {
  for (const key of ["abs_rel", "match_median_px", "contradicted_percent"]) {
    if (image[key] !== null && image[key] !== undefined) return image[key];
  }
  return -1;
}

function imageSection() {
  const node = section("images", "Image by image", "The worst first. Click a column's title to sort.");
  const keys = ["coverage_percent", "abs_rel", "median_abs_rel", "scale_error_percent", "warp_percent", "edge_accuracy_px",
    "consistent_2_percent", "contradicted_percent", "relative_scale_percent", "match_median_px", "match_scale_percent"];
  const metrics = data.metrics.filter((metric) => keys.includes(metric.key)
    && data.sources.some((source) => source.images.some((image) => image[metric.key] !== null)));
  const place = element("div");
  const draw = (index) => place.replaceChildren(sortableTable([
    { title: "image", value: (row) => row.image },
    ...metrics.map((metric) => ({ title: titleOf(metric), better: metric.better, value: (row) => row[metric.key],
      text: (row) => number(row[metric.key], metric.digits) })),
  ], [...data.sources[index].images].sort((a, b) => badness(b) - badness(a)), { tall: true }));
  const first = data.sources.length > 1 && data.sources[0].is_truth ? 1 : 0;
  node.append(element("div", { class: "controls" }, choice("source", data.sources.map((source) => source.name), draw, first)), place);
  draw(first);
}

function colorKey(name, colors, from, to) {
  return element("div", { class: "key" }, element("span", {}, `${name}: ${from}`),
    element("div", { class: "bar", role: "img", "aria-label": `colors of ${name}`, style: `background:linear-gradient(90deg,${colors.join(",")})` }),
    element("span", {}, to));
}

function stripSection() {
  if (!data.strips || data.strips.length === 0) return;
  const node = section("strips", "Depth side by side",
    "The image with the worst source first. One color scale of depth for all, gray is a hole."
    + (data.truth ? " Histograms cover the range of the errors' colors." : ""));
  const full = number(100 * data.full_error, 0);
  node.append(element("div", { class: "keys" },
    colorKey("depth", data.depth_colors, number(data.depth_range[0]), `${number(data.depth_range[1])} units (log)`),
    data.truth ? colorKey("error", data.error_colors, `${full} % too near`, `${full} % too far`) : null));
  const worst = new Map();
  for (const source of data.sources) {
    if (source.is_truth) continue;
    for (const image of source.images) worst.set(image.image, Math.max(worst.get(image.image) ?? -1, badness(image)));
  }
  for (const strip of [...data.strips].sort((a, b) => (worst.get(b.image) ?? -1) - (worst.get(a.image) ?? -1))) {
    const tile = (uri, caption, extra) => element("figure", { style: `width:${data.tile_width}px` },
      element("img", { src: uri, width: data.tile_width, loading: "lazy", alt: caption }), extra || null, element("figcaption", {}, caption));
    node.append(element("article", { class: "panel strip" }, element("h3", {}, strip.image),
      element("div", { class: "tiles", tabindex: "0" }, ...(strip.photo ? [tile(strip.photo, "photograph")] : []),
        ...strip.sources.map((source, index) => tile(source.depth, data.sources[index].name, source.error
          ? element("div", {}, element("img", { src: source.error, width: data.tile_width, loading: "lazy", alt: `${data.sources[index].name}: error` }),
            histogram(source.histogram)) : null)))));
  }
}

function warningSection() {
  if (!data.warnings || !data.warnings.length) return;
  const node = section("warnings", "Warnings");
  node.append(element("ul", { class: "warnings" }, ...data.warnings.map((text) => element("li", {}, text))));
}

// `onPick`: shows a query of this name; whether there is such a thing.
function sceneSection(onPick) {
  if (!data.scene) return;
  const node = section("scene", "The scene", "Drag to turn, wheel or pinch to zoom, shift and drag to move; arrow keys work, too. "
    + "A click on a camera flies there.");
  const canvas = element("canvas", { tabindex: "0", "aria-label": "3D view of points and cameras", id: "scene-view" });
  const kinds = [...new Set(data.scene.cameras.map((camera) => camera.kind))];
  const controls = element("div", { class: "controls" });
  node.append(controls, element("div", {}, canvas));
  const caption = element("p", { class: "soft" });
  node.append(caption);
  const view = new SceneView(canvas, data.scene, (camera) => {
    view.flyTo(camera);
    const isShown = onPick && onPick(camera.name);
    caption.replaceChildren(camera.name, ...(isShown ? [": ", element("a", { href: "#queries" }, "its matches")] : []));
  });
  controls.append(element("button", { type: "button", onclick: () => view.home() }, "whole scene"));
  if (data.walk) node.append(walkFacts());
  if (data.walk && data.walk.frames.length > 1) controls.append(walkControl(view, caption));
  if (data.scene.mesh) {
    const box = element("input", { type: "checkbox", checked: "", onchange: () => { view.showMesh = box.checked; view.draw(); } });
    controls.append(element("label", {}, box, " mesh"));
  }
  for (const kind of kinds) {
    const box = element("input", { type: "checkbox", checked: "", onchange: () => {
      if (box.checked) view.shown.add(kind); else view.shown.delete(kind);
      view.draw();
    } });
    const name = { reference: "references", true: "true queries", estimated: "estimated queries", localized: "localized queries",
      doubtful: "doubtful queries", single: "photographs by themselves" }[kind] || kind;
    controls.append(element("label", {}, box, " ", element("span", { class: "dot", style: `background:${SceneView.colorOf(kind)}` }), ` ${name}`));
  }
}

// The frame of the walks at each time, one walk after the other; it stands in the scene, whose
// caption tells what it is.
function walkControl(view, caption) {
  const { frames } = data.walk;
  view.walk = frames;
  const show = (index) => {
    const frame = frames[index];
    view.walkAt = index;
    view.draw();
    caption.replaceChildren(`${frame.query} at ${number(frame.time_s)} s: ${frame.role}`
      + (frame.lost_before ? "; odometry was lost before it" : ""));
  };
  const input = element("input", { type: "range", min: 0, max: frames.length - 1, value: 0, "aria-label": "time",
    oninput: () => show(+input.value) });
  view.draw();
  return element("label", {}, "walk ", input);
}

function walkFacts() {
  const { frames, odometry } = data.walk;
  const lost = frames.filter((frame) => frame.lost_before).map((frame) => frame.query);
  const facts = odometry.map((walk) => {
    const where = walk.folder ? ` of ${walk.folder}` : "";
    if (walk.scale === undefined) return `the walk${where} told nothing of the odometry`;
    return `odometry${where}: scale ${number(walk.scale)}, noise of a step ${number(walk.step_sigma)} units and `
      + `${number(walk.step_rotation_sigma_deg)}\u00b0`;
  });
  if (lost.length) facts.push(`it was lost before ${lost.join(", ")}`);
  return element("p", { class: "soft" }, facts.join("; "));
}

header();
warningSection();
let showQuery = null;
if (data.sources) {
  sourceSummary();
  if (data.truth || data.sources.some((source) => source.curves.reprojection_px)) sourceCurves();
}
if (data.rows && data.rows.length) {
  if (data.rows[0].recalls.length) recallSection(data.rows, data.rows[0].recalls);
  showQuery = querySection(data.rows);
}
if (data.sources) {
  imageSection();
  stripSection();
}
if (data.rendered) renderedSections(data.rendered);
if (data.doctor) doctorSections(data.doctor);
if (data.experiment) {
  if (data.experiment.tables.length) experimentTables(data.experiment.tables);
  if (data.experiment.figures.length) experimentFigures(data.experiment.figures);
  if (data.experiment.claims.length) experimentClaims(data.experiment.claims);
}
sceneSection(showQuery);
fillNavigation();
document.documentElement.dataset.ready = "true";
