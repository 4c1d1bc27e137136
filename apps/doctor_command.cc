// raylift doctor: checks whether a scene's input is read as it was meant.

#include <cstdio>
#include <memory>
#include <optional>

#include "apps/argument_files.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/matching_options.h"
#include "apps/options.h"
#include "base/json_text.h"
#include "lifting/alignment_text.h"
#include "localization/calibration_images.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/diagnosis/doctor.h"
#include "raylift/io/query_list.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/report/geometry_report.h"

namespace raylift {
namespace {

using std::filesystem::path;
using Json = nlohmann::ordered_json;

struct DoctorFlags {
  ReferenceFlags references;
  path images, queries, query_images;
  std::string geometry;
  MatchingFlags matching;
  path json, report;
  RunFlags run;
};

// Returns whether the queries are the references: without queries these are matched with each
// other.
RetrievalFlags::Queries QueriesAre(const DoctorFlags& flags) {
  return flags.queries.empty() ? RetrievalFlags::Queries::kReferences
                               : RetrievalFlags::Queries::kOwn;
}

void Check(const DoctorFlags& flags) {
  flags.references.Check();
  flags.run.Check();
  flags.matching.Check({flags.geometry}, QueriesAre(flags));
  RequireWithoutHloc(flags.matching.hloc, "--images is",
                     !flags.images.empty() || flags.references.HaveFeatures());
  if (flags.queries.empty() && !flags.query_images.empty()) {
    throw OptionError("--query-images", flags.query_images.string(), "needs --queries");
  }
}

path QueryImages(const DoctorFlags& flags) {
  return QueryImagesOf(flags.query_images, flags.images, flags.queries);
}

std::vector<Query> ReadQueries(const DoctorFlags& flags, const ReferenceSet& references) {
  if (!flags.queries.empty()) return ReadQueryList(flags.queries, QueryImages(flags));
  return QueriesOf(references);
}

std::unique_ptr<MatchSource> Open(const DoctorFlags& flags, const Scene& scene,
                                  const std::vector<Query>& queries) {
  return OpenMatchesBetween(flags.matching, {flags.geometry}, QueryImages(flags), flags.run, scene,
                            queries, QueriesAre(flags));
}

Json OptionsOf(const RepairOptions& repair) {
  Json options = Json::array();
  if (repair.model_poses) {
    options.push_back(fmt::format("--model-poses {}", ToString(*repair.model_poses)));
  }
  return options;
}

Json EvidenceJson(const ConventionEvidence& evidence, const DataConvention& as_read) {
  const RepairOptions repair = FindRepair(as_read, evidence.convention);
  return {{"reading", DescribeDifference(as_read, evidence.convention)},
          {"keypoints", evidence.num_keypoints},
          {"median_px", evidence.median_px},
          {"share_within_5px", evidence.share_within_5px},
          {"median_own_scale_px", evidence.median_own_scale_px},
          {"gain", evidence.gain},
          {"standard_errors", evidence.sigmas},
          {"geometry_keys", repair.geometry_keys},
          {"options", OptionsOf(repair)}};
}

Json PlacementJson(const MeshPlacement& placement) {
  Json rows = Json::array();
  for (int row = 0; row < 3; ++row) {
    Json values = Json::array();
    for (int column = 0; column < 3; ++column) {
      values.push_back(placement.scale * placement.axes(row, column));
    }
    values.push_back(placement.shift[row]);
    rows.push_back(std::move(values));
  }
  rows.push_back({0, 0, 0, 1});
  return rows;
}

Json DiagnosisJson(const Diagnosis& diagnosis, const DepthAlignment& alignment) {
  Json conventions = Json::array();
  for (const ConventionEvidence& evidence : diagnosis.conventions) {
    conventions.push_back(EvidenceJson(evidence, diagnosis.as_read));
  }
  const ConventionFit& fit = diagnosis.fit;
  Json json = {{"verdict", ToString(diagnosis.verdict)},
               {"fault", ToString(diagnosis.fault)},
               {"reason", diagnosis.reason},
               {"suspicious", diagnosis.suspicious()},
               {"summary", InOptions(Summary(diagnosis))},
               {"repair",
                {{"geometry_keys", diagnosis.repair.geometry_keys},
                 {"replaced_keys", diagnosis.repair.replaced_keys},
                 {"options", OptionsOf(diagnosis.repair)}}},
               {"matches", diagnosis.num_matches},
               {"matches_that_fit_the_poses", diagnosis.num_agreeing},
               {"median_epipolar_px", diagnosis.epipolar_px},
               {"fit",
                {{"median_px", fit.median_px},
                 {"median_px_by_chance", fit.median_chance_px},
                 {"three_quarters_px", fit.upper_px},
                 {"three_quarters_px_by_chance", fit.upper_chance_px}}},
               {"alignment",
                {{"mode", ToString(alignment.mode)},
                 {"median_before_px", alignment.median_before_px},
                 {"median_after_px", alignment.median_after_px},
                 {"warning", WarnOfFactors(alignment).value_or("")}}},
               {"readings", std::move(conventions)}};
  // The readings are those of the mesh as it is placed.
  if (diagnosis.mesh_placement) {
    json["world_from_mesh"] = PlacementJson(*diagnosis.mesh_placement);
    json["mesh"] = "as its files have it, without scale, axes, shift and matrix of --geometry";
  } else {
    json["best"] = DescribeDifference(diagnosis.as_read, diagnosis.best);
  }
  return json;
}

void Print(const Diagnosis& diagnosis, const DepthAlignment& alignment) {
  if (!diagnosis.conventions.empty()) {
    fmt::print("{:>10} {:>9} {:>10} {:>8} {:>9}  {}\n", "median px", "in 5 px", "own scale", "gain",
               "std. err.", "reading");
  }
  for (const ConventionEvidence& evidence : diagnosis.conventions) {
    fmt::print("{:>10.2f} {:>8.1f}% {:>10.2f} {:>+8.3f} {:>+9.1f}  {}\n", evidence.median_px,
               100 * evidence.share_within_5px, evidence.median_own_scale_px, evidence.gain,
               evidence.sigmas, DescribeDifference(diagnosis.as_read, evidence.convention));
  }
  // Factors of depth mean nothing where the input is misread.
  if (!diagnosis.suspicious()) {
    fmt::print("--align-depth auto: the depth {}{}\n",
               alignment.mode == AlignMode::kOff ? "" : "is corrected ", Describe(alignment));
    if (const auto warning = WarnOfFactors(alignment)) fmt::print("{}\n", *warning);
  }
  fmt::print("{}\n", InOptions(Summary(diagnosis)));
}

void Run(const DoctorFlags& flags) {
  const Scene scene =
      OpenScene(flags.references.Scene(flags.images, {flags.geometry}, flags.run.threads));
  const NamedGeometry& geometry = scene.sources.front().geometry;
  if (geometry.kind == GeometryKind::kSfm) {
    throw OptionError("--geometry", flags.geometry, "expected mesh:... or depth:...");
  }
  if (!flags.json.empty()) RequireWritable(flags.json);
  if (!flags.report.empty()) RequireWritable(flags.report / "index.html");
  const std::vector<Query> queries = ReadQueries(flags, scene.references);
  const auto match_source = Open(flags, scene, queries);
  const auto matches =
      CollectReferenceMatches(queries, *match_source, scene.references, flags.run.threads);
  PrintWarnings(scene.warnings);
  PrintWarnings(match_source->Warnings());

  const Diagnosis diagnosis =
      Diagnose(MakeDoctorInput(geometry, scene.references.images, matches, scene.model_poses),
               {.threads = flags.run.threads});
  const DepthAlignment alignment = AlignDepth(*geometry.source, scene.references.images, matches,
                                              AlignMode::kAuto, flags.run.threads);
  const std::string json = JsonText(DiagnosisJson(diagnosis, alignment), 2) + "\n";
  if (!flags.json.empty()) WriteFile(flags.json, json);
  if (!flags.report.empty()) {
    std::vector<std::string> warnings = scene.warnings;
    const auto of_matches = match_source->Warnings();
    warnings.insert(warnings.end(), of_matches.begin(), of_matches.end());
    WriteFile(flags.report / "index.html",
              FormatDoctorReport(
                  {.title = "Raylift: " + flags.geometry,
                   .subtitle = fmt::format(
                       "{} references{}", scene.references.images.size(),
                       geometry.interpretation.empty() ? "" : "; " + geometry.interpretation),
                   .diagnosis = json,
                   .source = *geometry.source,
                   .surface = geometry.mesh,
                   .references = scene.references.images,
                   .images = flags.images,
                   .warnings = warnings,
                   .threads = flags.run.threads}));
  }
  if (!flags.run.quiet) Print(diagnosis, alignment);
}

}  // namespace

Command AddDoctorCommand(CLI::App& program) {
  auto flags = std::make_shared<DoctorFlags>();
  CLI::App& command =
      AddCommand(program, "doctor", "Whether depth, mesh and poses are read as they were meant");
  AddSceneOption(command);
  AddReferenceOptions(command, flags->references);
  const OptionGroup references(command, "References");
  references.Add("--images", flags->images, "Folder of the reference photographs");
  AddModelPosesOption(command, flags->references);
  const OptionGroup geometry(command, "Geometry");
  geometry.Add("--geometry", flags->geometry, GeometryHelp()).Required();
  const OptionGroup matches(command, "Matches");
  matches.Add("--queries", flags->queries,
              "List of queries, whose matches join the references (default: the\n"
              "references are matched with each other)");
  matches.Add("--query-images", flags->query_images,
              "Folder of the query photographs (default: --images)");
  AddMatchingOptions(command, flags->matching, "; without it, RootSIFT", "none");
  const OptionGroup output(command, "Output");
  output.Add("--json", flags->json, "Also write the table as JSON");
  output.Add("--report", flags->report, "Folder for one HTML page to look at (index.html)");
  AddRunOptions(command, flags->run);
  SetFooter(
      command,
      "Columns: distance of projected keypoints from their matches in other references (median,\n"
      "share within 5 px), the median with each map at its own best scale, and by how much the\n"
      "reading explains the matches better than the one as read. The last line is the verdict:\n"
      "read as meant, what repairs it, or that nothing fits, and why; above it stands what "
      "localize\n"
      "makes of such depth by --align-depth auto.");
  return {&command, [flags] {
            Check(*flags);
            UntilSignal([&] { Run(*flags); }, &BeginsAnew);
          }};
}

}  // namespace raylift
