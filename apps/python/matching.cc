// Features of photographs, and extractors and matchers that are Python's.

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "apps/python/conversions.h"

#include "raylift/base/error.h"
#include "raylift/localization/match_source.h"

namespace raylift::python {
namespace {

// Returns a shared object that threads without the interpreter's lock may copy and let go of.
std::shared_ptr<const py::object> Shared(py::object object) {
  return {new py::object(std::move(object)), [](const py::object* held) {
            const py::gil_scoped_acquire lock;
            delete held;
          }};
}

py::dict ToDict(const Features& features) {
  py::dict dict;
  dict["keypoints"] =
      MakeRows(features.keypoints_px.size(), 2, [&](size_t i) { return features.keypoints_px[i]; });
  py::array_t<float> descriptors(
      {py::ssize_t{features.descriptors.cols()}, py::ssize_t{features.descriptors.rows()}});
  std::copy_n(features.descriptors.data(), features.descriptors.size(), descriptors.mutable_data());
  dict["descriptors"] = descriptors;
  dict["scores"] = py::array_t<float>(std::ssize(features.scores), features.scores.data());
  return dict;
}

FeatureExtractor ToExtractor(const ExtractorLike& extractor, const MatchReading& reading) {
  const py::object adapt = py::module_::import("raylift._matching").attr("extractor_of");
  return [extract = Shared(adapt(extractor)),
          shift = 0.5 - reading.first_pixel](const Image& photograph) {
    const py::gil_scoped_acquire lock;
    Features features =
        ToFeatures((*extract)(ToArray(photograph)), {photograph.width_px, photograph.height_px});
    for (Eigen::Vector2d& pixel : features.keypoints_px) pixel.array() += shift;
    return features;
  };
}

GlobalDescriptor ToDescriptor(const DescriptorLike& retrieval) {
  const py::object adapt = py::module_::import("raylift._matching").attr("descriptor_of");
  return [describe = Shared(adapt(retrieval))](const Image& photograph) -> Eigen::VectorXf {
    const py::gil_scoped_acquire lock;
    const auto vector = (*describe)(ToArray(photograph)).cast<py::array_t<float>>();
    return Eigen::Map<const Eigen::VectorXf>(vector.data(), vector.size());
  };
}

py::tuple NameAndFile(const Photograph& photograph) {
  return py::make_tuple(photograph.name, photograph.file.string());
}

PhotographMatcher ToMatcher(const MatcherLike& matcher,
                            const std::optional<ExtractorLike>& extractor,
                            const FrontEndOptions& options) {
  const py::object adapt = py::module_::import("raylift._matching").attr("matcher_of");
  return [match = Shared(adapt(matcher, extractor, options.reading.first_pixel,
                               options.cache.string(), options.matcher_name,
                               py::arg("extractor_name") = options.extractor_name))](
             const Photograph& query, std::span<const Photograph> references) {
    const py::gil_scoped_acquire lock;
    py::list others;
    for (const Photograph& reference : references) others.append(NameAndFile(reference));
    const py::object pixels =
        query.pixels == nullptr ? py::object(py::none()) : ToArray(*query.pixels);
    std::vector<PixelMatches> matches;
    for (const py::handle& found : (*match)(NameAndFile(query), others, pixels)) {
      const auto [query_px, reference_px, scores] =
          found.cast<std::tuple<ArrayLike, ArrayLike, std::optional<ArrayLike>>>();
      PixelMatches& rows = matches.emplace_back();
      rows.query_px = Rows<2>(query_px, "matcher").ToVector();
      rows.reference_px = Rows<2>(reference_px, "matcher").ToVector();
      const auto numbers = PerMatch<double>(scores, "matcher, scores", rows.query_px.size());
      if (numbers) rows.scores.assign(numbers->data(), numbers->data() + numbers->size());
    }
    return matches;
  };
}

}  // namespace

Features ToFeatures(const py::object& mapping, PlaneSize size) {
  const auto item = [&](const char* key) -> py::object {
    return mapping.attr("get")(py::str(key));
  };
  const py::object keypoints = item("keypoints"), descriptors = item("descriptors");
  if (keypoints.is_none() || descriptors.is_none()) {
    throw InputError("features: expected keypoints (N, 2) and descriptors (N, D)");
  }
  Features features;
  features.image_width_px = size.width_px;
  features.image_height_px = size.height_px;
  features.keypoints_px =
      Rows<2>(py::reinterpret_borrow<ArrayLike>(keypoints), "features, keypoints").ToVector();
  if (py::isinstance<py::array_t<uint8_t>>(descriptors)) {
    throw InputError(
        "features, descriptors: uint8 ones, such as ORB's, are compared by bits, which a matcher "
        "does: matcher=cv2.BFMatcher(cv2.NORM_HAMMING)");
  }
  RequireMostInside(features.keypoints_px, "features, keypoints", [&](size_t) { return size; });
  const std::string expected =
      fmt::format("an array of shape ({}, D)", features.keypoints_px.size());
  const auto rows = internal::ArrayOf<float>(py::reinterpret_borrow<ArrayLike>(descriptors),
                                             "features, descriptors", expected);
  if (rows.ndim() != 2 || static_cast<size_t>(rows.shape(0)) != features.keypoints_px.size()) {
    internal::ThrowShape("features, descriptors", expected, rows);
  }
  features.descriptors =
      Eigen::Map<const Eigen::MatrixXf>(rows.data(), rows.shape(1), rows.shape(0));
  if (!features.descriptors.allFinite()) {
    throw InputError("features, descriptors: expected finite numbers");
  }
  return features;
}

void UseOwn(const OwnMatching& own, const MatchReading& reading, FrontEndOptions* options) {
  const auto& [extractor, matcher, retrieval] = own;
  options->reading = reading;
  if (retrieval) options->descriptor = ToDescriptor(*retrieval);
  const bool keeps_matches = matcher && !options->matcher_name.empty();
  const bool keeps_features = extractor && !matcher;
  if (extractor && !options->cache.empty() && options->extractor_name.empty() &&
      (keeps_matches || keeps_features)) {
    throw OptionError("extractor_name", "",
                      fmt::format("expected a name of the extractor, by which the cache tells its "
                                  "{} from others",
                                  keeps_matches ? "matches" : "features"));
  }
  if (matcher) options->matcher = ToMatcher(*matcher, extractor, *options);
  // Retrieval goes by features that are compared by their directions; a matcher's may be others.
  if (keeps_features) options->extractor = ToExtractor(*extractor, reading);
}

void BindFeatures(py::module_& module) {
  module.def(
      "extract_features",
      [](const ArrayLike& image, int max_features) {
        const Image photograph = ToImage(image);
        RequireAtLeast("max_features", max_features, 1);
        return ToDict(
            WithoutLock([&] { return ExtractFrontEndFeatures(photograph, max_features); }));
      },
      py::arg("image"), py::kw_only(), py::arg("max_features") = 4096,
      "RootSIFT features of a photograph, (H, W) or (H, W, 3) uint8: a dict with keypoints (N, "
      "2),\n"
      "descriptors (N, 128) float32 of unit length, scores (N,).");
}

}  // namespace raylift::python
