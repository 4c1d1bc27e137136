// Pose problems and their estimates.

#include <algorithm>
#include <array>
#include <limits>

#include "apps/python/conversions.h"
#include "apps/python/estimate_state.h"
#include "base/progress.h"
#include "estimation/fields.h"

#include "raylift/base/parallel.h"
#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/estimation/solvers.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift::python {
namespace {

using OptionalArray = std::optional<ArrayLike>;

// Returns an index; nullopt where it is negative or none are given.
std::optional<int> IndexAt(const std::optional<py::array_t<int64_t>>& indices, size_t i) {
  if (!indices || indices->data()[i] < 0) return std::nullopt;
  constexpr int64_t kBeyondAll = std::numeric_limits<int>::max();  // no list is as long
  return static_cast<int>(std::min(indices->data()[i], kBeyondAll));
}
// Returns a standard deviation; nullopt where it is NaN or none are given.
std::optional<double> SigmaAt(const std::optional<py::array_t<double>>& sigmas, const char* name,
                              size_t i) {
  if (!sigmas || std::isnan(sigmas->data()[i])) return std::nullopt;
  const double sigma = sigmas->data()[i];
  if (!(sigma >= 0)) {
    throw InputError(
        fmt::format("{}, row {}: expected a standard deviation, found {}", name, i, sigma));
  }
  return sigma;
}

void RequireEqualCounts(const char* a, size_t count_a, const char* b, size_t count_b) {
  if (count_a != count_b) {
    throw InputError(
        fmt::format("{} and {}: expected as many rows, found {} and {}", a, b, count_a, count_b));
  }
}

int CheckedReference(int64_t index, const char* name, size_t row, size_t count) {
  if (index < 0 || static_cast<size_t>(index) >= count) {
    throw InputError(fmt::format("{}, row {}: expected an index into {} references, found {}", name,
                                 row, count, index));
  }
  return static_cast<int>(index);
}

struct ProblemArrays {
  OptionalArray points2d, points3d, point_sigmas, point_references, point_keypoints, point_matches;
  OptionalArray query2d, reference2d, reference_index, reference_sigmas_px, query_keypoints,
      reference_keypoints;
};

void AddPoints(const ProblemArrays& arrays, PoseProblem& problem) {
  const Rows<2> pixels(arrays.points2d, "points2d");
  const Rows<3> points(arrays.points3d, "points3d");
  const size_t count = points.size();
  RequireEqualCounts("points2d", pixels.size(), "points3d", count);
  RequireMostInside(pixels, "points2d", [&](size_t) { return SizeOf(problem.query_camera); });
  const auto sigmas = PerMatch<double>(arrays.point_sigmas, "point_sigmas", count);
  const auto references = PerMatch<int64_t>(arrays.point_references, "point_references", count);
  const auto keypoints = PerMatch<int64_t>(arrays.point_keypoints, "point_keypoints", count);
  const auto matches = PerMatch<int64_t>(arrays.point_matches, "point_matches", count);
  problem.matches_2d3d.resize(count);
  for (size_t i = 0; i < count; ++i) {
    Match2D3D& match = problem.matches_2d3d[i];
    match.query_px = pixels[i];
    match.point_in_world = points[i];
    match.point_sigma = SigmaAt(sigmas, "point_sigmas", i);
    match.query_keypoint = IndexAt(keypoints, i);
    if (const auto reference = IndexAt(references, i)) {
      match.reference =
          CheckedReference(*reference, "point_references", i, problem.references.size());
    }
    if (const auto other = IndexAt(matches, i)) {
      match.match_2d2d = static_cast<size_t>(*other);
      if (*match.match_2d2d >= problem.matches_2d2d.size()) {
        throw InputError(
            fmt::format("point_matches, row {}: expected an index into {} 2D-2D "
                        "matches, found {}",
                        i, problem.matches_2d2d.size(), *other));
      }
    }
  }
}

void AddPairs(const ProblemArrays& arrays, PoseProblem& problem) {
  const Rows<2> query(arrays.query2d, "query2d"), reference(arrays.reference2d, "reference2d");
  const size_t count = query.size();
  RequireEqualCounts("query2d", count, "reference2d", reference.size());
  const auto indices = PerMatch<int64_t>(arrays.reference_index, "reference_index", count);
  const auto sigmas = PerMatch<double>(arrays.reference_sigmas_px, "reference_sigmas_px", count);
  const auto keypoints = PerMatch<int64_t>(arrays.query_keypoints, "query_keypoints", count);
  const auto others = PerMatch<int64_t>(arrays.reference_keypoints, "reference_keypoints", count);
  if (count > 0 && !indices && problem.references.size() > 1) {
    throw InputError("reference_index is missing: there are several references");
  }
  RequireMostInside(query, "query2d", [&](size_t) { return SizeOf(problem.query_camera); });
  problem.matches_2d2d.resize(count);
  for (size_t i = 0; i < count; ++i) {
    Match2D2D& match = problem.matches_2d2d[i];
    match.reference = CheckedReference(indices ? indices->data()[i] : 0, "reference_index", i,
                                       problem.references.size());
    match.query_px = query[i];
    match.reference_px = reference[i];
    match.reference_sigma_px = SigmaAt(sigmas, "reference_sigmas_px", i);
    match.query_keypoint = IndexAt(keypoints, i);
    match.reference_keypoint = IndexAt(others, i);
  }
  RequireMostInside(reference, "reference2d", [&](size_t i) {
    return SizeOf(
        problem.references[static_cast<size_t>(problem.matches_2d2d[i].reference)].camera);
  });
}

PoseProblem MakeProblem(const CameraLike& camera, const ProblemArrays& arrays,
                        const std::vector<PosedImageLike>& references,
                        const std::vector<int>& clusters, const PosePriors& priors,
                        const std::string& name) {
  PoseProblem problem;
  problem.name = name;
  problem.query_camera = ToCamera(camera);
  problem.references = ToPosedImages(references);
  if (!clusters.empty()) {
    RequireEqualCounts("reference_clusters", clusters.size(), "references", references.size());
  }
  problem.reference_clusters = clusters;
  problem.priors = priors;
  AddPairs(arrays, problem);
  AddPoints(arrays, problem);
  return problem;
}

// Binds properties that are arrays of what each match has: its pixels or its point, or an index
// (-1: none).
template <typename Match>
class MatchProperties {
 public:
  using Class = py::class_<KnownProblem, std::shared_ptr<KnownProblem>>;

  MatchProperties(Class& owner, std::vector<Match> PoseProblem::*matches)
      : owner_(owner), matches_(matches) {}

  template <int kRows>
  const MatchProperties& Add(const char* name, Eigen::Matrix<double, kRows, 1> Match::*member,
                             const char* help) const {
    const auto get = [matches = matches_, member](const KnownProblem& problem) {
      const auto& all = problem.*matches;
      return MakeRows(all.size(), kRows, [&](size_t i) { return all[i].*member; });
    };
    owner_.def_property_readonly(name, get, help);
    return *this;
  }
  template <typename Index>
  const MatchProperties& Add(const char* name, Index Match::*member, const char* help) const {
    const auto get = [matches = matches_, member](const KnownProblem& problem) {
      const auto& all = problem.*matches;
      py::array_t<int64_t> array(std::ssize(all));
      for (size_t i = 0; i < all.size(); ++i) {
        const auto index = std::optional(all[i].*member);
        array.mutable_data()[i] = index ? static_cast<int64_t>(*index) : -1;
      }
      return array;
    };
    owner_.def_property_readonly(name, get, help);
    return *this;
  }

 private:
  Class& owner_;
  std::vector<Match> PoseProblem::*matches_;
};

void BindProblem(py::module_& module) {
  const auto none = py::none();
  py::class_<KnownProblem, std::shared_ptr<KnownProblem>> bound(
      module, "PoseProblem",
      "All that an estimator sees of one query: 2D-3D matches, 2D-2D matches, or both.");
  bound
      .def(py::init([](const CameraLike& camera, OptionalArray points2d, OptionalArray points3d,
                       OptionalArray point_sigmas, OptionalArray point_references,
                       OptionalArray point_keypoints, OptionalArray point_matches,
                       const std::vector<PosedImageLike>& references, OptionalArray query2d,
                       OptionalArray reference2d, OptionalArray reference_index,
                       OptionalArray reference_sigmas_px, OptionalArray query_keypoints,
                       OptionalArray reference_keypoints, const std::vector<int>& clusters,
                       const PositionArgument& position, const GravityArgument& gravity,
                       const HeadingArgument& heading, const OrientationArgument& orientation,
                       const std::optional<double>& focal_sigma, const std::string& name) {
             return std::make_shared<KnownProblem>(
                 MakeProblem(camera,
                             {points2d, points3d, point_sigmas, point_references, point_keypoints,
                              point_matches, query2d, reference2d, reference_index,
                              reference_sigmas_px, query_keypoints, reference_keypoints},
                             references, clusters,
                             ToPriors({.position = position,
                                       .gravity = gravity,
                                       .heading = heading,
                                       .orientation = orientation,
                                       .focal_sigma = focal_sigma}),
                             name));
           }),
           py::arg("camera"), py::arg("points2d") = none, py::arg("points3d") = none, py::kw_only(),
           py::arg("point_sigmas") = none, py::arg("point_references") = none,
           py::arg("point_keypoints") = none, py::arg("point_matches") = none,
           py::arg("references") = std::vector<PosedImageLike>(), py::arg("query2d") = none,
           py::arg("reference2d") = none, py::arg("reference_index") = none,
           py::arg("reference_sigmas_px") = none, py::arg("query_keypoints") = none,
           py::arg("reference_keypoints") = none,
           py::arg("reference_clusters") = std::vector<int>(), py::arg("position_prior") = none,
           py::arg("gravity_prior") = none, py::arg("heading_prior") = none,
           py::arg("orientation_prior") = none, py::arg("focal_sigma") = none, py::arg("name") = "",
           "The arguments are those of raylift.estimate_pose(), and the camera's focal_sigma.")
      .def_readonly("name", &PoseProblem::name, "The query's; estimates depend on it.")
      .def_readonly("camera", &PoseProblem::query_camera, "The query's.")
      .def_readonly("references", &PoseProblem::references)
      .def(
          "write",
          [](const KnownProblem& problem, const PathLike& file) {
            WritePoseProblem(ToPath(file, "file"), {problem, std::nullopt});
          },
          py::arg("file"), "As JSON (pose-problem/2), which `raylift estimate` reads.")
      .def_static(
          "read",
          [](const PathLike& file) {
            return std::make_shared<KnownProblem>(ReadPoseProblem(ToPath(file, "file")).problem);
          },
          py::arg("file"), "Raises InputError with the JSON path of what is wrong.")
      .def("__repr__", [](const KnownProblem& p) {
        return fmt::format("<raylift.PoseProblem {} 2D-3D, {} 2D-2D matches, {} references>",
                           p.matches_2d3d.size(), p.matches_2d2d.size(), p.references.size());
      });
  BindState(bound, py::overload_cast<const KnownProblem&>(&StateOf), &ProblemOf);
  MatchProperties<Match2D3D>(bound, &PoseProblem::matches_2d3d)
      .Add("points2d", &Match2D3D::query_px, "Query pixels (N, 2) of the 2D-3D matches.")
      .Add("points3d", &Match2D3D::point_in_world, "Their points in the world (N, 3).")
      .Add("point_references", &Match2D3D::reference,
           "Index of the reference that each point was lifted from (N,); -1: none.")
      .Add("point_keypoints", &Match2D3D::query_keypoint,
           "Index of the query's keypoint (N,); -1: not known.")
      .Add("point_matches", &Match2D3D::match_2d2d,
           "Index of the 2D-2D match that each point was lifted from (N,); -1: none.");
  MatchProperties<Match2D2D>(bound, &PoseProblem::matches_2d2d)
      .Add("query2d", &Match2D2D::query_px, "Query pixels (M, 2) of the 2D-2D matches.")
      .Add("reference2d", &Match2D2D::reference_px, "Their reference pixels (M, 2).")
      .Add("reference_index", &Match2D2D::reference, "Which reference (M,).")
      .Add("query_keypoints", &Match2D2D::query_keypoint,
           "Index of the query's keypoint (M,); -1: not known.");
}

std::optional<Rigid3> PoseOf(const PoseEstimate& estimate) { return estimate.cam_from_world; }

void BindEstimate(py::module_& module) {
  const auto text = [](const auto value) { return std::string(ToString(value)); };
  py::class_<PoseEstimate, std::shared_ptr<PoseEstimate>> bound(
      module, "PoseEstimate", "What an estimator found. True where there is a pose.");
  bound.def_property_readonly("cam_from_world", &PoseOf, "The pose; None where there is none.")
      .def_property_readonly(
          "verdict", [=](const PoseEstimate& e) { return text(e.verdict); },
          "\"localized\", \"doubtful\" or \"failed\".")
      .def_readonly("confidence", &PoseEstimate::confidence,
                    "The probability that the pose is right.")
      .def_property_readonly(
          "failure", [=](const PoseEstimate& e) { return text(e.failure); },
          "Why there is no pose; \"ok\" where there is one.")
      .def_property_readonly(
          "covariance",
          [](const PoseEstimate& e) -> std::optional<py::array_t<double>> {
            if (!e.covariance) return std::nullopt;
            return ToArray(*e.covariance);
          },
          R"(6 x 6, of a step (rotation vector in radians, translation in scene units) in the camera's
frame: the true pose is exp(w), v after the estimated one. None where the inliers do not
determine the pose.)")
      .def_readonly("rotation_sigma_deg", &PoseEstimate::rotation_sigma_deg,
                    "Standard deviation of the orientation, degrees; 0 without a covariance.")
      .def_readonly(
          "position_sigma", &PoseEstimate::position_sigma,
          "Standard deviation of the camera's center, scene units; 0 without a covariance.")
      .def_readonly("position_observable", &PoseEstimate::position_observable,
                    "False where only the orientation is determined.")
      .def_property_readonly(
          "inliers_2d3d", [](const PoseEstimate& e) { return ToArray(e.inliers_2d3d); },
          "Which 2D-3D matches agree with the pose (N,), bool.")
      .def_property_readonly(
          "inliers_2d2d", [](const PoseEstimate& e) { return ToArray(e.inliers_2d2d); },
          "Which 2D-2D matches agree with the pose (M,), bool.")
      .def_property_readonly(
          "inlier_mask",
          [](const PoseEstimate& e) {
            std::vector<bool> all = e.inliers_2d3d;
            all.insert(all.end(), e.inliers_2d2d.begin(), e.inliers_2d2d.end());
            return ToArray(all);
          },
          "Which matches agree with the pose (N + M,), bool: inliers_2d3d and inliers_2d2d.")
      .def_property_readonly(
          "num_inliers",
          [](const PoseEstimate& e) { return e.score_2d3d.num_inliers + e.score_2d2d.num_inliers; },
          "Of both kinds of matches.")
      .def_property_readonly("num_inliers_2d3d",
                             [](const PoseEstimate& e) { return e.score_2d3d.num_inliers; })
      .def_property_readonly("num_inliers_2d2d",
                             [](const PoseEstimate& e) { return e.score_2d2d.num_inliers; })
      .def_property_readonly(
          "alternatives",
          [](const PoseEstimate& e) {
            py::list alternatives;
            for (const AlternativePose& other : e.alternatives) {
              py::dict alternative;
              alternative["cam_from_world"] = other.cam_from_world;
              alternative["probability"] = other.probability;
              alternative["covariance"] = py::none();
              if (other.covariance) alternative["covariance"] = ToArray(*other.covariance);
              alternatives.append(alternative);
            }
            return alternatives;
          },
          "Poses elsewhere that explain the matches about as well, so that the pose is doubtful; "
          "the likeliest first.")
      .def_readonly("inlier_keypoints", &PoseEstimate::inlier_keypoints,
                    "Of the query: one counts once, in however many references.")
      .def_readonly("num_keypoints", &PoseEstimate::num_keypoints, "That have matches.")
      .def_readonly("iterations", &PoseEstimate::iterations, "Of RANSAC.")
      .def_property_readonly(
          "solver", [=](const PoseEstimate& e) { return text(e.solver); },
          "Which minimal solver the pose comes from: \"p3p\", \"e5p1\" or \"d3p1\".")
      .def_property_readonly(
          "noise",
          [](const PoseEstimate& e) -> py::object {
            if (!e.noise) return py::none();
            return NumbersOf<double>(ConstFieldsOf(*e.noise));
          },
          "What Adaptive found the matches to be worth (standard deviations), or "
          "None.")
      .def_readonly("refined_camera", &PoseEstimate::refined_camera,
                    "The camera with the refined focal length, with refine_focal; else None.")
      .def("__bool__", [](const PoseEstimate& e) { return e.cam_from_world.has_value(); })
      .def("__repr__",
           [=](const PoseEstimate& e) {
             if (!e.cam_from_world)
               return fmt::format("<raylift.PoseEstimate: {}>", text(e.failure));
             return fmt::format(
                 "<raylift.PoseEstimate {}, confidence {:.4f}: {} of {} 2D-3D and {} of {} 2D-2D "
                 "matches "
                 "agree>",
                 text(e.verdict), e.confidence, e.score_2d3d.num_inliers, e.score_2d3d.num_matches,
                 e.score_2d2d.num_inliers, e.score_2d2d.num_matches);
           })
      .def("_repr_html_",
           [](const PoseEstimate& e) { return HtmlTable("PoseEstimate", HtmlRowsOf(e)); });
  BindState(bound, py::overload_cast<const PoseEstimate&>(&StateOf), &EstimateOf);
}

EstimatorOptions OptionsOf(const py::kwargs& given) {
  Keywords keywords(given);
  EstimatorOptions options;
  keywords.Take(FieldsOf(options));
  std::filesystem::path calibration;
  keywords.Take("scene_calibration", calibration);
  keywords.RequireAllTaken();
  options.Validate();
  if (!calibration.empty()) options.scene_noise = ReadSceneCalibration(calibration)->match_noise;
  return options;
}

// Returns the options for a problem, with the noise of its scene, or of other problems (`learned`),
// where it is known.
EstimatorOptions OptionsFor(const KnownProblem& problem, EstimatorOptions options,
                            const std::optional<SceneNoise>& learned = std::nullopt) {
  if (!options.scene_noise) options.scene_noise = problem.scene_noise;
  if (!options.scene_noise) options.scene_noise = learned;
  return options;
}

using ProblemList = std::vector<std::reference_wrapper<const KnownProblem>>;

// Learns the noise of the problems that know nothing of their scene, whatever their order.
std::optional<SceneNoise> LearnSceneNoise(ProblemList problems, const EstimatorOptions& options,
                                          int threads) {
  std::erase_if(problems, [](const KnownProblem& problem) { return problem.scene_noise; });
  const auto path_of = [](const KnownProblem& problem) {
    return std::filesystem::path(problem.name);  // as for the files that the program reads
  };
  std::stable_sort(
      problems.begin(), problems.end(),
      [&](const KnownProblem& a, const KnownProblem& b) { return path_of(a) < path_of(b); });
  return raylift::LearnSceneNoise(
      problems.size(), [&](size_t i) -> PoseProblem { return problems[i].get(); }, options,
      threads);
}

std::vector<PoseEstimate> EstimateAll(const ProblemList& problems, bool independent, int threads,
                                      const EstimatorOptions& options) {
  std::optional<SceneNoise> learned;
  if (!independent && !options.scene_noise) learned = LearnSceneNoise(problems, options, threads);
  std::vector<PoseEstimate> estimates(problems.size());
  Progress count("problems", problems.size(), Progress::Show::kNever);
  ParallelFor(problems.size(), threads, [&](size_t i) {
    const KnownProblem& problem = problems[i];
    estimates[i] = MakePoseEstimator(OptionsFor(problem, options, learned))->Estimate(problem);
    count.Advance();
  });
  return estimates;
}

// Returns the rows of an array of the shape (kCount, 3).
template <size_t kCount>
std::array<Eigen::Vector3d, kCount> Vectors(const ArrayLike& argument, std::string_view name) {
  const Rows<3> rows(argument, name);
  if (rows.size() != kCount) {
    throw InputError(fmt::format("{}: expected an array of shape ({}, 3), found {} rows", name,
                                 kCount, rows.size()));
  }
  std::array<Eigen::Vector3d, kCount> vectors;
  for (size_t i = 0; i < kCount; ++i) vectors[i] = rows[i];
  return vectors;
}

void BindSolvers(py::module_& module) {
  module.def(
      "solve_p3p",
      [](const ArrayLike& rays, const ArrayLike& points) {
        return SolveP3p(Vectors<3>(rays, "rays"), Vectors<3>(points, "points3d"));
      },
      py::arg("rays"), py::arg("points3d"),
      "P3P: the poses (cam_from_world, up to 4) from three points (3, 3) and the rays to them in\n"
      "the camera's frame (3, 3), of any length (Camera.rays()). Lambda Twist.");
  module.def(
      "solve_gp3p",
      [](const ArrayLike& centers, const ArrayLike& rays, const ArrayLike& points) {
        return SolveGeneralizedP3p(Vectors<3>(centers, "centers"), Vectors<3>(rays, "rays"),
                                   Vectors<3>(points, "points3d"));
      },
      py::arg("centers"), py::arg("rays"), py::arg("points3d"),
      "Generalized P3P: a rig's poses (rig_from_world, up to 8) from three points, each seen from\n"
      "a center of its own; centers and rays (3, 3) are in the rig's frame.");
  module.def(
      "solve_e5p1",
      [](const ArrayLike& rays, const ArrayLike& reference_rays, const PoseLike& reference,
         const PoseLike& sixth_reference) {
        return SolveE5p1(Vectors<6>(rays, "rays"), Vectors<6>(reference_rays, "reference_rays"),
                         ToPose(reference), ToPose(sixth_reference));
      },
      py::arg("rays"), py::arg("reference_rays"), py::arg("reference"), py::arg("sixth_reference"),
      "E5+1: the poses (cam_from_world, up to 10) from five 2D-2D matches with one reference and "
      "a\n"
      "sixth with another: rays (6, 3) in the camera's frame and in those of the references, "
      "whose\n"
      "poses (cam_from_world) are given.");
  module.def(
      "solve_d3p1",
      [](const ArrayLike& rays, const ArrayLike& points_in_reference, const ArrayLike& fourth_ray,
         const PoseLike& reference, const PoseLike& fourth_reference) {
        return SolveD3p1(Vectors<4>(rays, "rays"),
                         Vectors<3>(points_in_reference, "points_in_reference"),
                         ToVector3(fourth_ray, "fourth_reference_ray"), ToPose(reference),
                         ToPose(fourth_reference));
      },
      py::arg("rays"), py::arg("points_in_reference"), py::arg("fourth_reference_ray"),
      py::arg("reference"), py::arg("fourth_reference"),
      "D3+1: as E5+1, but by three matches whose points (3, 3) are known in the reference's frame\n"
      "up to one factor (depth of any scale), and a fourth with another reference, by its ray "
      "(3,).\n"
      "Rays are (4, 3); up to 4 poses.");
  module.def(
      "solve_up2p",
      [](const ArrayLike& rays, const ArrayLike& points, const ArrayLike& down_in_cam,
         const ArrayLike& down_in_world) {
        return SolveUp2p(Vectors<2>(rays, "rays"), Vectors<2>(points, "points3d"),
                         ToVector3(down_in_cam, "down_in_cam"),
                         ToVector3(down_in_world, "down_in_world"));
      },
      py::arg("rays"), py::arg("points3d"), py::arg("down_in_cam"), py::arg("down_in_world"),
      "UP2P: the poses (cam_from_world, up to 2) from two points (2, 3), the rays to them and the\n"
      "direction of gravity (3,) in both frames.");
  module.def(
      "solve_known_center",
      [](const ArrayLike& rays, const ArrayLike& points, const ArrayLike& center) {
        return SolveKnownCenter(Vectors<2>(rays, "rays"), Vectors<2>(points, "points3d"),
                                ToVector3(center, "center"));
      },
      py::arg("rays"), py::arg("points3d"), py::arg("center"),
      "The pose (cam_from_world, none or one) of a camera at a known center (3,) from two points\n"
      "(2, 3) and the rays to them.");
}

}  // namespace

void BindEstimation(py::module_& module) {
  BindProblem(module);
  BindEstimate(module);
  BindSolvers(module);
  module.def(
      "estimate",
      [](const KnownProblem& problem, const py::kwargs& options) {
        const auto estimator = MakePoseEstimator(OptionsFor(problem, OptionsOf(options)));
        return WithoutLock([&] { return estimator->Estimate(problem); });
      },
      py::arg("problem"),
      "The pose of a problem. Options as of raylift.estimate_pose(), which see.");
  module.def(
      "estimate_all",
      [](const ProblemList& problems, bool independent, int threads,
         const std::optional<ProgressCall>& progress, const py::kwargs& given) {
        const EstimatorOptions options = OptionsOf(given);
        return WithoutLock(progress,
                           [&] { return EstimateAll(problems, independent, threads, options); });
      },
      py::arg("problems"), py::kw_only(), py::arg("independent") = false, py::arg("threads") = 0,
      py::arg("progress") = py::none(),
      R"(The poses of many problems of one scene, as of `raylift estimate`: some 30 of them tell how
noisy the scene's matches are, where no scene_calibration does and the problems, as those of
a LocalizedQuery, do not know it. independent=True: each one's pose is that of estimate().

threads: 0 is all; the poses are the same for any number of them.)");
  module.def(
      "refine_pose",
      [](const KnownProblem& problem, const PoseLike& pose, const py::kwargs& options) {
        const EstimatorOptions values = OptionsFor(problem, OptionsOf(options));
        const Rigid3 cam_from_world = ToPose(pose);
        return WithoutLock([&] { return RefinePose(problem, values, cam_from_world); });
      },
      py::arg("problem"), py::arg("cam_from_world"),
      "Refines a pose without RANSAC: on the matches near it, and then as the method does with\n"
      "RANSAC's best pose. It must be so near that some right matches lie within three "
      "thresholds.\n"
      "Options as of raylift.estimate_pose(). Returns a PoseEstimate.");
}

}  // namespace raylift::python
