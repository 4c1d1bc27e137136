// A procedural city of about a given number of triangles: uneven ground, 10 x 10 houses with window
// recesses, two centimeters of noise, so that rays and files behave like those of an MVS mesh.

#pragma once

#include <cstddef>
#include <vector>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

TriangleMesh MakeCity(size_t num_triangles);

// 1920 x 1080 pinhole views: in the streets, and every fourth one above the roofs.
Camera CityCamera();
std::vector<Rigid3> CityViews(int count);

}  // namespace raylift
