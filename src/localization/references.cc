// The references of a scene from a COLMAP model.

#include <stdexcept>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"
#include "raylift/localization/match_source.h"

namespace raylift {

void MatchSource::Join(const PosedImage& localized_query) {
  throw std::logic_error("this source of matches was not opened for " + localized_query.name);
}

LoadedReferences LoadReferences(const std::filesystem::path& model, int every,
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
  for (size_t i = 0; i < images.size(); ++i) {
    if (i % static_cast<size_t>(every) == 0) {
      loaded.references.images.push_back(images[i]);
    } else {
      loaded.references.thinned_out.push_back(images[i].name);
    }
  }
  return loaded;
}

}  // namespace raylift
