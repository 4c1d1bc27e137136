// Collects city models, in the form that CityJSON and CityGML have in common. Objects are of some
// levels of detail (LoD), of which one is taken; their surfaces are polygons with holes;
// coordinates are of a system that the file names.

#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "surfaces/raw_mesh.h"

namespace raylift {

// Returns which of an object's levels of detail is taken: the finest up to `wanted` ("2" holds 2.2)
// and up to 3, or else the coarsest; nullopt where there is none.
std::optional<size_t> ChooseLevel(std::span<const double> levels, std::optional<double> wanted);

class CityMesh {
 public:
  // Says where something stands in the file; asked where it is at fault.
  using Locator = std::function<std::string()>;

  // `file_bytes` bounds what its references to itself may make of it.
  CityMesh(const std::filesystem::path& path, size_t file_bytes);

  // Counts what is read, maybe once more through a reference, in corners. Throws InputError where
  // the file refers to itself too often.
  void CountRead(const Locator& locate, size_t count);

  // Begins the object that polygons are added to.
  void BeginObject(const std::string& name) { mesh_.parts.push_back(name); }

  // Adds rings of three corners or more, the outer one first, and counts them; `kind` is that of
  // the surface, as RoofSurface, or empty. Throws InputError where a ring is shorter.
  void AddPolygon(const Locator& locate, std::vector<std::vector<Eigen::Vector3d>> rings,
                  std::string_view kind);

  void Warn(const std::string& message);

  // Looks at where the surfaces that were added are. `system` is what the file says: a URN, a URL
  // or a short name of an EPSG code, of a compound system, or as German surveys write it. Throws
  // Throws InputError where it is in degrees; warns where it is unknown, not meant for this place
  // or has northings before eastings that cannot be told from them.
  void CheckPlace(const std::string& field, const std::string& system);

  RawMesh Finish() &&;

 private:
  std::filesystem::path path_;
  size_t left_to_read_;
  size_t num_polygons_ = 0;
  size_t too_large_ = 0;
  std::map<std::string, uint32_t, std::less<>> material_of_kind_;
  RawMesh mesh_;
};

}  // namespace raylift
