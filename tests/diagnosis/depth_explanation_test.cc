// One planted cause at a time, made by casting rays through a camera that is wrong in a known way
// or by changing exact depth; and maps of which nothing may be said.

#include "diagnosis/depth_explanation.h"

#include <cmath>
#include <numbers>
#include <ostream>

#include "base/rng.h"
#include "comparison/compared_room.h"
#include "diagnosis/value_models.h"
#include <gmock/gmock.h>

#include "raylift/diagnosis/depth_faults.h"

namespace raylift {

void PrintTo(const DepthExplanation& found, std::ostream* out) { *out << found.text; }

namespace {

using ::testing::IsEmpty;

// What one camera shows of the room in place of another.
using Planted = std::function<DepthMap(const ComparedRoom& room, const PosedImage& image)>;

DepthMap Cast(const ComparedRoom& room, const Camera& camera, const Rigid3& cam_from_world) {
  return RenderDepth(*room.caster, camera, cam_from_world, 1);
}

// 384 x 288: a pixel is small beside the boxes.
Camera Pinhole(double focal_px = 300, double cx = 192, double cy = 144) {
  const double params[] = {focal_px, focal_px, cx, cy};
  return Camera(CameraModel::kPinhole, 384, 288, params);
}

ComparedRoom LargeRoom() {
  ComparedRoom room;
  for (PosedImage& image : room.images) image.camera = Pinhole();
  return room;
}

DepthExplanation Explain(const Planted& planted, double noise_sigma = 0,
                         ComparedRoom room = LargeRoom()) {
  const MapSource source([&](const PosedImage& image) { return planted(room, image); });
  const auto views = ViewsToExplain(source, room.truth, room.images, 0);
  const auto found = ExplainDepthErrors(views, noise_sigma, 0);
  if (!found) throw std::logic_error("nothing to judge by");
  return *found;
}

Planted Perturbed(const DepthPerturbation& perturbation) {
  return [perturbation](const ComparedRoom& room, const PosedImage& image) {
    return PerturbDepth(Cast(room, image.camera, image.cam_from_world), perturbation, image.name);
  };
}

MATCHER_P(IsCause, cause, std::string(ToString(cause))) {
  *result_listener << "which explains " << arg.explained_percent << " %, alike:";
  for (const DepthFault fault : arg.alike) *result_listener << " " << ToString(fault);
  return arg.cause == cause;
}

TEST(DepthExplanation, AShiftHasItsSize) {
  for (const Eigen::Vector2d& shift :
       {Eigen::Vector2d(1, 0), Eigen::Vector2d(-2, 3.5), Eigen::Vector2d(0.5, -0.5)}) {
    const auto found = Explain([&](const ComparedRoom& room, const PosedImage& image) {
      return Cast(room, Pinhole(300, 192 + shift.x(), 144 + shift.y()), image.cam_from_world);
    });
    ASSERT_THAT(found, IsCause(DepthFault::kShift));
    EXPECT_NEAR(found.size[0], shift.x(), 0.1);
    EXPECT_NEAR(found.size[1], shift.y(), 0.1);
    EXPECT_GT(found.explained_percent, 60);
  }
}

TEST(DepthExplanation, AWrongFocalLengthIsAZoom) {
  for (const double factor : {0.97, 1.03}) {
    const auto found = Explain([&](const ComparedRoom& room, const PosedImage& image) {
      return Cast(room, Pinhole(300 * factor), image.cam_from_world);
    });
    ASSERT_THAT(found, IsCause(DepthFault::kZoom));
    EXPECT_NEAR(found.size[0], factor, 0.002);
  }
}

TEST(DepthExplanation, ARotationHasItsVector) {
  for (const Eigen::Vector3d& deg : {Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0.5, -0.7, 2)}) {
    const Eigen::Quaterniond cam_from_map_camera =
        RotationFromVector(deg * (std::numbers::pi / 180));
    const auto found = Explain([&](const ComparedRoom& room, const PosedImage& image) {
      const Rigid3 turn{cam_from_map_camera, Eigen::Vector3d::Zero()};
      return Cast(room, image.camera, turn.Inverse() * image.cam_from_world);
    });
    ASSERT_THAT(found, IsCause(DepthFault::kRotation));
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(found.size[static_cast<size_t>(axis)], deg[axis], 0.04);
    }
  }
}

TEST(DepthExplanation, ADisplacedCameraHasItsPlace) {
  const Eigen::Vector3d place(0.15, 0.02, -0.08);
  const auto found = Explain([&](const ComparedRoom& room, const PosedImage& image) {
    const Rigid3 cam_from_map_camera{Eigen::Quaterniond::Identity(), place};
    return Cast(room, image.camera, cam_from_map_camera.Inverse() * image.cam_from_world);
  });
  ASSERT_THAT(found, IsCause(DepthFault::kDisplacement));
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(found.size[static_cast<size_t>(axis)], place[axis], 0.004);
  }
}

TEST(DepthExplanation, AMissingUndistortionIsTheLens) {
  const auto found = Explain([&](const ComparedRoom& room, const PosedImage& image) {
    return MisalignDepth(Cast(room, image.camera, image.cam_from_world), image.camera,
                         {.lens = -0.08});
  });
  ASSERT_THAT(found, IsCause(DepthFault::kLens));
  EXPECT_NEAR(found.size[0], -0.08, 0.005);
}

// Between frames of a camera that turns and moves unevenly.
TEST(DepthExplanation, ATimeOffsetIsInFrames) {
  ComparedRoom room = LargeRoom();
  Rng rng(StreamSeed(0, "DepthExplanation.TimeOffset", ""));
  for (size_t i = 0; i < room.images.size(); ++i) {
    const double angle = 0.05 * static_cast<double>(i) + 0.02 * rng.Uniform();
    room.images[i].cam_from_world =
        LookAt({2.4 * std::sin(angle), 0.05 * rng.Uniform(), -2 * std::cos(angle)},
               {0.3 * rng.Uniform(), 0.3 * rng.Uniform(), 1});
  }
  const auto images = room.images;
  const auto found = Explain(
      [&](const ComparedRoom& of, const PosedImage& image) {
        const auto index = static_cast<size_t>(image.name[1] - '0');
        const PosedImage& other = images[std::min(index + 1, images.size() - 1)];
        return Cast(of, image.camera, other.cam_from_world);
      },
      0, room);
  ASSERT_THAT(found, IsCause(DepthFault::kTimeOffset));
  EXPECT_NEAR(found.size[0], 1, 0.05);
}

// Maps under each other's names, of images that hardly see the same.
TEST(DepthExplanation, ATimeOffsetIsFoundBetweenImagesThatShareLittle) {
  ComparedRoom room = LargeRoom();
  for (size_t i = 0; i < room.images.size(); ++i) {
    const double angle = 1.9 * static_cast<double>(i);
    room.images[i].cam_from_world =
        LookAt({0.5 * std::sin(angle), 0, -2}, {3 * std::cos(angle), 0, 3 * std::sin(angle)});
  }
  const auto images = room.images;
  const auto found = Explain(
      [&](const ComparedRoom& of, const PosedImage& image) {
        const auto index = static_cast<size_t>(image.name[1] - '0');
        return Cast(of, image.camera, images[index > 0 ? index - 1 : 0].cam_from_world);
      },
      0, room);
  ASSERT_THAT(found, IsCause(DepthFault::kTimeOffset));
  EXPECT_NEAR(found.size[0], -1, 0.05);
}

TEST(DepthExplanation, AnOffsetIsNoFactor) {
  const auto found = Explain(Perturbed({.offset = 0.2}));
  ASSERT_THAT(found, IsCause(DepthFault::kOffset));
  EXPECT_NEAR(found.size[0], 0.2, 1e-4);
  EXPECT_THAT(Explain(Perturbed({.scale = 1.05})), IsCause(DepthFault::kScale));
  EXPECT_THAT(Explain(Perturbed({.scale_sigma = 0.05})), IsCause(DepthFault::kScale));
}

TEST(DepthExplanation, AffineInverseDepthIsNamed) {
  const auto found = Explain([](const ComparedRoom& room, const PosedImage& image) {
    DepthMap map = Cast(room, image.camera, image.cam_from_world);
    for (float& z : map.z) z = 1 / (0.9F / z + 0.06F);
    return map;
  });
  ASSERT_THAT(found, IsCause(DepthFault::kInverseOffset));
  EXPECT_NEAR(found.size[0], 0.9, 1e-3);
  EXPECT_NEAR(found.size[1], 0.06, 1e-3);
}

// As an inverse offset to the first order.
TEST(DepthExplanation, ADriftWithDepthIsACurve) {
  const auto found = Explain([](const ComparedRoom& room, const PosedImage& image) {
    DepthMap map = Cast(room, image.camera, image.cam_from_world);
    for (float& z : map.z) z *= 1 + 0.02F * z;
    return map;
  });
  ASSERT_THAT(found, IsCause(DepthFault::kCurve));
  for (size_t i = 0; i < found.size.size(); i += 2) {
    EXPECT_NEAR(found.size[i + 1], 0.02 * found.size[i], 1e-3);
  }
}

TEST(DepthExplanation, AClampHasItsLimit) {
  const auto found = Explain(Perturbed({.clamp = 3}));
  ASSERT_THAT(found, IsCause(DepthFault::kClamp));
  EXPECT_NEAR(found.size[0], 3, 1e-6);
}

TEST(DepthExplanation, QuantizationIsInBits) {
  for (const int bits : {6, 8}) {
    const auto found = Explain(Perturbed({.quantization_bits = bits}));
    ASSERT_THAT(found, IsCause(DepthFault::kQuantization));
    EXPECT_NEAR(found.size[1], bits, 0.01);
  }
  // Of disparity.
  const auto inverse = Explain([](const ComparedRoom& room, const PosedImage& image) {
    DepthMap map = Cast(room, image.camera, image.cam_from_world);
    for (float& z : map.z) z = 1 / (0.02F * std::round(1 / z / 0.02F));
    return map;
  });
  ASSERT_THAT(inverse, IsCause(DepthFault::kQuantization));
  EXPECT_NEAR(inverse.size[0], 0.02, 1e-5);
  EXPECT_EQ(inverse.size[2], 1);
}

TEST(DepthExplanation, SmoothingHasItsWidth) {
  for (const double sigma_px : {1.5, 4.0}) {
    const auto found = Explain(Perturbed({.smoothing_px = sigma_px}));
    ASSERT_THAT(found, IsCause(DepthFault::kSmoothing));
    EXPECT_NEAR(found.size[0], sigma_px, 0.1 * sigma_px);
  }
}

// Changes each pixel of the exact map.
template <typename Value>
Planted EachPixel(Value value) {
  return [value](const ComparedRoom& room, const PosedImage& image) {
    const DepthMap z = Cast(room, image.camera, image.cam_from_world);
    DepthMap planted = z;
    for (int y = 0; y < z.height_px; ++y) {
      for (int x = 0; x < z.width_px; ++x) {
        planted.z[static_cast<size_t>(y * z.width_px + x)] = value(z, x, y);
      }
    }
    return planted;
  };
}

TEST(DepthExplanation, ConventionsThatWereMisreadAreNamed) {
  for (const auto& [x, y] : {std::pair(true, false), std::pair(false, true)}) {
    const auto found = Explain(EachPixel([x = x, y = y](const DepthMap& z, int u, int v) {
      return z.At(x ? z.width_px - 1 - u : u, y ? z.height_px - 1 - v : v);
    }));
    ASSERT_THAT(found, IsCause(DepthFault::kFlipped));
    EXPECT_EQ(found.size, (std::vector<double>{x ? 1.0 : 0.0, y ? 1.0 : 0.0}));
  }
  for (const int power : {1, -1}) {
    const auto found = Explain(EachPixel([power](const DepthMap& z, int u, int v) {
      const double length = std::hypot((u + 0.5 - 192) / 300, (v + 0.5 - 144) / 300, 1);
      return z.At(u, v) * static_cast<float>(std::pow(length, power));
    }));
    ASSERT_THAT(found, IsCause(DepthFault::kRayLength));
    EXPECT_EQ(found.size, std::vector<double>{double(power)});
  }
  // Much is explained by a power, too, but for little of what there is in all.
  const auto inverse = Explain(
      EachPixel([](const DepthMap& z, int u, int v) { return 1 / (120 / z.At(u, v) + 4); }));
  ASSERT_THAT(inverse, IsCause(DepthFault::kInverseOffset));
  EXPECT_NEAR(inverse.size[1], 4, 0.01);
  for (const float shift : {0.0F, 20.0F}) {
    const auto found = Explain(
        EachPixel([shift](const DepthMap& z, int u, int v) { return 300 / z.At(u, v) + shift; }));
    ASSERT_THAT(found, IsCause(DepthFault::kDisparity));
    EXPECT_NEAR(found.size[0], 300, 0.1);
    EXPECT_NEAR(found.size[1], shift, 0.1);
  }
  const auto power = Explain(
      EachPixel([](const DepthMap& z, int u, int v) { return std::pow(z.At(u, v), 0.8F); }));
  ASSERT_THAT(power, IsCause(DepthFault::kPowerLaw));
  EXPECT_NEAR(power.size[0], 0.8, 1e-3);
}

TEST(DepthExplanation, FattenedForegroundHasItsReach) {
  const auto found = Explain(EachPixel([](const DepthMap& z, int u, int v) {
    float nearest = z.At(u, v);
    for (int y = std::max(0, v - 4); y <= std::min(z.height_px - 1, v + 4); ++y) {
      for (int x = std::max(0, u - 4); x <= std::min(z.width_px - 1, u + 4); ++x) {
        nearest = std::min(nearest, z.At(x, y));
      }
    }
    return nearest < 0.8F * z.At(u, v) ? nearest : z.At(u, v);
  }));
  ASSERT_THAT(found, IsCause(DepthFault::kFattening));
  EXPECT_EQ(found.size[0], 4);
}

TEST(DepthExplanation, PixelsThatFlyBetweenSurfacesAreNamed) {
  std::vector<Finding> findings;
  const auto flying = Explain(Perturbed({.flying_share = 0.8}));
  AddExplanation(flying, findings);
  ASSERT_FALSE(findings.empty());
  EXPECT_EQ(findings[0].fault, DepthFault::kFlying) << findings[0].text;
  for (const DepthPerturbation& other :
       {DepthPerturbation{}, DepthPerturbation{.relative_noise_sigma = 0.02},
        DepthPerturbation{.warp_sigma = 0.06}, DepthPerturbation{.scale_sigma = 0.05}}) {
    EXPECT_LT(Explain(Perturbed(other)).flying_percent, 4);
  }
}

TEST(DepthExplanation, NoiseDoesNotHideAMisalignment) {
  const auto found = Explain(
      [&](const ComparedRoom& room, const PosedImage& image) {
        return PerturbDepth(Cast(room, Pinhole(300, 195, 142), image.cam_from_world),
                            {.relative_noise_sigma = 0.01}, image.name);
      },
      0.01);
  ASSERT_THAT(found, IsCause(DepthFault::kShift));
  EXPECT_NEAR(found.size[0], 3, 0.3);
  EXPECT_NEAR(found.size[1], -2, 0.3);
}

TEST(DepthExplanation, ExactAndNoisyMapsHaveNoCause) {
  const auto exact = Explain(Perturbed({}));
  EXPECT_EQ(exact.cause, std::nullopt) << exact.text;
  EXPECT_THAT(exact.alike, IsEmpty());
  EXPECT_LT(exact.error, 1e-6);
  for (const DepthPerturbation& other :
       {DepthPerturbation{.relative_noise_sigma = 0.02}, DepthPerturbation{.noise_sigma = 0.05},
        DepthPerturbation{.relative_noise_sigma = 0.001}}) {
    const auto found =
        Explain(Perturbed(other), std::max(other.relative_noise_sigma, other.noise_sigma / 3));
    EXPECT_EQ(found.cause, std::nullopt) << found.text;
    EXPECT_THAT(found.alike, IsEmpty());
  }
}

TEST(DepthExplanation, OtherFaultsAreNotTakenForOne) {
  for (const DepthPerturbation& other :
       {DepthPerturbation{.warp_sigma = 0.06}, DepthPerturbation{.floaters = 25},
        DepthPerturbation{.bubbles = 4}, DepthPerturbation{.flying_share = 0.8},
        DepthPerturbation{.hole_share = 0.2}}) {
    const auto found = Explain(Perturbed(other));
    EXPECT_EQ(found.cause, std::nullopt) << found.text;
    EXPECT_THAT(found.alike, IsEmpty());
  }
}

// Where all is one plane a shift adds a constant to the inverse depth, and a turn does nearly so.
TEST(DepthExplanation, OnAPlaneNothingIsNamedThatCouldBeAnother) {
  ComparedRoom room = LargeRoom();
  const auto plane = [](double shift_px) {
    DepthMap map{384, 288, {}};
    for (int y = 0; y < 288; ++y) {
      for (int x = 0; x < 384; ++x) {
        map.z.push_back(static_cast<float>(1 / (0.3 + 5e-4 * (x - shift_px) + 2e-4 * y)));
      }
    }
    return map;
  };
  std::vector<ExplainedView> views;
  for (int i = 0; i < 3; ++i) views.push_back({Pinhole(), plane(6), plane(0), 1, {}});
  const auto found = ExplainDepthErrors(views, 0, 0);
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->cause, std::nullopt) << found->text;
  EXPECT_THAT(found->alike, ::testing::Contains(DepthFault::kShift));
}

TEST(DepthExplanation, ReplacesTheTracesOfACause) {
  std::vector<Finding> findings = {{DepthFault::kEdges, 30, 2, "edges"},
                                   {DepthFault::kHoles, 7, 1.4, "holes"}};
  DepthExplanation explanation;
  explanation.cause = DepthFault::kShift;
  explanation.size = {2, 0};
  explanation.text = "shift";
  AddExplanation(explanation, findings);
  ASSERT_EQ(findings.size(), 2u);
  EXPECT_EQ(findings[0].fault, DepthFault::kShift);
  EXPECT_EQ(findings[1].fault, DepthFault::kHoles);

  findings = {{DepthFault::kWarp, 0.1, 8, "warp"}, {DepthFault::kHoles, 7, 1.4, "holes"}};
  explanation.cause.reset();
  explanation.alike = {DepthFault::kShift, DepthFault::kRotation};
  explanation.text = "shift or rotation would do alike";
  AddExplanation(explanation, findings);
  ASSERT_EQ(findings.size(), 2u);
  EXPECT_EQ(findings[0].text, "not explained: shift or rotation would do alike");
  EXPECT_EQ(findings[1].fault, DepthFault::kHoles);

  // How large a scale is, its own finding alone tells.
  findings = {{DepthFault::kScale, 1.04, 3, "scale"}, {DepthFault::kWarp, 0.1, 8, "warp"}};
  explanation.alike = {DepthFault::kScale, DepthFault::kZoom};
  AddExplanation(explanation, findings);
  ASSERT_EQ(findings.size(), 2u);
  EXPECT_EQ(findings[1].fault, DepthFault::kScale);

  std::vector<Finding> none;
  DepthExplanation unknown;
  unknown.is_beyond_noise = true;
  unknown.error = 0.03;
  AddExplanation(unknown, none);
  ASSERT_EQ(none.size(), 1u);
  EXPECT_EQ(none[0].fault, DepthFault::kUnexplained);
  none.clear();
  unknown.error = 0.001;
  AddExplanation(unknown, none);
  EXPECT_THAT(none, IsEmpty());
}

TEST(DepthExplanation, TheSameForAnyNumberOfThreads) {
  const ComparedRoom room(3);
  const MapSource source(
      [&](const PosedImage& image) { return Perturbed({.offset = 0.1})(room, image); });
  const auto views = ViewsToExplain(source, room.truth, room.images, 2);
  const auto one = ExplainDepthErrors(views, 0.01, 1), four = ExplainDepthErrors(views, 0.01, 4);
  EXPECT_EQ(one->size, four->size);
  EXPECT_EQ(one->explained_percent, four->explained_percent);
}

}  // namespace
}  // namespace raylift
