#include "apps/matching_options.h"

#include <algorithm>

#include "lifting/mesh_spec.h"
#include "localization/fields.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

bool UsesPoses(RetrievalMethod method) {
  return method == RetrievalMethod::kPose || method == RetrievalMethod::kOverlap;
}

void RequireMethod(const char* option, bool is_given, RetrievalMethod wanted,
                   RetrievalMethod method) {
  if (is_given && method != wanted) {
    throw OptionError(fmt::format("{} goes with --retrieval {}, not {}", option, ToString(wanted),
                                  ToString(method)));
  }
}

}  // namespace

bool HlocFlags::Any() const {
  return !files.features.empty() || !files.matches.empty() || !files.pairs.empty();
}

bool HlocFlags::All() const {
  if (StandAlone(files.matches)) return files.features.empty();
  return !files.features.empty() && !files.matches.empty() && !files.pairs.empty();
}

void HlocFlags::Check() const {
  RequireAtLeast("--top-k", top_k, 1);
  if (Any() && !All()) {
    throw OptionError(
        "--features, --matches and --pairs go together: give all three or none (or COLMAP's "
        "database, or a folder of pairs, as --matches, with or without --pairs)");
  }
  if (reading.min_score && !Any()) {
    throw OptionError("--min-match-score", fmt::format("{}", *reading.min_score),
                      "needs --matches");
  }
  raylift::Check(reading);
  if ((reading.first_pixel != 0 || reading.cell_px != 0) && !IsFolder(files.matches)) {
    throw OptionError("--first-pixel and --cell-px go with a folder of pairs as --matches");
  }
}

void RequireWithoutHloc(const HlocFlags& flags, std::string_view options_are, bool are_given) {
  if (flags.Any() || are_given) return;
  throw OptionError(
      fmt::format("{} required where no --features, --matches and --pairs are given", options_are));
}

bool RetrievalFlags::Any() const {
  return method || !global_features.references.empty() || !global_features.queries.empty() ||
         !prior_poses.empty() || !view_range.empty();
}

void RetrievalFlags::CheckAngle() const {
  if (max_angle_deg > 0 && max_angle_deg <= 180) return;
  throw OptionError("--max-angle-deg", FormatDouble(max_angle_deg),
                    "must be above 0 and at most 180");
}

RetrievalOptions RetrievalFlags::Resolve(const std::vector<std::string>& geometry,
                                         Queries queries) const {
  RetrievalOptions options;
  options.method = method.value_or(global_features.references.empty() ? RetrievalMethod::kVlad
                                                                      : RetrievalMethod::kGlobal);
  RequireMethod("--global-features", !global_features.references.empty(), RetrievalMethod::kGlobal,
                options.method);
  RequireMethod("--query-global-features", !global_features.queries.empty(),
                RetrievalMethod::kGlobal, options.method);
  RequireMethod("--view-range", !view_range.empty(), RetrievalMethod::kPose, options.method);
  if (options.method == RetrievalMethod::kGlobal && global_features.references.empty()) {
    throw OptionError("--retrieval global needs --global-features");
  }
  options.global_features = global_features;
  if (queries == Queries::kReferences && !prior_poses.empty()) {
    throw OptionError("--prior-poses", prior_poses.string(), "needs --queries");
  }
  if (queries == Queries::kOwn && UsesPoses(options.method) && prior_poses.empty()) {
    throw OptionError(fmt::format("--retrieval {} needs --prior-poses", ToString(options.method)));
  }
  if (!UsesPoses(options.method) && !prior_poses.empty()) {
    throw OptionError(fmt::format("--prior-poses goes with --retrieval pose or overlap, not {}",
                                  ToString(options.method)));
  }
  if (options.method == RetrievalMethod::kOverlap &&
      std::none_of(geometry.begin(), geometry.end(), IsMeshSpec)) {
    throw OptionError("--retrieval overlap needs --geometry mesh:PATH or dsm:FILE");
  }
  CheckAngle();
  options.max_angle_deg = max_angle_deg;
  if (!view_range.empty()) {
    if (view_range.size() != 2 || !(view_range[0] > 0) || !(view_range[1] > view_range[0])) {
      throw OptionError("--view-range", fmt::format("{}", fmt::join(view_range, ",")),
                        "expected NEAR,FAR with 0 < NEAR < FAR");
    }
    options.view_range = ViewRange{view_range[0], view_range[1]};
  }
  return options;
}

void RetrievalFlags::ReadPriorPoses(RetrievalOptions* options) const {
  if (UsesPoses(options->method)) options->prior_poses = ReadModelOrPoses(prior_poses);
}

void AddRetrievalOptions(CLI::App& command, RetrievalFlags& flags) {
  const OptionGroup group(command, "Retrieval");
  group.Add("--retrieval", flags.method,
            "How references are found:\n" + Descriptions<RetrievalMethod>() +
                "\n(default: vlad, or global where --global-features is given)");
  group.Add("--global-features", flags.global_features.references,
            "hloc's global-feats*.h5 (NetVLAD, AP-GeM, MegaLoc, ...)");
  group.Add("--query-global-features", flags.global_features.queries,
            "Those of the queries, where they are in another file");
  group.Add("--prior-poses", flags.prior_poses,
            "Roughly known poses of the queries, for pose and overlap:\n"
            "COLMAP model folder or pose file");
  group.Add("--max-angle-deg", flags.max_angle_deg,
            "pose: the nearest cameras whose axes differ by at most this");
  group
      .Add("--view-range", flags.view_range,
           "pose: NEAR,FAR in scene units: instead, the cameras that see most of\n"
           "what the query sees at these distances")
      .Commas();
}

void MatchingFlags::Check(const std::vector<std::string>& geometry,
                          RetrievalFlags::Queries queries) const {
  hloc.Check();
  CheckRanges(ConstFieldsOf(front_end));
  if (hloc.Any() && retrieval.Any()) {
    throw OptionError("--pairs", hloc.files.pairs.string(),
                      "names the references: no options of retrieval go with it");
  }
  const RetrievalOptions resolved = retrieval.Resolve(geometry, queries);
  if (resolved.method == RetrievalMethod::kCovisibility &&
      queries == RetrievalFlags::Queries::kOwn) {
    throw OptionError("--retrieval", "covisibility", "queries observe no points of the model");
  }
}

MatchingOptions MatchingFlags::Resolve(const std::vector<std::string>& geometry,
                                       const std::filesystem::path& query_images,
                                       const std::filesystem::path& default_cache, uint64_t seed,
                                       const RunFlags& run, RetrievalFlags::Queries queries) const {
  MatchingOptions matching{.top_k = hloc.top_k};
  if (hloc.All()) {
    matching.hloc = hloc.files;
    matching.reading = hloc.reading;
    return matching;
  }
  matching.front_end = front_end;
  if (front_end.cache.empty()) matching.front_end.cache = default_cache;
  matching.front_end.query_images = query_images;
  matching.front_end.among_references = queries == RetrievalFlags::Queries::kReferences;
  matching.front_end.seed = seed;
  matching.front_end.threads = run.threads;
  matching.front_end.show_progress = !run.quiet;
  matching.retrieval = retrieval.Resolve(geometry, queries);
  matching.retrieval->threads = run.threads;
  matching.retrieval->show_progress = !run.quiet;
  retrieval.ReadPriorPoses(&*matching.retrieval);
  return matching;
}

std::unique_ptr<MatchSource> OpenMatchesBetween(const MatchingFlags& flags,
                                                const std::vector<std::string>& geometry,
                                                const std::filesystem::path& query_images,
                                                const RunFlags& run, const Scene& scene,
                                                const std::vector<Query>& queries,
                                                RetrievalFlags::Queries queries_are) {
  MatchingOptions matching = flags.Resolve(geometry, query_images, {}, 0, run, queries_are);
  if (matching.retrieval && queries_are == RetrievalFlags::Queries::kReferences) {
    matching.retrieval->prior_poses = PosesOf(scene.references);
  }
  return OpenMatches(scene, queries, matching);
}

void AddMatchingOptions(CLI::App& command, MatchingFlags& flags, const std::string& without_hloc,
                        const std::string& default_cache) {
  const OptionGroup group(command, "Matches");
  group.Add("--features", flags.hloc.files.features, "hloc's features.h5" + without_hloc);
  group.Add("--matches", flags.hloc.files.matches,
            "hloc's matches.h5; or COLMAP's database.db, or a folder of a file\n"
            "of each pair, QUERY__REFERENCE.npz or .npy (N x 4 pixels, or\n"
            "mkpts0, mkpts1; also scores), which need no --features and no --pairs");
  group.Add("--pairs", flags.hloc.files.pairs, "hloc's pairs list: query reference");
  group.Add(FieldsOf(flags.hloc.reading));
  group.Add("--top-k", flags.hloc.top_k, "Retrieved references per query");
  AddRetrievalOptions(command, flags.retrieval);
  group.Add(FieldsOf(flags.front_end));
  group.Add("--cache", flags.front_end.cache,
            fmt::format("Where RootSIFT features are kept (default: {})", default_cache));
}

}  // namespace raylift
