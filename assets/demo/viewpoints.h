// Where the demo's photographs are taken, and with which lenses.

#pragma once

#include <string>
#include <vector>

#include "base/rng.h"

#include "raylift/scene/photographs.h"

namespace raylift::demo {

// Heading counter-clockwise from east, pitch up, roll clockwise, all in degrees.
Rigid3 CamFromWorld(const Eigen::Vector3d& center, double heading_deg, double pitch_deg,
                    double roll_deg);
std::string Numbered(const std::string& prefix, size_t number);

// References: two walks around the yard, one looking across it, one looking at the near fronts.
std::vector<PosedImage> ReferenceViews();

// Queries: other lenses, other heights, between the references' places and directions.
std::vector<PosedImage> QueryViews();

// The same views from places up to 0.2 m and directions up to 5 degrees away.
void MoveViews(Rng& rng, std::vector<PosedImage>& views);

}  // namespace raylift::demo
