// Answers requests, apart from how these travel (server.cc).

#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "service/localize_request.h"
#include "service/metrics.h"
#include "service/problem.h"
#include "service/tokens.h"
#include "service/walks.h"
#include "service/work_queue.h"

#include "raylift/service/server.h"

namespace raylift {

struct RoughPosition;

struct HttpRequest {
  std::string method, target;                             // as in its first line
  std::string content_type, authorization, origin, body;  // empty: it has none
};

struct HttpAnswer {
  int status = 200;
  std::string content_type = "application/json";
  std::string body = {};
  std::vector<std::pair<std::string, std::string>> headers = {};
  WorkQueue::Tells tells = WorkQueue::Tells::kNothing;  // only where something was localized for it
};

// Tells whether somebody still waits for an answer.
struct AnswerWatch {
  using Clock = std::chrono::steady_clock;
  Clock::time_point deadline;
  std::shared_ptr<std::atomic<bool>> is_gone;  // the client; null: no work is done for it

  // Returns whether nobody waits any more.
  bool IsOver() const;
  // Throws Problem where nobody does.
  void Check() const;
};

// Is called where somebody wants to see the gauges.
using ReadGauges = std::function<std::vector<Gauge>()>;

// Answers the requests of clients; any thread may call its functions.
class Service {
 public:
  explicit Service(const ServerOptions& options);

  // Replaces the scenes; work in hand goes on with those that it has begun with. Prepares them on
  // `threads`, 0: one for each core. Throws InputError where a name stands twice.
  void Take(std::vector<ServedScene> scenes, int threads);

  // Answers requests that need no body, and refuses those that are to be refused before theirs is
  // read. nullopt where the request is one for Localize() or for a batch.
  std::optional<HttpAnswer> AnswerHead(const HttpRequest& head, bool is_ready,
                                       const ReadGauges& gauges);
  static bool IsBatch(const HttpRequest& request);

  // Answers requests that take a thread: a photograph on /v1/localize or /geopose, and /v1/view.
  HttpAnswer Localize(const HttpRequest& request, const AnswerWatch& watch);

  // The photographs of one request, localized one after the other.
  struct Opened;
  struct Batch {
    HttpRequest request;  // whose body the photographs are views into
    BatchRequest photographs;
    std::shared_ptr<const Opened> scene;
    size_t next = 0;

    bool AtEnd() const { return next == photographs.photographs.size(); }
  };
  struct BegunBatch {
    HttpAnswer answer;             // whose body follows where there is a batch
    std::unique_ptr<Batch> batch;  // null: the request was refused
  };
  BegunBatch BeginBatch(HttpRequest request);
  struct BatchLine {
    std::string text;
    WorkQueue::Tells tells = WorkQueue::Tells::kNothing;  // as of HttpAnswer
  };
  // Returns the next photograph's answer, or its name and what was wrong with it.
  BatchLine Next(Batch& batch, const AnswerWatch& watch);

  // Returns the answer that tells a problem, and counts it.
  HttpAnswer Refuse(const HttpRequest& request, const Problem& problem);

 private:
  using OpenedScenes = std::map<std::string, std::shared_ptr<const Opened>>;

  // Sets `tells` for the answer, and also where it throws.
  HttpAnswer AnswerLocalize(const HttpRequest& request, const AnswerWatch& watch,
                            WorkQueue::Tells& tells);
  HttpAnswer AnswerView(const HttpRequest& request, const AnswerWatch& watch) const;
  HttpAnswer AnswerGeoPose(const HttpRequest& request, const AnswerWatch& watch,
                           WorkQueue::Tells& tells);

  // Counts an answer and adds what belongs to all of them.
  void Complete(const HttpRequest& request, HttpAnswer& answer);
  std::shared_ptr<const OpenedScenes> Scenes() const;
  std::shared_ptr<const Opened> SceneOf(const HttpRequest& request) const;
  // Returns the scene nearest to the position. Throws Problem where it cannot be told, or where
  // none has a coordinate system for the position.
  static const Opened& NearestOf(std::span<const std::shared_ptr<const Opened>> scenes,
                                 const std::optional<RoughPosition>& near);
  // Returns the scenes that may answer where a photograph is on the earth; at least one.
  std::vector<std::shared_ptr<const Opened>> PlacedScenesOf(const HttpRequest& request) const;
  HttpAnswer Get(std::string_view path, bool is_ready, const ReadGauges& gauges) const;
  HttpAnswer ListScenes() const;
  LocalizedQuery Run(const Opened& scene, LocalizeRequest request, const AnswerWatch& watch,
                     WorkQueue::Tells& tells);
  void Keep(const std::string& picture, const std::string& line);

  const ServerOptions options_;
  std::unique_ptr<Tokens> tokens_;  // null: everybody may ask
  const WalkTokens walk_tokens_;
  Metrics metrics_;
  std::atomic<uint64_t> num_kept_ = 0;
  mutable std::mutex mutex_;
  std::shared_ptr<const OpenedScenes> scenes_;  // guarded by it
};

// Returns the parameters of a request's target: "/v1/localize?scene=a". Throws Problem for what
// cannot be decoded, and for a parameter that stands twice.
std::map<std::string, std::string> ParseParameters(std::string_view target);

}  // namespace raylift
