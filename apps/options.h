// Options that several commands share: the same name means the same thing everywhere.

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
// Parses names of methods, "p3p,adaptive:mult_inl,select:0.7": Adaptive takes a score and Select an
// alpha, which are those of `base` where left out. Throws OptionError in the name of --methods.
std::vector<EstimatorOptions> ParseMethods(std::string_view text, const EstimatorOptions& base);
// Returns the forms of these names, for help: "p3p|...|adaptive[:SCORE]|...".
std::string MethodForms();
void AddFilterOptions(CLI::App& command, FilterOptions& options);

// Sources of the 3D points.
struct GeometryFlags {
  std::vector<std::string> specs;  // in the order in which sources are asked
  GeometryMode mode = GeometryMode::kFirst;
  AlignMode align = AlignMode::kAuto;
  CandidateOptions candidates;

  // Throws OptionError.
  void Check() const;
};
void AddGeometryOptions(CLI::App& command, GeometryFlags& flags);

// Returns the folder of the query photographs: `query_images` if given, else `queries` if that is a
// folder outside of `images`, else `images`.
std::filesystem::path QueryImagesOf(const std::filesystem::path& query_images,
                                    const std::filesystem::path& images,
                                    const std::filesystem::path& queries);

// Adds `--every` and the options that go with it. `of_what` ends the help of --every.
void AddSubsamplingOptions(const OptionGroup& group, Subsampling& subsampling,
                           const std::string& of_what);
// Throws OptionError.
void CheckSubsampling(const Subsampling& subsampling);

// Options of a scene's references.
struct ReferenceFlags {
  std::filesystem::path model;
  Subsampling subsampling = {};
  PoseConvention poses = PoseConvention::kCamFromWorld;

  // Throws OptionError.
  void Check() const { CheckSubsampling(subsampling); }
  // Returns whether they are a packed map's, whose features stand for photographs.
  bool HaveFeatures() const;
  LoadedReferences Load() const;
  // Returns the options that open a scene with these references.
  SceneOptions Scene(const std::filesystem::path& images, std::vector<std::string> geometry,
                     int threads) const;
};
void AddReferenceOptions(CLI::App& command, ReferenceFlags& flags, bool model_is_required = true);
// Adds `--model-poses`, which says what the poses of --model mean.
void AddModelPosesOption(CLI::App& command, ReferenceFlags& flags);

// Adds an option for the up direction, "x", "-y", ... or "X,Y,Z"; nullopt, "auto", unless given,
// which `help` explains.
void AddUpOption(const OptionGroup& group, const std::string& name,
                 std::optional<Eigen::Vector3d>& up_in_world, const std::string& help);
// The help of that option for commands in which "auto" asks the mesh (EstimateUp).
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

// Adds `--crs`, the coordinate system of the world.
void AddCrsOption(const OptionGroup& group, std::optional<WorldFrame>& world);

struct RunFlags {
  int threads = 0;
  bool quiet = false;

  Progress::Show Show() const { return quiet ? Progress::Show::kNever : Progress::Show::kAuto; }
  // Throws OptionError.
  void Check() const;
};
void AddRunOptions(CLI::App& command, RunFlags& flags);
// Adds `--config`, which main reads before the command runs (argument_files.h).
void AddConfigOption(CLI::App& command);

// Returns a text of the library in which the fields that a repair names are options.
std::string InOptions(std::string text);
// Prints one line on stderr.
void PrintWarning(const std::string& warning);
void PrintWarnings(const std::vector<std::string>& warnings);

}  // namespace raylift
