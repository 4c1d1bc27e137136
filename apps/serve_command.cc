// raylift serve: localizes photographs over HTTP in scenes that are opened once.

#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/localize_flags.h"
#include "apps/localize_inputs.h"
#include "apps/options.h"
#include "lifting/mesh_spec.h"
#include <fmt/format.h>
#include <sys/resource.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/scene_file.h"
#include "raylift/localization/scene_calibration.h"
#include "raylift/service/server.h"

namespace raylift {
namespace {

struct ServeFlags {
  std::vector<std::filesystem::path> scenes;
  LocalizeFlags localize;  // options that all scenes have in common
  ServerOptions server;

  void Check() const {
    localize.estimator.Validate();
    localize.filter.thresholds.Validate();
    localize.geometry.Check();
    localize.run.Check();
    RequireAtLeast("--max-connections", server.limits.connections, 1);
    RequireAtLeast("--max-queue", static_cast<double>(server.limits.queue), 1);
    const auto refuse_several = [&](const char* option, const std::string& value) {
      if (value.empty() || scenes.size() == 1) return;
      throw OptionError(option, value, "is of one scene, but there are several");
    };
    refuse_several("--scene-calibration", localize.scene_calibration.string());
    refuse_several("--crs", localize.world ? localize.world->text : "");
  }
};

double ParseBetween(std::string_view option, const std::string& text, double least, double most) {
  const auto value = ParseDouble(text);
  if (value && *value >= least && *value <= most) return *value;
  throw OptionError(option, text, fmt::format("must lie between {} and {}", least, most));
}

double ParseSeconds(std::string_view option, const std::string& text, double shortest) {
  constexpr double kDay = 86'400;
  return ParseBetween(option, text.ends_with('s') ? text.substr(0, text.size() - 1) : text,
                      shortest, kDay);
}

// Returns the name in the file, else that of its folder or its own.
std::string NameOf(const SceneFile& scene, const std::filesystem::path& file) {
  if (!scene.name.empty()) return scene.name;
  return file.stem() == "scene" ? std::filesystem::absolute(file).parent_path().filename().string()
                                : file.stem().string();
}

std::optional<WorldFrame> WorldOf(const ServeFlags& serve, const std::filesystem::path& file,
                                  const SceneFile& scene) {
  if (serve.localize.world || scene.crs.empty()) return serve.localize.world;
  try {
    return WorldFrame::Parse(scene.crs);
  } catch (const InputError& error) {
    throw InputError(file, fmt::format("crs: {}", error.what()));
  }
}

// Returns the flags with which `localize --scene FILE` would open the scene.
LocalizeFlags FlagsOf(const ServeFlags& serve, const std::filesystem::path& file,
                      const SceneFile& scene) {
  LocalizeFlags flags = serve.localize;
  flags.references.model = scene.references;
  flags.images = scene.images;
  flags.geometry.specs = InWorld(SceneOptionsOf(scene, serve.localize.geometry.specs).geometry,
                                 WorldOf(serve, file, scene));
  if (scene.references.empty()) {
    throw InputError(file, "references: is missing: photographs are matched with references");
  }
  if (!flags.matching.front_end.cache.empty() && serve.scenes.size() > 1) {
    flags.matching.front_end.cache /= NameOf(scene, file);
  }
  return flags;
}

ServedScene Open(const ServeFlags& serve, const std::filesystem::path& file) {
  const SceneFile described = ReadSceneFile(file);
  const LocalizeFlags flags = FlagsOf(serve, file, described);
  Scene scene = WithKnownCalibration(flags, OpenSceneOf(flags, {}));
  const std::optional<WorldFrame> world = WorldOf(WorldOf(serve, file, described), scene);
  PrintWarnings(scene.warnings);
  const std::shared_ptr<const MatchSource> matches =
      OpenMatchesOf(flags, scene, {}, flags.estimator.seed);
  const LocalizerOptions options = flags.Localizer();
  scene = Calibrate(
      scene, matches, {},
      {.localizer = options, .align = flags.geometry.align, .threads = flags.run.threads});
  return {.name = NameOf(described, file),
          .localizer = std::make_shared<const Localizer>(
              std::make_shared<const Scene>(std::move(scene)), matches, options),
          .world = world};
}

// Raises the number of open files to the machine's limit: each connection is one.
void AllowManyFiles() {
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) return;
  files.rlim_cur = files.rlim_max;
  setrlimit(RLIMIT_NOFILE, &files);
}

void Serve(ServeFlags flags) {
  flags.Check();
  flags.server.threads = flags.localize.run.threads;
  flags.server.log = [](const std::string& message) { PrintWarning(message); };
  AllowManyFiles();
  const auto open = [flags] {
    std::vector<ServedScene> scenes;
    for (const std::filesystem::path& file : flags.scenes) scenes.push_back(Open(flags, file));
    return scenes;
  };
  std::unique_ptr<Server> server;
  UntilSignal([&] { server = std::make_unique<Server>(open, flags.server); });
  fmt::print("listening on {}\n", server->url());
  std::fflush(stdout);
  server->Run();
}

void AddServerOptions(CLI::App& command, ServeFlags& flags) {
  ServerOptions& server = flags.server;
  ServerLimits& limits = server.limits;
  const OptionGroup group(command, "Server");
  group.Add("--port", server.port, "Port to listen on; 0: any that is free");
  group.Add("--listen", server.listen,
            "Address to listen on; 0.0.0.0: all of this machine's. Nothing is\n"
            "encrypted: leave what comes from elsewhere to a proxy");
  group.Add("--tokens", server.tokens,
            "File of those who may ask: lines TOKEN [REQUESTS_PER_MINUTE], sent as\n"
            "\"Authorization: Bearer TOKEN\" (default: whoever reaches the port)");
  group.Add("--session-key", server.session_key,
            "File of 32 bytes or more that sign what clients carry of their walks:\n"
            "the same for all replicas (default: random, of this process alone)");
  group.Add("--cors", server.cors_origin,
            "Origin of web pages that may ask from browsers (https://example.org)");
  group.Add("--keep", server.keep, "Folder to keep photographs and answers in (default: none)");
  const OptionGroup limit(command, "Limits");
  const auto add_time = [&](const char* name, double& seconds, const char* help,
                            double shortest = 0.001) {
    const auto parse = [shortest](std::string_view option, const std::string& text) {
      return ParseSeconds(option, text, shortest);
    };
    limit.AddParsed(name, seconds, parse, help, fmt::format("{}s", seconds));
  };
  const auto add_size = [&](const char* name, uint64_t& size, uint64_t unit, const char* help) {
    const auto parse = [unit](std::string_view option, const std::string& text) {
      constexpr double kSmallest = 1e-6, kMost = 1e6;
      return static_cast<uint64_t>(ParseBetween(option, text, kSmallest, kMost) *
                                   static_cast<double>(unit));
    };
    limit.AddParsed(name, size, parse, help, fmt::format("{}", size / unit)).Type("FLOAT");
  };
  constexpr uint64_t kMegabyte = 1 << 20, kMegapixel = 1'000'000;
  add_time("--deadline", limits.answer_s,
           "Time from a request to its answer, after which it is given up (503)");
  add_time("--header-deadline", limits.header_s,
           "Time for a request's header, and of a connection without one");
  add_time("--body-deadline", limits.body_s, "Time for a request's body");
  add_time("--drain-delay", flags.server.drain_s,
           "Time that /readyz says that it ends, at SIGTERM, before no more requests\n"
           "are taken: a proxy asks others meanwhile",
           0);
  limit.Add("--max-queue", limits.queue,
            "Photographs that wait for a thread; further ones are refused (429), and\n"
            "so are those that would wait for more than half of --deadline");
  limit.Add("--max-connections", limits.connections,
            "Connections at once; further ones take the place of those that ask\n"
            "nothing, and are else refused (503)");
  add_size("--max-body-mb", limits.body_bytes, kMegabyte, "Size of a request's body (413)");
  add_size("--max-held-mb", limits.held_bytes, kMegabyte, "Size of all bodies at once (503)");
  add_size("--max-megapixels", limits.pixels, kMegapixel, "Size of a photograph (413)");
}

}  // namespace

Command AddServeCommand(CLI::App& program) {
  auto flags = std::make_shared<ServeFlags>();
  flags->localize.run.quiet = true;
  CLI::App& command =
      AddCommand(program, "serve", "Poses of photographs over HTTP, in scenes that stay open");
  const OptionGroup scenes(command, "Scenes");
  scenes.Add("SCENE", flags->scenes, "Scene files (raylift import makes them)").Required();
  AddCrsOption(scenes, flags->localize.world);
  AddServerOptions(command, *flags);
  LocalizeFlags& localize = flags->localize;
  const OptionGroup geometry(command, "Geometry");
  geometry.Add("--scene-calibration", localize.scene_calibration,
               "What is known of the scene: the file that calibrate or a run of\n"
               "localize wrote (default: learned from the references)");
  AddGeometryOptions(command, localize.geometry);
  AddMatchingOptions(command, localize.matching, "; without it, RootSIFT", "none is kept");
  AddFilterOptions(command, localize.filter);
  AddEstimatorOptions(command, localize.estimator);
  AddRunOptions(command, localize.run);
  SetFooter(
      command,
      R"(Prints "listening on URL" once the scenes are open. POST URL/v1/localize?scene=NAME takes a
photograph as the part `image` of a form, and beside it a part `query`, JSON with name, camera
("MODEL width height params..."), priors (lines of a priors file) and session (a walk with
odometry); it answers with a line of
queries.jsonl, the same as `raylift localize` writes with the same calibration. What is wrong
with a request is told as JSON that names the field. SIGTERM answers what is there and ends
with 0; SIGHUP opens the scenes anew. URL/openapi.json describes the rest.
Example:
  raylift serve scene.toml --port 8080
  curl -F image=@photo.jpg http://127.0.0.1:8080/v1/localize)");
  return {&command, [flags] { Serve(*flags); }};
}

}  // namespace raylift
