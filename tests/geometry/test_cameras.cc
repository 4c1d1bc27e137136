#include "geometry/test_cameras.h"

namespace raylift {

std::vector<TestCamera> TypicalCameras() {
  using enum CameraModel;
  const auto make = [](CameraModel model, std::vector<double> params) {
    return Camera(model, 640, 480, params);
  };
  std::vector<TestCamera> cameras;
  const auto add = [&](const std::string& name, CameraModel model, std::vector<double> params) {
    cameras.push_back({name, make(model, std::move(params))});
  };
  add("SimplePinhole", kSimplePinhole, {500, 320, 240});
  add("Pinhole", kPinhole, {500, 510, 315, 245});
  add("SimpleRadialBarrel", kSimpleRadial, {500, 320, 240, -0.2});
  add("SimpleRadialPincushion", kSimpleRadial, {500, 320, 240, 0.3});
  add("Radial", kRadial, {500, 320, 240, -0.25, 0.08});
  add("OpenCv", kOpenCv, {500, 510, 315, 245, -0.28, 0.09, 0.002, -0.003});
  add("OpenCvFisheye", kOpenCvFisheye, {260, 262, 320, 240, -0.01, 0.02, -0.008, 0.001});
  add("FullOpenCv", kFullOpenCv,
      {500, 510, 315, 245, 0.4, -0.1, 0.001, -0.002, 0.02, 0.7, -0.05, 0.03});
  add("Fov", kFov, {400, 405, 320, 240, 0.9});
  add("FovAlmostPinhole", kFov, {400, 405, 320, 240, 1e-5});
  add("SimpleRadialFisheye", kSimpleRadialFisheye, {260, 320, 240, -0.02});
  add("RadialFisheye", kRadialFisheye, {260, 320, 240, -0.03, 0.004});
  add("ThinPrismFisheye", kThinPrismFisheye,
      {260, 262, 320, 240, -0.02, 0.01, 0.001, -0.002, -0.003, 0.0005, 0.002, -0.001});
  add("RadTanThinPrismFisheye", kRadTanThinPrismFisheye,
      {260, 262, 320, 240, 0.02, -0.015, 0.004, -0.002, 0.0005, -0.00005, 0.001, -0.002, 0.001,
       -0.0005, -0.001, 0.0004});
  add("SimpleDivisionBarrel", kSimpleDivision, {400, 320, 240, -0.3});
  add("SimpleDivisionPincushion", kSimpleDivision, {500, 320, 240, 0.2});
  add("Division", kDivision, {400, 410, 320, 240, -0.2});
  add("SimpleFisheye", kSimpleFisheye, {150, 320, 240});
  add("Fisheye", kFisheye, {260, 262, 320, 240});
  add("Eucm", kEucm, {300, 305, 320, 240, 0.62, 1.13});
  add("EucmAlmostPinhole", kEucm, {500, 505, 320, 240, 0.1, 0.9});
  add("Equirectangular", kEquirectangular, {640, 480});
  return cameras;
}

}  // namespace raylift
