// Retrieval by global descriptors from files that need not fit into memory.

#include <algorithm>

#include "base/progress.h"
#include "localization/retrieved_lists.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/features/dot_product_search.h"
#include "raylift/io/hloc_files.h"
#include "raylift/localization/retrieval.h"

namespace raylift {
namespace {

// What is in memory at once: the descriptors of so many queries, two blocks of references (one in
// work, one being read), and the products of the queries with a block.
constexpr size_t kQueryBytes = size_t{64} << 20;
constexpr size_t kBlockBytes = size_t{16} << 20;

// How many descriptors fit into `bytes`.
size_t CountIn(size_t bytes, Eigen::Index dimension) {
  return std::max<size_t>(1, bytes / (sizeof(float) * static_cast<size_t>(dimension)));
}

// The references in blocks; the next one is read while the last one is in work.
class BlockReader {
 public:
  BlockReader(const GlobalFeatureFile& file, std::span<const std::string> names, size_t block)
      : file_(file), names_(names), block_(block) {}

  // Empty at the end.
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
