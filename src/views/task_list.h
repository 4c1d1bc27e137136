// Lists the views that a job renders, with their sizes and the names of their files.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/io/colmap_model.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"
#include "raylift/views/render_job.h"

namespace raylift {

// Parses "WIDTHxHEIGHT"; throws OptionError naming the option for anything else.
PlaneSize ParseSize(std::string_view option, const std::string& text);

// Parses a number of pixels; likewise.
int ParseSide(std::string_view option, const std::string& text);

struct TaskSelection {
  std::filesystem::path list = {};  // only the images in this list; empty: all
  std::string glob = {};            // only names that match, as in a shell; empty: all
  Subsampling subsampling = {};     // only every N-th of those, by name
  // Images are scaled by this factor, and their lens with them. At most one of this and the
  // following is given.
  std::optional<double> scale = std::nullopt;
  std::optional<PlaneSize> size = std::nullopt;
  // Instead of the images a panorama of this size is rendered from each camera's place.
  std::optional<PlaneSize> panorama = std::nullopt;
  // Instead of each image the six faces of a cube around its camera's place are rendered, this many
  // pixels wide.
  std::optional<int> cubemap = std::nullopt;
  // Files have these names, without extension: {name}, {dir}, {stem} and {base} are as
  // ExpandPattern() has them, and {index} is the place among the tasks, 00000000.
  std::string pattern = "{dir}/{stem}";
};

// Reads the views of a COLMAP model. Its warnings are added to `warnings`.
std::vector<PosedImage> ReadModelViews(const std::filesystem::path& model,
                                       std::vector<std::string>& warnings);

// Returns six pinholes of 90 degrees, "seq/a/front.jpg", right, back, left, up and down of
// "seq/a.jpg". Front has the camera's axes, the next three are turned to the right about its y
// axis; up's lower edge and down's upper one are front's.
std::vector<PosedImage> CubeFaces(const PosedImage& view, int side_px);

// Returns a sentence where `selection.size` would stretch pictures, as it has another shape than
// they have.
std::optional<std::string> StretchWarning(const std::vector<PosedImage>& views,
                                          const TaskSelection& selection);

// Returns the tasks by name. Throws InputError where an image of the list is not among the views,
// where none is left, or where two images would be written to one file or outside of the output
// folder.
std::vector<RenderTask> SelectTasks(std::vector<PosedImage> views, const TaskSelection& selection);

// Returns a model of the cameras and poses of what is rendered, under the images' names: the
// cameras of scaled images are scaled, so that the maps and this model belong together. nullopt
// where one is a panorama.
std::optional<ColmapModel> ModelOf(std::span<const RenderTask> tasks);

}  // namespace raylift
