// Localization over HTTP: scenes that are opened once answer photographs of many clients.
//
//   Server server([] { return OpenAll(); }, {.port = 8080});
//   std::cout << "listening on " << server.url() << std::endl;
//   server.Run();  // until SIGTERM or Stop()
//
// Routes, as /openapi.json tells them in full:
//
//   POST /v1/localize?scene=NAME        one photograph; answers a line of queries.jsonl
//   POST /v1/localize/batch?scene=NAME  several; answers a line each, as they are done
//   POST /geopose?scene=NAME            the GeoPose Protocol of Open AR Cloud, version 2
//   POST /v1/view?scene=NAME            what a camera sees of the scene, a JPEG
//   GET  /v1/scenes /healthz /readyz /metrics /openapi.json /
//
// An answer depends on its request and the scene's calibration alone: it is that of the command
// line, whoever else asks at the same time. What is wrong with a request is told as a JSON object
// (RFC 9457) that names the field.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "raylift/geometry/geodesy.h"
#include "raylift/localization/localizer.h"

namespace raylift {

struct ServedScene {
  std::string name;  // each another
  std::shared_ptr<const Localizer> localizer;
  std::optional<WorldFrame> world = std::nullopt;  // where its place on the earth is known
};
// Opens the scenes. It is called before the first request, and again, on another thread, to open
// the scenes anew.
using OpenScenes = std::function<std::vector<ServedScene>()>;

// The limits on what clients may use. Bodies are counted as they are decoded.
struct ServerLimits {
  // Connections at once. A further one replaces a connection that was answered and is about to end,
  // or the one that has been without a request for longest, once it had time to send one or where
  // most have none. Where there is none of these, it is answered with 503.
  int connections = 1000;
  // Requests that wait for a thread; further ones get 429, as do those that would wait for more
  // than half of answer_s.
  size_t queue = 64;
  size_t body_bytes = size_t{32} << 20;
  size_t held_bytes = size_t{512} << 20;  // of all bodies at once; further ones get 503
  uint64_t pixels = 64'000'000;           // of a photograph
  // Seconds for a request's header and a connection without one, for its body, for a part of the
  // answer, and from the body's end to the answer, after which it is given up.
  double header_s = 10;
  double body_s = 30;
  double write_s = 30;
  double answer_s = 30;
};

struct ServerOptions {
  std::string listen = "127.0.0.1";  // an address of this machine
  int port = 8080;                   // 0: any that is free
  int threads = 0;                   // photographs at once; 0: one for each core
  ServerLimits limits = {};
  std::filesystem::path tokens = {};  // empty: whoever reaches it may ask
  // The key that signs the state of walks that clients carry: replicas of one service share it.
  // Where it is empty, the key is random, so that no other process accepts these tokens.
  std::filesystem::path session_key = {};
  // Seconds from SIGTERM until no more requests are taken; meanwhile /readyz reports the end, so
  // that a proxy turns to other servers.
  double drain_s = 0;
  std::filesystem::path keep = {};  // folder for photographs and answers; empty: none is kept
  std::string cors_origin = {};     // of pages that browsers may use it from; empty: none
  std::function<void(const std::string& message)> log = {};  // from any thread
};

class Server {
 public:
  // Opens the scenes and the port; signals wait for Run() from then on. Throws what `open` throws,
  // OptionError for an address or a port that cannot be used, and ResourceError where threads
  // cannot be started.
  Server(OpenScenes open, const ServerOptions& options);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  std::string url() const;  // "http://127.0.0.1:8080"

  // Answers until Stop(), SIGTERM or SIGINT; then takes no more requests, answers those that are
  // there and returns. SIGHUP opens the scenes anew: those that cannot be opened stay as they are.
  void Run();
  void Stop();  // from any thread

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace raylift
