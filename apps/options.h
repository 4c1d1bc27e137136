// The options that several commands share: the same name means the same thing everywhere.

#pragma once

#include <filesystem>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/command_line.h"
#include "base/progress.h"
#include <Eigen/Core>

#include "raylift/base/error.h"
#include "raylift/estimation/options.h"
#include "raylift/geometry/geodesy.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/lifter.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct LoadedReferences;
struct SceneOptions;

void AddEstimatorOptions(CLI::App& command, EstimatorOptions& options);
// "p3p,adaptive:mult_inl,select:0.7": names of methods, Adaptive's with a score and Select's with
// an alpha where these are not those of `base`. Throws OptionError in the name of --methods.
std::vector<EstimatorOptions> ParseMethods(std::string_view text, const EstimatorOptions& base);
// The forms of these names, for help: "p3p|...|adaptive[:SCORE]|...".
std::string MethodForms();
void AddFilterOptions(CLI::App& command, FilterOptions& options);

// Where 3D points come from.
struct GeometryFlags {
  std::vector<std::string> specs;  // in the order in which sources are asked
  GeometryMode mode = GeometryMode::kFirst;
  AlignMode align = AlignMode::kAuto;
  CandidateOptions candidates;

  // Throws OptionError.
  void Check() const;
};
void AddGeometryOptions(CLI::App& command, GeometryFlags& flags);

// Returns where the query photographs are: in `query_images`, or where `queries` is a folder that
// is not in `images`, there, or in `images`.
std::filesystem::path QueryImagesOf(const std::filesystem::path& query_images,
                                    const std::filesystem::path& images,
                                    const std::filesystem::path& queries);

// `--every` and what goes with it. `of_what` ends the help of --every.
void AddSubsamplingOptions(const OptionGroup& group, Subsampling& subsampling,
                           const std::string& of_what);
// Throws OptionError.
void CheckSubsampling(const Subsampling& subsampling);

// A scene's references.
struct ReferenceFlags {
  std::filesystem::path model;
  Subsampling subsampling = {};
  PoseConvention poses = PoseConvention::kCamFromWorld;

  // Throws OptionError.
  void Check() const { CheckSubsampling(subsampling); }
  // Whether they are a packed map's, whose features stand for photographs.
  bool HaveFeatures() const;
  LoadedReferences Load() const;
  // What a scene with these references is opened by.
  SceneOptions Scene(const std::filesystem::path& images, std::vector<std::string> geometry,
                     int threads) const;
};
void AddReferenceOptions(CLI::App& command, ReferenceFlags& flags, bool model_is_required = true);
// `--model-poses`: what the poses of --model mean.
void AddModelPosesOption(CLI::App& command, ReferenceFlags& flags);

// "x", "-y", ... or "X,Y,Z"; none, "auto", unless given, which `help` explains.
void AddUpOption(const OptionGroup& group, const std::string& name,
                 std::optional<Eigen::Vector3d>& up_in_world, const std::string& help);
// What it is for commands that ask the mesh then (EstimateUp).
inline constexpr const char* kUpOfMeshHelp =
    "x|y|z|-x|-y|-z or X,Y,Z in the mesh's coordinates; auto: by\n"
    "what its floors and walls face, z where that does not tell";

// Throws OptionError where one of these options is given, as none of them goes with `other`.
struct GivenOption {
  const char* name;
  bool is_given;
};
void RefuseWith(std::string_view other, std::initializer_list<GivenOption> options);

// Returns a parser of an option's text by `read`, whose InputErrors become OptionErrors.
template <typename Read>
auto AsOption(Read read) {
  return [read](std::string_view name, const std::string& text) {
    try {
      return read(text);
    } catch (const InputError& error) {
      throw OptionError(name, text, error.what());
    }
  };
}

// `--crs`: the system that the world's coordinates are of.
void AddCrsOption(const OptionGroup& group, std::optional<WorldFrame>& world);

struct RunFlags {
  int threads = 0;
  bool quiet = false;

  Progress::Show Show() const { return quiet ? Progress::Show::kNever : Progress::Show::kAuto; }
  // Throws OptionError.
  void Check() const;
};
void AddRunOptions(CLI::App& command, RunFlags& flags);
// `--config`, which main reads before the command runs (argument_files.h).
void AddConfigOption(CLI::App& command);

// One line on stderr.
// Returns a text of the library, in which a repair names fields, with the options of these names.
std::string InOptions(std::string text);
void PrintWarning(const std::string& warning);
void PrintWarnings(const std::vector<std::string>& warnings);

}  // namespace raylift
