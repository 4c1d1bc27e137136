// Asks a server (raylift/service/server.h) for poses, over HTTP.

#pragma once

#include <chrono>
#include <string>
#include <utility>

#include "raylift/scene/photographs.h"

namespace raylift {

// Parses "http://HOST:PORT", followed by "?scene=NAME" where the server has several. Throws
// InputError for anything else; https is not supported, as nothing is encrypted here.
struct ServerUrl {
  std::string host, port, path, parameters;

  static ServerUrl Parse(const std::string& text);
};

struct ClientOptions {
  ServerUrl server;
  std::string token = {};  // empty: none is sent
  // A request to a busy server is repeated, and waited for, for this time at most, in s.
  std::chrono::seconds patience{600};
};

// Sends requests to a server; any thread may call its functions.
class Client {
 public:
  explicit Client(ClientOptions options) : options_(std::move(options)) {}

  // Returns a photograph's line of queries.jsonl. Its camera is sent where the focal length is
  // known; priors of the pose are not. Throws InputError where the server refuses the photograph or
  // cannot be asked.
  std::string Localize(const Query& query, const std::string& photograph) const;

 private:
  ClientOptions options_;
};

}  // namespace raylift
