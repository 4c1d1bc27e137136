// Runs `raylift localize --server`: asks a server for the poses of a list's photographs.

#pragma once

#include <filesystem>
#include <optional>

#include "apps/command_line.h"
#include "apps/localize_flags.h"

#include "raylift/service/client.h"

namespace raylift {

struct RemoteFlags {
  std::optional<ServerUrl> server;
  std::filesystem::path token_file;
};
void AddRemoteOptions(CLI::App& command, RemoteFlags& flags);

// Writes queries.jsonl, the server's lines in the list's order, and poses.txt. The scene, matching
// and estimation are the server's; of `localize` only the queries and the output count.
void LocalizeRemotely(const RemoteFlags& flags, const LocalizeFlags& localize);

}  // namespace raylift
