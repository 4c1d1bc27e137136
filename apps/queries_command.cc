// raylift queries: writes lists of queries and priors from the metadata of photographs.

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/command_line.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include "base/input_paths.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/geometry/geodesy.h"
#include "raylift/io/pose_priors.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct QueriesFlags {
  std::vector<path> photographs;
  path query_images, out, priors;
  std::optional<WorldFrame> world;
  bool quiet = false;
};

// Returns the absolute path, in which a photograph that is a link keeps its own name.
path Whole(const path& given) {
  const path whole = std::filesystem::absolute(given).lexically_normal();
  return whole.has_filename() ? whole : whole.parent_path();
}

// Returns the folder that names start at: the given one, a folder of photographs, or that of all
// files.
path RootOf(const QueriesFlags& flags) {
  if (!flags.query_images.empty()) return Whole(flags.query_images);
  std::optional<path> root;
  for (const path& photograph : flags.photographs) {
    const path whole = Whole(photograph);
    const path folder = std::filesystem::is_directory(whole) ? whole : whole.parent_path();
    if (!root) root = folder;
    const auto [in_root, in_folder] =
        std::mismatch(root->begin(), root->end(), folder.begin(), folder.end());
    path common;
    for (auto part = root->begin(); part != in_root; ++part) common /= *part;
    root = common;
  }
  return *root;
}

std::vector<Query> QueriesOf(const QueriesFlags& flags, const path& root) {
  std::vector<Query> queries;
  for (const path& photograph : flags.photographs) {
    const path whole = Whole(photograph);
    if (std::filesystem::is_directory(whole)) {
      const std::vector<Query> below = ReadQueryList(whole, root);
      queries.insert(queries.end(), below.begin(), below.end());
      continue;
    }
    const auto name = Below(whole, root);
    if (!name) {
      throw InputError(photograph, fmt::format("expected a photograph in {}", root.string()));
    }
    queries.push_back(QueryOfUnknownCamera(name->string(), root));
  }
  std::ranges::sort(queries, {}, &Query::name);
  const auto twice = std::ranges::adjacent_find(queries, {}, &Query::name);
  if (twice != queries.end()) throw InputError(root / twice->name, "is given twice");
  return queries;
}

// Prints how far heights above the ellipsoid and above the sea's level are apart, where PROJ knows
// it.
void PrintHeights(const PhotographTags::Position& position) {
  const Eigen::Vector3d& point = position.point;
  const CrsTransform transform(Crs("EPSG:4326+5773"), Crs("EPSG:4979"));
  const double geoid_m = transform({point.x(), point.y(), 0}).z();
  if (transform.Warning()) return;
  fmt::print("heights: there, the sea's level (EGM96) is {:.1f} m {} the ellipsoid (WGS 84)\n",
             std::abs(geoid_m), geoid_m < 0 ? "below" : "above");
}

void Run(const QueriesFlags& flags) {
  RequireWritable(flags.out);
  RequireWritable(flags.priors);
  const path root = RootOf(flags);
  const std::vector<Query> queries = QueriesOf(flags, root);
  std::string priors = flags.world ? fmt::format("* world_crs {}\n", flags.world->text) : "";
  std::vector<PriorText> texts;
  std::optional<PhotographTags::Position> first;
  size_t num_positions = 0, num_headings = 0;
  for (const Query& query : queries) {
    const PhotographTags tags = ReadPhotographTags(root / query.name);
    if (tags.position && !first) first = tags.position;
    num_positions += tags.position ? 1 : 0;
    num_headings += tags.heading_deg ? 1 : 0;
    const std::string known = FormatPhotographPriors(query.name, tags);
    priors += known;
    texts.push_back({root / query.name, known});
    if (query.priors.focal_range != 1) {
      priors += FormatFocalRange(query.name, query.priors.focal_range);
    }
    if (!flags.quiet) fmt::print("{}: {}\n", query.name, tags.summary);
  }
  // Positions outside of the coordinate system's area of use are errors before anything is written.
  std::vector<std::string> warnings;
  if (flags.world) ParsePosePriors(texts, flags.world, &warnings);
  WriteQueryList(flags.out, queries);
  WriteFile(flags.priors, priors);
  for (const std::string& warning : warnings) PrintWarning(warning);
  if (flags.quiet) return;
  if (first) PrintHeights(*first);
  fmt::print("{} photographs, {} with a position, {} with a heading: {}, {}\n", queries.size(),
             num_positions, num_headings, flags.out.string(), flags.priors.string());
}

}  // namespace

Command AddQueriesCommand(CLI::App& program) {
  auto flags = std::make_shared<QueriesFlags>();
  CLI::App& command =
      AddCommand(program, "queries", "Lists of queries and priors from photographs' EXIF and XMP");
  const OptionGroup options(command);
  options.Add("PHOTOGRAPHS", flags->photographs, "Photographs, or folders of them").Required();
  options.Add("--out", flags->out, "List of queries to write, for localize --queries").Required();
  options.Add("--priors", flags->priors, "Priors to write, for localize --priors").Required();
  options.Add("--query-images", flags->query_images,
              "Folder that the names start at (default: the one of all photographs)");
  AddCrsOption(options, flags->world);
  options.Flag("--quiet", flags->quiet, "Print nothing but warnings");
  AddConfigOption(command);
  SetFooter(
      command,
      R"(Reads the GPS position with its error and the direction that phones write, the gimbal's
angles, deviations by RTK, the laser's range and the lens's calibration that DJI's and Autel's
drones write, and the focal length on film.
Positions are of WGS 84 in the priors: longitude, latitude, and height above the sea
(crs=EPSG:4326+5773), by RTK above the ellipsoid (EPSG:4979), or none (EPSG:4326); --crs says
what the scene's own coordinates are, to which localize leads them. Where a photograph states
no standard deviation, it is 3 m (drones) or 8 m (phones) across, 2 degrees for a gimbal's tilt
and 10 to 25 for headings. A height's is 20 m, as ellipsoid and sea level are taken for each
other, together with twice that across (21 or 26 m in all), or 3000 m without an altitude. The
lists are text to be changed by hand.
Example:
  raylift queries photos --out queries.txt --priors priors.txt
  raylift localize --geometry dsm:dsm.tif,ortho=ortho.tif --queries queries.txt \
      --query-images photos --priors priors.txt --out result)");
  return {&command, [flags] { UntilSignal([&] { Run(*flags); }, &BeginsAnew); }};
}

}  // namespace raylift
