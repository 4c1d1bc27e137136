// The fixed parts of the report's page.

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/scene/image.h"

namespace raylift {

// Returns the page around a JSON document. Title and JSON may hold anything.
std::string MakePage(std::string_view title, std::string_view json);

// Makes small pictures of depth and its errors, as they stand in an HTML page.

// Reads a photograph; nullopt where it is missing or damaged: the pages are about geometry.
std::optional<Image> ReadPhoto(const std::filesystem::path& folder, const std::string& name);

// Colors depth from dark blue (near) to yellow (far), even in brightness and for the color blind;
// holes are gray.
Image ColorizeDepth(const DepthMap& map, double near, double far);

// Colors ln(estimated / true): blue where the estimate is too near, orange where it is too far,
// white where it is right, full color from `full` on; gray where one of them is unknown.
Image ColorizeError(const DepthMap& estimated, const DepthMap& truth, double full);

// Return the colors of the two, evenly spread over their ranges, as style sheets write them.
std::vector<std::string> DepthColors();
std::vector<std::string> ErrorColors();

// Returns counts of ln(estimated / true) in `bins` equal bins over [-full, full]; the ends hold the
// rest.
std::vector<int> ErrorHistogram(const DepthMap& estimated, const DepthMap& truth, double full,
                                int bins);

// Returns "data:image/jpeg;base64,..." of a picture that is shrunk to at most this width.
std::string JpegDataUri(const Image& image, int max_width_px);
// Returns "data:image/png;base64,..." of a picture with four channels, the last one opacity.
std::string PngDataUri(const Image& image);

}  // namespace raylift
