#include <cstdio>
#include <filesystem>
#include <memory>

#include <raylift/base/error.h>
#include <raylift/io/image_file.h>
#include <raylift/localization/localizer.h>
#include <raylift/localization/match_source.h>

int main(int, char** arguments) {
  // References with known poses, their photographs, and a mesh in the same coordinates.
  const std::filesystem::path demo = arguments[1];
  // What is wrong with the input is thrown.
  try {
    raylift::OpenScene(
        {.model = demo / "nothing", .geometry = {"mesh:" + (demo / "scene.obj").string()}});
  } catch (const raylift::InputError&) {
    std::puts("there is no such model");
  }
  const auto scene = std::make_shared<const raylift::Scene>(
      raylift::OpenScene({.model = demo / "model",
                          .images = demo / "images",
                          .geometry = {"mesh:" + (demo / "scene.obj").string()}}));
  const raylift::Localizer localizer(scene, raylift::OpenMatches(*scene, {}, {}), {});

  const raylift::Image photograph =
      raylift::ReadImage(demo / "images/query/query_02.jpg", raylift::ImageChannels::kRgb);
  const double f_cx_cy_k[] = {488, 323.1, 236.4, -0.11};
  const raylift::Camera camera(raylift::CameraModel::kSimpleRadial, photograph.width_px,
                               photograph.height_px, f_cx_cy_k);
  const raylift::LocalizedQuery query =
      localizer.Localize({"a photograph", camera}, photograph).localized;
  if (!query.localized()) return 1;
  const Eigen::Vector3d center = query.estimate.cam_from_world->OriginInSource();
  std::printf("taken at (%.0f, %.0f, %.0f)\n", center.x(), center.y(), center.z());
}
