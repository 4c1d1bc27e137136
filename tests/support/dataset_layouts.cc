#include "support/dataset_layouts.h"

#include "scene/seven_scenes_kinect.h"
#include <fmt/format.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

using std::filesystem::path;

std::string Join(const std::vector<double>& numbers, std::string_view separator) {
  std::string text;
  for (const double number : numbers) {
    if (!text.empty()) text += separator;
    text += FormatDouble(number);
  }
  return text;
}

std::vector<double> Quaternion(const Rigid3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  return {q.w(), q.x(), q.y(), q.z()};
}

std::vector<double> Vector(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

Eigen::Matrix4d MatrixOf(const Rigid3& pose) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = pose.rotation.toRotationMatrix();
  matrix.topRightCorner<3, 1>() = pose.translation;
  return matrix;
}

std::string MatrixText(const Eigen::Matrix4d& matrix) {
  std::string text;
  for (int row = 0; row < 4; ++row) {
    text += Join({matrix(row, 0), matrix(row, 1), matrix(row, 2), matrix(row, 3)}, " ") + "\n";
  }
  return text;
}

void WritePicture(const LayoutInput& input, const path& file, const PosedImage& view) {
  std::filesystem::create_directories(file.parent_path());
  if (input.write_picture) {
    input.write_picture(file, view);
    return;
  }
  WriteImage(file, {view.camera.width_px(), view.camera.height_px(), 1,
                    std::vector<uint8_t>(static_cast<size_t>(view.camera.width_px()) *
                                             static_cast<size_t>(view.camera.height_px()),
                                         90)});
}

// A camera of the layout's size; the parameters are those of 64 x 48 pixels.
Camera ScaledCamera(const LayoutInput& input, CameraModel model,
                    const std::vector<double>& params) {
  return Camera(model, 64, 48, params).Scaled(input.width_px, input.height_px);
}

// Of data sets that are one sequence: the references, then one query.
std::vector<Rigid3> AllPoses(const LayoutInput& input) {
  std::vector<Rigid3> poses = input.references;
  poses.push_back(input.queries.at(0));
  return poses;
}

void SplitInOrder(const LayoutInput& input, const std::vector<PosedImage>& views, Layout& layout) {
  layout.query_every = static_cast<int>(input.references.size()) + 1;
  layout.references.assign(views.begin(), views.begin() + layout.query_every - 1);
  layout.queries = {views[static_cast<size_t>(layout.query_every) - 1]};
}

void WriteModel(const path& folder, const std::vector<PosedImage>& views) {
  ColmapModel model;
  for (const PosedImage& view : views) {
    const auto id = static_cast<uint32_t>(model.images.size() + 1);
    model.cameras.emplace(id, view.camera);
    ColmapImage& image = model.images[id];
    image.name = view.name;
    image.camera_id = id;
    image.SetCamFromWorld(view.cam_from_world);
  }
  WriteColmapModel(folder, model, ColmapForm::kBinary);
}

}  // namespace

Layout Write7Scenes(const path& folder, const LayoutInput& input) {
  Layout layout{.folder = folder, .images = folder, .query_images = folder};
  const Camera camera =
      Camera(CameraModel::kSimplePinhole, 640, 480, std::vector<double>{525, 320, 240})
          .Scaled(input.width_px, input.height_px);
  const auto add = [&](const std::string& sequence, size_t index, const Rigid3& pose) {
    const std::string stem = fmt::format("{}/frame-{:06}", sequence, index);
    PosedImage view{stem + ".color.png", camera, pose};
    WritePicture(input, folder / view.name, view);
    const Rigid3 depth_from_world = SevenScenesColorFromDepth().Inverse() * pose;
    WriteFile(folder / (stem + ".pose.txt"), MatrixText(MatrixOf(depth_from_world.Inverse())));
    return view;
  };
  for (size_t i = 0; i < input.references.size(); ++i) {
    layout.references.push_back(add(i % 2 == 0 ? "seq-01" : "seq-02", i, input.references[i]));
  }
  for (size_t i = 0; i < input.queries.size(); ++i) {
    layout.queries.push_back(add("seq-03", i, input.queries[i]));
  }
  WriteFile(folder / "TrainSplit.txt", "sequence1\nsequence2\n");
  WriteFile(folder / "TestSplit.txt", "sequence3\n");
  return layout;
}

Layout Write12Scenes(const path& folder, const LayoutInput& input) {
  Layout layout{.folder = folder, .images = folder, .query_images = folder};
  const Camera camera = ScaledCamera(input, CameraModel::kPinhole, {53, 52, 31.5, 24.5});
  const auto add = [&](size_t index, const Rigid3& pose) {
    const std::string stem = fmt::format("data/frame-{:06}", index);
    PosedImage view{stem + ".color.jpg", camera, pose};
    WritePicture(input, folder / view.name, view);
    WriteFile(folder / (stem + ".pose.txt"), MatrixText(MatrixOf(pose.Inverse())));
    return view;
  };
  const size_t num_queries = input.queries.size(), num_references = input.references.size();
  for (size_t i = 0; i < num_queries; ++i) layout.queries.push_back(add(i, input.queries[i]));
  for (size_t i = 0; i < num_references; ++i) {
    layout.references.push_back(add(num_queries + i, input.references[i]));
  }
  const auto k = camera.params();
  WriteFile(folder / "info.txt",
            fmt::format("m_versionNumber = 4\nm_sensorName = StructureSensor\n"
                        "m_colorWidth = {}\nm_colorHeight = {}\nm_depthWidth = 64\n"
                        "m_calibrationColorIntrinsic = {} 0 {} 0 0 {} {} 0 0 0 1 0 0 0 0 1 \n",
                        camera.width_px(), camera.height_px(), FormatDouble(k[0]),
                        FormatDouble(k[2] - 0.5), FormatDouble(k[1]), FormatDouble(k[3] - 0.5)));
  WriteFile(folder / "split.txt", fmt::format("sequence0 [frames={}]  [start=0 ; end={}]\n"
                                              "sequence1 [frames={}]  [start={} ; end={}]\n",
                                              num_queries, num_queries - 1, num_references,
                                              num_queries, num_queries + num_references - 1));
  return layout;
}

Layout WriteCambridge(const path& folder, const LayoutInput& input) {
  Layout layout{.folder = folder, .images = folder, .query_images = folder};
  std::string nvm;
  const auto add = [&](const std::string& name, const Rigid3& pose, std::string& rows) {
    const double focal_px = (52 + 0.1 * static_cast<double>(rows.size() % 7)) * input.width_px / 64;
    const Camera camera(CameraModel::kSimplePinhole, input.width_px, input.height_px,
                        std::vector<double>{focal_px, 0.5 * input.width_px, 0.5 * input.height_px});
    PosedImage view{name + ".png", camera, pose};
    WritePicture(input, folder / view.name, view);
    const std::string q = Join(Quaternion(pose), " ");
    const std::string c = Join(Vector(pose.OriginInSource()), " ");
    rows += fmt::format("{} {} {}\n", view.name, c, q);
    nvm += fmt::format("{}.jpg\t{} {} {} 0 0\n", name, FormatDouble(focal_px), q, c);
    return view;
  };
  const std::string header =
      "Visual Landmark Dataset V1\nImageFile, Camera Position [X Y Z W P Q R]\n\n";
  std::string train = header, test = header;
  for (size_t i = 0; i < input.references.size(); ++i) {
    layout.references.push_back(add(fmt::format("seq1/frame{:05}", i), input.references[i], train));
  }
  for (size_t i = 0; i < input.queries.size(); ++i) {
    layout.queries.push_back(add(fmt::format("seq2/frame{:05}", i), input.queries[i], test));
  }
  WriteFile(folder / "dataset_train.txt", train);
  WriteFile(folder / "dataset_test.txt", test);
  WriteFile(
      folder / "reconstruction.nvm",
      fmt::format("NVM_V3\n\n{}\n{}\n0\n", layout.references.size() + layout.queries.size(), nvm));
  return layout;
}

Layout WriteAachen(const path& folder, const LayoutInput& input) {
  const path images = folder / "images_upright";
  Layout layout{.folder = folder, .images = images, .query_images = images};
  const auto add = [&](const std::string& name, const Camera& camera, const Rigid3& pose) {
    PosedImage view{name, camera, pose};
    WritePicture(input, images / name, view);
    return view;
  };
  for (size_t i = 0; i < input.references.size(); ++i) {
    layout.references.push_back(add(fmt::format("db/{}.jpg", i + 1),
                                    ScaledCamera(input, CameraModel::kSimpleRadial,
                                                 {50 + static_cast<double>(i), 32, 24, -0.01}),
                                    input.references[i]));
  }
  std::vector<Query> day, night;
  for (size_t i = 0; i < input.queries.size(); ++i) {
    const std::string name = fmt::format("query/{}/nexus/IMG_{}.jpg", i == 0 ? "day" : "night", i);
    const Camera camera = ScaledCamera(input, CameraModel::kSimpleRadial, {51, 32, 24, 0.02});
    layout.queries.push_back(add(name, camera, input.queries[i]));
    (i == 0 ? day : night).push_back({name, camera});
  }
  WriteQueryList(folder / "queries" / "day_time_queries_with_intrinsics.txt", day);
  WriteQueryList(folder / "queries" / "night_time_queries_with_intrinsics.txt", night);
  WriteModel(folder / "3D-models" / "aachen_v_1_1", layout.references);
  return layout;
}

Layout WriteCmu(const path& folder, const LayoutInput& input) {
  const path slice = folder / "slice2";
  Layout layout{.folder = folder, .images = slice / "database", .query_images = slice / "query"};
  const std::vector<double> lens = {-0.02, 0.001, 0.0005, -0.0003};
  const auto camera = [&](double focal_px) {
    return ScaledCamera(input, CameraModel::kOpenCv,
                        {focal_px, focal_px + 0.5, 32.2, 23.8, lens[0], lens[1], lens[2], lens[3]});
  };
  const Camera c0 = camera(52), c1 = camera(55);
  const auto add = [&](size_t index, const Rigid3& pose, const path& images, std::string& rows) {
    PosedImage view{
        fmt::format("img_{:05}_c{}_{}us.jpg", index, index % 2, 1303398474000000 + 1000000 * index),
        index % 2 == 0 ? c0 : c1, pose};
    WritePicture(input, images / view.name, view);
    rows += fmt::format("{} {} {}\n", view.name, Join(Quaternion(pose), " "),
                        Join(Vector(pose.OriginInSource()), " "));
    return view;
  };
  std::string database, truth, names;
  for (size_t i = 0; i < input.references.size(); ++i) {
    layout.references.push_back(add(i, input.references[i], layout.images, database));
  }
  for (size_t i = 0; i < input.queries.size(); ++i) {
    layout.queries.push_back(add(100 + i, input.queries[i], layout.query_images, truth));
    names += layout.queries.back().name + "\n";
  }
  WriteFile(folder / "intrinsics.txt",
            fmt::format("# camera model width height parameters\nc0 {}\nc1 {}\n", c0.ToString(),
                        c1.ToString()));
  WriteFile(slice / "ground-truth-database-images-slice2.txt", database);
  WriteFile(slice / "test-images-slice2.txt", names);
  WriteFile(slice / "camera-poses" / "slice-2-day.txt", truth);
  return layout;
}

Layout WriteGangnam(const path& folder, const LayoutInput& input) {
  const auto part = [&](const std::string& name) { return folder / "release" / name / "sensors"; };
  Layout layout{.folder = folder,
                .images = part("mapping") / "records_data",
                .query_images = part("validation") / "records_data"};
  const Camera left = ScaledCamera(input, CameraModel::kPinhole, {52, 53, 32, 24});
  const Camera right =
      ScaledCamera(input, CameraModel::kOpenCv, {54, 55, 31, 23, -0.01, 0.001, 0, 0});
  const Rigid3 right_from_rig{RotationFromVector({0.1, -0.2, 0.3}), {0.2, 0.1, -0.05}};
  const Rigid3 left_from_rig{RotationFromVector({-0.3, 0.1, 0.05}), {-0.1, 0.02, 0.03}};
  const auto csv = [](const Rigid3& pose) {
    return Join(Quaternion(pose), ", ") + ", " + Join(Vector(pose.translation), ", ");
  };
  const auto camera_row = [](const std::string& id, const Camera& camera) {
    std::string text = camera.ToString();
    for (size_t at = text.find(' '); at != std::string::npos; at = text.find(' ', at + 2)) {
      text.replace(at, 1, ", ");
    }
    return fmt::format("{}, , camera, {}\n", id, text);
  };
  const std::string header = "# kapture format: 1.1\n# comment\n";
  const auto write = [&](const std::string& name, const std::string& session,
                         const std::vector<Rigid3>& poses) {
    std::vector<PosedImage> views;
    std::string records = header, trajectories = header;
    for (size_t i = 0; i < poses.size(); ++i) {
      const bool is_left = i % 2 == 0;
      const std::string device = is_left ? "40027089_00" : "40027089_01";
      const uint64_t timestamp = 1575366894000000 + 100000 * i;
      const PosedImage view{fmt::format("{}/{}/{}.jpg", session, device, timestamp),
                            is_left ? left : right, poses[i]};
      WritePicture(input, part(name) / "records_data" / view.name, view);
      records += fmt::format("{}, {}, {}\n", timestamp, device, view.name);
      const Rigid3 rig_from_world = (is_left ? left_from_rig : right_from_rig).Inverse() * poses[i];
      trajectories += fmt::format("{}, rig0, {}\n", timestamp, csv(rig_from_world));
      views.push_back(view);
    }
    WriteFile(part(name) / "records_camera.txt", records);
    WriteFile(part(name) / "trajectories.txt", trajectories);
    WriteFile(part(name) / "sensors.txt", header + "wifi0, , wifi\n" +
                                              camera_row("40027089_00", left) +
                                              camera_row("40027089_01", right));
    WriteFile(part(name) / "rigs.txt",
              header + fmt::format("rig0, 40027089_00, {}\nrig0, 40027089_01, {}\n",
                                   csv(left_from_rig), csv(right_from_rig)));
    return views;
  };
  layout.references = write("mapping", "2019-12-03_10-54-54", input.references);
  layout.queries = write("validation", "2019-12-18_12-34-13", input.queries);
  return layout;
}

Layout WriteNerfstudio(const path& folder, const LayoutInput& input) {
  Layout layout{.folder = folder, .images = folder, .query_images = folder};
  const Rigid3 transform{RotationFromVector({0.4, -0.3, 0.2}), {1, -2, 3}};
  const double scale = 2.5;
  std::string frames;
  std::vector<PosedImage> views;
  for (const Rigid3& pose : AllPoses(input)) {
    const size_t i = views.size();
    const Camera camera = ScaledCamera(
        input, CameraModel::kOpenCv,
        {52 + 0.1 * static_cast<double>(i), 53, 32, 24, -0.01, 0.001, 0.0002, -0.0001});
    const PosedImage view{fmt::format("frames/{:04}.png", i + 1), camera, pose};
    WritePicture(input, folder / view.name, view);
    Rigid3 world_from_cam = transform * pose.Inverse();
    world_from_cam.translation *= scale;
    Eigen::Matrix4d matrix = MatrixOf(world_from_cam);
    matrix.col(1) *= -1;
    matrix.col(2) *= -1;
    std::string rows;
    for (int row = 0; row < 4; ++row) {
      rows += (row > 0 ? ", [" : "[") +
              Join({matrix(row, 0), matrix(row, 1), matrix(row, 2), matrix(row, 3)}, ", ") + "]";
    }
    frames += fmt::format("{}{{\"file_path\": \"./{}\", \"fl_x\": {}, \"transform_matrix\": [{}]}}",
                          frames.empty() ? "" : ",\n", view.name, FormatDouble(camera.focal_x_px()),
                          rows);
    views.push_back(view);
  }
  const auto k = views[0].camera.params();
  const Eigen::Matrix4d m = MatrixOf(transform);
  std::string applied;
  for (int row = 0; row < 3; ++row) {
    applied +=
        (row > 0 ? ", [" : "[") + Join({m(row, 0), m(row, 1), m(row, 2), m(row, 3)}, ", ") + "]";
  }
  WriteFile(folder / "transforms.json",
            fmt::format("{{\"camera_model\": \"OPENCV\", \"fl_x\": 1, \"fl_y\": {}, \"cx\": {}, "
                        "\"cy\": {}, \"w\": {}, \"h\": {}, \"k1\": {}, \"k2\": {}, \"p1\": {}, "
                        "\"p2\": {},\n\"applied_transform\": [{}], \"applied_scale\": {},\n"
                        "\"frames\": [{}]}}\n",
                        FormatDouble(k[1]), FormatDouble(k[2]), FormatDouble(k[3]), input.width_px,
                        input.height_px, FormatDouble(k[4]), FormatDouble(k[5]), FormatDouble(k[6]),
                        FormatDouble(k[7]), applied, scale, frames));
  SplitInOrder(input, views, layout);
  return layout;
}

Layout WriteTum(const path& parent, const LayoutInput& input) {
  const path folder = parent / "rgbd_dataset_freiburg3_tiny";
  Layout layout{.folder = folder, .images = folder, .query_images = folder};
  const Camera camera = Camera(CameraModel::kPinhole, 640, 480,
                               std::vector<double>{535.433105, 539.212524, 320.606653, 248.132132})
                            .Scaled(input.width_px, input.height_px);
  std::string rgb = "# color images\n# file: 'tiny.bag'\n# timestamp filename\n";
  std::string truth = "# ground truth trajectory\n# timestamp tx ty tz qx qy qz qw\n";
  std::vector<PosedImage> views;
  for (const Rigid3& pose : AllPoses(input)) {
    const std::string time =
        fmt::format("{:.6f}", 1305031102.175304 + 0.25 * static_cast<double>(views.size()));
    const PosedImage view{fmt::format("rgb/{}.png", time), camera, pose};
    WritePicture(input, folder / view.name, view);
    rgb += fmt::format("{} {}\n", time, view.name);
    const Rigid3 world_from_cam = pose.Inverse();
    const Eigen::Quaterniond& q = world_from_cam.rotation;
    truth += fmt::format("{} {} {}\n", time, Join(Vector(world_from_cam.translation), " "),
                         Join({q.x(), q.y(), q.z(), q.w()}, " "));
    views.push_back(view);
  }
  WriteFile(folder / "rgb.txt", rgb);
  WriteFile(folder / "groundtruth.txt", truth);
  SplitInOrder(input, views, layout);
  return layout;
}

Layout WriteScanNet(const path& parent, const LayoutInput& input) {
  const path folder = parent / "scene0000_00";
  Layout layout{.folder = folder, .images = folder, .query_images = folder};
  const Camera camera = ScaledCamera(input, CameraModel::kPinhole, {57, 58, 32.1, 23.7});
  const auto k = camera.params();
  std::vector<PosedImage> views;
  for (const Rigid3& pose : AllPoses(input)) {
    const PosedImage view{fmt::format("color/{}.jpg", views.size()), camera, pose};
    WritePicture(input, folder / view.name, view);
    WriteFile(folder / "pose" / fmt::format("{}.txt", views.size()),
              MatrixText(MatrixOf(pose.Inverse())));
    views.push_back(view);
  }
  Eigen::Matrix4d intrinsic = Eigen::Matrix4d::Identity();
  intrinsic.topLeftCorner<2, 3>() << k[0], 0, k[2] - 0.5, 0, k[1], k[3] - 0.5;
  WriteFile(folder / "intrinsic" / "intrinsic_color.txt", MatrixText(intrinsic));
  SplitInOrder(input, views, layout);
  return layout;
}

Layout WriteScanNetPp(const path& folder, const LayoutInput& input) {
  const path dslr = folder / "dslr", phone = folder / "iphone";
  Layout layout{
      .folder = folder, .images = dslr / "resized_images", .query_images = dslr / "resized_images"};
  const Camera fisheye = ScaledCamera(input, CameraModel::kOpenCvFisheye,
                                      {40, 41, 32.5, 23.5, 0.02, -0.01, 0.003, -0.001});
  const Camera phone_camera =
      ScaledCamera(input, CameraModel::kOpenCv, {52, 53, 31, 24, -0.02, 0.004, 0.001, -0.001});
  std::vector<PosedImage> photographs, frames;
  const auto add = [&](const Rigid3& pose) {
    PosedImage view{fmt::format("DSC{:05}.JPG", 1752 + photographs.size()), fisheye, pose};
    WritePicture(input, layout.images / view.name, view);
    photographs.push_back(view);
    return view;
  };
  std::string train, test;
  for (const Rigid3& pose : input.references) {
    layout.references.push_back(add(pose));
    train += fmt::format("{}\"{}\"", train.empty() ? "" : ", ", layout.references.back().name);
  }
  for (const Rigid3& pose : input.queries) {
    layout.queries.push_back(add(pose));
    test += fmt::format("{}\"{}\"", test.empty() ? "" : ", ", layout.queries.back().name);
    const PosedImage frame{fmt::format("frame_{:06}.jpg", 10 * frames.size()), phone_camera, pose};
    WritePicture(input, phone / "rgb" / frame.name, frame);
    frames.push_back(frame);
  }
  WriteModel(dslr / "colmap", photographs);
  WriteModel(phone / "colmap", frames);
  WriteFile(folder / "scans" / "mesh_aligned_0.05.ply", "");  // nobody reads it
  WriteFile(dslr / "train_test_lists.json",
            fmt::format("{{\"train\": [{}], \"test\": [{}], \"has_masks\": true}}", train, test));
  return layout;
}

Layout WriteEth3d(const path& folder, const LayoutInput& input) {
  Layout layout{.folder = folder, .images = folder / "images", .query_images = folder / "images"};
  const Camera camera = ScaledCamera(
      input, CameraModel::kThinPrismFisheye,
      {50, 51, 32.2, 24.3, -0.03, 0.01, 0.0003, -0.0002, 0.002, -0.001, 0.0002, -0.0001});
  std::vector<PosedImage> views;
  for (const Rigid3& pose : AllPoses(input)) {
    const PosedImage view{fmt::format("dslr_images/DSC_{:04}.JPG", 286 + views.size()), camera,
                          pose};
    WritePicture(input, layout.images / view.name, view);
    views.push_back(view);
  }
  WriteModel(folder / "dslr_calibration_jpg", views);
  SplitInOrder(input, views, layout);
  return layout;
}

Layout WriteLamar(const path& folder, const LayoutInput& input) {
  const path sessions = folder / "sessions";
  Layout layout{.folder = folder, .images = sessions, .query_images = sessions};
  const Camera camera = ScaledCamera(input, CameraModel::kPinhole, {52, 53, 32, 24});
  const Rigid3 right_from_rig{RotationFromVector({0.1, -0.2, 0.3}), {0.2, 0.1, -0.05}};
  const auto csv = [](const Rigid3& pose) {
    return Join(Quaternion(pose), ", ") + ", " + Join(Vector(pose.translation), ", ");
  };
  const auto write = [&](const std::string& session, const std::vector<Rigid3>& poses,
                         bool is_rig) {
    std::vector<PosedImage> views;
    std::string images = "# timestamp, sensor_id, image_path\n", sensors, trajectories;
    for (const Rigid3& pose : poses) {
      const std::string device = is_rig ? "s/right" : fmt::format("ios_{}/cam", views.size());
      const uint64_t timestamp = 1638000000000000 + 40000 * views.size();
      const std::string file = fmt::format("images/{}.jpg", timestamp);
      const PosedImage view{session + "/raw_data/" + file, camera, pose};
      WritePicture(input, sessions / view.name, view);
      images += fmt::format("{}, {}, {}\n", timestamp, device, file);
      const Rigid3 device_from_world = is_rig ? right_from_rig.Inverse() * pose : pose;
      trajectories += fmt::format("{}, {}, {}\n", timestamp, is_rig ? "s/rig" : device,
                                  csv(device_from_world.Inverse()));
      const auto k = camera.params();
      if (!is_rig || views.empty()) {
        sensors += fmt::format("{}, name, camera, PINHOLE, {}, {}, {}\n", device, input.width_px,
                               input.height_px, Join({k[0], k[1], k[2], k[3]}, ", "));
      }
      views.push_back(view);
    }
    WriteFile(sessions / session / "images.txt", images);
    WriteFile(sessions / session / "trajectories.txt", trajectories);
    WriteFile(sessions / session / "sensors.txt",
              "# sensor_id, name, sensor_type, [sensor_params]+\n" + sensors);
    if (is_rig) {
      WriteFile(sessions / session / "rigs.txt",
                fmt::format("s/rig, s/right, {}\n", csv(right_from_rig.Inverse())));
    }
    return views;
  };
  layout.references = write("map", input.references, true);
  layout.queries = write("query_val_phone", input.queries, false);
  return layout;
}

}  // namespace raylift
