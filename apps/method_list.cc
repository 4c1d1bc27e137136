#include "method_list.h"

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

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

std::vector<EstimatorOptions> ParseMethods(std::string_view text, const EstimatorOptions& base) {
  std::vector<EstimatorOptions> methods;
  for (const std::string_view part : SplitBy(text, ',')) methods.push_back(ParseMethod(part, base));
  return methods;
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

}  // namespace raylift
