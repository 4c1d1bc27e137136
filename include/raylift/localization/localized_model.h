// Localized queries as images of a COLMAP model beside the references, for COLMAP's GUI and all
// viewers of such models.

#pragma once

#include <span>

#include "raylift/io/colmap_model.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/references.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The references in use with their SfM points, as far as their model has some, and the localized
// queries without points of their own; where a query is also a reference, its new pose counts. Rigs
// and frames are left out, since queries have none. A camera whose focal length was refined is its
// query's own.
ColmapModel LocalizedModel(const ReferenceSet& references, std::span<const Query> queries,
                           std::span<const LocalizedQuery> localized);

}  // namespace raylift
