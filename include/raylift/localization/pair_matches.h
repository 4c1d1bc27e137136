// Matches that stand as pixels in a folder, a file of each pair (io/pair_pixels.h): of dense and
// learned matchers, whose pixels are no features of an image.
//
// Which pair a file is of: `pairs.txt` in the folder says so in lines `query reference FILE`, or the
// name does: QUERY__REFERENCE.npz, QUERY_REFERENCE_matches.npz (SuperGlue) or QUERY/REFERENCE.npz,
// where "/" within names may stand as "-" or "_" and extensions may be left out, or all folders of
// one of them. A file may be of the reference first.

#pragma once

#include <filesystem>
#include <memory>

#include "raylift/localization/hloc_matches.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/references.h"

namespace raylift {

// `pairs` ranks the references of each query; else `pairs.txt` in the folder, else the number of
// matches with each. Equal pixels of a query are one keypoint, in whatever pair they stand, or those
// in one cell (MatchReading). Warns of pixels outside of their image, as of resized images.
// InputError where the folder holds no file of a pair with one of the references.
std::unique_ptr<MatchSource> OpenPairMatches(const std::filesystem::path& folder,
                                             const std::filesystem::path& pairs,
                                             const ReferenceSet& references, int top_k,
                                             const JoiningQueries& joining = {},
                                             const MatchReading& reading = {});

}  // namespace raylift
