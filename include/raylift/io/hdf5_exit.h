// For programs, which end when their results are written.

#pragma once

namespace raylift {

// Call it before anything else: HDF5 then does not clean up when the process ends. Where a disk was
// full it would crash there, as it goes through files again that it could not close.
void LeaveHdf5AsItIsAtExit();

}  // namespace raylift
