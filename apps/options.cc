#include "apps/options.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

#include "apps/program.h"
#include "base/input_paths.h"
#include "estimation/fields.h"
#include "io/map/packed_map.h"
#include "lifting/fields.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

std::optional<Eigen::Vector3d> ParseUp(std::string_view option, const std::string& text) {
  if (text == "auto") return std::nullopt;
  constexpr std::array<std::string_view, 3> kAxes = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    const std::string name(kAxes[static_cast<size_t>(axis)]);
    if (text == name) return Eigen::Vector3d::Unit(axis);
    if (text == "-" + name) return Eigen::Vector3d(-Eigen::Vector3d::Unit(axis));
  }
  const auto parts = SplitBy(text, ',');
  Eigen::Vector3d up = Eigen::Vector3d::Zero();
  for (size_t i = 0; parts.size() == 3 && i < 3; ++i) {
    up[static_cast<int>(i)] = ParseDouble(parts[i]).value_or(std::nan(""));
  }
  if (!up.allFinite() || up.norm() == 0) {
    throw OptionError(option, text, "expected auto|x|y|z|-x|-y|-z or X,Y,Z");
  }
  return up;
}

EstimatorOptions ParseMethod(std::string_view text, EstimatorOptions options) {
  const size_t colon = text.find(':');
  const auto method = FromName<Method>(text.substr(0, colon));
  const auto fail = [text](const std::string& constraint) {
    return OptionError("--methods", text, constraint);
  };
  if (!method) throw fail("expected " + MethodForms());
  options.method = *method;
  if (colon == std::string_view::npos) return options;
  const std::string_view detail = text.substr(colon + 1);
  if (*method == Method::kAdaptive) {
    const auto score = FromName<ScoreCombination>(detail);
    if (!score) throw fail("expected adaptive:" + NameList<ScoreCombination>());
    options.score = *score;
  } else if (*method == Method::kSelect) {
    const auto alpha = ParseDouble(detail);
    if (!alpha) throw fail("expected select:ALPHA");
    options.alpha = *alpha;
  } else {
    throw fail("only adaptive has a score and select an alpha");
  }
  options.Validate();
  return options;
}

}  // namespace

void AddEstimatorOptions(CLI::App& command, EstimatorOptions& options) {
  OptionGroup(command, "Estimator").Add(FieldsOf(options));
}

std::string MethodForms() {
  std::string forms;
  for (const Method method : AllValues<Method>()) {
    if (!forms.empty()) forms += '|';
    forms += ToString(method);
    if (method == Method::kAdaptive) forms += "[:SCORE]";
    if (method == Method::kSelect) forms += "[:ALPHA]";
  }
  return forms;
}

std::vector<EstimatorOptions> ParseMethods(std::string_view text, const EstimatorOptions& base) {
  std::vector<EstimatorOptions> methods;
  for (const std::string_view part : SplitBy(text, ',')) methods.push_back(ParseMethod(part, base));
  return methods;
}

void AddFilterOptions(CLI::App& command, FilterOptions& options) {
  OptionGroup(command, "Consistency filter").Add(FieldsOf(options));
}

void AddModelPosesOption(CLI::App& command, ReferenceFlags& flags) {
  OptionGroup(command, "References")
      .Add("--model-poses", flags.poses,
           "What the model's poses are, where they are not as COLMAP writes\n"
           "them: {}");
}

void GeometryFlags::Check() const {
  const bool is_asked_for = align != AlignMode::kOff && align != AlignMode::kAuto;
  if (is_asked_for && specs.empty()) {
    throw OptionError("--align-depth", ToString(align), "needs --geometry");
  }
  candidates.Validate();
}

void AddGeometryOptions(CLI::App& command, GeometryFlags& flags) {
  const OptionGroup geometry(command, "Geometry");
  geometry.Add("--geometry", flags.specs, GeometryHelp()).OnePerUse();
  geometry.Add("--geometry-mode", flags.mode,
               "Of several sources: {}. The point of the first that\n"
               "has one, or the points of all");
  geometry.Add("--align-depth", flags.align,
               "Correct each reference's depth by the matches between references:\n"
               "{}. auto: the first of these that\n"
               "predicts further matches as well as any; off with --refinement paper");
  geometry.Add(FieldsOf(flags.candidates));
}

std::filesystem::path QueryImagesOf(const std::filesystem::path& query_images,
                                    const std::filesystem::path& images,
                                    const std::filesystem::path& queries) {
  if (!query_images.empty()) return query_images;
  if (!IsFolder(queries)) return images;
  const bool is_below =
      Below(std::filesystem::weakly_canonical(queries), std::filesystem::weakly_canonical(images))
          .has_value();
  return is_below ? images : queries;
}

void AddSubsamplingOptions(const OptionGroup& group, Subsampling& subsampling,
                           const std::string& of_what) {
  group.Add("--every", subsampling.every, "Use every N-th " + of_what);
  group.Add("--every-offset", subsampling.offset, "The first of them, from 0 to N - 1");
  group.Flag("--every-per-camera", subsampling.per_camera,
             "Every N-th of each camera, where cameras take turns");
}

void CheckSubsampling(const Subsampling& subsampling) {
  RequireAtLeast("--every", subsampling.every, 1);
  RequireAtLeast("--every-offset", subsampling.offset, 0);
  if (subsampling.offset >= subsampling.every) {
    throw OptionError("--every-offset", std::to_string(subsampling.offset),
                      fmt::format("must be below --every, {}", subsampling.every));
  }
}

bool ReferenceFlags::HaveFeatures() const { return IsPackedMap(model); }

LoadedReferences ReferenceFlags::Load() const { return LoadReferences(model, subsampling, poses); }

SceneOptions ReferenceFlags::Scene(const std::filesystem::path& images,
                                   std::vector<std::string> geometry, int threads) const {
  return {.model = model,
          .model_poses = poses,
          .subsampling = subsampling,
          .images = images,
          .geometry = std::move(geometry),
          .threads = threads};
}

void AddReferenceOptions(CLI::App& command, ReferenceFlags& flags, bool model_is_required) {
  const OptionGroup references(command, "References");
  references.Add("--model", flags.model, "References: COLMAP model folder, text or binary")
      .Required(model_is_required);
  AddSubsamplingOptions(references, flags.subsampling, "reference (by name)");
}

void AddUpOption(const OptionGroup& group, const std::string& name,
                 std::optional<Eigen::Vector3d>& up_in_world, const std::string& help) {
  group.AddParsed(name, up_in_world, &ParseUp, help, "auto");
}

void RefuseWith(std::string_view other, std::initializer_list<GivenOption> options) {
  for (const auto& [name, is_given] : options) {
    if (is_given) throw OptionError(fmt::format("{} does not go with {}", name, other));
  }
}

void AddCrsOption(const OptionGroup& group, std::optional<WorldFrame>& world) {
  group.AddParsed("--crs", world, AsOption(&WorldFrame::Parse),
                  "What the world's coordinates are (localize knows it of surface and city\n"
                  "models): EPSG:25832, with heights EPSG:25832+7837;\n"
                  "EPSG:25832@X,Y,Z where X,Y,Z were taken off all of them");
}

void AddRunOptions(CLI::App& command, RunFlags& flags) {
  const OptionGroup running(command, "Running");
  running.Add("--threads", flags.threads, "Threads; 0: all. Never changes a result");
  running.Flag("--quiet", flags.quiet, "No progress, no table");
  AddConfigOption(command);
}

void RunFlags::Check() const {
  if (threads < 0) {
    throw OptionError("--threads", std::to_string(threads), "must not be negative");
  }
}

void AddConfigOption(CLI::App& command) {
  OptionGroup(command, "Running")
      .AddText("--config", "TOML file with any of these options", [](const std::string&) {})
      .NotConfigurable();
}

std::string InOptions(std::string text) {
  constexpr std::pair<std::string_view, std::string_view> kOptions[] = {
      {"model_poses = ", "--model-poses "},
      {"odometry_scale = ", "--odometry-scale "},
      {"in the geometry: ", "in --geometry: "}};
  for (const auto& [field, option] : kOptions) {
    const size_t at = text.find(field);
    if (at != std::string::npos) text.replace(at, field.size(), option);
  }
  return text;
}

void PrintWarning(const std::string& warning) {
  std::fputs(fmt::format("raylift: warning: {}\n", Printable(InOptions(warning))).c_str(), stderr);
}

void PrintWarnings(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) PrintWarning(warning);
}

}  // namespace raylift
