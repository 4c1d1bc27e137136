// A house front: a painted sheet on a wall with real depth. Windows, doors and arches lie back in
// the wall, sills, frames, shutters and cornices stand out of it. In the wall's frame x runs to
// the right, y up, and z out of the wall, toward the yard.

#pragma once

#include <vector>

#include "canvas.h"
#include "materials.h"
#include "mesh_builder.h"

namespace raylift::demo {

struct Opening {
  enum class Kind { kWindow, kDoor, kShopWindow, kGate, kNiche };
  enum class Top { kFlat, kArched };
  Kind kind;
  double x, y;  // lower left corner
  double width, height;
  double recess_m;
  Top top = Top::kFlat;
  Color paint{0.36f, 0.25f, 0.17f};  // of a door or gate

  Rect area() const { return {x, y, x + width, y + height}; }
};

class Facade {
 public:
  // Takes the canvas's picture as the wall's texture, which `sheet` will show; the base coat is
  // already on it. Draws what is behind the openings, and the water stains beneath them, and builds
  // the wall.
  Facade(const Frame& wall, Canvas& canvas, const Material& sheet,
         const std::vector<Opening>& openings, const Material& reveal, MeshBuilder& mesh, Rng rng);

  // Wooden frame and cross bars of a window, of a door the frame only.
  void AddJoinery(const Opening& opening, const Material& paint);
  void AddSill(const Opening& opening, const Material& stone);
  void AddSurround(const Opening& opening, const Material& stone, double width_m, double out_m);
  // Both shutters, each opened so far (180: flat on the wall).
  void AddShutters(const Opening& window, const Material& louvers, double left_deg,
                   double right_deg);
  // A band along the wall: cornice, string course, plinth.
  void AddBand(double x0, double x1, double y0, double y1, double out_m, const Material& material);
  // The lower edge of a tiled roof that rises behind the wall.
  void AddRoof(double eaves_m, double depth_m, double rise_m, const Material& tiles,
               const Material& gutter, const Material& soffit);

  const Frame& wall() const { return wall_; }
  MeshBuilder& mesh() { return mesh_; }
  Rng& rng() { return rng_; }

 private:
  void BuildWall(const std::vector<Opening>& openings);
  void BuildArchCorners(const Opening& opening);
  void BuildReveals(const Opening& opening, const Material& reveal);
  Corner At(double x, double y, double z) const;

  Frame wall_;
  Material sheet_;
  MeshBuilder& mesh_;
  Rng rng_;
};

}  // namespace raylift::demo
