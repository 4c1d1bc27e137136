// Loops over independent items (queries, images, tiles) on TBB. Results must be written to the
// item's own place, so that the thread count never changes them.

#pragma once

#include <cstddef>
#include <functional>

namespace raylift {

// Hardware threads if `threads` <= 0.
int ResolveThreads(int threads);

// Calls body(0) ... body(count - 1) on up to `threads` threads (<= 0: all). The first exception of
// the lowest index among those that were thrown is rethrown after the running items end.
void ParallelFor(size_t count, int threads, const std::function<void(size_t)>& body);

}  // namespace raylift
