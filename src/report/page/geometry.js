// What was rendered, and what the doctor says of an input.
function pictureStrips(node, pictures) {
  node.append(element("div", { class: "keys" },
    colorKey("depth", data.depth_colors, number(data.depth_range[0]), `${number(data.depth_range[1])} units (log)`)));
  const strips = element("div", { class: "grid" });
  for (const picture of pictures) {
    const coverage = picture.coverage_percent === undefined ? "" : `, ${number(picture.coverage_percent, 1)} % covered`;
    strips.append(element("article", { class: "panel" }, element("h3", {}, picture.image + coverage),
      element("div", { class: "tiles even" }, ...picture.tiles.map((tile) => element("figure", {},
        element("img", { src: tile.uri, loading: "lazy", alt: tile.caption }), element("figcaption", {}, tile.caption))))));
  }
  node.append(strips);
}

function renderedSections({ images, pictures }) {
  const node = section("images", "Image by image", "What sees least comes first. Click a column's title to sort.");
  node.append(searchableTable("search images", [
    { title: "image", value: (row) => row.image },
    { title: "size, px", value: (row) => row.size },
    { title: "coverage, %", better: "high", value: (row) => row.coverage_percent, text: (row) => number(row.coverage_percent, 1) },
    { title: "nearest, units", value: (row) => row.nearest, text: (row) => number(row.nearest) },
    { title: "farthest, units", value: (row) => row.farthest, text: (row) => number(row.farthest) },
    { title: "files, kB", value: (row) => row.bytes, text: (row) => number(row.bytes / 1000) },
  ], [...images].sort((a, b) => a.coverage_percent - b.coverage_percent), (row) => row.image));
  const total = pictures.length < images.length ? `${pictures.length} of ${images.length} images, evenly spread. ` : "";
  pictureStrips(section("pictures", "Pictures", `${total}One color scale of depth for all, gray is a hole.`), pictures);
}

const doctorVerdicts = { as_meant: ["localized", "read as it is meant"], repair: ["doubtful", "another reading fits"],
  nothing_fits: ["failed", "nothing fits"], too_few_matches: ["doubtful", "too few matches to tell"] };

function doctorSections({ diagnosis, pictures }) {
  const [style, words] = doctorVerdicts[diagnosis.verdict];
  const fit = diagnosis.fit;
  const facts = [diagnosis.summary,
    `${diagnosis.matches} matches, ${diagnosis.matches_that_fit_the_poses} of them fit the poses (median distance from the epipolar line ${number(diagnosis.median_epipolar_px)} px)`];
  if (diagnosis.readings.length) {
    facts.push(`keypoints land ${number(fit.median_px)} px from their matches (median; ${number(fit.median_px_by_chance)} px if depths were dealt out at random)`);
  }
  const { geometry_keys: keys, options } = diagnosis.repair;
  const node = section("verdict", "Verdict");
  node.append(element("article", { class: "panel" }, element("h3", { class: `verdict ${style}` }, words),
    element("ul", {}, ...facts.map((fact) => element("li", {}, fact))),
    keys.length + options.length ? element("p", {}, "To add: ", element("code", {},
      [keys.length ? `in --geometry: ${keys.join(",")}` : "", ...options].filter(Boolean).join("; "))) : null));
  if (diagnosis.readings.length) {
    const readings = section("readings", "Readings", "Each reading lifts the keypoints elsewhere; under the right one they project onto their matches in the other references. "
      + "The gain is over the input as it is read, each map at its own scale.");
    readings.append(sortableTable([
      { title: "reading", value: (row) => row.reading },
      { title: "keypoints", value: (row) => row.keypoints },
      { title: "median, px", better: "low", value: (row) => row.median_px, text: (row) => number(row.median_px) },
      { title: "within 5 px, %", better: "high", value: (row) => row.share_within_5px, text: (row) => number(100 * row.share_within_5px, 1) },
      { title: "median at each map's scale, px", better: "low", value: (row) => row.median_own_scale_px, text: (row) => number(row.median_own_scale_px) },
      { title: "gain", better: "high", value: (row) => row.gain, text: (row) => number(row.gain, 3) },
      { title: "gain, standard errors", better: "high", value: (row) => row.standard_errors, text: (row) => number(row.standard_errors, 1) },
    ], diagnosis.readings, { tall: diagnosis.readings.length > 14 }));
  }
  pictureStrips(section("pictures", "Depth as it is read", "One color scale of depth for all, gray is a hole."), pictures);
}
