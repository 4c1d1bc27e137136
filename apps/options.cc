#include "options.h"

#include <cmath>
#include <cstdio>

#include "base/json_text.h"
#include "typed_options.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

std::string MethodHelp() {
  std::string text = "Estimator:";
  for (const EnumName<Method>& method : kEnumNames<Method>) {
    text += fmt::format("\n{} = {}: {}", method.name, method.title, method.description);
  }
  return text;
}

Json EffectiveValue(const CLI::Option& option) {
  if (option.get_items_expected_max() == 0) {  // a flag
    return option.count() > 0 && option.as<bool>();
  }
  if (option.get_items_expected_max() > 1) {
    return option.count() > 0 ? option.reduced_results() : std::vector<std::string>{};
  }
  if (option.count() == 0 && option.get_default_str().empty()) {
    return nullptr;
  }
  const std::string type = option.get_type_name();
  if (type == "INT") return option.as<int64_t>();
  if (type == "UINT") return option.as<uint64_t>();
  if (type == "FLOAT") return option.as<double>();
  return option.as<std::string>();
}

std::string ShellQuoted(const std::string& text) {
  constexpr std::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=./,:@%";
  if (!text.empty() && text.find_first_not_of(kPlain) == std::string::npos) return text;
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

}  // namespace

EstimatorOptions EstimatorFlags::Resolve() const {
  values.Validate();
  return values;
}

void AddEstimatorOptions(CLI::App& app, EstimatorFlags& flags) {
  const std::string group = "Estimator";
  EstimatorOptions& values = flags.values;
  AddEnumOption(app, "--method", values.method, MethodHelp())->group(group);
  AddEnumOption(app, "--score", values.score, "Score that Adaptive compares poses by:\n{}")
      ->group(group);
  AddEnumOption(app, "--lo", values.local_optimization, "Adaptive's local optimization: {}")
      ->group(group);
  app.add_option("--alpha", values.alpha,
                 "Select takes the P3P pose if it has more than alpha times\n"
                 "the E5+1 pose's 2D-2D inliers")
      ->capture_default_str()
      ->group(group);
  AddEstimatorNumbers(app, values, group);
}

void AddEstimatorNumbers(CLI::App& app, EstimatorOptions& values, const std::string& group) {
  AddEnumOption(app, "--refinement", values.refinement,
                "What happens beyond the paper, in every method: {}.\n"
                "robust refines the pose after RANSAC by maximum likelihood,\n"
                "Adaptive's and D3+1's by both kinds of matches with what they are\n"
                "found to be worth, draws samples of D3+1 in Adaptive as well, and\n"
                "drops poses that chance explains;\n"
                "paper optimizes each new best pose on all matches, no more")
      ->group(group);
  app.add_option("--reprojection-threshold-px", values.reprojection_threshold_px,
                 "Inlier threshold of 2D-3D matches")
      ->capture_default_str()
      ->group(group);
  app.add_option("--sampson-threshold-px", values.sampson_threshold_px,
                 "Inlier threshold of 2D-2D matches")
      ->capture_default_str()
      ->group(group);
  app.add_option("--point-sigma", values.point_sigma,
                 "Standard deviation of the 3D points, in scene units:\n"
                 "widens the inlier threshold of 2D-3D matches")
      ->capture_default_str()
      ->group(group);
  app.add_flag("--refine-focal", values.refine_focal, "Find the query's focal length with the pose")
      ->group(group);
  app.add_option("--focal-range", values.focal_range,
                 "With --refine-focal: it is the given one up to this factor\n"
                 "either way")
      ->capture_default_str()
      ->group(group);
  app.add_option("--min-iterations", values.min_iterations, "RANSAC")
      ->capture_default_str()
      ->group(group);
  app.add_option("--max-iterations", values.max_iterations, "RANSAC")
      ->capture_default_str()
      ->group(group);
  app.add_option("--confidence", values.confidence,
                 "RANSAC stops when a sample of inliers alone has\n"
                 "been drawn with this probability")
      ->capture_default_str()
      ->group(group);
  app.add_option("--seed", values.seed, "Seed of all random choices")
      ->capture_default_str()
      ->group(group);
}

FilterOptions FilterFlags::Resolve() const {
  thresholds.Validate();
  return {.mode = mode, .thresholds = thresholds};
}

void AddFilterOptions(CLI::App& app, FilterFlags& flags) {
  const std::string group = "Consistency filter";
  AddEnumOption(app, "--filter", flags.mode,
                "Drop lifted points that too few references agree on:\n"
                "{}. fixed helps noisy geometry and hurts accurate\n"
                "geometry; auto leaves accurate geometry alone and needs none\n"
                "of the options below")
      ->group(group);
  AddFilterThresholds(app, flags.thresholds, group);
}

void AddFilterThresholds(CLI::App& app, ConsistencyThresholds& thresholds,
                         const std::string& group) {
  app.add_option("--filter-reprojection-px", thresholds.reprojection_px,
                 "A reference agrees where the point lands this close to\n"
                 "the matched keypoint")
      ->capture_default_str()
      ->group(group);
  app.add_option("--filter-min-views", thresholds.min_views,
                 "References that must agree, the point's own included")
      ->capture_default_str()
      ->group(group);
  app.add_option("--filter-min-ratio", thresholds.min_ratio,
                 "Share that must agree of the references that observe\n"
                 "the keypoint; 0: any")
      ->capture_default_str()
      ->group(group);
}

void AddModelPosesOption(CLI::App& app, ModelPosesFlags& flags) {
  AddEnumOption(app, "--model-poses", flags.convention,
                "What the model's poses are, where they are not as COLMAP writes\n"
                "them: {}")
      ->group("References");
}

void AddRunOptions(CLI::App& app, RunFlags& flags) {
  const std::string group = "Running";
  app.add_option("--threads", flags.threads, "Threads; 0: all. Never changes a result")
      ->capture_default_str()
      ->group(group);
  app.add_flag("--quiet", flags.quiet, "No progress, no table")->group(group);
  AddConfigOption(app);
}

void RunFlags::Check() const {
  if (threads < 0) {
    throw OptionError("--threads", std::to_string(threads), "must not be negative");
  }
}

double ParsePositive(std::string_view option, const std::string& text) {
  const auto value = ParseDouble(text);
  if (!value || !(*value > 0) || !std::isfinite(*value)) {
    throw OptionError(option, text, "must be a positive number");
  }
  return *value;
}

void AddConfigOption(CLI::App& app) {
  app.add_option("--config", "TOML file with any of these options")
      ->type_name("TEXT")
      ->configurable(false)
      ->group("Running");
}

void CheckNumbers(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    const std::string type = option->get_type_name();
    if (type == "INT" || type == "UINT") {
      const bool is_unsigned = type == "UINT";
      option->transform(CLI::Validator(
          [is_unsigned](std::string& text) -> std::string {
            if (const auto number = ParseUint(text)) {
              text = std::to_string(*number);
            } else if (const auto signed_number = ParseInt(text); signed_number && !is_unsigned) {
              text = std::to_string(*signed_number);
            } else {
              return fmt::format("expected a whole number{}, found \"{}\"",
                                 is_unsigned ? " of at least 0" : "", text);
            }
            return {};
          },
          ""));
    } else if (type == "FLOAT") {
      option->check([](const std::string& text) -> std::string {
        const auto number = ParseDouble(text);
        if (number && std::isfinite(*number)) return {};
        return fmt::format("expected a number, found \"{}\"", text);
      });
    }
  }
}

void PrintWarning(const std::string& warning) {
  std::fputs(fmt::format("raylift: warning: {}\n", warning).c_str(), stderr);
}

void PrintWarnings(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) PrintWarning(warning);
}

std::string CommandLine(const CLI::App& app) {
  std::string line = "raylift " + app.get_name();
  for (const CLI::Option* option : app.get_options()) {
    if (option->count() == 0 || !option->get_configurable()) continue;
    const std::string name = option->get_positional() ? "" : " " + option->get_name();
    const bool is_flag = option->get_expected_min() == 0;
    if (is_flag) line += name;
    for (const std::string& value : option->results()) {
      if (!is_flag) line += name + " " + ShellQuoted(value);
    }
  }
  return line;
}

std::string EffectiveOptionsJson(const CLI::App& app) {
  Json options = Json::object();
  options["command"] = app.get_name();
  options["raylift_version"] = RAYLIFT_VERSION;
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_configurable()) {
      options[option->get_single_name()] = EffectiveValue(*option);
    }
  }
  return JsonText(options, 2) + '\n';
}

}  // namespace raylift
