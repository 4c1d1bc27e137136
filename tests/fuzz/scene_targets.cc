// Pose problems, lists and scene files.

#include "evaluation/submission.h"
#include "fuzz/fuzz_targets.h"

#include "raylift/base/file.h"
#include "raylift/io/hloc_files.h"
#include "raylift/io/pose_priors.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"

namespace raylift {
namespace {

constexpr std::string_view kListWords =
    "# * PINHOLE SIMPLE_RADIAL OPENCV FULL_OPENCV FOV EQUIRECTANGULAR position gravity heading "
    "orientation focal_range "
    "world_down world_north world_crs crs= EPSG:4326 EPSG:32615 EPSG:4978 @1,2,3 nan inf 1e308 "
    "1e-320 -0 2147483648 18446744073709551616";

std::vector<std::string> Lines(std::string text) { return {std::move(text)}; }

// Of each kind one match, with all that a match can have.
PoseProblem SmallProblem() {
  PoseProblem problem;
  problem.name = "query";
  problem.references = {{"reference", Camera(), Rigid3()}};
  problem.reference_clusters = {0};
  problem.other_cameras = {{"right", Camera(), Rigid3()}};
  problem.matches_2d2d = {{0, {1, 2}, {3, 4}, 0.5, 0, 7, 1}};
  problem.matches_2d3d = {{{1, 2}, {3, 4, 5}, 0, 0.25, 0, 0, 0}};
  problem.priors.position = PositionPrior{{1, 2, 3}, {1, 1, 1}};
  return problem;
}

}  // namespace

std::vector<FuzzTarget> SceneFuzzTargets() {
  return {
      {"pose_problem",
       [](std::string_view bytes) { FormatPoseProblem(ParsePoseProblem(bytes, "problem.json")); },
       [] {
         return Lines(FormatPoseProblem({SmallProblem(), Rigid3()}));
       },
       "pose-problem/1 pose-problem/2 null true -1 1e308 1e999 \"extra\" \"keypoint\" \"query\" "
       "\"position_prior\" \"gravity_prior\" \"focal_range\" \"reference_sigmas\" "
       "\"reference_clusters\" "
       "\"other_cameras\" "
       "\"matches_2d2d_camera\" [[[["},
      {"query_list",
       [](std::string_view bytes) {
         const auto queries = ReadQueryList(PutFile("queries.txt", bytes));
         WriteQueryList(ScratchFolder() / "queries_out.txt", queries);
       },
       [] {
         return Lines("a.jpg PINHOLE 640 480 500 501 320 240\nb OPENCV 9 8 7 7 4 4 0 0 0 0\n");
       },
       kListWords},
      {"pose_file", [](std::string_view bytes) { ReadPoseFile(PutFile("poses.txt", bytes)); },
       [] { return Lines("a.jpg 1 0 0 0 1 2 3\nb.jpg 0 1 0 0 1 2 3 500\n"); }, kListWords},
      {"pose_priors", [](std::string_view bytes) { ReadPosePriors(PutFile("priors.txt", bytes)); },
       [] {
         return Lines(
             "* world_crs EPSG:32615@1,2,3\na position -92 46 3 5 crs=EPSG:4326\na gravity 0 1 0 "
             "1\n"
             "b focal_range 1.5\nb heading 46 10 0 1 0\nb orientation 1 0 0 0 2\n"
             "* world_down 0 0 -1\n* world_north 0 1 0\n");
       },
       kListWords},
      {"photograph_tags",
       [](std::string_view bytes) {
         FormatPhotographPriors("a", ReadPhotographTags(PutFile("photograph.jpg", bytes)));
       },
       [] {
         const std::string xmp = "http://ns.adobe.com/xap/1.0/" + std::string(1, '\0') +
                                 "<x><rdf:Description d:GimbalYawDegree=\"+46\" "
                                 "d:GimbalPitchDegree=\"-90\" d:GimbalRollDegree=\"0\"/></x>";
         return Lines("\xFF\xD8\xFF\xE1" + std::string(1, '\0') +
                      static_cast<char>(xmp.size() + 2) + xmp);
       },
       "Exif II* MM RtkFlag RtkStdLon RtkStdLat RtkStdHgt AbsoluteAltitude RelativeAltitude < > / "
       "= "
       "\" &amp; <!DOCTYPE <![CDATA["},
      {"rig_config",
       [](std::string_view bytes) {
         std::vector<Query> queries(2);
         queries[0].name = "a/1.jpg";
         queries[1].name = "b/1.jpg";
         TakeRigs(PutFile("rig_config.json", bytes), queries);
       },
       [] {
         return Lines(
             R"([{"cameras": [{"image_prefix": "a/", "ref_sensor": true}, {"image_prefix": "b/",)"
             R"( "cam_from_rig_rotation": [1, 0, 0, 0], "cam_from_rig_translation": [1, 2, 3]}]}])");
       },
       "\"cameras\" \"image_prefix\" \"ref_sensor\" \"cam_from_rig_rotation\" true null 1e999 "
       "[[[["},
      {"view_list", [](std::string_view bytes) { ReadViewList(PutFile("views.txt", bytes)); },
       [] {
         return Lines(
             "a 1 0 0 0 0 0 0 SIMPLE_PINHOLE 64 48 50 32 24\nb 0 0 0 1 1 2 3 "
             "EQUIRECTANGULAR 64 32\n");
       },
       kListWords},
      {"pairs",
       [](std::string_view bytes) {
         const auto file = PutFile("pairs.txt", bytes);
         ReadImageList(file);
         ReadPairs(file);
       },
       [] { return Lines("q/1.jpg r/1.jpg\nq/1.jpg r/2.jpg\n"); }, ","},
      {"scene_lists",
       [](std::string_view bytes) {
         const auto file = PutFile("list.txt", bytes);
         ReadGroups(file);
         ReadTimes(file);
       },
       [] { return Lines("a.jpg 12.5\nb.jpg 13\n"); }, kListWords},
      {"point_list", [](std::string_view bytes) { ReadPointList(PutFile("points.txt", bytes)); },
       [] { return Lines("0 1 2\n# c\n3 4 5\n"); }, kListWords},
      {"submission",
       [](std::string_view bytes) {
         const std::vector<std::string> queries = {"a/b.jpg", "c.jpg"};
         const std::vector<Eigen::Vector3d> centers = {{0, 0, 0}, {1, 1, 1}};
         CheckSubmission(PutFile("poses.txt", bytes), queries, centers);
       },
       [] { return Lines("b.jpg 1 0 0 0 1 2 3\nc.jpg 0 1 0 0 1 2 3\n"); }, kListWords},
      {"scene_toml",
       [](std::string_view bytes) {
         WriteSceneFile(ScratchFolder() / "out" / "scene.toml",
                        ReadSceneFile(PutFile("scene.toml", bytes)));
       },
       [] {
         SceneFile scene;
         scene.name = "demo";
         scene.references = "references";
         scene.queries = "queries.txt";
         scene.thresholds = "7scenes";
         scene.geometries = {{"mesh", "mesh:a.ply"}, {"depth", "depth:maps,kind=ray"}};
         scene.provenance = {{"dataset", "demo"}};
         const auto file = ScratchFolder() / "seed.toml";
         WriteSceneFile(file, scene);
         return Lines(TakeFile(file));
       },
       "format raylift-scene/1 references images queries [[geometry]] [provenance] ''' \"\"\" \\u "
       "[[[[ {a={a={a= 1979-05-27T07:32:00Z 0x inf"},
  };
}

}  // namespace raylift
