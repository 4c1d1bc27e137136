#include "raylift/localization/references.h"

#include <string_view>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"

namespace raylift {

namespace {

std::vector<size_t> Keep(const std::filesystem::path& model, const std::vector<PosedImage>& images,
                         const Thinning& thinning) {
  std::vector<std::string> cameras;
  cameras.reserve(images.size());
  for (const PosedImage& image : images) cameras.push_back(image.camera.ToString());
  std::vector<size_t> kept = KeptIndices(cameras, thinning);
  const auto fail = [&](std::string_view what) {
    throw InputError(model, fmt::format("{} of {} images by every {}, offset {}", what,
                                        images.size(), thinning.every, thinning.offset));
  };
  if (kept.empty()) fail("none is left");
  if (thinning.per_camera && !thinning.KeepsAll() && kept.size() == images.size() &&
      images.size() > 1) {
    fail("each has a camera of its own, which leaves all");
  }
  return kept;
}

}  // namespace

LoadedReferences LoadReferences(const std::filesystem::path& model, int every,
                                PoseConvention poses) {
  return LoadReferences(model, Thinning{.every = every}, poses);
}

LoadedReferences LoadReferences(const std::filesystem::path& model, const Thinning& thinning,
                                PoseConvention poses) {
  ColmapModel colmap = ReadColmapModel(model);
  LoadedReferences loaded;
  loaded.warnings = std::move(colmap.warnings);
  loaded.covisibility = Covisibility(colmap);
  loaded.references.model = model;
  std::vector<PosedImage> images = colmap.PosedImages();
  for (PosedImage& image : images) image.cam_from_world = CamFromWorld(image.cam_from_world, poses);
  if (images.empty()) {
    throw InputError(model, "the model has no images with a pose");
  }
  size_t next = 0;
  for (const size_t kept : Keep(model, images, thinning)) {
    for (; next < kept; ++next) loaded.references.thinned_out.push_back(images[next].name);
    loaded.references.images.push_back(images[next++]);
  }
  for (; next < images.size(); ++next) loaded.references.thinned_out.push_back(images[next].name);
  return loaded;
}

std::vector<Query> QueriesOf(const ReferenceSet& references) {
  std::vector<Query> queries;
  queries.reserve(references.images.size());
  for (const PosedImage& image : references.images) queries.push_back({image.name, image.camera});
  return queries;
}

std::map<std::string, Rigid3> PosesOf(const ReferenceSet& references) {
  std::map<std::string, Rigid3> poses;
  for (const PosedImage& image : references.images) poses.emplace(image.name, image.cam_from_world);
  return poses;
}

}  // namespace raylift
