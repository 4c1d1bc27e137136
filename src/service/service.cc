#include "service/service.h"

#include <algorithm>
#include <array>
#include <exception>
#include <new>
#include <span>

#include "base/json_text.h"
#include "base/lap_clock.h"
#include "localization/results/result_json.h"
#include "service/documents.h"
#include "service/geopose.h"
#include "service/mesh_view.h"
#include "service/scene_place.h"
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift {

struct Service::Opened {
  ServedScene scene;
  ReferencesByName references;
  SceneWalks walks;
  std::unique_ptr<const ScenePlace> place;  // null: it is not known

  Opened(const WalkTokens& tokens, ServedScene opened, int threads)
      : scene(std::move(opened)), walks(tokens, scene, threads) {}

  // Returns a line of queries.jsonl, with the camera as GeoPose where the place is known.
  std::string Line(const LocalizedQuery& query) const {
    return WithPlace(FormatQueryDiagnostics(query), query);
  }
  std::string Line(const WalkedQuery& query) const {
    return WithPlace(FormatQueryDiagnostics(query), query.localized);
  }
  std::string WithPlace(std::string line, const LocalizedQuery& localized) const {
    if (!place || !localized.localized()) return line;
    const auto camera = place->CameraOf(localized.estimate);
    if (!camera) return line;
    return WithMember(std::move(line), "geopose", camera->geopose);
  }
};

namespace {

constexpr std::string_view kLocalizePath = "/v1/localize";
constexpr std::string_view kBatchPath = "/v1/localize/batch";
constexpr std::string_view kGeoPosePath = "/geopose";
constexpr std::string_view kViewPath = "/v1/view";
constexpr std::array<std::string_view, 6> kGetPaths = {"/",       "/v1/scenes", "/healthz",
                                                       "/readyz", "/metrics",   "/openapi.json"};

bool IsGet(std::string_view path) {
  return std::find(kGetPaths.begin(), kGetPaths.end(), path) != kGetPaths.end();
}

bool IsPost(std::string_view path) {
  return path == kLocalizePath || path == kBatchPath || path == kGeoPosePath || path == kViewPath;
}

// Returns the path undecoded, as all of ours are plain.
std::string_view PathOf(const HttpRequest& request) {
  return std::string_view(request.target).substr(0, request.target.find('?'));
}

// Returns the path where it is one of ours, else "other": paths that clients make up are not
// counted by their names.
std::string RouteOf(const HttpRequest& request) {
  const std::string_view path = PathOf(request);
  return IsGet(path) || IsPost(path) ? std::string(path) : "other";
}

std::string Decoded(std::string_view text) {
  const auto digit = [](char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    throw Problem(400, "the target is badly encoded");
  };
  std::string decoded;
  for (size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%') {
      if (i + 2 >= text.size()) throw Problem(400, "the target is badly encoded");
      decoded += static_cast<char>(digit(text[i + 1]) * 16 + digit(text[i + 2]));
      i += 2;
    } else {
      decoded += text[i] == '+' ? ' ' : text[i];
    }
  }
  return decoded;
}

// Turns errors of localization into problems that the client is told. Errors that are our own fault
// are told to the log alone.
template <typename Function>
auto AsProblems(const ServerOptions& options, const Function& work) {
  try {
    return work();
  } catch (const Problem&) {
    throw;
  } catch (const OutputError& error) {
    if (options.log) options.log(error.what());
    throw Problem(503, "the answer could not be kept");
  } catch (const LostFile& error) {
    if (options.log) options.log(error.what());
    throw TryLater(503, "a file of the scene cannot be read");
  } catch (const InputError& error) {
    throw ProblemOfInput(error.what());
  } catch (const std::bad_alloc&) {
    throw TryLater(503, "out of memory");
  } catch (const std::exception& error) {
    if (options.log) options.log(fmt::format("this is a bug: {}", error.what()));
    throw Problem(500, "this is a bug; the server's log says more");
  }
}

// Returns the scene that a request names.
std::optional<std::string> SceneNameOf(const HttpRequest& request) {
  std::optional<std::string> wanted;
  for (const auto& [name, value] : ParseParameters(request.target)) {
    if (name != "scene") throw Problem(400, name, name + ": is not known here; expected scene");
    wanted = value;
  }
  return wanted;
}

template <typename Read>
auto ReadTimed(Metrics& metrics, const Read& read) {
  const LapClock clock;
  auto request = read();
  metrics.ObserveStage("read", clock.Seconds());
  return request;
}

constexpr auto kStages = std::span(kQueryStages).first<4>();  // nothing is rendered again

std::string ServerTiming(const StageTimes& times) {
  std::string text;
  for (const auto& [name, milliseconds] : kStages) {
    text += fmt::format("{}{};dur={:.3f}", text.empty() ? "" : ", ", name, times.*milliseconds);
  }
  return text;
}

}  // namespace

std::map<std::string, std::string> ParseParameters(std::string_view target) {
  std::map<std::string, std::string> parameters;
  const size_t question = std::min(target.find('?'), target.size());
  std::string_view rest = target.substr(std::min(question + 1, target.size()));
  while (!rest.empty()) {
    const std::string_view pair = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(pair.size() + 1, rest.size()));
    const size_t equals = std::min(pair.find('='), pair.size());
    const std::string name = Decoded(pair.substr(0, equals));
    const std::string value = Decoded(pair.substr(std::min(equals + 1, pair.size())));
    if (!parameters.emplace(name, value).second) {
      throw Problem(400, name, name + ": stands twice");
    }
  }
  return parameters;
}

bool AnswerWatch::IsOver() const { return (is_gone && *is_gone) || Clock::now() >= deadline; }

void AnswerWatch::Check() const {
  if (!IsOver()) return;
  if (is_gone && *is_gone) throw Problem(503, "the client has gone");
  throw TryLater(503, "there was no answer in time");
}

Service::Service(const ServerOptions& options)
    : options_(options), walk_tokens_(options.session_key) {
  if (!options.tokens.empty()) tokens_ = std::make_unique<Tokens>(options.tokens);
  if (!options.keep.empty()) RequireWritable(options.keep / "photograph");
}

void Service::Take(std::vector<ServedScene> scenes, int threads) {
  auto opened = std::make_shared<OpenedScenes>();
  for (ServedScene& given : scenes) {
    auto entry = std::make_shared<Opened>(walk_tokens_, std::move(given), threads);
    const ServedScene& scene = entry->scene;
    for (const PosedImage& image : scene.localizer->scene().references.images) {
      entry->references.emplace(image.name, &image);
    }
    if (scene.world) {
      try {
        entry->place =
            std::make_unique<const ScenePlace>(*scene.world, scene.localizer->scene().references);
      } catch (const InputError& error) {
        throw InputError(
            fmt::format("scene {}: {}: {}", scene.name, scene.world->text, error.what()));
      }
      const auto warning = entry->place->Warning();
      if (warning && options_.log) options_.log(*warning);
    }
    const std::string name = scene.name;
    if (!opened->emplace(name, std::move(entry)).second) {
      throw InputError(fmt::format("two scenes have the name {}", name));
    }
  }
  std::shared_ptr<const OpenedScenes> taken = std::move(opened);
  const std::lock_guard lock(mutex_);
  scenes_.swap(taken);  // the old ones are freed without the lock
}

std::shared_ptr<const Service::OpenedScenes> Service::Scenes() const {
  const std::lock_guard lock(mutex_);
  return scenes_;
}

std::shared_ptr<const Service::Opened> Service::SceneOf(const HttpRequest& request) const {
  const auto scenes = Scenes();
  const auto expected = [&] {
    std::vector<std::string_view> names;
    for (const auto& [name, scene] : *scenes) names.push_back(name);
    return fmt::format("expected {}", fmt::join(names, "|"));
  };
  const auto wanted = SceneNameOf(request);
  if (!wanted) {
    if (scenes->size() == 1) return scenes->begin()->second;
    throw Problem(400, "scene", "scene: is required: " + expected());
  }
  const auto found = scenes->find(*wanted);
  if (found != scenes->end()) return found->second;
  throw Problem(404, "scene", "scene: " + expected());
}

std::vector<std::shared_ptr<const Service::Opened>> Service::PlacedScenesOf(
    const HttpRequest& request) const {
  std::vector<std::shared_ptr<const Opened>> placed;
  if (SceneNameOf(request)) {
    placed = {SceneOf(request)};
  } else {
    const auto scenes = Scenes();
    for (const auto& [name, scene] : *scenes) placed.push_back(scene);
  }
  std::erase_if(placed, [](const auto& scene) { return !scene->place; });
  if (!placed.empty()) return placed;
  throw Problem(404, "scene", "scene: its place on the earth is not known: it has no CRS");
}

std::optional<HttpAnswer> Service::AnswerHead(const HttpRequest& head, bool is_ready,
                                              const ReadGauges& gauges) {
  try {
    const std::string_view path = PathOf(head);
    const bool is_get = IsGet(path);
    if (!is_get && !IsPost(path)) throw Problem(404, "there is nothing at this path");
    const bool is_preflight = head.method == "OPTIONS" && !options_.cors_origin.empty();
    if (is_preflight) {
      HttpAnswer answer{.status = 204};
      answer.headers = {{"Access-Control-Allow-Methods", is_get ? "GET" : "POST"},
                        {"Access-Control-Allow-Headers", "Authorization, Content-Type"}};
      Complete(head, answer);
      return answer;
    }
    const bool fits =
        is_get ? head.method == "GET" || head.method == "HEAD" : head.method == "POST";
    if (!fits) {
      HttpAnswer answer = Refuse(head, Problem(405, "another method is expected here"));
      answer.headers.emplace_back("Allow", is_get ? "GET, HEAD" : "POST");
      return answer;
    }
    // Health is no secret, nor is the page, which asks for a token itself.
    const bool is_open = path == "/healthz" || path == "/readyz" || path == "/";
    if (tokens_ && !is_open) tokens_->Admit(head.authorization, AnswerWatch::Clock::now());
    if (!is_get) {
      if (path == kGeoPosePath) {
        PlacedScenesOf(head);
      } else {
        SceneOf(head);
      }
      return std::nullopt;
    }
    HttpAnswer answer = Get(path, is_ready, gauges);
    Complete(head, answer);
    return answer;
  } catch (const Problem& problem) {
    return Refuse(head, problem);
  }
}

bool Service::IsBatch(const HttpRequest& request) { return RouteOf(request) == kBatchPath; }

HttpAnswer Service::Get(std::string_view path, bool is_ready, const ReadGauges& gauges) const {
  if (path == "/v1/scenes") return ListScenes();
  if (path == "/metrics") {
    return {.content_type = "text/plain; version=0.0.4", .body = metrics_.Text(gauges())};
  }
  if (path == "/openapi.json") return {.body = std::string(kOpenApi)};
  if (path == "/") {
    return {.content_type = "text/html; charset=utf-8", .body = std::string(kStartPage)};
  }
  if (path == "/readyz" && !is_ready) throw Problem(503, "the server is about to end");
  return {.content_type = "text/plain", .body = "ok\n"};
}

HttpAnswer Service::ListScenes() const {
  nlohmann::ordered_json json;
  SetMember(json, "scenes", nlohmann::ordered_json::array());
  const auto scenes = Scenes();
  for (const auto& [name, opened] : *scenes) {
    const Scene& scene = opened->scene.localizer->scene();
    nlohmann::ordered_json entry;
    SetMember(entry, "name", name);
    SetMember(entry, "references", scene.references.images.size());
    SetMember(entry, "geometry", nlohmann::ordered_json::array());
    for (const SceneSource& source : scene.sources) {
      AppendTo(entry, "geometry", source.spec.substr(0, source.spec.find(':')));
    }
    SetMember(entry, "calibrated", scene.calibration != nullptr);
    AppendTo(json, "scenes", std::move(entry));
  }
  return {.body = JsonText(std::move(json))};
}

LocalizedQuery Service::Run(const Opened& opened, LocalizeRequest request, const AnswerWatch& watch,
                            WorkQueue::Tells& tells) {
  const Localizer& localizer = *opened.scene.localizer;
  watch.Check();
  tells = WorkQueue::Tells::kLeastTime;
  QueryResult result = std::visit(
      [&](auto& evidence) { return localizer.Match(request.query, std::move(evidence)); },
      request.evidence);
  watch.Check();
  ReadOpened([&] { localizer.Lift(result); });
  watch.Check();
  localizer.Filter(result);
  watch.Check();
  localizer.Estimate(result);
  tells = WorkQueue::Tells::kTime;
  const StageTimes& times = result.localized.times;
  constexpr double kMsPerS = 1000;
  for (const auto& [name, milliseconds] : kStages) {
    metrics_.ObserveStage(name, times.*milliseconds / kMsPerS);
  }
  metrics_.CountVerdict(opened.scene.name, ToString(result.localized.verdict()));
  if (!options_.keep.empty()) {
    Keep(request.picture_bytes, opened.Line(result.localized));
  }
  return std::move(result.localized);
}

HttpAnswer Service::AnswerLocalize(const HttpRequest& request, const AnswerWatch& watch,
                                   WorkQueue::Tells& tells) {
  const auto opened = SceneOf(request);
  LocalizeRequest read = ReadTimed(metrics_, [&] {
    return ReadLocalizeRequest(request.content_type, request.body, opened->references,
                               options_.limits.pixels);
  });
  const std::optional<WalkStep> step = std::move(read.session);
  ServedWalk walk = step ? opened->walks.Before(*step) : ServedWalk{};
  const Query query = read.query;
  const LocalizedQuery localized = Run(*opened, std::move(read), watch, tells);
  HttpAnswer answer;
  if (step) {
    const SceneWalks::Walked walked = opened->walks.GoOn(
        std::move(walk), {query, localized, step->cam_from_odometry, step->time_s});
    answer.body = WithMember(opened->Line(walked.query), "session", walked.session);
  } else {
    answer.body = opened->Line(localized);
  }
  answer.headers.emplace_back("Server-Timing", ServerTiming(localized.times));
  return answer;
}

const Service::Opened& Service::NearestOf(std::span<const std::shared_ptr<const Opened>> scenes,
                                          const std::optional<RoughPosition>& near) {
  if (scenes.size() == 1) return *scenes.front();
  if (!near) {
    throw Problem(400, "scene",
                  "scene: is required with several scenes and no geolocationReadings");
  }
  const Opened* nearest = nullptr;
  double least_m = 0;
  for (const auto& scene : scenes) {
    const auto distance_m = scene->place->DistanceMeters(*near);
    if (!distance_m || (nearest != nullptr && *distance_m >= least_m)) continue;
    nearest = scene.get();
    least_m = *distance_m;
  }
  if (nearest != nullptr) return *nearest;
  throw Problem(404, "scene", "scene: none is near to where the photograph was taken");
}

HttpAnswer Service::AnswerView(const HttpRequest& request, const AnswerWatch& watch) const {
  const auto opened = SceneOf(request);
  const ViewRequest view = ReadViewRequest(request.body);
  // Some lenses take minutes to render.
  const CallWatch call({.stop_wanted = [&] { return watch.IsOver(); }});
  try {
    return {.content_type = "image/jpeg",
            .body = RenderView(view, opened->scene.localizer->scene())};
  } catch (const Cancelled&) {
    watch.Check();
    throw;
  }
}

HttpAnswer Service::AnswerGeoPose(const HttpRequest& request, const AnswerWatch& watch,
                                  WorkQueue::Tells& tells) {
  const auto placed = PlacedScenesOf(request);
  GeoPoseRequest read =
      ReadTimed(metrics_, [&] { return ReadGeoPoseRequest(request.body, options_.limits.pixels); });
  const Opened& opened = NearestOf(placed, read.near);
  if (read.near) read.photograph.query.priors.position = opened.place->PriorOf(*read.near);
  const LocalizedQuery localized = Run(opened, std::move(read.photograph), watch, tells);
  if (!localized.localized()) {
    throw Problem(422, "the photograph was not localized: " + localized.reason);
  }
  const auto camera = opened.place->CameraOf(localized.estimate);
  if (!camera) throw Problem(422, "the photograph was localized beyond where the CRS is meant for");
  HttpAnswer answer{.body = FormatGeoPoseAnswer(read, opened.scene.name, localized, *camera)};
  answer.headers.emplace_back("Server-Timing", ServerTiming(localized.times));
  return answer;
}

HttpAnswer Service::Localize(const HttpRequest& request, const AnswerWatch& watch) {
  HttpAnswer answer;
  auto tells = WorkQueue::Tells::kNothing;
  try {
    answer = AsProblems(options_, [&] {
      watch.Check();
      return PathOf(request) == kViewPath      ? AnswerView(request, watch)
             : PathOf(request) == kGeoPosePath ? AnswerGeoPose(request, watch, tells)
                                               : AnswerLocalize(request, watch, tells);
    });
    Complete(request, answer);
  } catch (const Problem& problem) {
    answer = Refuse(request, problem);
  }
  answer.tells = tells;
  return answer;
}

Service::BegunBatch Service::BeginBatch(HttpRequest request) {
  auto batch = std::make_unique<Batch>();
  batch->request = std::move(request);
  try {
    AsProblems(options_, [&] {
      batch->scene = SceneOf(batch->request);
      batch->photographs = ReadBatchRequest(batch->request.content_type, batch->request.body);
    });
    HttpAnswer head{.content_type = "application/x-ndjson"};
    Complete(batch->request, head);
    return {.answer = std::move(head), .batch = std::move(batch)};
  } catch (const Problem& problem) {
    return {.answer = Refuse(batch->request, problem), .batch = nullptr};
  }
}

Service::BatchLine Service::Next(Batch& batch, const AnswerWatch& watch) {
  const size_t index = batch.next++;
  BatchLine line;
  try {
    line.text = AsProblems(options_, [&] {
      watch.Check();
      // The token was admitted for the first photograph when the batch began.
      if (tokens_ && index > 0) {
        tokens_->Admit(batch.request.authorization, AnswerWatch::Clock::now());
      }
      LocalizeRequest read = ReadTimed(metrics_, [&] {
        return ReadBatchEntry(batch.photographs, index, options_.limits.pixels);
      });
      return batch.scene->Line(Run(*batch.scene, std::move(read), watch, line.tells));
    });
  } catch (const Problem& problem) {
    nlohmann::ordered_json json;
    SetMember(json, "name", batch.photographs.photographs[index].name);
    SetMember(json, "status", "refused");
    SetMember(json, "problem", ProblemObject(problem));
    line.text = JsonText(std::move(json));
  }
  line.text += '\n';
  return line;
}

HttpAnswer Service::Refuse(const HttpRequest& request, const Problem& problem) {
  HttpAnswer answer{.status = problem.status(),
                    .content_type = "application/problem+json",
                    .body = ProblemJson(problem)};
  if (problem.retry_after_s) {
    answer.headers.emplace_back("Retry-After", std::to_string(*problem.retry_after_s));
  }
  if (problem.status() == 401) answer.headers.emplace_back("WWW-Authenticate", "Bearer");
  Complete(request, answer);
  return answer;
}

void Service::Complete(const HttpRequest& request, HttpAnswer& answer) {
  metrics_.CountRequest(RouteOf(request), answer.status);
  if (options_.cors_origin.empty() || request.origin != options_.cors_origin) return;
  answer.headers.emplace_back("Access-Control-Allow-Origin", options_.cors_origin);
  answer.headers.emplace_back("Vary", "Origin");
}

// Keeps a picture and its line under a name of ours: the time, the process and a number.
void Service::Keep(const std::string& picture, const std::string& line) {
  const std::string name = fmt::format(
      "{:%Y%m%d-%H%M%S}-{}-{:06}",
      std::chrono::time_point_cast<std::chrono::seconds>(std::chrono::system_clock::now()),
      getpid(), ++num_kept_);
  if (!picture.empty()) WriteFile(options_.keep / (name + ".photograph"), picture);
  WriteFile(options_.keep / (name + ".json"), line + '\n');
}

}  // namespace raylift
