// Which queries are photographs of one rig, as COLMAP has it: the rig configuration of its
// rig_configurator (rig_config.json), a list of rigs
//
//   [{"cameras": [{"image_prefix": "left/", "ref_sensor": true},
//                 {"image_prefix": "right/", "cam_from_rig_rotation": [qw, qx, qy, qz],
//                  "cam_from_rig_translation": [tx, ty, tz]}]}]
//
// where photographs whose names are alike after the prefix are of one frame; or a model with rigs and
// frames (COLMAP >= 3.12), whose poses are not looked at.

#pragma once

#include <filesystem>
#include <span>

#include "raylift/scene/photographs.h"

namespace raylift {

// Gives each query of a frame its place there. Those that share their frame with no other query stay
// as they are, as those do that the file does not know. InputError where it knows none at all, and
// for a camera without known pose in its rig.
void TakeRigs(const std::filesystem::path& file_or_model, std::span<Query> queries);

}  // namespace raylift
