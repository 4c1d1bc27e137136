#include "localization/pair_files.h"

#include <algorithm>
#include <array>
#include <unordered_map>
#include <utility>

#include "io/scene/pair_pixels.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using fs::path;

constexpr const char* kListName = "pairs.txt";
constexpr const char* kSeparators[] = {"__", "_-_", "_", "/"};

// What an image may be called in a file's name.
struct Form {
  std::string text;
  int level;  // 0: all of its name, 1: without its extension, 2: without folders, 3: without both
};

std::vector<Form> FormsOf(const std::string& name) {
  const std::string base = name.substr(name.rfind('/') + 1);
  const auto stem = [](const std::string& file) { return path(file).replace_extension().string(); };
  std::vector<Form> forms;
  int level = 0;
  for (const std::string& text : {name, stem(name), base, stem(base)}) {
    for (const char separator : {'/', '-', '_'}) {
      std::string form = text;
      std::replace(form.begin(), form.end(), '/', separator);
      const bool is_new = std::none_of(forms.begin(), forms.end(),
                                       [&](const Form& other) { return other.text == form; });
      if (is_new) forms.push_back({std::move(form), level});
    }
    ++level;
  }
  return forms;
}

std::vector<path> PairFilesBelow(const path& folder) {
  std::vector<path> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file() && IsPairFileName(entry.path())) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

// Of a file of matches: its path in the folder without what does not name the images.
std::string NameOfPair(const path& folder, const path& file) {
  std::string name = file.lexically_relative(folder).replace_extension().generic_string();
  constexpr std::string_view kMatches = "_matches";
  if (name.ends_with(kMatches)) name.resize(name.size() - kMatches.size());
  return name;
}

// Both halves of a name at each place where it may be cut.
std::vector<std::pair<std::string, std::string>> Halves(const std::string& name) {
  std::vector<std::pair<std::string, std::string>> halves;
  for (const std::string_view separator : kSeparators) {
    for (size_t at = name.find(separator); at != std::string::npos;
         at = name.find(separator, at + 1)) {
      std::pair<std::string, std::string> cut(name.substr(0, at),
                                              name.substr(at + separator.size()));
      if (cut.first.empty() || cut.second.empty()) continue;
      if (std::find(halves.begin(), halves.end(), cut) == halves.end()) {
        halves.push_back(std::move(cut));
      }
    }
  }
  return halves;
}

}  // namespace

PairFiles::PairFiles(path folder, std::span<const std::string> references)
    : folder_(std::move(folder)) {
  std::error_code ignored;
  if (fs::exists(ListFile(), ignored)) ReadList();
  if (files_of_query_.empty()) ReadNames(references);
}

path PairFiles::ListFile() const { return folder_ / kListName; }

// Lines `query reference [FILE]`.
void PairFiles::ReadList() {
  listed_.emplace();
  LineReader lines(ListFile());
  bool with_files = false;
  while (const auto line = lines.NextContent()) {
    const auto tokens = SplitTokens(*line);
    if (tokens.size() < 2 || tokens.size() > 3 ||
        (!listed_->empty() && with_files != (tokens.size() == 3))) {
      lines.Fail("expected \"query reference FILE\", or in all lines \"query reference\"");
    }
    with_files = tokens.size() == 3;
    const std::string query(tokens[0]), reference(tokens[1]);
    std::vector<std::string>& references = (*listed_)[query];
    if (std::find(references.begin(), references.end(), reference) != references.end()) {
      lines.Fail(fmt::format("the pair {} {} stands twice", query, reference));
    }
    references.push_back(reference);
    if (with_files) files_of_query_[query][reference] = {folder_ / tokens[2], false};
  }
}

void PairFiles::ReadNames(std::span<const std::string> references) {
  // Who is called so by more of its name goes first.
  struct Called {
    int level;
    std::vector<std::string> references;
  };
  std::unordered_map<std::string, Called> by_form;
  for (const std::string& reference : references) {
    for (const Form& form : FormsOf(reference)) {
      Called& called = by_form.try_emplace(form.text, Called{form.level, {}}).first->second;
      if (form.level < called.level) called = {form.level, {}};
      if (form.level == called.level) called.references.push_back(reference);
    }
  }
  for (const path& file : PairFilesBelow(folder_)) {
    for (const auto& [first, second] : Halves(NameOfPair(folder_, file))) {
      for (const bool reference_first : {false, true}) {
        const auto reference = by_form.find(reference_first ? first : second);
        if (reference == by_form.end()) continue;
        by_query_half_.emplace(reference_first ? second : first,
                               Half{reference->second.references, {file, reference_first}});
      }
    }
  }
  if (by_query_half_.empty()) {
    const std::string example = references.empty() ? "REFERENCE" : FormsOf(references[0])[1].text;
    throw InputError(folder_,
                     fmt::format("holds no file that is called after a query and one of the {} "
                                 "references, such as QUERY__{}.npz, and no {} with names of files",
                                 references.size(), example, kListName));
  }
}

// Two queries may not take the same half for their name.
void PairFiles::Claim(const std::string& half, const std::string& query, const path& file) const {
  const std::lock_guard<std::mutex> lock(claims_->mutex);
  const std::string& other = claims_->query_of_half.try_emplace(half, query).first->second;
  if (other == query) return;
  throw InputError(file, fmt::format("may be of the query {} and of {}: {} can tell",
                                     std::min(other, query), std::max(other, query), kListName));
}

std::map<std::string, PairFile> PairFiles::Of(const std::string& query) const {
  const auto listed = files_of_query_.find(query);
  if (listed != files_of_query_.end()) return listed->second;
  std::map<std::string, PairFile> files;
  int level = 0;
  for (const Form& form : FormsOf(query)) {
    if (form.level > level && !files.empty()) break;
    level = form.level;
    const auto [begin, end] = by_query_half_.equal_range(form.text);
    for (auto found = begin; found != end; ++found) {
      const auto& [references, pair] = found->second;
      Claim(form.text, query, pair.file);
      if (references.size() > 1) {
        throw InputError(pair.file, fmt::format("may be of the reference {} and of {}: {} can tell",
                                                references[0], references[1], kListName));
      }
      files.try_emplace(references[0], pair);
    }
  }
  return files;
}

}  // namespace raylift
