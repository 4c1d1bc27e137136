#include "raylift/localization/localized_model.h"

#include <map>
#include <string>
#include <unordered_map>
#include <vector>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// Adds images behind those that are there; equal cameras are one.
class Adder {
 public:
  explicit Adder(ColmapModel& model) : model_(model) {
    for (const auto& [id, camera] : model.cameras) camera_ids_.emplace(camera.ToString(), id);
  }

  void Add(const std::string& name, const Camera& camera, const Rigid3& cam_from_world) {
    const auto [known, is_new] = camera_ids_.emplace(camera.ToString(), NextId(model_.cameras));
    if (is_new) model_.cameras.emplace(known->second, camera);
    ColmapImage image;
    image.name = name;
    image.camera_id = known->second;
    image.SetCamFromWorld(cam_from_world);
    model_.images.emplace(NextId(model_.images), std::move(image));
  }

 private:
  template <typename T>
  static uint32_t NextId(const std::map<uint32_t, T>& records) {
    return records.empty() ? 1 : records.rbegin()->first + 1;
  }

  ColmapModel& model_;
  std::map<std::string, uint32_t> camera_ids_;
};

// The references' own model without the images that are not in use; made anew where they have none.
ColmapModel ModelOf(const ReferenceSet& references) {
  ColmapModel model;
  if (DetectColmapForm(references.model)) {
    model = ReadColmapModel(references.model);
    model.rigs.clear();
    model.frames.clear();
    model.rig_order.clear();
    model.frame_order.clear();
    RemoveImages(model, references.thinned_out);
  }
  std::unordered_map<std::string, ColmapImage*> images;
  for (auto& [id, image] : model.images) images.emplace(image.name, &image);
  Adder adder(model);
  for (const PosedImage& reference : references.images) {
    const auto image = images.find(reference.name);
    if (image == images.end()) {
      adder.Add(reference.name, reference.camera, reference.cam_from_world);
    } else {
      image->second->SetCamFromWorld(reference.cam_from_world);
    }
  }
  return model;
}

}  // namespace

ColmapModel LocalizedModel(const ReferenceSet& references, std::span<const Query> queries,
                           std::span<const LocalizedQuery> localized) {
  std::unordered_map<std::string, const Camera*> cameras;
  for (const Query& query : queries) cameras.emplace(query.name, &query.camera);
  std::vector<std::string> names;
  for (const LocalizedQuery& query : localized) {
    if (query.localized()) names.push_back(query.name);
  }
  ColmapModel model = ModelOf(references);
  RemoveImages(model, names);
  Adder adder(model);
  for (const LocalizedQuery& query : localized) {
    if (!query.localized()) continue;
    const auto camera = cameras.find(query.name);
    RAYLIFT_CHECK(camera != cameras.end());
    adder.Add(query.name, query.estimate.refined_camera.value_or(*camera->second),
              *query.estimate.cam_from_world);
  }
  return model;
}

}  // namespace raylift
