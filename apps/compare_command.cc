// raylift compare: compares several sources of geometry side by side.

#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "apps/argument_files.h"
#include "apps/command_line.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/job_options.h"
#include "apps/matching_options.h"
#include "apps/options.h"
#include "apps/pose_files.h"
#include "base/json_text.h"
#include "base/progress.h"
#include "comparison/comparison_tables.h"
#include "estimation/fields.h"
#include "lifting/fields.h"
#include "localization/calibration_images.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/comparison/depth_comparison.h"
#include "raylift/comparison/localization_comparison.h"
#include "raylift/comparison/report.h"
#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/io/query_list.h"
#include "raylift/jobs/task_job.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Returns the bytes of the depth maps of an image and its neighbors, for two threads: a larger
// cache would only grow with the scene.
size_t CacheBytes(std::span<const PosedImage> images) {
  constexpr size_t kMaps = 24;
  size_t pixels = 1;
  for (const PosedImage& image : images) {
    pixels = std::max(pixels, static_cast<size_t>(image.camera.width_px()) *
                                  static_cast<size_t>(image.camera.height_px()));
  }
  return kMaps * sizeof(float) * pixels;
}

struct CompareFlags {
  ReferenceFlags references;
  std::vector<std::string> geometry;
  std::string truth;
  int max_side_px = 640;
  int overlaps = 5;
  std::vector<DepthProtocol> protocols;
  double min_depth = 0;
  std::optional<double> max_depth;
  std::vector<double> surface_thresholds;
  path queries;
  MatchingFlags matching;
  path ground_truth;
  std::string thresholds = "0.05,5:0.1,1:0.25,2";
  std::string methods = "p3p,e5p1,adaptive,select";
  std::vector<FilterMode> filters = {FilterMode::kOff};
  std::vector<AlignMode> alignments = {AlignMode::kOff};
  ConsistencyThresholds filter_thresholds;
  CandidateOptions candidates;
  EstimatorOptions estimator;
  path out, report, images, query_images;
  JobFlags running;  // not shared
  RunFlags run;

  // Returns the folder that keeps what is done; empty where nothing is kept.
  const path& Folder() const { return out.empty() ? report : out; }

  DepthRange Range() const {
    DepthRange range{.min = min_depth};
    if (max_depth) range.max = *max_depth;
    return range;
  }
};

// The file that is written last tells that a run is finished.
constexpr const char* kWrittenLast = "options.json";

// Returns the form of the job whose tasks are the localizations of queries.
JobForm CompareJobForm() {
  return {.results = {kWrittenLast, "comparison.json", "sources.csv", "images.csv", "curves.csv",
                      "localization.csv", "localization.json", "index.html"},
          .is_readable = [](const std::string& line) {
            const auto json = nlohmann::json::parse(line, nullptr, /*allow_exceptions=*/false);
            return json.is_object() && json.contains("outcomes");
          }};
}

struct NamedSpec {
  std::string name;
  std::string spec;
};

// Parses "name=SPEC"; without a name, the specification is its own.
NamedSpec ParseNamedSpec(const std::string& text) {
  const size_t equals = text.find('=');
  const bool is_named = equals != std::string::npos && equals < text.find_first_of(":,");
  if (!is_named) return {text, GeometrySpecOf(text)};
  if (equals == 0) throw OptionError("--geometry", text, "expected name=SPEC");
  return {text.substr(0, equals), GeometrySpecOf(text.substr(equals + 1))};
}

std::vector<NamedSpec> ParseSpecs(const CompareFlags& flags) {
  std::vector<NamedSpec> specs;
  std::set<std::string> names;
  for (const std::string& text : flags.geometry) {
    specs.push_back(ParseNamedSpec(text));
    if (!names.insert(specs.back().name).second) {
      throw OptionError("--geometry", text,
                        fmt::format("the name {} stands twice", specs.back().name));
    }
  }
  if (!flags.truth.empty() && !names.contains(flags.truth)) {
    throw OptionError("--truth", flags.truth, "must be the name of a --geometry");
  }
  return specs;
}

void Check(const CompareFlags& flags) {
  flags.run.Check();
  for (const path& folder : {flags.out, flags.report}) {
    if (!folder.empty())
      RefuseFinished(folder / kWrittenLast, flags.running.resume || flags.running.overwrite);
  }
  flags.running.Check();
  flags.references.Check();
  RequireAtLeast("--max-side", flags.max_side_px, 16);
  RequireAtLeast("--overlaps", flags.overlaps, 0);
  flags.Range().Validate();
  if (!flags.protocols.empty() && flags.truth.empty()) {
    throw OptionError("--protocol", ToString(flags.protocols.front()), "needs --truth");
  }
  for (const double threshold : flags.surface_thresholds) {
    if (!(threshold > 0)) {
      throw OptionError("--surface-thresholds", fmt::format("{}", threshold), "must be positive");
    }
  }
  std::vector<std::string> specs;
  for (const NamedSpec& named : ParseSpecs(flags)) specs.push_back(named.spec);
  flags.matching.Check(specs);
  flags.filter_thresholds.Validate();
  flags.candidates.Validate();
  if (flags.matching.hloc.Any() && flags.queries.empty()) {
    throw OptionError("--queries, --features, --matches and --pairs go together");
  }
  if (!flags.ground_truth.empty() && flags.queries.empty()) {
    throw OptionError("--ground-truth", flags.ground_truth.string(), "needs --queries");
  }
  if (!flags.queries.empty() && !flags.matching.hloc.Any()) {
    if (flags.images.empty() && !flags.references.HaveFeatures()) {
      throw OptionError("--queries", flags.queries.string(),
                        "needs --images, or hloc's --features, --matches and --pairs");
    }
    if (flags.matching.front_end.cache.empty() && flags.out.empty() && flags.report.empty()) {
      throw OptionError("--queries", flags.queries.string(), "needs --cache, --out or --report");
    }
  }
}

LocalizationGrid ParseGrid(const CompareFlags& flags) {
  LocalizationGrid grid;
  flags.estimator.Validate();
  grid.methods = ParseMethods(flags.methods, flags.estimator);
  grid.filters = flags.filters;
  grid.filter_thresholds = flags.filter_thresholds;
  grid.alignments = flags.alignments;
  grid.candidates = flags.candidates;
  grid.thresholds = ParseThresholds(flags.thresholds);
  grid.seed = flags.estimator.seed;
  grid.threads = flags.run.threads;
  return grid;
}

// Opens the references and all sources.
Scene OpenSceneOf(const CompareFlags& flags) {
  Scene scene = OpenScene(flags.references.Scene(flags.images, {}, flags.run.threads));
  PrintWarnings(scene.warnings);
  for (const NamedSpec& named : ParseSpecs(flags)) {
    OpenGeometry(
        scene, named.spec,
        {.max_cache_bytes = CacheBytes(scene.references.images), .threads = flags.run.threads});
    SceneSource& opened = scene.sources.back();
    opened.name = named.name;
    for (const std::string& warning : opened.geometry.warnings) {
      PrintWarning(fmt::format("{}: {}", named.name, warning));
    }
  }
  return scene;
}

class CompareRun {
 public:
  explicit CompareRun(const CompareFlags& flags)
      : flags_(flags),
        grid_(ParseGrid(flags)),
        scene_(OpenSceneOf(flags)),
        sources_(ComparedSourcesOf(scene_)) {
    for (size_t i = 0; i < sources_.size(); ++i) {
      if (sources_[i].name == flags.truth) truth_ = i;
    }
    if (!flags.out.empty()) RequireWritable(flags.out / "comparison.json");
    if (!flags.report.empty()) RequireWritable(flags.report / "index.html");
  }

  void Run(const std::string& options_json) {
    const std::vector<PosedImage>& images = scene_.references.images;
    OpenMatchSource();
    if (!flags_.Folder().empty()) OpenJob(options_json);
    const std::vector<ReferenceMatch> matches =
        match_source_ ? CollectReferenceMatches(queries_, *match_source_, scene_.references,
                                                flags_.run.threads)
                      : std::vector<ReferenceMatch>();
    const CommittedFiles results;
    const ReportOptions report_options = ReportOptionsOf();
    std::unique_ptr<ReportPictures> pictures;
    if (!flags_.report.empty()) {
      pictures = std::make_unique<ReportPictures>(sources_, images, truth_, report_options);
    }
    DepthComparison comparison;
    {
      std::optional<Progress> progress(std::in_place, "views", images.size() * sources_.size(),
                                       flags_.run.Show());
      size_t num_judged = 0;
      DepthComparisonOptions options;
      options.truth = truth_;
      options.max_side_px = flags_.max_side_px;
      options.max_overlaps = flags_.overlaps;
      options.range = flags_.Range();
      options.surface_thresholds = flags_.surface_thresholds;
      options.threads = flags_.run.threads;
      options.on_progress = [&progress] { progress->Advance(); };
      options.on_judged = [&] {
        if (num_judged++ == 0) progress.emplace("sources", sources_.size(), flags_.run.Show());
        progress->Advance();
      };
      if (pictures) {
        options.on_views = [&pictures](size_t image, const PosedImage& view,
                                       std::span<const SourceView> views) {
          pictures->Take(image, view, views);
        };
      }
      comparison = CompareDepth(sources_, images, matches, options);
    }
    for (const path& folder : {flags_.out, flags_.report}) {
      if (!folder.empty()) WriteTables(folder, comparison);
    }
    if (!flags_.run.quiet) {
      PrintStride(images);
      fmt::print("{}", FormatComparisonText(comparison, flags_.protocols));
    }
    std::optional<LocalizationComparison> localization;
    if (!flags_.ground_truth.empty()) localization = CompareByLocalization(matches);
    if (pictures) {
      const std::vector<PosedImage> true_queries =
          flags_.ground_truth.empty() ? std::vector<PosedImage>()
                                      : ReadPosedQueries(flags_.ground_truth, flags_.queries);
      WriteFile(flags_.report / "index.html",
                FormatReport(comparison, localization ? &*localization : nullptr, *pictures, images,
                             true_queries, report_options));
    }
    for (const path& folder : {flags_.out, flags_.report}) {
      if (!folder.empty()) WriteFile(folder / kWrittenLast, OptionsOfResults(options_json));
    }
    if (job_) job_->Finish(job_->Whole().value(), results.paths());
    if (match_source_) {
      PrintWarnings(match_source_->Warnings());
    }
  }

 private:
  path QueryImages() const {
    return QueryImagesOf(flags_.query_images, flags_.images, flags_.queries);
  }

  void PrintStride(std::span<const PosedImage> images) const {
    int stride = 1;
    for (const PosedImage& image : images) {
      stride = std::max(stride, ComparedStride(image.camera, flags_.max_side_px));
    }
    if (stride == 1) return;
    fmt::print("of images larger than --max-side {}, one pixel in {} x {} is compared\n",
               flags_.max_side_px, stride, stride);
  }

  ReportOptions ReportOptionsOf() const {
    ReportOptions options;
    options.title = fmt::format("Raylift: {}", flags_.references.model.lexically_normal().string());
    options.images = flags_.images;
    options.query_images = QueryImages();
    return options;
  }

  static void WriteTables(const path& folder, const DepthComparison& comparison) {
    WriteFile(folder / "sources.csv", FormatSourcesCsv(comparison));
    WriteFile(folder / "images.csv", FormatImagesCsv(comparison));
    WriteFile(folder / "curves.csv", FormatCurvesCsv(comparison));
    WriteFile(folder / "comparison.json", FormatComparisonJson(comparison));
  }

  // Begins the manifest: from now on nothing else is left of a former run that is overwritten.
  void OpenJob(const std::string& options_json) {
    const std::vector<std::string> names = NamesOf(std::span(queries_).first(NumTasks()));
    job_ = std::make_unique<TaskJob>(names, Header(options_json),
                                     flags_.running.In(flags_.Folder()), CompareJobForm());
    job_->Begin(std::nullopt);
  }

  // Returns the number of queries that are localized.
  size_t NumTasks() const { return flags_.ground_truth.empty() ? 0 : queries_.size(); }

  std::string Header(const std::string& options_json) const {
    nlohmann::ordered_json inputs = InputsJson({.model = flags_.references.model,
                                                .images = flags_.images,
                                                .query_images = QueryImages(),
                                                .out = flags_.Folder(),
                                                .matching = flags_.matching,
                                                .threads = flags_.run.threads},
                                               scene_, queries_);
    if (!flags_.ground_truth.empty()) {
      inputs["ground-truth"] = FileOrModelFingerprint(flags_.ground_truth);
    }
    return JobHeader(
        nlohmann::ordered_json::parse(options_json), NumTasks(),
        {"scene", "model", "images", "queries", "query-images", "features", "matches", "pairs",
         "cache", "prior-poses", "global-features", "query-global-features", "ground-truth",
         "report", "max-side", "overlaps", "surface-thresholds", "truth", "thresholds"},
        inputs);
  }

  LocalizationHooks JobHooks() const {
    if (!job_) return {};
    std::map<size_t, std::string> kept;
    for (const auto& [key, record] : job_->manifest().records) {
      kept.emplace(record.place, nlohmann::json::parse(record.line).at("outcomes").dump());
    }
    LocalizationHooks hooks;
    hooks.kept = [kept](size_t query) -> std::optional<std::string> {
      const auto found = kept.find(query);
      return found == kept.end() ? std::nullopt : std::optional(found->second);
    };
    hooks.keep = [this](size_t query, const std::string& outcomes) {
      job_->Add(query, JsonText(nlohmann::ordered_json{
                           {"name", queries_[query].name},
                           {"place", query},
                           {"key", job_->key(query)},
                           {"outcomes", nlohmann::ordered_json::parse(outcomes)}}));
    };
    return hooks;
  }

  LocalizationComparison CompareByLocalization(const std::vector<ReferenceMatch>& matches) const {
    const PosesByName truth = ReadModelOrPoses(flags_.ground_truth);
    LocalizationComparison comparison;
    {
      Progress progress("queries", queries_.size(), flags_.run.Show());
      LocalizationHooks hooks = JobHooks();
      hooks.on_query = [&progress] { progress.Advance(); };
      comparison =
          CompareLocalization(scene_, queries_, match_source_, matches, truth, grid_, hooks);
    }
    for (const path& folder : {flags_.out, flags_.report}) {
      if (folder.empty()) continue;
      WriteFile(folder / "localization.csv", FormatLocalizationCsv(comparison));
      WriteFile(folder / "localization.json", FormatLocalizationJson(comparison));
    }
    if (!flags_.run.quiet) fmt::print("\n{}", FormatLocalizationText(comparison));
    return comparison;
  }

  void OpenMatchSource() {
    if (flags_.queries.empty()) return;
    queries_ = ReadQueryList(flags_.queries, QueryImages());
    std::vector<std::string> specs;
    for (const ComparedSource& source : sources_) specs.push_back(source.spec);
    const MatchingOptions matching = flags_.matching.Resolve(
        specs, QueryImages(), (flags_.out.empty() ? flags_.report : flags_.out) / "cache",
        flags_.estimator.seed, flags_.run);
    match_source_ = OpenMatches(scene_, queries_, matching);
  }

  const CompareFlags& flags_;
  LocalizationGrid grid_;
  Scene scene_;
  std::vector<Query> queries_;
  std::shared_ptr<MatchSource> match_source_;
  std::vector<ComparedSource> sources_;
  std::optional<size_t> truth_;
  std::unique_ptr<TaskJob> job_;  // null where nothing is kept
};

void AddLocalizationOptions(CLI::App& command, CompareFlags& flags) {
  const OptionGroup group(command, "Localization with every source, on the same matches");
  group.Add("--ground-truth", flags.ground_truth,
            "True poses of the queries: COLMAP model folder or pose file");
  group.Add(
      "--thresholds", flags.thresholds,
      "Recall thresholds: position,degrees between colons, or those of\n" + ThresholdPresetNames());
  group.Add("--methods", flags.methods, "List of " + MethodForms());
  group.AddList("--filters", flags.filters, "List of {}");
  group.AddList("--alignments", flags.alignments, "List of {}");
  group.Add(FieldsOf(flags.filter_thresholds));
  group.Add(FieldsOf(flags.candidates));
  group.Add(NumberFieldsOf(flags.estimator));
}

}  // namespace

Command AddCompareCommand(CLI::App& program) {
  auto flags = std::make_shared<CompareFlags>();
  CLI::App& command =
      AddCommand(program, "compare",
                 "Which source of geometry is best, where, and what is wrong with the others");
  AddSceneOption(command);
  AddReferenceOptions(command, flags->references);
  AddModelPosesOption(command, flags->references);
  const OptionGroup geometry(command, "Geometry");
  geometry.Add("--geometry", flags->geometry, "name=SPEC, repeated. " + GeometryHelp())
      .Required()
      .OnePerUse();
  geometry.Add("--truth", flags->truth, "Name of the geometry to take for the truth");
  geometry.AddList("--protocol", flags->protocols,
                   "Print the standard metrics of depth networks' papers, aligned with the truth\n"
                   "image by image: list of {}\n" +
                       Descriptions<DepthProtocol>());
  geometry.Add("--min-depth", flags->min_depth,
               "Errors count true depths from here, and depth is clamped to it; scene units");
  geometry.Add("--max-depth", flags->max_depth,
               "The same up to here (NYU's protocol: 10 m; KITTI's: 80 m)");
  geometry.Add("--max-side", flags->max_side_px,
               "Images of a longer side than this, pixels, are compared at every n-th pixel");
  geometry.Add("--overlaps", flags->overlaps,
               "Overlapping images that each image is compared with; 0: none");
  geometry
      .Add("--surface-thresholds", flags->surface_thresholds,
           "Of accuracy, completeness and F-score against a mesh, scene units\n"
           "(default: 1, 2 and 5 % of the median depth)")
      .Commas();
  const OptionGroup matches(command, "Matches");
  matches.Add("--queries", flags->queries, "List of queries, whose matches are used");
  AddMatchingOptions(command, flags->matching, "; without it, RootSIFT of --images",
                     "OUT/cache or REPORT/cache");
  AddLocalizationOptions(command, *flags);
  const OptionGroup output(command, "Output");
  output.Add("--out", flags->out,
             "Folder for sources.csv, images.csv, curves.csv, comparison.json");
  output.Add("--report", flags->report,
             "Folder for one HTML page to look at (index.html), and the same tables");
  matches.Add("--images", flags->images, "Photographs of the references, for matches and the page");
  matches.Add("--query-images", flags->query_images,
              "Photographs of the queries (default: --images)");
  const OptionGroup running(command, "Running");
  running.Flag("--resume", flags->running.resume,
               "Go on where a run of the same options and inputs was stopped or killed:\n"
               "queries that are localized are kept; it ends with the same bytes");
  AddOverwriteOption(command, flags->running.overwrite);
  AddRunOptions(command, flags->run);
  SetFooter(
      command,
      "Each query that is localized is kept in manifest.jsonl; a signal ends the run between two\n"
      "images or queries (exit code 4). Shards are what `raylift experiment` has, for many\n"
      "queries in many ways.\n"
      "Examples:\n"
      "  raylift compare --model sfm --geometry mesh=mesh:scene.ply \\\n"
      "      --geometry mono=depth:metric3d --truth mesh --out comparison\n"
      "  A row of a depth network's paper, at the maps' own size:\n"
      "  raylift compare --model sfm --geometry lidar=depth:lidar --truth lidar \\\n"
      "      --geometry midas=depth:midas,kind=inverse --protocol affine-inverse \\\n"
      "      --max-depth 80 --max-side 100000\n"
      "  Without a truth, by overlapping views and matches:\n"
      "  raylift compare --model sfm --geometry a=depth:a --geometry b=depth:b \\\n"
      "      --queries queries.txt --images photos --out comparison\n"
      "  and what the sources do to localization, with --ground-truth truth \\\n"
      "      --methods p3p,e5p1,adaptive,select:0.7,select:0.9 --filters off,auto");
  return {&command, [flags, &command] {
            Check(*flags);
            UntilSignal([&] { CompareRun(*flags).Run(EffectiveOptionsJson(command)); },
                        [] { return "stopped by a signal; --resume goes on"; });
          }};
}

}  // namespace raylift
