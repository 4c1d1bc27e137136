#include "retrieval_options.h"

#include <algorithm>

#include "pose_files.h"
#include "typed_options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

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

bool IsMesh(const std::string& geometry) { return geometry.starts_with("mesh:"); }

}  // namespace

bool RetrievalFlags::Any() const {
  return method || !global_features.references.empty() || !global_features.queries.empty() ||
         !prior_poses.empty() || !view_range.empty();
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
      std::none_of(geometry.begin(), geometry.end(), IsMesh)) {
    throw OptionError("--retrieval overlap needs --geometry mesh:PATH");
  }
  if (!(max_angle_deg > 0 && max_angle_deg <= 180)) {
    throw OptionError("--max-angle-deg", FormatDouble(max_angle_deg),
                      "must be above 0 and at most 180");
  }
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
  if (UsesPoses(options->method)) options->prior_poses = ReadGroundTruth(prior_poses);
}

void AddRetrievalOptions(CLI::App& app, RetrievalFlags& flags) {
  const std::string group = "Retrieval";
  AddEnumOption(app, "--retrieval", flags.method,
                "How references are found:\n" + Descriptions<RetrievalMethod>() +
                    "\n(default: vlad, or global where --global-features is given)")
      ->group(group);
  app.add_option("--global-features", flags.global_features.references,
                 "hloc's global-feats*.h5 (NetVLAD, AP-GeM, MegaLoc, ...)")
      ->group(group);
  app.add_option("--query-global-features", flags.global_features.queries,
                 "Those of the queries, where they are in another file")
      ->group(group);
  app.add_option("--prior-poses", flags.prior_poses,
                 "Roughly known poses of the queries, for pose and overlap:\n"
                 "COLMAP model folder or pose file")
      ->group(group);
  app.add_option("--max-angle-deg", flags.max_angle_deg,
                 "pose: the nearest cameras whose axes differ by at most this")
      ->capture_default_str()
      ->group(group);
  app.add_option("--view-range", flags.view_range,
                 "pose: NEAR,FAR in scene units: instead, the cameras that see most of\n"
                 "what the query sees at these distances")
      ->delimiter(',')
      ->group(group);
}

}  // namespace raylift
