#include "apps/localize_remote.h"

#include <algorithm>
#include <string>
#include <system_error>
#include <vector>

#include "apps/interrupt.h"
#include "apps/localize_output.h"
#include "apps/options.h"
#include "base/progress.h"
#include "jobs/manifest_file.h"
#include "localization/results/query_job.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

void Check(const LocalizeFlags& localize) {
  if (localize.queries.empty()) throw OptionError("--server needs --queries");
  if (localize.QueryImages().empty()) throw OptionError("--server needs --query-images");
  RefuseWith("--server", {{"--priors", !localize.priors.empty()},
                          {"--rigs", !localize.rigs.empty()},
                          {"--leave-one-out", localize.leave_one_out},
                          {"--continuous", localize.continuous.enabled},
                          {"--odometry", localize.walk.enabled()},
                          {"--report", !localize.report.empty()},
                          {"--pictures", localize.pictures > 0},
                          {"--write-model", !localize.write_model.empty()},
                          {"--write-problems", !localize.write_problems.empty()},
                          {"--rerender", localize.mesh_only.rerender > 0},
                          {"--resume", localize.running.resume},
                          {"--shard", !localize.running.Resolve().IsAll()}});
  RefuseFormerRun(localize.running.In(localize.out), QueryJobForm(localize.out));
}

// Returns the line of queries.jsonl, as a local run has it. Throws InputError for anything else.
std::string LineOf(std::string answer, const Query& query) {
  while (answer.ends_with('\n')) answer.pop_back();
  const auto json = nlohmann::json::parse(answer, nullptr, false);
  if (!json.is_object() || json.value("name", nlohmann::json()) != query.name ||
      answer.find('\n') != std::string::npos) {
    throw InputError(
        fmt::format("{}: expected the server to answer a line of queries.jsonl, found "
                    "\"{}\"",
                    query.name, answer.substr(0, 80)));
  }
  // Where the server knows its scene's place on the earth, this is the last member.
  if (json.contains("geopose")) answer = answer.substr(0, answer.rfind(",\"geopose\":")) + '}';
  return answer;
}

// Removes the results of a former run, also of one on this machine, except for the calibration: it
// holds as well as before, and the server may read it.
void RemoveFormerResults(const LocalizeFlags& localize) {
  const std::filesystem::path& out = localize.out;
  const bool is_of_run = !ListManifests(out).empty();
  RemoveFormerRun(out, QueryJobForm(out));
  if (!is_of_run) return;
  std::error_code ignored;
  for (const char* name : {"options.json", "timing.jsonl", "depth_alignment.jsonl"}) {
    std::filesystem::remove(out / name, ignored);
  }
}

std::string ReadToken(const std::filesystem::path& file) {
  if (file.empty()) return {};
  std::string token(Trim(ReadFile(file)));
  const bool is_word =
      std::all_of(token.begin(), token.end(), [](unsigned char c) { return c > ' ' && c < 0x7F; });
  if (token.empty() || !is_word) throw InputError(file, "expected a token alone");
  return token;
}

}  // namespace

void AddRemoteOptions(CLI::App& command, RemoteFlags& flags) {
  const OptionGroup group(command, "Server");
  group
      .AddParsed("--server", flags.server, AsOption(&ServerUrl::Parse),
                 "Have a server (raylift serve) localize the photographs of --queries:\n"
                 "http://HOST:PORT, or http://HOST:PORT?scene=NAME where it has several.\n"
                 "The scene, matching and estimation are the server's; --threads: requests\n"
                 "at once")
      .NotConfigurable();
  group.Add("--token-file", flags.token_file, "File with the token that the server asks for")
      .NotConfigurable();
}

void LocalizeRemotely(const RemoteFlags& flags, const LocalizeFlags& localize) {
  Check(localize);
  RequireWritable(localize.out / "queries.jsonl");
  std::error_code ignored;
  std::filesystem::remove(localize.out, ignored);  // where it is empty: nothing is there yet
  const Client client({.server = *flags.server, .token = ReadToken(flags.token_file)});
  const std::filesystem::path images = localize.QueryImages();
  const std::vector<Query> queries = ReadQueryList(localize.queries, images);
  std::vector<std::string> lines(queries.size());
  UntilSignal(
      [&] {
        Progress progress("queries", queries.size(), localize.run.Show());
        ParallelFor(queries.size(), localize.run.threads, [&](size_t i) {
          lines[i] =
              LineOf(client.Localize(queries[i], ReadFile(images / queries[i].name)), queries[i]);
          progress.Advance();
        });
      },
      &BeginsAnew);
  std::filesystem::create_directories(localize.out);
  const FolderLock lock(localize.out, FolderLock::Mode::kExclusive);
  if (localize.running.overwrite) RemoveFormerResults(localize);
  WriteQueryDiagnostics(localize.out / "queries.jsonl", lines);
  const std::vector<LocalizedQuery> localized =
      ReadQueryDiagnostics(localize.out / "queries.jsonl");
  WritePoses(localize.out / "poses.txt", localized);
  if (localize.run.quiet) return;
  fmt::print("{} of {} queries localized\n",
             std::count_if(localized.begin(), localized.end(),
                           [](const LocalizedQuery& query) { return query.localized(); }),
             localized.size());
}

}  // namespace raylift
