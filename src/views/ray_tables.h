// The tables of rays of the cameras that are in use: views of one camera share one. Private to
// views.

#pragma once

#include <future>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "raylift/renderers/pixel_rays.h"
#include "raylift/scene/photographs.h"

namespace raylift {

class RayTables {
 public:
  // Keeps at most `capacity` tables, besides those that are held by others.
  explicit RayTables(size_t capacity) : capacity_(capacity) {}

  // Makes the table where it is not there. Thread safe; a table is made once.
  std::shared_ptr<const PixelRays> Get(const ViewCamera& camera);

 private:
  using Table = std::shared_future<std::shared_ptr<const PixelRays>>;

  size_t capacity_;
  std::mutex mutex_;
  std::list<std::pair<std::string, Table>> tables_;  // the last used first
};

}  // namespace raylift
