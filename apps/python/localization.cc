// Photographs localized in scenes.

#include <algorithm>
#include <map>
#include <mutex>

#include "apps/localize_inputs.h"
#include "apps/matching_options.h"
#include "apps/python/conversions.h"
#include "apps/python/estimate_state.h"
#include "apps/python/geometry_source.h"
#include "base/progress.h"
#include "estimation/fields.h"
#include "lifting/fields.h"
#include "localization/fields.h"
#include "localization/rerender.h"
#include "localization/results/result_json.h"
#include "pictures/picture_codec.h"
#include "report/page.h"

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/localize_all.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/localization/scene_calibration.h"
#include "raylift/views/rendered_references.h"

namespace raylift::python {
namespace {

using ScenePointer = std::shared_ptr<Scene>;

bool IsMapping(const py::object& object) {
  return PyMapping_Check(object.ptr()) != 0 && py::hasattr(object, "keys");
}

LocalizerOptions TakeLocalizerOptions(Keywords& keywords) {
  LocalizerOptions options;
  keywords.Take(FieldsOf(options.estimator));
  keywords.Take(FieldsOf(options.filter));
  keywords.Take(FieldsOf(options.candidates));
  keywords.Take("geometry_mode", options.geometry_mode);
  keywords.Take("min_confidence", options.min_confidence);
  return options;
}

// Takes the options of retrieval, where they are given. A method that needs prior poses and has
// none is for leave_one_out(), which takes the references' own. A descriptor of the caller's own
// goes to `own`.
std::optional<RetrievalOptions> TakeRetrieval(Keywords& keywords, const Scene& scene,
                                              OwnMatching& own) {
  RetrievalFlags flags;
  py::object retrieval = py::none();
  py::object prior_poses = py::none();
  std::optional<std::pair<double, double>> view_range;
  keywords.Take("retrieval", retrieval);
  keywords.Take("global_features", flags.global_features.references);
  keywords.Take("query_global_features", flags.global_features.queries);
  keywords.Take("prior_poses", prior_poses);
  keywords.Take("max_angle_deg", flags.max_angle_deg);
  keywords.Take("view_range", view_range);
  if (py::isinstance<py::str>(retrieval)) {
    flags.method = ToEnum<RetrievalMethod>("retrieval", retrieval.cast<std::string>());
  } else if (!retrieval.is_none()) {
    own.retrieval = retrieval.cast<DescriptorLike>();
  }
  if (view_range) flags.view_range = {view_range->first, view_range->second};
  const bool has_poses = !prior_poses.is_none();
  const bool is_mapping = IsMapping(prior_poses);
  if (is_mapping) {
    flags.prior_poses = "a dict";
  } else if (has_poses) {
    flags.prior_poses = ToPath(prior_poses.cast<PathLike>(), "prior_poses");
  }
  if (!flags.Any()) {
    flags.CheckAngle();
    return std::nullopt;
  }
  if (own.retrieval) {
    throw OptionError("retrieval by a function goes without the options of other ways");
  }
  using Queries = RetrievalFlags::Queries;
  const std::vector<std::string> surfaces(scene.Surface() == nullptr ? 0 : 1, "mesh:");
  RetrievalOptions options =
      flags.Resolve(surfaces, has_poses ? Queries::kOwn : Queries::kReferences);
  if (is_mapping) {
    options.prior_poses = ToNamedPoses(prior_poses, "prior_poses");
  } else if (has_poses) {
    flags.ReadPriorPoses(&options);
  }
  return options;
}

MatchingOptions TakeMatchingOptions(Keywords& keywords, const Scene& scene, OwnMatching own) {
  MatchingOptions options;
  HlocFlags given;
  keywords.Take("features", given.files.features);
  keywords.Take("matches", given.files.matches);
  keywords.Take("pairs", given.files.pairs);
  keywords.Take("top_k", options.top_k);
  keywords.Take(FieldsOf(options.front_end));
  keywords.Take("cache", options.front_end.cache);
  keywords.Take("extractor_name", options.front_end.extractor_name);
  keywords.Take("matcher_name", options.front_end.matcher_name);
  keywords.Take("query_images", options.front_end.query_images);
  if (given.Any() && !given.All()) {
    throw OptionError(
        "features, matches and pairs go together, but for matches that are COLMAP's database or a "
        "folder of pairs");
  }
  if (!options.front_end.matcher_name.empty() &&
      (options.front_end.cache.empty() || !own.matcher)) {
    throw OptionError("matcher_name needs cache and matcher");
  }
  options.retrieval = TakeRetrieval(keywords, scene, own);
  if (given.Any() && (own.extractor || own.matcher || own.retrieval)) {
    throw OptionError(
        "an extractor or matcher makes matches, which features, matches and pairs give");
  }
  if (given.Any()) options.hloc = given.files;
  if (given.Any() && options.retrieval) {
    throw OptionError("retrieval goes without files of matches, which name the references");
  }
  keywords.Take(FieldsOf(options.reading));
  Check(options.reading);
  RequireAtLeast("top_k", options.top_k, 1);
  CheckRanges(ConstFieldsOf(options.front_end));
  if (options.front_end.query_images.empty()) options.front_end.query_images = scene.images;
  UseOwn(own, options.reading, &options.front_end);
  return options;
}

// Returns a copy of the caller's dict and of the dicts in it, which the caller may change later.
py::dict CopyOf(const py::dict& given) {
  const auto is_dict = [](const py::handle& value) { return py::isinstance<py::dict>(value); };
  py::dict copy;
  for (const auto& [key, value] : given) {
    copy[key] = is_dict(value) ? value.attr("copy")() : py::reinterpret_borrow<py::object>(value);
  }
  return copy;
}

// The state of the module's Localizer. The front end extracts the references' features when the
// first query needs them.
class SceneLocalizer {
 public:
  SceneLocalizer(ScenePointer scene, const py::dict& reference_features,
                 const std::optional<ExtractorLike>& extractor,
                 const std::optional<MatcherLike>& matcher, int threads, const py::kwargs& given)
      : scene_(std::move(scene)),
        threads_(threads),
        state_(py::make_tuple(scene_, CopyOf(reference_features), extractor, matcher, threads,
                              CopyOf(given))) {
    Keywords keywords(given);
    options_ = TakeLocalizerOptions(keywords);
    matching_ = TakeMatchingOptions(keywords, *scene_, {extractor, matcher, std::nullopt});
    std::filesystem::path calibration;
    keywords.Take("scene_calibration", calibration);
    keywords.Take("align_depth", align_);
    int rounds = 0;
    keywords.Take("rerender", rounds);
    keywords.RequireAllTaken();
    RequireAtLeast("rerender", rounds, 0);
    if (rounds > 0) rerenderer_ = MakeRerenderer(rounds);
    matching_.front_end.threads = threads;
    if (!calibration.empty()) {
      scene_ = std::make_shared<Scene>(Calibrated(*scene_, ReadSceneCalibration(calibration)));
    }
    for (const PosedImage& image : scene_->references.images) {
      if (!reference_features.contains(image.name)) continue;
      matching_.front_end.features.emplace(
          image.name, ToFeatures(reference_features[py::str(image.name)], SizeOf(image.camera)));
    }
    // This throws for options out of their range.
    Localizer(scene_, nullptr, options_);
  }

  Localizer WithoutMatches() const { return {scene_, nullptr, options_}; }
  // Runs without the interpreter's lock.
  Localizer ForQueries() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!source_) source_ = OpenMatches(*scene_, {}, matching_);
    }
    return {CalibratedScene(source_), source_, options_};
  }
  // Returns the scene as every query that the front end matches sees it, alone or among others: its
  // calibration is learned once, from the references.
  std::shared_ptr<const Scene> CalibratedScene(const std::shared_ptr<const MatchSource>& source) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!calibrated_) {
      calibrated_ = matching_.hloc
                        ? std::shared_ptr<const Scene>(scene_)
                        : std::make_shared<const Scene>(Calibrate(
                              *scene_, source, {},
                              {.localizer = options_, .align = align_, .threads = threads_}));
    }
    return calibrated_;
  }
  // Returns the arguments that it was made of.
  const py::tuple& state() const { return state_; }
  const Scene& scene() const { return *scene_; }
  const ScenePointer& shared_scene() const { return scene_; }
  const LocalizerOptions& options() const { return options_; }
  const MatchingOptions& matching() const { return matching_; }
  int threads() const { return threads_; }
  LocalizeAllOptions BatchOptions(int threads) const {
    return {.localizer = options_, .align = align_, .rerenderer = rerenderer_, .threads = threads};
  }
  const std::shared_ptr<const Rerenderer>& rerenderer() const { return rerenderer_; }

 private:
  std::shared_ptr<const Rerenderer> MakeRerenderer(int rounds) const {
    const auto surface = PicturedSurface(*scene_);
    if (surface == nullptr) {
      throw OptionError("rerender", std::to_string(rounds), "needs a mesh or splats in the scene");
    }
    return std::make_shared<const Rerenderer>(
        surface, ColorsLikePhotographs(*surface), matching_.front_end.query_images,
        RerenderOptions{.rounds = rounds,
                        .use_pairs = Scores2D2DAlone(options_.estimator.method),
                        .max_features = matching_.front_end.max_features,
                        .reprojection_threshold_px = options_.estimator.reprojection_threshold_px});
  }

  ScenePointer scene_;
  LocalizerOptions options_;
  AlignMode align_ = AlignMode::kAuto;
  std::shared_ptr<const Rerenderer> rerenderer_;  // null: poses are not sharpened
  MatchingOptions matching_;
  int threads_;
  py::tuple state_;
  std::mutex mutex_;
  std::shared_ptr<const MatchSource> source_;
  std::shared_ptr<const Scene> calibrated_;
};

using CameraArgument = std::optional<CameraLike>;

// Returns the query with its priors; `unknown` makes the query where no camera is given.
Query AskedQuery(const std::string& name, const CameraArgument& camera, PosePriors priors,
                 const std::function<Query()>& unknown) {
  return WithPriors(camera ? Query{name, ToCamera(*camera)} : unknown(), std::move(priors));
}

ResultPointer LocalizePhotograph(SceneLocalizer& localizer, const Query& asked,
                                 const Image& photograph) {
  return WithoutLock([&] {
    const Localizer knowing = localizer.ForQueries();
    QueryResult result = knowing.Localize(asked, photograph);
    if (localizer.rerenderer() != nullptr) {
      localizer.rerenderer()->Improve(asked, photograph, knowing.estimator(), result,
                                      knowing.options().min_confidence);
    }
    return std::make_shared<KnownResult>(std::move(result), knowing);
  });
}

ResultPointer LocalizeFeatures(SceneLocalizer& localizer, const Query& asked,
                               const py::object& given) {
  const Features features = ToFeatures(given, SizeOf(asked.camera));
  if (localizer.rerenderer() != nullptr) {
    throw InputError("query: rerender needs the photograph, found its features");
  }
  return WithoutLock([&] {
    const Localizer knowing = localizer.ForQueries();
    return std::make_shared<KnownResult>(knowing.Localize(asked, features), knowing);
  });
}

ResultPointer LocalizeOne(SceneLocalizer& localizer, const py::object& query,
                          const CameraArgument& camera, const std::string& name,
                          const PositionArgument& position, const GravityArgument& gravity,
                          const HeadingArgument& heading, const OrientationArgument& orientation,
                          const RangeArgument& range, const std::optional<double>& focal_sigma,
                          double focal_range) {
  const PosePriors priors =
      ToPriors({position, gravity, heading, orientation, range, focal_sigma, focal_range});
  const auto& retrieval = localizer.matching().retrieval;
  if (retrieval && retrieval->method != RetrievalMethod::kVlad) {
    throw OptionError("retrieval", std::string(ToString(retrieval->method)),
                      "is for localize_all(): those of a single query are retrieved by vlad");
  }
  if (query.is_none()) throw WrongType("query: expected a photograph or features, found None");
  if (IsMapping(query)) {
    const Query asked = AskedQuery(name, camera, priors, []() -> Query {
      throw InputError("camera: expected that of the features, found None");
    });
    return LocalizeFeatures(localizer, asked, query);
  }
  std::filesystem::path file;
  if (py::isinstance<py::str>(query) || py::hasattr(query, "__fspath__")) {
    file = ToPath(py::reinterpret_borrow<PathLike>(query), "query");
  }
  const Image photograph = file.empty()
                               ? ToImage(py::reinterpret_borrow<ArrayLike>(query))
                               : WithoutLock([&] { return ReadImage(file, ImageChannels::kRgb); });
  const Query asked = AskedQuery(name, camera, priors, [&] {
    return QueryOfUnknownCamera(name, {photograph.width_px, photograph.height_px},
                                file.empty() ? LensTags() : ReadLensTags(file));
  });
  return LocalizePhotograph(localizer, asked, photograph);
}

// Returns the matches that lie inside of their images, as for the program's files of pixels. Throws
// InputError where most of many lie outside.
QueryMatches ToMatches(const Query& asked, const Rows<2>& query, const Rows<2>& reference,
                       const std::vector<std::string>& reference_names,
                       const std::optional<ArrayLike>& query_keypoints,
                       const std::vector<PosedImage>& images) {
  if (query.size() != reference.size() || query.size() != reference_names.size()) {
    throw InputError(fmt::format(
        "query2d, reference2d and reference_names: expected as many, found {}, {} and {}",
        query.size(), reference.size(), reference_names.size()));
  }
  const auto keypoints = PerMatch<int64_t>(query_keypoints, "query_keypoints", query.size());
  QueryMatches matches;
  size_t outside = 0;
  std::optional<size_t> outside_of;  // the first reference that a match lies outside of
  std::map<std::string, size_t> index_of_name;
  for (size_t i = 0; i < query.size(); ++i) {
    const std::string& of = reference_names[i];
    auto known = index_of_name.find(of);
    if (known == index_of_name.end()) {
      const auto image = std::find_if(images.begin(), images.end(),
                                      [&of](const PosedImage& one) { return one.name == of; });
      if (image == images.end()) {
        throw InputError(
            fmt::format("reference_names, row {}: the scene has no reference {}", i, of));
      }
      known = index_of_name.emplace(of, matches.references.size()).first;
      matches.references.push_back(*image);
    }
    const size_t index = known->second;
    if (!Shows(SizeOf(asked.camera), query[i]) ||
        !Shows(SizeOf(matches.references[index].camera), reference[i])) {
      ++outside;
      if (!outside_of) outside_of = index;
      continue;
    }
    Match2D2D& match = matches.matches.emplace_back();
    match.reference = static_cast<int>(index);
    match.query_px = query[i];
    match.reference_px = reference[i];
    if (keypoints && keypoints->data()[i] >= 0) {
      match.query_keypoint = static_cast<int>(keypoints->data()[i]);
    }
  }
  if (LookResized(outside, query.size())) {
    const PosedImage& image = matches.references[*outside_of];
    throw InputError(fmt::format(
        "query2d and reference2d: {} of {} matches lie outside of {} ({} x {}) or of their "
        "references, such as {} ({} x {}): are their pixels those of resized images?",
        outside, query.size(), asked.name, asked.camera.width_px(), asked.camera.height_px(),
        image.name, image.camera.width_px(), image.camera.height_px()));
  }
  return matches;
}

ResultPointer LocalizeMatches(const SceneLocalizer& localizer, const CameraLike& camera,
                              const ArrayLike& query2d, const ArrayLike& reference2d,
                              const std::vector<std::string>& reference_names,
                              const std::optional<ArrayLike>& query_keypoints,
                              const std::string& name, const PositionArgument& position,
                              const GravityArgument& gravity, const HeadingArgument& heading,
                              const OrientationArgument& orientation, const RangeArgument& range,
                              const std::optional<double>& focal_sigma, double focal_range) {
  const Query asked{
      name, ToCamera(camera),
      ToPriors({position, gravity, heading, orientation, range, focal_sigma, focal_range})};
  QueryMatches matches =
      ToMatches(asked, Rows<2>(query2d, "query2d"), Rows<2>(reference2d, "reference2d"),
                reference_names, query_keypoints, localizer.scene().references.images);
  return WithoutLock([&] {
    const Localizer knowing = localizer.WithoutMatches();
    return std::make_shared<KnownResult>(knowing.Localize(asked, std::move(matches)), knowing);
  });
}

py::dict LocalizeInParallel(SceneLocalizer& localizer, const std::vector<Query>& asked,
                            MatchingOptions matching, int threads,
                            const std::optional<ProgressCall>& progress) {
  std::vector<ResultPointer> results(asked.size());
  WithoutLock(progress, [&] {
    matching.front_end.threads = threads;
    std::shared_ptr<MatchSource> matches = OpenMatches(localizer.scene(), asked, matching);
    const auto scene = localizer.CalibratedScene(matches);
    raylift::LocalizeAll batch(*scene, asked, std::move(matches), localizer.BatchOptions(threads));
    Progress count("queries", asked.size(), Progress::Show::kNever);
    batch.Run([&](size_t i, const QueryResult& result) {
      results[i] = std::make_shared<KnownResult>(result, batch.configuration(0));
      count.Advance();
    });
  });
  py::dict by_name;
  for (size_t i = 0; i < asked.size(); ++i) by_name[py::str(asked[i].name)] = results[i];
  return by_name;
}

py::dict LocalizeList(SceneLocalizer& localizer, const std::vector<QueryLike>& queries, int threads,
                      const std::optional<ProgressCall>& progress) {
  std::vector<Query> asked;
  for (const QueryLike& query : queries) asked.push_back(ToQuery(query));
  if (const auto& retrieval = localizer.matching().retrieval) {
    const bool by_pose = retrieval->method == RetrievalMethod::kPose ||
                         retrieval->method == RetrievalMethod::kOverlap;
    if (retrieval->method == RetrievalMethod::kCovisibility ||
        (by_pose && retrieval->prior_poses.empty())) {
      throw OptionError("retrieval", std::string(ToString(retrieval->method)),
                        by_pose ? "needs prior_poses, but for leave_one_out()"
                                : "is for leave_one_out(): queries observe no points of the model");
    }
  }
  return LocalizeInParallel(localizer, asked, localizer.matching(), threads, progress);
}

py::dict LeaveOneOut(SceneLocalizer& localizer, int threads,
                     const std::optional<ProgressCall>& progress) {
  MatchingOptions matching = localizer.matching();
  matching.front_end.among_references = true;
  if (matching.retrieval) {
    matching.retrieval->prior_poses = PosesOf(localizer.scene().references);
  }
  return LocalizeInParallel(localizer, QueriesOf(localizer.scene().references), matching, threads,
                            progress);
}

// The localized query, the estimate and the problem in JSON.
using ResultState = std::tuple<std::string, std::string, ProblemState>;
ResultState StateOf(const KnownResult& result) {
  return {ToJson(result.localized).dump(), python::StateOf(result.localized.estimate),
          python::StateOf(KnownProblem(result.problem, result.scene_noise))};
}
ResultPointer ResultOf(const ResultState& state) {
  auto result = std::make_shared<KnownResult>();
  result->localized = ParseJson<LocalizedQuery>(std::get<0>(state));
  result->localized.estimate = *EstimateOf(std::get<1>(state));
  const auto problem = ProblemOf(std::get<2>(state));
  result->problem = *problem;
  result->scene_noise = problem->scene_noise;
  return result;
}

// Returns what the photograph's camera sees of the scene from the pose that was found; nullopt
// without a pose, or where the scene, which has a mesh, a cloud or splats, no longer exists.
std::optional<Image> PictureOf(const KnownResult& result) {
  const auto surface = result.surface.lock();
  const auto& pose = result.localized.estimate.cam_from_world;
  if (!surface || !result.localized.localized() || !pose) return std::nullopt;
  const auto& refined = result.localized.estimate.refined_camera;
  const Camera& camera = refined ? *refined : result.problem.query_camera;
  return WithoutLock([&] { return PictureFrom(surface, camera, *pose); });
}

void BindResult(py::module_& module) {
  py::class_<KnownResult, ResultPointer> bound(
      module, "LocalizedQuery", "What became of a query. True where it was localized.");
  bound.def_property_readonly("name", [](const KnownResult& r) { return r.localized.name; })
      .def_property_readonly(
          "cam_from_world",
          [](const KnownResult& r) -> std::optional<Rigid3> {
            if (!r.localized.localized()) return std::nullopt;
            return r.localized.estimate.cam_from_world;
          },
          "The pose, or None.")
      .def_property_readonly(
          "verdict",
          [](const KnownResult& r) { return std::string(ToString(r.localized.verdict())); },
          "\"localized\", \"doubtful\" or \"failed\".")
      .def_property_readonly(
          "confidence", [](const KnownResult& r) { return r.localized.confidence(); },
          "The probability that the pose is right.")
      .def_property_readonly(
          "reason", [](const KnownResult& r) { return r.localized.reason; },
          "Why there is no pose; empty where there is one.")
      .def_property_readonly(
          "counts",
          [](const KnownResult& r) {
            return NumbersOf<uint64_t>(ConstFieldsOf(r.localized.counts));
          },
          "What each stage found: references retrieved, 2D-2D matches, those lifted, points, "
          "inliers.")
      .def_property_readonly(
          "estimate",
          [](const KnownResult& r) { return std::make_shared<PoseEstimate>(r.localized.estimate); },
          "The PoseEstimate, with the covariance.")
      .def_property_readonly(
          "problem",
          [](const KnownResult& r) {
            return std::make_shared<KnownProblem>(r.problem, r.scene_noise);
          },
          "The PoseProblem that was estimated, which knows what the scene's calibration says.")
      .def("__bool__", [](const KnownResult& r) { return r.localized.localized(); })
      .def("__repr__",
           [](const KnownResult& r) {
             return fmt::format("<raylift.LocalizedQuery {}: {}{}>", r.localized.name,
                                ToString(r.localized.verdict()),
                                r.localized.localized() ? "" : ", " + r.localized.reason);
           })
      .def("_repr_html_",
           [](const KnownResult& r) {
             auto rows = HtmlRowsOf(r.localized.estimate);
             if (!r.localized.localized())
               rows.insert(rows.begin(), {"failed", r.localized.reason});
             rows.emplace_back("references", std::to_string(r.localized.counts.retrieved));
             const auto picture = PictureOf(r);
             return HtmlTable(r.localized.name, rows) +
                    (picture ? fmt::format("<img alt=\"the scene from the pose\" src=\"{}\">",
                                           JpegDataUri(*picture, kPictureSidePx))
                             : std::string());
           })
      .def(
          "_repr_png_",
          [](const KnownResult& r) -> std::optional<py::bytes> {
            const auto picture = PictureOf(r);
            if (!picture) return std::nullopt;
            return py::bytes(EncodePng(*picture));
          },
          "The scene as the photograph's camera sees it from the pose.");
  BindState(bound, py::overload_cast<const KnownResult&>(&StateOf), &ResultOf);
}

}  // namespace

void BindLocalization(py::module_& module) {
  BindResult(module);
  py::class_<SceneLocalizer, std::shared_ptr<SceneLocalizer>>(
      module, "Localizer", "Localizes photographs in a scene. Thread safe.")
      .def(
          py::init([](ScenePointer scene, const py::dict& reference_features,
                      const std::optional<ExtractorLike>& extractor,
                      const std::optional<MatcherLike>& matcher, int threads,
                      const py::kwargs& options) {
            return std::make_shared<SceneLocalizer>(std::move(scene), reference_features, extractor,
                                                    matcher, threads, options);
          }),
          py::arg("scene").none(false), py::kw_only(), py::arg("reference_features") = py::dict(),
          py::arg("extractor") = py::none(), py::arg("matcher") = py::none(),
          py::arg("threads") = 0,
          R"(Options as of `raylift localize`, with its defaults: those of raylift.estimate_pose(), and
filter="off", filter_reprojection_px=4, filter_min_views=3, filter_min_ratio=0.8,
candidates="keep", candidates_error_px=4, candidates_min_angle_deg=1,
geometry_mode="first", min_confidence=0, top_k=10; of the built-in front end (RootSIFT and
VLAD, made from the scene's photographs) max_features=4096, max_ratio=0.8, cache,
query_images; or hloc's files features, matches and pairs; or as matches alone COLMAP's
database, or a folder of the matches of each pair (N, 4), with first_pixel=0, cell_px=0
as of raylift.hloc.matches_from(); of matches in files, min_match_score;
scene_calibration: the file that `raylift calibrate` or write_calibration() wrote; else
align_depth="auto" (or "off", "scale", "affine", "grid") says how depth is corrected.
rerender=0: rounds in which a pose is sharpened against the scene's mesh or splats, rendered
as the query saw them.

reference_features: features of one's own, a dict by the references' names of dicts with
keypoints (N, 2) and descriptors (N, D) of unit length; their photographs are not read.

extractor: called with each photograph (H, W, 3) uint8, RGB, in place of RootSIFT: OpenCV's
Feature2D, LightGlue's extractors, or a callable that returns a dict or pair of keypoints
and descriptors. Its features are cached under its extractor_name.

matcher: called with a query's photograph and a reference's that RootSIFT and VLAD
retrieved: returns rows (N, 4) of pixels, a pair of (N, 2), or a dict as LoFTR, SuperGlue
or image-matching-models return, or what MASt3R or DUSt3R predict of photographs that
their load_images() resized; with an extractor, it is called with what that returned, and
may return indices (K, 2) of keypoints. One with match_batch(query, references) is called
once for all references of a query instead, and returns a list. These are taken as they
are: with an extractor OpenCV's DescriptorMatcher and LightGlue, without RoMa, DKM and the
matchers of image-matching-models (vismatch). With cache and a matcher_name, matches of
photographs in files are kept as hloc.match_dense does, by h5py; those of an extractor's
features need its extractor_name, too.

retrieval: how references are found: by a function that is called with each photograph and
returns its global descriptor (D,), as raylift.onnx.GlobalDescriptor does (nothing of it is
kept: each localize_all() and leave_one_out() describes the references anew); or "vlad"; "global"
by global_features (hloc's global-feats file; query_global_features: that of the queries,
where it is another one); "pose" or "overlap" by prior_poses (a COLMAP model, a pose file, or
a dict of poses by the queries' names), the first within max_angle_deg or by the view_range
(near, far) in scene units; or "covisibility", of leave_one_out(). All but functions and
"vlad" are for localize_all() and leave_one_out().

Functions are called one call at a time; pixels count as first_pixel says, by default as OpenCV's,
whose first pixel's center is (0, 0).

Raises OptionError for an option out of range.)")
      .def(
          "localize", &LocalizeOne, py::arg("query"), py::arg("camera") = py::none(), py::kw_only(),
          py::arg("name") = "query", py::arg("position_prior") = py::none(),
          py::arg("gravity_prior") = py::none(), py::arg("heading_prior") = py::none(),
          py::arg("orientation_prior") = py::none(), py::arg("range_prior") = py::none(),
          py::arg("focal_sigma") = py::none(), py::arg("focal_range") = 1.0,
          R"(One query: a photograph, (H, W) or (H, W, 3) uint8, RGB, or its file; or features, a dict
with keypoints (N, 2) and descriptors (N, D), as the references have. Priors and focal_...
as of raylift.Query. camera=None: of a photograph, the lens is found with the pose
(estimate.refined_camera), near the focal length that EXIF tells where it does; or it is
the calibration that a drone wrote.

Returns a LocalizedQuery. Raises InputError where a photograph is not of the camera's size.)")
      .def(
          "localize_matches", &LocalizeMatches, py::arg("camera"), py::arg("query2d"),
          py::arg("reference2d"), py::arg("reference_names"), py::kw_only(),
          py::arg("query_keypoints") = py::none(), py::arg("name") = "query",
          py::arg("position_prior") = py::none(), py::arg("gravity_prior") = py::none(),
          py::arg("heading_prior") = py::none(), py::arg("orientation_prior") = py::none(),
          py::arg("range_prior") = py::none(), py::arg("focal_sigma") = py::none(),
          py::arg("focal_range") = 1.0,
          R"(One query by matches of one's own: pixels (M, 2) of the query and of references, and the
references' names (M,). query_keypoints: (M,), where it is known which keypoint of the
query a match is of. Priors and focal_... as of raylift.Query.

Matches outside of their images are left out of the result's problem; InputError where most of
at least 10 are, as those of resized images.)")
      .def("localize_all", &LocalizeList, py::arg("queries"), py::kw_only(), py::arg("threads") = 0,
           py::arg("progress") = py::none(),
           "Many queries, Query or (name, camera) each, whose photographs or matches are in files. "
           "Of\n"
           "photographs the results are those of localize(). Returns a dict by name.")
      .def(
          "write_calibration",
          [](SceneLocalizer& localizer, const PathLike& file) {
            const std::filesystem::path path = ToPath(file, "file");
            WithoutLock([&] {
              const Localizer calibrated = localizer.ForQueries();
              if (calibrated.scene().calibration == nullptr) {
                throw InputError("a scene is calibrated by the built-in front end, or read");
              }
              WriteSceneCalibration(path, *calibrated.scene().calibration);
            });
          },
          py::arg("file"),
          "Writes what is known of the scene, for the option scene_calibration and\n"
          "`raylift localize --scene-calibration`.")
      .def_property_readonly(
          "scene", [](const SceneLocalizer& localizer) { return localizer.shared_scene(); },
          "The scene, with what the option scene_calibration says of it.")
      .def("leave_one_out", &LeaveOneOut, py::kw_only(), py::arg("threads") = 0,
           py::arg("progress") = py::none(),
           "Each reference as a query of the others: what is to be expected where no query's pose\n"
           "is known; but retrieval=\"pose\" or \"overlap\" takes the references' own poses as\n"
           "their prior poses. Returns a dict by name.")
      .def("__repr__",
           [](const SceneLocalizer& localizer) {
             return fmt::format("<raylift.Localizer in {} references, method {}>",
                                localizer.scene().references.images.size(),
                                ToString(localizer.options().estimator.method));
           })
      .def(py::pickle([](const SceneLocalizer& localizer) { return localizer.state(); },
                      [](const py::tuple& state) {
                        return std::make_shared<SceneLocalizer>(
                            state[0].cast<ScenePointer>(), state[1].cast<py::dict>(),
                            state[2].cast<std::optional<ExtractorLike>>(),
                            state[3].cast<std::optional<MatcherLike>>(), state[4].cast<int>(),
                            state[5].cast<py::kwargs>());
                      }));
  BindFeatures(module);
}

}  // namespace raylift::python
