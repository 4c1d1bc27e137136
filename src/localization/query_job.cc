#include "raylift/localization/query_job.h"

namespace raylift {
namespace {

std::vector<std::string> NamesOf(std::span<const Query> queries) {
  std::vector<std::string> names;
  names.reserve(queries.size());
  for (const Query& query : queries) names.push_back(query.name);
  return names;
}

}  // namespace

JobForm QueryJobForm() {
  return {.results = {"queries.jsonl", "poses.txt", "summary.json"},
          .is_readable = &IsReadableLine};
}

QueryJob::QueryJob(std::span<const Query> queries, const std::string& header,
                   const JobFolder& folder)
    : names_(NamesOf(queries)),
      job_(names_, header, folder, QueryJobForm()),
      facts_(FactsOf(job_.manifest())) {
  for (const QueryRecord& record : RecordsOf(job_.manifest())) {
    told_.insert(record.warnings.begin(), record.warnings.end());
  }
}

void QueryJob::Begin(const RunFacts& facts) {
  job_.Begin(ToJsonLine(facts));
  facts_ = facts;
}

void QueryJob::Add(size_t query, const LocalizedQuery& localized,
                   const std::vector<std::string>& warnings,
                   const std::optional<double>& log_focal_factor) {
  QueryRecord record{.place = query, .key = job_.key(query)};
  record.localized.name = names_[query];
  record.localized.times = localized.times;
  record.diagnostics = FormatQueryDiagnostics(localized);
  record.log_focal_factor = log_focal_factor;
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const std::string& warning : warnings) {
    if (told_.insert(warning).second) record.warnings.push_back(warning);
  }
  job_.Add(query, ToJsonLine(record));
}

std::optional<std::vector<QueryRecord>> QueryJob::Finish() {
  const std::optional<TaskManifest> whole = job_.Whole();
  if (!whole) return std::nullopt;
  std::vector<QueryRecord> records = RecordsOf(*whole);
  job_.Finish(WithRecords(*whole, records));
  // As they are in the list, where they need not be UTF-8.
  for (QueryRecord& record : records) record.localized.name = names_[record.place];
  return records;
}

}  // namespace raylift
