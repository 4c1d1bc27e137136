// Options of long commands that resume where they were and share their work with other machines,
// and the header of their manifests, which says what their results depend on.

#pragma once

#include <cstddef>
#include <filesystem>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

#include "apps/matching_options.h"
#include <nlohmann/json.hpp>

#include "raylift/jobs/task_job.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct JobFlags {
  bool resume = false;
  bool overwrite = false;
  std::string shard = "0/1";

  // Throws OptionError.
  void Check() const;
  // Returns the shard, by the environment where that is asked for. Throws OptionError.
  Shard Resolve() const;
  // Returns the job that these options make of a run to `out`.
  JobFolder In(const std::filesystem::path& out) const;
};

// Throws Interrupted where tasks are left; `tasks` is their name in the message.
void RequireNoneLeft(size_t left, std::string_view tasks);

// Adds --overwrite, which lets a finished run be replaced, to a command that cannot be resumed.
void AddOverwriteOption(CLI::App& command, bool& overwrite);
// Throws OptionError where `file`, which a run writes last, exists, unless `overwrite` is set.
void RefuseFinished(const std::filesystem::path& file, bool overwrite);

// Adds --resume, --overwrite and --shard; `resume` and `overwrite` are the help texts of the first
// two.
void AddJobOptions(CLI::App& command, JobFlags& flags, const std::string& resume,
                   const std::string& overwrite);

// Returns the header of a manifest, JSON: `options`, as EffectiveOptionsJson() gives them, without
// those of `needless` and those of all commands that change no result or say where something is;
// and `inputs`, fingerprints in place of paths, so that another machine may resume the run.
std::string JobHeader(nlohmann::ordered_json options, size_t tasks,
                      std::initializer_list<const char*> needless,
                      const nlohmann::ordered_json& inputs);

// Returns the effective options without those that say how the work is shared and resumed.
std::string OptionsOfResults(const std::string& options_json);

// Returns a fingerprint of the queries: of their names, cameras, priors and places on rigs.
std::string QueriesFingerprint(std::span<const Query> queries);

// The files and folders that a scene and its queries are read from.
struct SceneInputs {
  std::filesystem::path model;  // empty: the references are rendered
  std::filesystem::path images, query_images;
  std::filesystem::path out;  // files below it are no input
  const MatchingFlags& matching;
  int threads = 0;
};

nlohmann::ordered_json InputsJson(const SceneInputs& inputs, const Scene& scene,
                                  std::span<const Query> queries);

// Returns the fingerprint of a file, or of a folder that holds a COLMAP model.
std::string FileOrModelFingerprint(const std::filesystem::path& file);

}  // namespace raylift
