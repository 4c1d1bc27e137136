#include "ray_tables.h"

#include <algorithm>

namespace raylift {
namespace {

std::shared_ptr<const PixelRays> MakeTable(const ViewCamera& camera) {
  return std::make_shared<const PixelRays>(
      camera.lens ? PixelRays(*camera.lens, 1)
                  : PixelRays::Equirectangular(camera.width_px, camera.height_px, 1));
}

}  // namespace

std::shared_ptr<const PixelRays> RayTables::Get(const ViewCamera& camera) {
  const std::string key = camera.ToString();
  std::promise<std::shared_ptr<const PixelRays>> promise;
  Table table;
  bool make = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = std::find_if(tables_.begin(), tables_.end(),
                                    [&key](const auto& entry) { return entry.first == key; });
    if (found != tables_.end()) {
      tables_.splice(tables_.begin(), tables_, found);
    } else {
      tables_.emplace_front(key, promise.get_future().share());
      if (tables_.size() > capacity_) tables_.pop_back();
      make = true;
    }
    table = tables_.front().second;
  }
  if (make) {
    try {
      promise.set_value(MakeTable(camera));
    } catch (...) {
      promise.set_exception(std::current_exception());
    }
  }
  return table.get();
}

}  // namespace raylift
