// raylift locate: finds the points of the world that pixels of localized photographs show.

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/command_line.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include "apps/pose_files.h"
#include "io/text/line_tokens.h"
#include "lifting/mesh_spec.h"
#include "localization/results/earth_exports.h"
#include "localization/results/pixel_location.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct LocateFlags {
  path run, pixels, out, queries, query_images;
  std::string geometry;
  std::optional<WorldFrame> world;
  RunFlags running;
};

struct Pixel {
  std::string name;
  Eigen::Vector2d pixel;
};

std::vector<Pixel> ReadPixels(const path& file) {
  std::vector<Pixel> pixels;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    std::string name(tokens.Name());
    pixels.push_back({std::move(name), tokens.Vector<2>("pixel")});
    tokens.ExpectEnd();
  }
  if (pixels.empty()) throw InputError(file, "expected lines `name x y`, found none");
  return pixels;
}

std::shared_ptr<const RayCaster> OpenSurface(const std::vector<std::string>& specs, int threads) {
  for (const std::string& spec : specs) {
    if (spec.starts_with("sfm") || spec.starts_with("depth")) continue;
    const NamedGeometry geometry = MakeGeometrySource(spec, {.threads = threads});
    PrintWarnings(geometry.warnings);
    if (const auto surface = geometry.Surface()) return surface;
  }
  throw OptionError("--geometry is required: the run has no mesh, surface model, cloud or splats");
}

class Locating {
 public:
  explicit Locating(const LocateFlags& flags) : flags_(flags), run_(ReadFinishedRun(flags.run)) {
    if (!flags.queries.empty()) run_.query_list = flags.queries;
    if (!flags.query_images.empty()) run_.query_images = flags.query_images;
    if (!flags.geometry.empty()) run_.geometry = {flags.geometry};
    if (flags.world) run_.world = flags.world;
    for (const LocalizedQuery& query : run_.queries) place_.emplace(query.name, std::nullopt);
    std::erase_if(run_.queries, [](const LocalizedQuery& query) { return !query.localized(); });
    const std::vector<Query> listed = run_.PosedQueries();
    for (size_t i = 0; i < listed.size(); ++i) {
      place_[listed[i].name] = cameras_.size();
      cameras_.push_back(run_.queries[i].estimate.refined_camera.value_or(listed[i].camera));
    }
    if (run_.world) earth_.emplace(*run_.world);
  }

  void Write() {
    const std::vector<Pixel> pixels = ReadPixels(flags_.pixels);
    for (const Pixel& pixel : pixels) Check(pixel);
    surface_ = OpenSurface(InWorld(run_.geometry, run_.world), flags_.running.threads);
    TableRow head = {"name", "x_px", "y_px", "status", "x",  "y", "z",
                     "xx",   "xy",   "xz",   "yy",     "yz", "zz"};
    if (earth_) head.insert(head.end(), {"longitude", "latitude", "height"});
    std::string text = CsvLine(head);
    for (const Pixel& pixel : pixels) {
      TableRow row = Row(pixel);
      row.resize(head.size());
      text += CsvLine(row);
    }
    if (flags_.out.empty()) {
      fmt::print("{}", text);
    } else {
      WriteFile(flags_.out, text);
    }
    if (earth_ && num_located_ > 0) {
      if (const auto warning = earth_->Warning()) PrintWarning(*warning);
    }
    if (flags_.out.empty() || flags_.running.quiet) return;
    fmt::print(
        "{} pixels, {} on the surface, {} sky, {} of photographs that are not localized: {}\n",
        pixels.size(), num_located_, num_sky_, pixels.size() - num_located_ - num_sky_,
        flags_.out.string());
  }

 private:
  void Check(const Pixel& pixel) const {
    const auto known = place_.find(pixel.name);
    if (known == place_.end()) {
      throw InputError(flags_.pixels, pixel.name, "the run has no such photograph");
    }
    if (!known->second) return;
    const Camera& camera = cameras_[*known->second];
    const Eigen::Array2d at = pixel.pixel.array();
    if ((at >= 0).all() && at.x() <= camera.width_px() && at.y() <= camera.height_px()) return;
    throw InputError(flags_.pixels, pixel.name,
                     fmt::format("pixel {:g} {:g} is not in the photograph of {} x {}", at.x(),
                                 at.y(), camera.width_px(), camera.height_px()));
  }

  // Returns the fields that are known.
  TableRow Row(const Pixel& pixel) {
    TableRow row = {pixel.name, FormatDouble(pixel.pixel.x()), FormatDouble(pixel.pixel.y())};
    const auto& place = place_.at(pixel.name);
    if (!place) {
      row.push_back("not localized");
      return row;
    }
    const auto located =
        LocatePixel(*surface_, run_.queries[*place].estimate, cameras_[*place], pixel.pixel);
    ++(located ? num_located_ : num_sky_);
    row.push_back(located ? "surface" : "sky");
    if (!located) return row;
    for (const double x : located->point_in_world) row.push_back(FormatDouble(x));
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) {
        const auto& covariance = located->covariance;
        row.push_back(covariance ? FormatDouble((*covariance)(i, j)) : "");
      }
    }
    if (earth_) {
      for (const double x : earth_->At(located->point_in_world).geographic) {
        row.push_back(FormatDouble(x));
      }
    }
    return row;
  }

  const LocateFlags& flags_;
  FinishedRun run_;
  std::map<std::string, std::optional<size_t>> place_;  // by name; index among those with a pose
  std::vector<Camera> cameras_;
  std::optional<EarthFrame> earth_;
  std::shared_ptr<const RayCaster> surface_;
  size_t num_located_ = 0, num_sky_ = 0;
};

void Run(const LocateFlags& flags) {
  flags.running.Check();
  if (!flags.out.empty()) RequireWritable(flags.out);
  Locating(flags).Write();
}

}  // namespace

Command AddLocateCommand(CLI::App& program) {
  auto flags = std::make_shared<LocateFlags>();
  CLI::App& command =
      AddCommand(program, "locate", "The points that pixels of localized photographs show");
  const OptionGroup options(command);
  options.Add("RUN", flags->run, "Folder of a run of localize").Required();
  options.Add("--pixels", flags->pixels, "Lines `name x y`; the first pixel's center is at 0.5 0.5")
      .Required();
  options.Add("--out", flags->out, "Table to write (CSV; default: printed)");
  const OptionGroup group(command, "What the run's options.json says, from another place");
  group.Add("--queries", flags->queries, "List of queries: name MODEL width height params...");
  group.Add("--query-images", flags->query_images,
            "Folder of the query photographs, for names that stand alone in the list");
  group.Add("--geometry", flags->geometry, "mesh:PATH, dsm:FILE, cloud:PATH or splat:PATH");
  AddCrsOption(group, flags->world);
  AddRunOptions(command, flags->running);
  SetFooter(
      command,
      R"(Writes a line for each pixel: name, pixel, status (surface, sky, not localized), the point
in the world, and its covariance (xx to zz, squares of scene units) of the pose and the
surface together; where --crs or the run says what the world's coordinates are, longitude,
latitude (WGS 84) and height besides. The covariance is what the pose's is, so a silhouette's
other side is not in it.
Example:
  raylift locate result --pixels pixels.txt --crs EPSG:32632)");
  return {&command, [flags] { UntilSignal([&] { Run(*flags); }, &BeginsAnew); }};
}

}  // namespace raylift
