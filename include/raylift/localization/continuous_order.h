// The order in which continuous localization takes the queries (the paper's supplement): those that
// are most like the references come first, where a scene changes slowly.

#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "raylift/scene/photographs.h"

namespace raylift {

// When photographs were taken, in seconds since any moment.
using CaptureTimes = std::map<std::string, double>;

// Indices of the queries. Those that are older than the oldest reference go first, backwards in
// time; then the others, from the oldest on. Of one time, by name. References whose times are not
// known do not count; where none is known, all queries go from the oldest on. InputError naming the
// query whose time is missing (`path_for_messages`).
std::vector<size_t> OrderByTime(std::span<const Query> queries,
                                std::span<const PosedImage> references, const CaptureTimes& times,
                                const std::filesystem::path& path_for_messages);

// Where there are no times.
std::vector<size_t> OrderByName(std::span<const Query> queries);

}  // namespace raylift
