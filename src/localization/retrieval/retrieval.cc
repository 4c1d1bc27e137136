#include "localization/retrieval/retrieval.h"

#include <algorithm>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "base/progress.h"
#include "features/dot_products.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/hloc_files.h"
#include "raylift/localization/scene.h"

namespace raylift {

namespace {

// Returns "2 of 5 queries, e.g. a.jpg, ..."; empty where there are no names. Throws InputError
// where all queries are named.
std::vector<std::string> WarnOf(const std::vector<std::string>& names, size_t of,
                                std::string_view what) {
  if (names.empty()) return {};
  if (names.size() == of) {
    throw InputError(fmt::format("all {} queries, e.g. {}, {}", of, names.front(), what));
  }
  return {fmt::format("{} of {} queries, e.g. {}, {}: they have no references", names.size(), of,
                      names.front(), what)};
}

// Retrieves references by cameras for the queries whose pose is known.
Retrieval RetrieveByCameras(std::span<const Query> queries, std::span<const PosedImage> references,
                            const RetrievalOptions& options) {
  std::vector<PosedImage> posed;
  std::vector<size_t> index_of_posed;
  std::vector<std::string> unknown;
  for (size_t i = 0; i < queries.size(); ++i) {
    const auto pose = options.prior_poses.find(queries[i].name);
    if (pose == options.prior_poses.end()) {
      unknown.push_back(queries[i].name);
      continue;
    }
    posed.push_back({queries[i].name, queries[i].camera, pose->second});
    index_of_posed.push_back(i);
  }
  Retrieval retrieval;
  retrieval.warnings = WarnOf(unknown, queries.size(), "have no prior pose");
  RetrievedLists found;
  if (options.method == RetrievalMethod::kOverlap) {
    RAYLIFT_CHECK(options.mesh != nullptr);
    found = RetrieveByOverlap(posed, references, *options.mesh, options.top_k, options.threads);
  } else if (options.view_range) {
    found =
        RetrieveByFrustum(posed, references, *options.view_range, options.top_k, options.threads);
  } else {
    found = RetrieveByDistance(posed, references, options.max_angle_deg, options.top_k,
                               options.threads);
  }
  retrieval.lists.resize(queries.size());
  for (size_t i = 0; i < found.size(); ++i) {
    retrieval.lists[index_of_posed[i]] = std::move(found[i]);
  }
  return retrieval;
}

Retrieval RetrieveByPoints(std::span<const Query> queries, std::span<const PosedImage> references,
                           const RetrievalOptions& options) {
  const Covisibility nothing;
  const Covisibility& covisibility = options.covisibility ? *options.covisibility : nothing;
  Retrieval retrieval;
  std::vector<std::string> unknown;
  const auto names = NamesOf(references);
  for (const Query& query : queries) {
    if (!covisibility.Knows(query.name)) unknown.push_back(query.name);
  }
  retrieval.lists =
      covisibility.MostShared(NamesOf(queries), names, options.top_k, options.threads);
  retrieval.warnings = WarnOf(unknown, queries.size(), "observe no points of the model");
  return retrieval;
}

Retrieval RetrieveSorted(std::span<const Query> queries, std::span<const PosedImage> references,
                         const RetrievalOptions& options) {
  switch (options.method) {
    case RetrievalMethod::kGlobal:
      return {
          RetrieveByGlobalFeatures(NamesOf(queries), NamesOf(references), options.global_features,
                                   options.top_k, options.threads, options.show_progress),
          {}};
    case RetrievalMethod::kPose:
    case RetrievalMethod::kOverlap:
      return RetrieveByCameras(queries, references, options);
    case RetrievalMethod::kCovisibility:
      return RetrieveByPoints(queries, references, options);
    case RetrievalMethod::kVlad:
      break;
  }
  RAYLIFT_CHECK(options.method != RetrievalMethod::kVlad);
  return {};
}

}  // namespace

Retrieval RetrieveReferences(std::span<const Query> queries, std::span<const PosedImage> references,
                             const RetrievalOptions& options) {
  std::vector<int> order(references.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    return references[static_cast<size_t>(a)].name < references[static_cast<size_t>(b)].name;
  });
  std::vector<PosedImage> sorted;
  sorted.reserve(order.size());
  for (const int index : order) sorted.push_back(references[static_cast<size_t>(index)]);
  Retrieval retrieval = RetrieveSorted(queries, sorted, options);
  for (auto& list : retrieval.lists) {
    for (RetrievedReference& reference : list) {
      reference.reference_index = order[static_cast<size_t>(reference.reference_index)];
    }
  }
  return retrieval;
}

// Retrieves by global descriptors from files that need not fit into memory.

namespace {

// The memory in use at once: the descriptors of so many queries, two blocks of references (one in
// work, one being read), and the products of the queries with a block.
constexpr size_t kQueryBytes = size_t{64} << 20;
constexpr size_t kBlockBytes = size_t{16} << 20;

// Returns how many descriptors fit into `bytes`.
size_t CountIn(size_t bytes, Eigen::Index dimension) {
  return std::max<size_t>(1, bytes / (sizeof(float) * static_cast<size_t>(dimension)));
}

// Reads the references in blocks; the next one is read while the last one is in work.
class BlockReader {
 public:
  BlockReader(const GlobalFeatureFile& file, std::span<const std::string> names, size_t block)
      : file_(file), names_(names), block_(block) {}

  // Reads the vectors of the next block of names; there are none at the end.
  Eigen::MatrixXf Next() {
    const size_t count = std::min(block_, names_.size());
    const auto now = names_.first(count);
    names_ = names_.subspan(count);
    return file_.Read(now);
  }

 private:
  const GlobalFeatureFile& file_;
  std::span<const std::string> names_;
  size_t block_;
};

RetrievedLists Search(Eigen::MatrixXf query_descriptors, BlockReader reader, int top_k, int threads,
                      Progress* progress) {
  DotProductSearch search(std::move(query_descriptors), top_k);
  Eigen::MatrixXf block = reader.Next();
  while (block.cols() > 0) {
    Eigen::MatrixXf next;
    search.Add(block, threads, [&] { next = reader.Next(); });
    block = std::move(next);
    progress->Advance();
  }
  return search.Best();
}

}  // namespace

RetrievedLists RetrieveByGlobalFeatures(std::span<const std::string> queries,
                                        std::span<const std::string> references,
                                        const GlobalFeatureFiles& files, int top_k, int threads,
                                        bool show_progress) {
  if (queries.empty() || references.empty()) return RetrievedLists(queries.size());
  const GlobalFeatureFile reference_file(files.references);
  const auto query_path = files.queries.empty() ? files.references : files.queries;
  const GlobalFeatureFile query_file(query_path);
  const Eigen::Index dimension = query_file.Read(queries.first(1)).rows();
  const Eigen::Index of_references = reference_file.Read(references.first(1)).rows();
  if (of_references != dimension) {
    throw InputError(files.references, references.front() + "/global_descriptor",
                     fmt::format("expected {} numbers as in {}, found {}", dimension,
                                 query_path.string(), of_references));
  }
  const size_t chunk = CountIn(kQueryBytes, dimension);
  const size_t block = std::min<size_t>(1024, CountIn(kBlockBytes, dimension));
  const size_t chunks = (queries.size() + chunk - 1) / chunk;
  Progress progress("blocks of references", chunks * ((references.size() + block - 1) / block),
                    show_progress ? Progress::Show::kAuto : Progress::Show::kNever);
  RetrievedLists lists;
  for (size_t first = 0; first < queries.size(); first += chunk) {
    const auto now = queries.subspan(first, std::min(chunk, queries.size() - first));
    RetrievedLists found = Search(query_file.Read(now), {reference_file, references, block},
                                  top_k + 1, threads, &progress);
    lists.insert(lists.end(), found.begin(), found.end());
  }
  DropOwn(queries, references, top_k, &lists);
  for (auto& list : lists) {
    std::erase_if(list, [](const RetrievedReference& reference) { return reference.score < 0; });
  }
  return lists;
}

}  // namespace raylift
