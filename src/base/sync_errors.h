// What may keep a file from being synced and is no fault of the disk.

#pragma once

namespace raylift {

// Returns whether, after this errno, there is nothing that could be synced: file systems of
// networks may have no such call for folders, a folder may be one to write to and not to read, and
// whoever promises a file that is gone finds that out.
bool CannotSyncHere(int error);

}  // namespace raylift
