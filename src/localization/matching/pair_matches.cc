#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/input_paths.h"
#include "io/scene/pair_pixels.h"
#include "localization/matching/file_matches.h"
#include "localization/matching/pixel_matches.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/hloc_files.h"

namespace raylift {
namespace {

// Finds the file of a folder that holds the matches of a pair. Private to localization.

struct PairFile {
  std::filesystem::path file;
  bool reference_first = false;
};

class PairFiles {
 public:
  // Throws InputError where none of the files is of a pair with one of the references.
  PairFiles(std::filesystem::path folder, std::span<const std::string> references);

  // Returns the files of a query by the names of the references. Throws InputError where a file
  // could be of more than one pair. Thread safe.
  std::map<std::string, PairFile> Of(const std::string& query) const;

  // Returns the references of each query, best first, as pairs.txt lists them; nullopt without it.
  const std::optional<RetrievalPairs>& listed() const { return listed_; }
  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path ListFile() const;

 private:
  struct Half {
    std::vector<std::string> references;  // that the other half of the name may stand for
    PairFile pair;
  };
  void ReadList();
  void ReadNames(std::span<const std::string> references);
  void Claim(const std::string& half, const std::string& query,
             const std::filesystem::path& file) const;

  std::filesystem::path folder_;
  std::optional<RetrievalPairs> listed_;
  std::map<std::string, std::map<std::string, PairFile>> files_of_query_;  // by pairs.txt
  std::multimap<std::string, Half> by_query_half_;                         // by the files' names
  // Claims are kept apart, so that the whole can be moved.
  struct Claims {
    std::mutex mutex;
    std::map<std::string, std::string> query_of_half;
  };
  std::unique_ptr<Claims> claims_ = std::make_unique<Claims>();
};

}  // namespace

namespace {

namespace fs = std::filesystem;
using fs::path;

constexpr const char* kListName = "pairs.txt";
constexpr const char* kSeparators[] = {"__", "_-_", "_", "/"};

// A form that an image's name may take in a file's name.
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
  std::vector<path> files = ListFilesBelow(folder);
  std::erase_if(files, [](const path& file) { return !IsPairFileName(file); });
  return files;
}

// Returns the path of a file of matches in the folder without what does not name the images.
std::string NameOfPair(const path& folder, const path& file) {
  std::string name = file.lexically_relative(folder).replace_extension().generic_string();
  constexpr std::string_view kMatches = "_matches";
  if (name.ends_with(kMatches)) name.resize(name.size() - kMatches.size());
  return name;
}

// Visits both halves of a name at each place where it may be cut.
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
  if (Exists(ListFile())) ReadList();
  if (files_of_query_.empty()) ReadNames(references);
}

path PairFiles::ListFile() const { return folder_ / kListName; }

// Reads the list of pairs, lines `query reference [FILE]`.
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

// Claims a half of a file's name; two queries may not take the same half for their name.
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

namespace {

using std::filesystem::path;

// Returns whether float16 has steps of half a pixel and more at the image's far side.
bool IsCoarseInHalf(const Camera& camera) {
  constexpr int kCoarseHalfPx = 512;
  return std::max(camera.width_px(), camera.height_px()) > kCoarseHalfPx;
}

class PairMatches final : public MatchSource {
 public:
  PairMatches(PairFiles files, std::optional<RetrievalPairs> ranked, const ReferenceSet& references,
              int top_k, const JoiningQueries& joining, const MatchReading& reading)
      : files_(std::move(files)),
        ranked_(std::move(ranked)),
        references_(references, top_k, joining),
        reading_(reading) {
    for (const PosedImage& image : references.images) cameras_.emplace(image.name, image.camera);
    for (const Query& query : joining.queries) cameras_.emplace(query.name, query.camera);
  }

  QueryMatches Match(const Query& query) const override {
    const auto files = files_.Of(query.name);
    std::map<std::string, PixelMatches> pairs;  // that were read to rank them
    const std::vector<std::string> names =
        ranked_ ? Ranked(query.name) : RankedByMatches(query, files, pairs);
    QueryMatches result{.references = references_.Take(query.name, names), .matches = {}};
    QueryPixels pixels(query, reading_);
    for (size_t r = 0; r < result.references.size(); ++r) {
      const std::string& name = result.references[r].name;
      const auto file = files.find(name);
      if (file == files.end()) {
        warnings_.Add(fmt::format("{}: no matches of {} with {}", files_.folder().string(),
                                  query.name, name));
        continue;
      }
      const auto known = pairs.find(name);
      pixels.Add(known != pairs.end() ? known->second : Read(query, name, file->second),
                 static_cast<int>(r), &result);
    }
    return result;
  }

  void Join(const PosedImage& localized_query) override { references_.Join(localized_query); }
  std::vector<std::string> Warnings() const override { return warnings_.All(); }

 private:
  std::vector<std::string> Ranked(const std::string& query) const {
    const auto listed = ranked_->find(query);
    return listed == ranked_->end() ? std::vector<std::string>() : listed->second;
  }

  // Returns the references of the most matches first.
  std::vector<std::string> RankedByMatches(const Query& query,
                                           const std::map<std::string, PairFile>& files,
                                           std::map<std::string, PixelMatches>& pairs) const {
    std::vector<std::string> names;
    for (const auto& [name, file] : files) {
      if (!cameras_.contains(name) || name == query.name) continue;
      names.push_back(name);
      pairs.emplace(name, Read(query, name, file));
    }
    std::stable_sort(names.begin(), names.end(), [&](const auto& a, const auto& b) {
      return pairs.at(a).query_px.size() > pairs.at(b).query_px.size();
    });
    return names;
  }

  PixelMatches Read(const Query& query, const std::string& reference, const PairFile& file) const {
    PairPixels pixels = ReadPairPixels(file.file);
    if (file.reference_first) std::swap(pixels.first_px, pixels.second_px);
    const Camera& reference_camera = cameras_.at(reference);
    if (pixels.is_half && (IsCoarseInHalf(query.camera) || IsCoarseInHalf(reference_camera))) {
      warnings_.Add(
          fmt::format("{}: pixels are float16, which rounds them to 0.5 px beyond 512 px "
                      "and to 1 px beyond 1024 px",
                      files_.folder().string()));
    }
    InsideMatches inside = QueryPixels(query, reading_)
                               .Inside({std::move(pixels.first_px), std::move(pixels.second_px),
                                        std::move(pixels.scores)},
                                       reference, reference_camera, file.file);
    if (inside.outside > 0) {
      warnings_.Add(fmt::format("{}: matches outside of their images are left out",
                                files_.folder().string()));
    }
    return std::move(inside.matches);
  }

  PairFiles files_;
  std::optional<RetrievalPairs> ranked_;
  KnownReferences references_;
  MatchReading reading_;
  std::map<std::string, Camera> cameras_;  // of all that are or may become references
  WarningSet warnings_;
};

}  // namespace

std::unique_ptr<MatchSource> OpenPairMatches(const path& folder, const path& pairs,
                                             const ReferenceSet& references, int top_k,
                                             const JoiningQueries& joining,
                                             const MatchReading& reading) {
  Check(reading);
  std::set<std::string> names(references.thinned_out.begin(), references.thinned_out.end());
  for (const PosedImage& image : references.images) names.insert(image.name);
  for (const Query& query : joining.queries) names.insert(query.name);
  PairFiles files(folder, std::vector<std::string>(names.begin(), names.end()));
  std::optional<RetrievalPairs> ranked;
  if (!pairs.empty()) {
    ranked = ReadPairsInUse(pairs, references, joining);
  } else if (files.listed()) {
    ranked = PairsInUse(*files.listed(), files.ListFile(), references, joining);
  }
  return std::make_unique<PairMatches>(std::move(files), std::move(ranked), references, top_k,
                                       joining, reading);
}

}  // namespace raylift
