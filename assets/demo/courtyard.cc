#include "courtyard.h"

#include <array>

#include "atlas.h"
#include "facade.h"
#include "props.h"
#include "sheets.h"

namespace raylift::demo {

namespace {

using Kind = Opening::Kind;
using Top = Opening::Top;

enum Texture { kNorth, kEast, kSouth, kWest, kGround, kThings };

const Frame kNorthWall{{0, 12, 0}, {1, 0, 0}, {0, 0, 1}, {0, -1, 0}};
const Frame kEastWall{{16, 12, 0}, {0, -1, 0}, {0, 0, 1}, {-1, 0, 0}};
const Frame kSouthWall{{16, 0, 0}, {-1, 0, 0}, {0, 0, 1}, {0, 1, 0}};
const Frame kWestWall{{0, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 0}};

Material Whole(const Canvas& canvas, int texture) {
  return {texture, {0, 0}, {1, 1}, {canvas.width_m(), canvas.height_m()}};
}

Opening Window(double x, double y, double width, double height, Top top = Top::kFlat) {
  return {Kind::kWindow, x, y, width, height, 0.16, top};
}

void FinishWindows(Facade& facade, const std::vector<Opening>& openings, const Material& joinery,
                   const Material& stone, const Material* louvers) {
  for (const Opening& opening : openings) {
    if (opening.kind != Kind::kWindow) continue;
    facade.AddJoinery(opening, joinery);
    facade.AddSill(opening, stone);
    if (louvers != nullptr) {
      const auto angle = [&] {
        return facade.rng().Uniform() < 0.35 ? facade.rng().Uniform(60, 160) : 180.0;
      };
      const double left = angle();
      facade.AddShutters(opening, *louvers, left, angle());
    }
  }
}

// A box of flowers on the sill.
void AddFlowerBox(Facade& facade, const Materials& m, const Opening& window) {
  facade.mesh().Box(facade.wall(), {window.x + 0.05, window.y, 0.0},
                    {window.x + window.width - 0.05, window.y + 0.2, 0.2}, m.terracotta,
                    facade.rng());
  Frame frame = facade.wall().Moved(window.x + 0.5 * window.width, window.y + 0.3, 0.12);
  PropContext context{facade.mesh(), m, facade.rng()};
  AddLeaves(context, frame, {0.5 * window.width, 0.16, 0.14}, 45, 0.15, m.leaves);
  AddLeaves(context, frame, {0.5 * window.width, 0.2, 0.16}, 16, 0.1, m.flowers);
}

void AddDrainpipe(Facade& facade, const Materials& m, double x, double top) {
  facade.mesh().Tube(facade.wall().At(x, 0.05, 0.09), facade.wall().At(x, top, 0.09), 0.055, 8,
                     m.iron);
  for (double y = 0.6; y < top; y += 1.9) {
    facade.mesh().Box(facade.wall(), {x - 0.08, y, 0}, {x + 0.08, y + 0.05, 0.16}, m.iron,
                      facade.rng());
  }
}

void AddStep(Facade& facade, const Material& stone, const Opening& door) {
  facade.mesh().Box(facade.wall(), {door.x - 0.2, 0, 0}, {door.x + door.width + 0.2, 0.12, 0.4},
                    stone, facade.rng(), MeshBuilder::LowFace::kHidden);
}

void AddSignBoard(Facade& facade, const Material& sign, double x, double y, double width,
                  double height) {
  Material whole = sign;
  whole.size_m = {width, height};
  facade.mesh().Box(facade.wall(), {x, y, 0}, {x + width, y + height, 0.07}, whole, facade.rng(),
                    MeshBuilder::LowFace::kHidden);
}

// A board that hangs out over the yard.
void AddHangingSign(Facade& facade, const Materials& m, const Material& sign, double x, double y) {
  Material whole = sign;
  whole.size_m = {1.1, 0.5};
  const Frame frame{facade.wall().At(x, y, 0.15), facade.wall().z, facade.wall().y,
                    -facade.wall().x};
  facade.mesh().Box(frame, {0, 0, -0.025}, {1.1, 0.5, 0.025}, whole, facade.rng());
  facade.mesh().Tube(facade.wall().At(x, y + 0.56, 0), facade.wall().At(x, y + 0.56, 1.4), 0.02, 6,
                     m.iron);
}

void AddAwning(Facade& facade, const Materials& m, double x0, double x1, double y) {
  const Frame& wall = facade.wall();
  facade.mesh().Quad(wall.At(x0, y - 0.55, 1.15), wall.At(x1, y - 0.55, 1.15), wall.At(x1, y, 0.02),
                     wall.At(x0, y, 0.02), m.awning);
  facade.mesh().Quad(wall.At(x0, y - 0.78, 1.15), wall.At(x1, y - 0.78, 1.15),
                     wall.At(x1, y - 0.55, 1.15), wall.At(x0, y - 0.55, 1.15),
                     m.awning.Part(0, 0, 1, 0.2));
}

void AddBalcony(Facade& facade, const Materials& m, double x0, double x1, double y) {
  const auto box = [&](const Eigen::Vector3d& low, const Eigen::Vector3d& high,
                       const Material& material) {
    facade.mesh().Box(facade.wall(), low, high, material, facade.rng());
  };
  box({x0, y - 0.18, 0}, {x1, y, 0.95}, m.pale_stone);
  for (double x : {x0 + 0.25, x1 - 0.4})
    box({x, y - 0.5, 0}, {x + 0.15, y - 0.18, 0.45}, m.pale_stone);
  box({x0, y + 0.92, 0.88}, {x1, y + 0.97, 0.93}, m.iron);
  box({x0, y + 0.08, 0.89}, {x1, y + 0.11, 0.92}, m.iron);
  for (double x = x0 + 0.05; x < x1; x += 0.16)
    box({x - 0.012, y, 0.893}, {x + 0.012, y + 0.92, 0.917}, m.iron);
  for (double x : {x0, x1 - 0.04}) box({x, y + 0.92, 0.0}, {x + 0.04, y + 0.97, 0.9}, m.iron);
}

void AddWallLamp(Facade& facade, const Materials& m, double x, double y) {
  const Frame& wall = facade.wall();
  facade.mesh().Tube(wall.At(x, y, 0), wall.At(x, y + 0.1, 0.35), 0.018, 5, m.iron);
  const Frame upright{wall.At(x, y - 0.3, 0.38), wall.z, wall.x, wall.y};
  const std::vector<Eigen::Vector2d> glass{{0.06, 0}, {0.12, 0.28}},
      hat{{0.15, 0.28}, {0.02, 0.42}, {0, 0.43}};
  facade.mesh().Turned(upright, glass, 6, m.lamp_glass);
  facade.mesh().Turned(upright, hat, 6, m.iron);
}

void BuildNorth(Canvas& canvas, const Materials& m, MeshBuilder& mesh, const Rng& rng) {
  std::vector<Opening> openings{
      {Kind::kDoor, 1.7, 0, 1.2, 2.5, 0.28, Top::kArched, {0.20f, 0.38f, 0.30f}},
      {Kind::kShopWindow, 6.2, 0.8, 2.6, 1.7, 0.14},
      {Kind::kDoor, 9.0, 0, 1.05, 2.4, 0.25, Top::kFlat, {0.50f, 0.16f, 0.14f}},
      Window(11.0, 0.95, 1.0, 1.4),
      Window(12.6, 0.95, 1.0, 1.4)};
  for (double x : {0.9, 3.5, 6.1, 8.7, 11.3, 13.9}) {
    openings.push_back(Window(x, 3.7, 1.1, 1.55, Top::kArched));
    openings.push_back(Window(x + 0.05, 6.2, 1.0, 1.3));
  }
  Facade facade(kNorthWall, canvas, Whole(canvas, kNorth), openings, m.pale_stone, mesh, rng);
  FinishWindows(facade, openings, m.white_paint, m.pale_stone, nullptr);
  for (const Opening& opening : openings) {
    if (opening.kind == Kind::kWindow) facade.AddSurround(opening, m.pale_stone, 0.13, 0.04);
  }
  facade.AddSurround(openings[0], m.stone, 0.2, 0.08);
  facade.AddSurround(openings[2], m.red_paint, 0.12, 0.06);
  facade.AddJoinery(openings[1], m.red_paint);
  facade.AddSill(openings[1], m.stone);
  for (size_t i : {0u, 2u}) AddStep(facade, m.stone, openings[i]);
  for (size_t i : {5u, 9u, 12u}) AddFlowerBox(facade, m, openings[i]);
  AddSignBoard(facade, m.signs[1], 6.1, 2.62, 2.8, 0.42);
  AddHangingSign(facade, m, m.signs[3], 5.0, 2.5);
  AddWallLamp(facade, m, 3.4, 2.5);
  facade.AddBand(0, 16, 5.72, 5.84, 0.08, m.pale_stone);
  facade.AddBand(0, 16, 8.1, 8.4, 0.25, m.pale_stone);
  AddDrainpipe(facade, m, 10.3, 8.1);
  AddDrainpipe(facade, m, 0.25, 8.1);
  facade.AddRoof(0.35, 4, 2.2, m.roof, m.copper, m.dark_wood);
}

void BuildEast(Canvas& canvas, const Materials& m, MeshBuilder& mesh, const Rng& rng) {
  std::vector<Opening> openings{
      {Kind::kShopWindow, 1.3, 0.65, 2.2, 1.9, 0.15},
      {Kind::kDoor, 3.8, 0, 1.1, 2.45, 0.25, Top::kFlat, {0.24f, 0.36f, 0.52f}},
      {Kind::kDoor, 8.2, 0, 1.3, 2.6, 0.3, Top::kArched, {0.46f, 0.30f, 0.18f}},
      Window(10.2, 1.0, 0.9, 1.3)};
  openings.push_back(Window(1.2, 3.9, 1.0, 1.5));
  openings.push_back(Window(3.4, 3.9, 1.0, 1.5));
  openings.push_back({Kind::kDoor, 5.75, 3.52, 1.2, 2.1, 0.2, Top::kFlat, {0.35f, 0.46f, 0.55f}});
  openings.push_back(Window(8.2, 3.9, 1.0, 1.5));
  openings.push_back(Window(10.4, 3.9, 1.0, 1.5));
  Facade facade(kEastWall, canvas, Whole(canvas, kEast), openings, m.pale_stone, mesh, rng);
  FinishWindows(facade, {openings.begin() + 4, openings.end()}, m.white_paint, m.stone,
                &m.louvers_blue);
  facade.AddJoinery(openings[3], m.blue_paint);
  facade.AddSill(openings[3], m.stone);
  facade.AddSurround(openings[3], m.stone, 0.12, 0.04);
  facade.AddJoinery(openings[0], m.blue_paint);
  facade.AddSurround(openings[2], m.stone, 0.18, 0.07);
  for (size_t i : {1u, 2u}) AddStep(facade, m.stone, openings[i]);
  AddAwning(facade, m, 1.0, 5.1, 3.05);
  AddSignBoard(facade, m.signs[0], 1.3, 3.08, 3.4, 0.4);
  AddBalcony(facade, m, 5.2, 7.5, 3.5);
  AddFlowerBox(facade, m, openings[4]);
  AddWallLamp(facade, m, 7.8, 2.7);
  facade.AddBand(0, 12, 5.95, 6.2, 0.2, m.pale_stone);
  AddDrainpipe(facade, m, 11.7, 5.9);
  facade.AddRoof(0.45, 4, 2.0, m.roof, m.iron, m.dark_wood);
}

void BuildSouth(Canvas& canvas, const Materials& m, MeshBuilder& mesh, const Rng& rng) {
  std::vector<Opening> openings{
      {Kind::kGate, 6.55, 0, 2.2, 3.1, 0.7, Top::kArched, {0.42f, 0.29f, 0.20f}},
      {Kind::kNiche, 1.0, 0.5, 1.5, 2.5, 0.4, Top::kArched},
      {Kind::kNiche, 3.6, 0.5, 1.5, 2.5, 0.4, Top::kArched},
      {Kind::kDoor, 11.1, 0, 1.2, 2.5, 0.3, Top::kArched, {0.30f, 0.34f, 0.22f}},
      Window(13.2, 1.1, 1.1, 1.4)};
  for (double x : {0.9, 3.1, 5.3, 9.6, 11.8, 14.0}) openings.push_back(Window(x, 4.0, 1.05, 1.6));
  for (double x : {1.4, 5.4, 9.4, 13.4}) openings.push_back(Window(x, 6.75, 1.0, 1.15));
  Facade facade(kSouthWall, canvas, Whole(canvas, kSouth), openings, m.stone, mesh, rng);
  const auto upper = openings.begin() + 5;
  FinishWindows(facade, {openings.begin() + 4, upper}, m.green_paint, m.stone, nullptr);
  FinishWindows(facade, {upper, upper + 6}, m.white_paint, m.stone, &m.louvers_green);
  FinishWindows(facade, {upper + 6, openings.end()}, m.dark_wood, m.dark_wood, &m.louvers_brown);
  for (size_t i = 0; i < 4; ++i)
    facade.AddSurround(openings[i], m.pale_stone, i == 0 ? 0.3 : 0.15, 0.09);
  AddStep(facade, m.stone, openings[3]);
  for (size_t i : {6u, 9u}) AddFlowerBox(facade, m, openings[i]);
  AddSignBoard(facade, m.signs[2], 10.6, 2.85, 2.2, 0.45);
  AddWallLamp(facade, m, 6.0, 2.6);
  AddWallLamp(facade, m, 9.3, 2.6);
  facade.AddBand(0, 16, 3.36, 3.55, 0.14, m.pale_stone);
  facade.AddBand(0, 16, 5.98, 6.12, 0.18, m.dark_wood);
  AddDrainpipe(facade, m, 15.8, 8.3);
  facade.AddRoof(0.5, 4, 2.4, m.roof, m.copper, m.dark_wood);
  // Urns in the niches.
  PropContext context{mesh, m, facade.rng()};
  for (double x : {1.75, 4.35}) {
    const Frame stand{kSouthWall.At(x, 0.5, -0.15), {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    AddPot(context, stand, x < 2 ? 0.62 : 0.5);
  }
}

void BuildWest(Canvas& canvas, const Materials& m, MeshBuilder& mesh, const Rng& rng) {
  std::vector<Opening> openings{
      {Kind::kGate, 1.0, 0, 2.6, 2.7, 0.22, Top::kFlat, {0.34f, 0.40f, 0.42f}},
      {Kind::kDoor, 6.5, 0, 1.05, 2.4, 0.25, Top::kFlat, {0.62f, 0.42f, 0.16f}},
      Window(8.4, 1.1, 0.95, 1.3),
      Window(10.3, 1.1, 0.95, 1.3)};
  for (double x : {1.0, 3.4, 6.3, 8.7, 10.6}) openings.push_back(Window(x, 4.1, 0.95, 1.5));
  openings.push_back({Kind::kNiche, 5.0, 3.3, 0.7, 1.5, 0.3, Top::kArched});
  Facade facade(kWestWall, canvas, Whole(canvas, kWest), openings, m.stone, mesh, rng);
  FinishWindows(facade, {openings.begin() + 4, openings.end()}, m.white_paint, m.stone,
                &m.louvers_brown);
  FinishWindows(facade, {openings.begin() + 2, openings.begin() + 4}, m.green_paint, m.stone,
                nullptr);
  for (size_t i : {0u, 1u, 2u, 3u}) facade.AddSurround(openings[i], m.stone, 0.16, 0.05);
  AddStep(facade, m.stone, openings[1]);
  facade.AddBand(0, 12, 3.0, 3.12, 0.09, m.stone);
  facade.AddBand(0, 12, 6.75, 7.0, 0.22, m.stone);
  AddDrainpipe(facade, m, 4.0, 6.8);
  AddHangingSign(facade, m, m.signs[2], 4.6, 2.35);
  AddFlowerBox(facade, m, openings[5]);
  facade.AddRoof(0.4, 4, 2.0, m.roof, m.iron, m.dark_wood);
  PropContext context{mesh, m, facade.rng()};
  AddIvy(context, kWestWall, 7.4, 11.6, 5.6, 900);
}

void FillYard(PropContext& c) {
  const auto at = [](double x, double y, double heading_deg) {
    return UprightFrame({x, y, 0}, heading_deg);
  };
  AddFountain(c, at(8, 6, 22.5));
  AddTree(c, at(1.7, 10.4, 0), 4.6, 720);
  AddTree(c, at(14.3, 1.7, 50), 4.0, 600);
  AddBench(c, at(11.8, 11.2, 0));
  AddBench(c, at(0.75, 3.9 - 0.2, 90));
  AddBench(c, at(9.6, 0.8, 180));
  AddPlanter(c, at(7.4, 11.35, 0), 1.6);
  AddPlanter(c, at(15.3, 4.9, 90), 1.4);
  for (const auto& [x, y, h] :
       {std::array{3.5, 11.5, 0.5}, std::array{1.2, 11.5, 0.42}, std::array{15.4, 7.6, 0.55},
        std::array{5.6, 0.6, 0.45}, std::array{0.6, 8.1, 0.5}, std::array{10.2, 11.6, 0.4}}) {
    AddPot(c, at(x, y, 0), h);
  }
  for (const auto& [x, y, size, heading] :
       {std::array{14.9, 11.1, 0.8, 8.0}, std::array{14.0, 11.3, 0.65, -14.0},
        std::array{15.4, 10.2, 0.6, 25.0}}) {
    AddCrate(c, at(x, y, heading), size, static_cast<size_t>(10 * size));
  }
  AddCrate(c, UprightFrame({14.8, 11.05, 0.8}, 31), 0.55, 2);
  AddBarrel(c, at(3.0, 0.8, 0), 0.95);
  AddBarrel(c, at(3.75, 0.62, 40), 0.95);
  AddBarrel(c, at(3.4, 1.35, 80), 0.85);
  AddCrate(c, at(2.2, 0.7, 5), 0.7, 3);
  for (const auto& [x, y] : {std::pair{13.9, 8.9}, std::pair{14.1, 6.9}}) {
    AddTable(c, at(x, y, 20));
    AddChair(c, at(x - 0.62, y + 0.1, 80), c.materials.red_paint);
    AddChair(c, at(x + 0.62, y - 0.1, -75), c.materials.blue_paint);
  }
  AddMenuBoard(c, at(13.3, 10.2, -60));
  AddLampPost(c, at(5.0, 10.6, 0));
  AddLampPost(c, at(12.3, 0.9, 0));
  AddCart(c, at(1.5, 1.5, 30));
  AddLadder(c, UprightFrame({10.6, 10.9, 0}, 0), 3.4);
  AddWashingLine(c, {0.1, 7.9, 5.2}, {6.2, 11.9, 5.6});
  AddWashingLine(c, {15.9, 3.2, 5.2}, {10.4, 0.1, 5.5});
}

void AddNewcomers(PropContext& c) {
  const auto at = [](double x, double y, double heading_deg) {
    return UprightFrame({x, y, 0}, heading_deg);
  };
  AddParasol(c, at(14.0, 7.9, 0));
  AddParasol(c, at(6.3, 9.3, 15));
  AddTable(c, at(6.3, 9.5, 0));
  AddCrate(c, at(4.9, 3.2, 20), 0.9, 0);
  AddCrate(c, at(5.75, 3.0, -8), 0.8, 1);
  AddCrate(c, UprightFrame({5.2, 3.15, 0.9}, 44), 0.7, 2);
  AddBarrel(c, at(11.6, 3.6, 0), 1.0);
  AddCart(c, at(10.9, 9.6, 200));
  AddMenuBoard(c, at(3.3, 6.4, 100));
  AddPot(c, at(12.9, 4.6, 0), 0.6);
  AddWashingLine(c, {0.1, 4.6, 4.6}, {5.0, 0.1, 4.9});
}

void AddGround(MeshBuilder& mesh) {
  const Material sheet{kGround, {0, 0}, {1, 1}, {16, 12}};
  // In squares, reaching a little under the walls.
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 6; ++j) {
      mesh.Quad({2.0 * i, 2.0 * j, 0}, {2.0 * i + 2, 2.0 * j, 0}, {2.0 * i + 2, 2.0 * j + 2, 0},
                {2.0 * i, 2.0 * j + 2, 0},
                sheet.Part(i / 8.0, j / 6.0, (i + 1) / 8.0, (j + 1) / 6.0));
    }
  }
}

}  // namespace

Courtyard BuildCourtyard(uint64_t seed) {
  const auto stream = [&](const char* purpose) {
    return Rng(StreamSeed(seed, "courtyard", purpose));
  };
  Atlas atlas(kThings, 14, 6.2, 110);
  const Materials materials = PaintMaterials(atlas);
  Canvas north = PaintNorthSheet(stream("north sheet"));
  Canvas east = PaintEastSheet(stream("east sheet"));
  Canvas south = PaintSouthSheet(stream("south sheet"));
  Canvas west = PaintWestSheet(stream("west sheet"));
  const Canvas ground = PaintGround(stream("ground"));

  Courtyard yard;
  AddGround(yard.scene.mesh);
  BuildNorth(north, materials, yard.scene.mesh, stream("north"));
  BuildEast(east, materials, yard.scene.mesh, stream("east"));
  BuildSouth(south, materials, yard.scene.mesh, stream("south"));
  BuildWest(west, materials, yard.scene.mesh, stream("west"));
  Rng things = stream("things");
  PropContext context{yard.scene.mesh, materials, things};
  FillYard(context);
  Rng newcomers = stream("newcomers");
  PropContext newcomer_context{yard.newcomers, materials, newcomers};
  AddNewcomers(newcomer_context);
  yard.scene.texture_names = {"north", "east", "south", "west", "ground", "things"};
  yard.scene.textures = {north.ToImage(), east.ToImage(),   south.ToImage(),
                         west.ToImage(),  ground.ToImage(), atlas.canvas().ToImage()};
  return yard;
}

}  // namespace raylift::demo
