// evaluate --geometry depth:DIR: the dense reprojection error from depth maps of the queries.

#include <map>
#include <string>
#include <vector>

#include "apps/program.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

// Writes a scene of two queries: one sees a slanted wall with a hole in its map, the other has an
// empty map. Prints points, mean and max of the first one's error in percent of the diagonal, from
// the definition: what each pixel shows, seen from the wrong pose.
constexpr const char* kScene = R"(
import numpy as np
import os
os.makedirs(folder + '/depth/q', exist_ok=True)
def rotation(q):
    w, x, y, z = q
    return np.array([[1-2*(y*y+z*z), 2*(x*y-w*z), 2*(x*z+w*y)],
                     [2*(x*y+w*z), 1-2*(x*x+z*z), 2*(y*z-w*x)],
                     [2*(x*z-w*y), 2*(y*z+w*x), 1-2*(x*x+y*y)]])
def unit(q): return np.array(q) / np.linalg.norm(q)
fx, fy, cx, cy, width, height = 70.0, 72.0, 41.0, 29.0, 80, 60
true = unit([0.9, 0.1, -0.3, 0.2]), np.array([100.5, -20.0, 3.0])
wrong = unit([0.9, 0.11, -0.29, 0.21]), np.array([102.9, -17.2, 2.1])
u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
z = (1 / (0.2 + 0.001 * u - 0.0008 * v)).astype(np.float32)
z[20:30, 50:65] = 0
np.save(folder + '/depth/q/wall.npy', z)
np.save(folder + '/depth/q/empty.npy', 0 * z)
def line(name, pose): return ' '.join([name] + [repr(float(x)) for part in pose for x in part]) + '\n'
def write(name, text): open(folder + '/' + name, 'w').write(text)
write('truth.txt', line('q/wall.png', true) + line('q/empty.png', true))
write('poses.txt', line('q/wall.png', wrong) + line('q/empty.png', wrong))
write('queries.txt', ''.join('q/%s.png PINHOLE 80 60 70 72 41 29\n' % n for n in ('wall', 'empty')))
known = z > 0
depth = z[known].astype(float)
x = np.stack([(u[known] - cx) / fx * depth, (v[known] - cy) / fy * depth, depth])
world = rotation(true[0]).T @ (x - true[1][:, None])
y = rotation(wrong[0]) @ world + wrong[1][:, None]
moved = np.hypot(fx * y[0] / y[2] + cx - u[known], fy * y[1] / y[2] + cy - v[known])
share = np.minimum(np.where(y[2] > 0, moved, np.inf) / np.hypot(width, height), 1)
print(known.sum(), 100 * share.mean(), 100 * share.max(), end='')
)";

TEST(EvaluateDepth, DenseErrorsAreThoseOfNumpy) {
  const fs::path folder = TestFolder();
  WriteFile(folder / "scene.py", fmt::format("folder = '{}'\n", folder.string()) + kScene);
  const std::string printed = RunProgram("/usr/bin/python3 " + (folder / "scene.py").string());
  const auto expected = SplitTokens(printed);
  ASSERT_EQ(expected.size(), 3u) << printed;
  const fs::path csv = folder / "dcre.csv";
  const CommandResult result =
      RunRaylift({"evaluate", "--ground-truth", folder / "truth.txt", "--queries",
                  folder / "queries.txt", "--poses", folder / "poses.txt", "--geometry",
                  "depth:" + (folder / "depth").string(), "--dcre-csv", csv});
  ASSERT_TRUE(Succeeds(result));
  std::map<std::string, std::vector<std::string>> rows;  // by the query's name
  for (const std::string& line : Lines(ReadFile(csv))) {
    const auto fields = SplitBy(line, ',');
    rows[std::string(fields.at(1))] = {fields.begin() + 2, fields.end()};
  }
  const std::vector<std::string>& wall = rows.at("q/wall.png");
  EXPECT_EQ(wall[0], "true");
  EXPECT_EQ(wall[1], expected[0]);
  // Depth is float, the table has six digits.
  EXPECT_NEAR(*ParseDouble(wall[2]) / *ParseDouble(expected[1]), 1, 2e-5) << printed;
  EXPECT_NEAR(*ParseDouble(wall[3]) / *ParseDouble(expected[2]), 1, 2e-5) << printed;
  // A photograph without depth is no success and no failure: it is told apart.
  EXPECT_EQ(rows.at("q/empty.png")[0], "false");
  EXPECT_EQ(rows.at("q/empty.png")[2], "");
  EXPECT_NE(result.out.find("without depth"), std::string::npos) << result.out;
}

}  // namespace
}  // namespace raylift
