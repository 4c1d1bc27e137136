// raylift pairs: lists the references that each query, or each reference, is to be matched with.

#include <memory>

#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/matching_options.h"
#include "apps/options.h"
#include "localization/retrieval/retrieval.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/hloc_files.h"
#include "raylift/io/query_list.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct PairsFlags {
  ReferenceFlags references;
  std::string geometry;
  path queries, images, query_images, cache;
  int max_features = 4096;
  uint64_t seed = 0;
  RetrievalFlags retrieval;
  int top_k = 20;
  path out, scores;
  RunFlags run;
};

RetrievalOptions Resolve(const PairsFlags& flags) {
  flags.references.Check();
  flags.run.Check();
  RequireAtLeast("--top-k", flags.top_k, 1);
  RequireAtLeast("--max-features", flags.max_features, 1);
  RetrievalOptions options = flags.retrieval.Resolve(
      {flags.geometry},
      flags.queries.empty() ? RetrievalFlags::Queries::kReferences : RetrievalFlags::Queries::kOwn);
  options.top_k = flags.top_k;
  options.threads = flags.run.threads;
  options.show_progress = !flags.run.quiet;
  if (options.method == RetrievalMethod::kVlad && flags.images.empty() &&
      !flags.references.HaveFeatures()) {
    throw OptionError("--retrieval vlad needs --images");
  }
  if (!flags.geometry.empty() && options.method != RetrievalMethod::kOverlap) {
    throw OptionError("--geometry", flags.geometry, "goes with --retrieval overlap");
  }
  return options;
}

class PairsRun {
 public:
  PairsRun(const PairsFlags& flags, RetrievalOptions options)
      : flags_(flags), options_(std::move(options)), loaded_(flags.references.Load()) {
    PrintWarnings(loaded_.warnings);
    RequireWritable(flags.out);
    if (!flags.scores.empty()) RequireWritable(flags.scores);
    if (!flags.queries.empty()) {
      queries_ = ReadQueryList(flags.queries, QueryImages());
      flags.retrieval.ReadPriorPoses(&options_);
    } else {
      queries_ = QueriesOf(loaded_.references);
      options_.prior_poses = PosesOf(loaded_.references);
    }
    if (options_.method == RetrievalMethod::kOverlap) {
      NamedGeometry geometry = MakeGeometrySource(flags.geometry, {.threads = flags.run.threads});
      PrintWarnings(geometry.warnings);
      options_.mesh = geometry.Surface();
    }
    options_.covisibility = std::move(loaded_.covisibility);
  }

  void Run() const {
    const Retrieval retrieval = Retrieve();
    PrintWarnings(retrieval.warnings);
    std::vector<std::pair<std::string, std::string>> pairs;
    std::string scores;
    size_t without = 0;
    for (size_t i = 0; i < queries_.size(); ++i) {
      without += retrieval.lists[i].empty();
      for (const RetrievedReference& found : retrieval.lists[i]) {
        const std::string& reference =
            References()[static_cast<size_t>(found.reference_index)].name;
        pairs.emplace_back(queries_[i].name, reference);
        scores +=
            fmt::format("{}, {}, {}\n", queries_[i].name, reference, FormatDouble(found.score));
      }
    }
    WritePairs(flags_.out, pairs);
    if (!flags_.scores.empty()) WriteFile(flags_.scores, scores);
    if (flags_.run.quiet) return;
    fmt::print("{} pairs of {} {} with {} references by {}", pairs.size(), queries_.size(),
               flags_.queries.empty() ? "references" : "queries", References().size(),
               ToString(options_.method));
    if (without > 0) fmt::print("; {} have none", without);
    fmt::print(": {}\n", flags_.out.string());
  }

 private:
  path QueryImages() const {
    return QueryImagesOf(flags_.query_images, flags_.images, flags_.queries);
  }

  const std::vector<PosedImage>& References() const { return loaded_.references.images; }

  Retrieval Retrieve() const {
    if (options_.method != RetrievalMethod::kVlad) {
      return RetrieveReferences(queries_, References(), options_);
    }
    return {RetrieveByVlad(
                queries_, loaded_.references,
                {.reference_images = flags_.images,
                 .query_images = QueryImages(),
                 .cache = flags_.cache.empty() ? flags_.out.parent_path() / "cache" : flags_.cache,
                 .top_k = flags_.top_k,
                 .max_features = flags_.max_features,
                 .seed = flags_.seed,
                 .threads = flags_.run.threads,
                 .show_progress = !flags_.run.quiet,
                 .among_references = true}),
            {}};
  }

  const PairsFlags& flags_;
  RetrievalOptions options_;
  LoadedReferences loaded_;
  std::vector<Query> queries_;
};

}  // namespace

Command AddPairsCommand(CLI::App& program) {
  auto flags = std::make_shared<PairsFlags>();
  CLI::App& command =
      AddCommand(program, "pairs",
                 "Which references to match with each query or reference, as hloc's pairs list");
  AddReferenceOptions(command, flags->references);
  AddModelPosesOption(command, flags->references);
  const OptionGroup queries(command, "Queries");
  queries.Add("--queries", flags->queries,
              "List of queries: name MODEL width height params...\n"
              "(default: pairs among the references)");
  AddRetrievalOptions(command, flags->retrieval);
  const OptionGroup retrieval(command, "Retrieval");
  retrieval.Add("--top-k", flags->top_k, "References per query");
  retrieval.Add("--geometry", flags->geometry, "mesh:PATH, for --retrieval overlap");
  const OptionGroup group(command, "Images, for --retrieval vlad");
  group.Add("--images", flags->images, "Folder of the reference photographs");
  group.Add("--query-images", flags->query_images,
            "Folder of the query photographs (default: --images)");
  group.Add("--max-features", flags->max_features, "RootSIFT features per image, the strongest");
  group.Add("--cache", flags->cache,
            "Where RootSIFT features are kept (default: cache beside --out)");
  group.Add("--seed", flags->seed, "Seed of the vocabulary");
  const OptionGroup output(command, "Output");
  output.Add("--out", flags->out, "Pairs list: query reference, best first").Required();
  output.Add("--scores", flags->scores, "Also write them with scores: query, reference, score");
  AddRunOptions(command, flags->run);
  SetFooter(
      command,
      "Examples:\n"
      "  raylift pairs --model sfm --queries queries.txt \\\n"
      "      --global-features global-feats-netvlad.h5 --top-k 50 --out pairs.txt\n"
      "  Pairs of references that see the same part of a mesh:\n"
      "  raylift pairs --model sfm --retrieval overlap --geometry mesh:scene.ply --out pairs.txt");
  return {&command,
          [flags] { UntilSignal([&] { PairsRun(*flags, Resolve(*flags)).Run(); }, &BeginsAnew); }};
}

}  // namespace raylift
