// One query: its photograph over what is seen from its pose, its matches and what is known of it.

const marks = { inlier: "#ffab4a", other: "#56b4e9" };

function svgOver(width, height, content) {
  const holder = element("div", { class: "layer" });
  holder.innerHTML = `<svg viewBox="0 0 ${width} ${height}" preserveAspectRatio="none">${content}</svg>`;
  return holder;
}

// Circles are inliers, crosses are not; lines lead to where the pose has the match, so many times as
// long as they are.
function markPaths(list, photo, factor) {
  const size = photo.width / 160;
  return (list || []).map(([x, y, inlier, dx, dy]) => {
    const color = inlier ? marks.inlier : marks.other;
    const sign = inlier ? `<circle cx="${x}" cy="${y}" r="${size}" fill="none"/>`
      : `<path d="M${x - size} ${y}h${2 * size}M${x} ${y - size}v${2 * size}"/>`;
    const far = dx === undefined || Math.hypot(dx, dy) > 0.1 * photo.width;
    const arrow = factor > 0 && !far ? `<path d="M${x} ${y}l${factor * dx} ${factor * dy}"/>` : "";
    return `<g stroke="${color}" stroke-width="${photo.width / 400}">${sign}${arrow}</g>`;
  }).join("");
}

// The photograph; over it, to the right of a line that can be moved, the mesh.
function comparedPhoto(query, photo) {
  const picture = element("img", { src: photo.uri, alt: `photograph ${query.query}` });
  const stack = element("div", { class: "photo" }, picture);
  const controls = element("div", { class: "controls" });
  const slider = (label, value, oninput) => {
    const input = element("input", { type: "range", min: 0, max: 100, value, "aria-label": label, oninput: () => oninput(+input.value) });
    controls.append(element("label", {}, `${label} `, input));
    oninput(value);
    return input;
  };
  const box = (label, checked, layer) => {
    const input = element("input", { type: "checkbox", checked: checked ? "" : null, onchange: () => { layer.hidden = !input.checked; } });
    layer.hidden = !checked;
    controls.append(element("label", {}, input, ` ${label}`));
  };
  if (query.rendering) {
    const rendering = element("img", { class: "layer rendering", src: query.rendering, alt: "the mesh as seen from the pose" });
    const edges = element("img", { class: "layer", src: query.edges, alt: "edges of the mesh" });
    const line = element("div", { class: "swipe" });
    stack.append(rendering, edges, line);
    const swipe = slider("swipe", 60, (percent) => {
      rendering.style.clipPath = `inset(0 0 0 ${percent}%)`;
      line.style.left = `${percent}%`;
    });
    slider("blend", 100, (percent) => { rendering.style.opacity = percent / 100; });
    box("edges of the mesh", true, edges);
    // The line itself can be dragged, too.
    const drag = (event) => {
      const frame = stack.getBoundingClientRect();
      swipe.value = Math.round((100 * (event.clientX - frame.left)) / frame.width);
      swipe.dispatchEvent(new Event("input"));
    };
    line.addEventListener("pointerdown", (event) => {
      line.setPointerCapture(event.pointerId);
      line.addEventListener("pointermove", drag);
    });
    for (const end of ["pointerup", "pointercancel"]) line.addEventListener(end, () => line.removeEventListener("pointermove", drag));
  }
  const points = svgOver(photo.width, photo.height, "");
  const pairs = svgOver(photo.width, photo.height, "");
  const factors = [1, 5, 20, 0];
  const draw = (which) => {
    points.firstChild.innerHTML = markPaths(query.points, photo, factors[which]);
    pairs.firstChild.innerHTML = markPaths(query.pairs, photo, factors[which]);
  };
  draw(0);
  stack.append(points, pairs);
  box(`2D-3D matches (${query.inliers_2d3d} inliers)`, true, points);
  box(`2D-2D matches (${query.inliers_2d2d} inliers)`, false, pairs);
  controls.append(choice("residuals", ["as long as they are", "5 times", "20 times", "none"], draw, 0));
  return element("article", { class: "panel wide" }, element("h3", {}, query.reason && query.rendering
    ? "Photograph and the nearest candidate, which is not sure enough" : "Photograph and pose"), controls, stack,
    element("p", { class: "soft" }, query.rendering
      ? "Left of the line the photograph, right of it the mesh from the pose. Circles are inliers, crosses are not; lines are residuals."
      : "Circles are inliers, crosses are not; lines are residuals."));
}

// The reference with most inliers beside the query.
function matchedReference(query, photo) {
  const reference = query.reference.photo || (data.reference_photos || {})[query.reference.name];
  if (!reference) return null;
  // Both are drawn at the height of the first.
  const scale = photo.height / reference.height;
  const width = photo.width + scale * reference.width;
  const lines = query.reference.lines.map(([x, y, u, v, inlier]) =>
    `<line x1="${x}" y1="${y}" x2="${photo.width + scale * u}" y2="${scale * v}" stroke="${inlier ? marks.inlier : marks.other}" `
    + `stroke-width="${width / 900}" opacity="${inlier ? 0.9 : 0.35}"/>`);
  const left = (100 * photo.width) / width;
  return element("article", { class: "panel wide" },
    element("h3", {}, `Matches with ${query.reference.name}`),
    element("div", { class: "photo pair" },
      element("img", { src: photo.uri, style: `width:${left}%`, alt: `photograph ${query.query}` }),
      element("img", { src: reference.uri, style: `width:${100 - left}%`, alt: `photograph ${query.reference.name}` }),
      svgOver(width, photo.height, lines.join(""))),
    element("p", { class: "soft" }, query.reason
      ? "The reference that most matches are of." : "The reference that most inliers are of. Orange: 2D-2D inliers."));
}

function verdictFacts(query) {
  if (!query.verdict) return [];
  const facts = [];
  const candidates = (query.references || []).map(({ name, matches }) => `${name} (${matches})`);
  if (candidates.length) facts.push(`matches are with ${candidates.join(", ")}`);
  else if (query.references) facts.push("it matches no reference");
  if (query.verdict !== "failed") {
    facts.push(`${query.verdict}: wrong with probability ${number(1 - query.confidence)}`);
    facts.push(`${query.inlier_keypoints} of ${query.keypoints} keypoints are inliers`);
    for (const other of query.alternatives || []) {
      facts.push(`a pose ${number(other.distance)} units away is the right one with probability ${number(other.probability)}`);
    }
    if (query.focal_px) facts.push(`focal length found with the pose: ${number(query.focal_px)} px`);
  }
  return facts;
}

// Of large runs each query's pictures are in a file of their own; `then` is called once they are there.
function loadPictures(query, then) {
  if (!query.file) return;
  window.takeQuery = (pictures) => { Object.assign(query, pictures, { file: null }); };
  document.head.append(element("script", { src: query.file, onload: then }));
}

function queryPictures(query) {
  const photo = query.photo;
  if (!photo || !query.points) return [];
  return [comparedPhoto(query, photo), query.reference ? matchedReference(query, photo) : null].filter(Boolean);
}

// The worst first.
const verdicts = ["failed", "doubtful", "localized"];
function worseFirst(a, b) {
  return verdicts.indexOf(a.verdict) - verdicts.indexOf(b.verdict) || (a.confidence ?? 0) - (b.confidence ?? 0)
    || (b.position_sigma ?? 0) - (a.position_sigma ?? 0);
}
