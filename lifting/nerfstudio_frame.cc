#include "nerfstudio_frame.h"

#include <vector>

#include "io/text/json_document.h"

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {

MeshPlacement ReadNerfstudioPlacement(const std::filesystem::path& path) {
  const JsonDocument document(ReadFile(path), path);
  const JsonPlace root = document.Root();
  const JsonPlace transform = root.Member("transform");
  transform.ExpectArraySize(3);
  std::vector<double> numbers;
  for (size_t row = 0; row < 3; ++row) {
    const JsonPlace values = transform.At(row);
    values.ExpectArraySize(4);
    for (size_t column = 0; column < 4; ++column) numbers.push_back(values.At(column).Number());
  }
  const auto moved = PlacementFromMatrix(numbers);
  if (!moved) transform.Fail("expected a rotation and a translation");
  const JsonPlace scale = root.Member("scale");
  if (!(scale.Number() > 0)) scale.Fail("expected a positive number");
  return Inverse(MeshPlacement{.scale = scale.Number()} * *moved);
}

}  // namespace raylift
