// Long commands that go on where they were, and share their work with other machines: their
// options, and what their results depend on, as their manifests begin with it.

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
  // By the environment, where that is asked for. Throws OptionError.
  Shard Resolve() const;
  // The job that these make of a run to `out`.
  JobFolder In(const std::filesystem::path& out) const;
};

// Throws Interrupted where tasks are left, which `tasks` names.
void RequireNoneLeft(size_t left, std::string_view tasks);

// Of commands that keep nothing to go on with: whether a finished run may be replaced.
void AddOverwriteOption(CLI::App& command, bool& overwrite);
// OptionError where `file`, which a run writes last, is there.
void RefuseFinished(const std::filesystem::path& file, bool overwrite);

// `resume` and `overwrite` are the helps of these options.
void AddJobOptions(CLI::App& command, JobFlags& flags, const std::string& resume,
                   const std::string& overwrite);

// JSON: `options`, as EffectiveOptionsJson() gives them, without those of `needless` and those of
// all commands that change no result or say where something is; and `inputs`, fingerprints that
// stand for paths, so that the same run may go on on another machine.
std::string JobHeader(nlohmann::ordered_json options, size_t tasks,
                      std::initializer_list<const char*> needless,
                      const nlohmann::ordered_json& inputs);

// The effective options but for those that say how the work is shared and gone on with.
std::string OptionsOfResults(const std::string& options_json);

// Returns what stands for the queries: their names, cameras, priors and places on rigs.
std::string QueriesFingerprint(std::span<const Query> queries);

// What a scene and its queries are read from.
struct SceneInputs {
  std::filesystem::path model;  // empty: the references are rendered
  std::filesystem::path images, query_images;
  std::filesystem::path out;  // what is below it is no input
  const MatchingFlags& matching;
  int threads = 0;
};

nlohmann::ordered_json InputsJson(const SceneInputs& inputs, const Scene& scene,
                                  std::span<const Query> queries);

// Of a file, or of a folder that holds a COLMAP model.
std::string FileOrModelFingerprint(const std::filesystem::path& file);

}  // namespace raylift
