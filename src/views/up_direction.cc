#include <algorithm>
#include <cmath>
#include <vector>

#include "base/constants.h"
#include <Eigen/Eigenvalues>

#include "raylift/views/view_sampler.h"

namespace raylift {
namespace {

// Real floors and walls, as scanned, stray by so much.
constexpr double kFloorConeDeg = 15;
constexpr double kWallBandDeg = 10;
constexpr double kFarDeg = 30;  // a direction that is another one
// The least ratio of area that faces up to area that faces down; and of the best direction to
// others.
constexpr double kLead = 2;
// The least ratio to others where z is at right angles to nothing, and so is hardly up.
constexpr double kLeadOfAny = 1.1;
constexpr double kLikeTheBest = 0.9;
constexpr double kLevelWithinDeg = 2;  // no picture is the worse for it
constexpr size_t kBinsPerSide = 24;    // of each face of a cube: some 4 degrees

struct Facing {
  Eigen::Vector3d normal;
  double share;  // of the whole area
};

// Returns the mesh's normals; like directions are joined.
std::vector<Facing> CollectFacings(const TriangleMesh& mesh) {
  std::vector<Eigen::Vector3d> sums(6 * kBinsPerSide * kBinsPerSide, Eigen::Vector3d::Zero());
  const auto bin_of = [](double share) {
    const auto bin = static_cast<size_t>(0.5 * (share + 1) * static_cast<double>(kBinsPerSide));
    return std::min(bin, kBinsPerSide - 1);
  };
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3d normal = (mesh.vertices[b] - mesh.vertices[a])
                                       .cross(mesh.vertices[c] - mesh.vertices[a])
                                       .cast<double>();
    Eigen::Index axis = 0;
    const double largest = normal.cwiseAbs().maxCoeff(&axis);
    if (!(largest > 0) || !std::isfinite(largest)) continue;
    const auto side = static_cast<size_t>(2 * axis + (normal[axis] < 0 ? 1 : 0));
    const size_t row = bin_of(normal[(axis + 1) % 3] / largest);
    const size_t column = bin_of(normal[(axis + 2) % 3] / largest);
    sums[(side * kBinsPerSide + row) * kBinsPerSide + column] += 0.5 * normal;
  }
  double whole = 0;
  for (const Eigen::Vector3d& sum : sums) whole += sum.norm();
  std::vector<Facing> facings;
  for (const Eigen::Vector3d& sum : sums) {
    const double area = sum.norm();
    if (area > 0) facings.push_back({sum / area, area / whole});
  }
  return facings;
}

// The evidence that a direction is up, as shares of the whole area.
struct Evidence {
  double up = 0;     // faces it
  double down = 0;   // faces away
  double walls = 0;  // at right angles

  double Explained() const { return up + down + walls; }
  double Score() const { return (up - down) * Explained(); }
};

Evidence EvidenceFor(const std::vector<Facing>& facings, const Eigen::Vector3d& direction) {
  static const double kFloor = std::cos(kFloorConeDeg * kRadPerDeg);
  static const double kWall = std::sin(kWallBandDeg * kRadPerDeg);
  Evidence evidence;
  for (const Facing& facing : facings) {
    const double cosine = facing.normal.dot(direction);
    if (cosine > kFloor) evidence.up += facing.share;
    if (cosine < -kFloor) evidence.down += facing.share;
    if (std::abs(cosine) < kWall) evidence.walls += facing.share;
  }
  return evidence;
}

// Returns the normal of floors and ceilings that is at right angles to walls', by least squares.
Eigen::Vector3d Levelled(const std::vector<Facing>& facings, Eigen::Vector3d up) {
  for (const double cone_deg : {kFloorConeDeg, kWallBandDeg, kWallBandDeg / 2}) {
    const double floor = std::cos(cone_deg * kRadPerDeg), wall = std::sin(cone_deg * kRadPerDeg);
    Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
    for (const Facing& facing : facings) {
      const double cosine = std::abs(facing.normal.dot(up));
      const Eigen::Matrix3d along = facing.share * facing.normal * facing.normal.transpose();
      if (cosine > floor) squares -= along;
      if (cosine < wall) squares += along;
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(squares);
    const Eigen::Vector3d axis = solver.eigenvectors().col(0);
    up = axis.dot(up) < 0 ? Eigen::Vector3d(-axis) : axis;
  }
  return up;
}

}  // namespace

UpDirection EstimateUp(const TriangleMesh& mesh) {
  const std::vector<Facing> facings = CollectFacings(mesh);
  struct Candidate {
    Eigen::Vector3d up;
    Evidence evidence;
  };
  // Where a surface faces, or faces away from.
  std::vector<Candidate> candidates;
  for (const Facing& facing : facings) {
    for (const Eigen::Vector3d& up : {facing.normal, Eigen::Vector3d(-facing.normal)}) {
      candidates.push_back({up, EvidenceFor(facings, up)});
    }
  }
  const auto best = std::max_element(candidates.begin(), candidates.end(),
                                     [](const Candidate& a, const Candidate& b) {
                                       return a.evidence.Score() < b.evidence.Score();
                                     });
  if (best == candidates.end()) return {};
  const Evidence z = EvidenceFor(facings, Eigen::Vector3d::UnitZ());
  const bool z_explains = z.Explained() >= kLikeTheBest * best->evidence.Explained();
  if (z_explains && z.up >= kLead * z.down && z.up > 0) return {Eigen::Vector3d::UnitZ(), true};
  double second = 0;
  for (const Candidate& other : candidates) {
    const bool is_far = other.up.dot(best->up) < std::cos(kFarDeg * kRadPerDeg);
    if (is_far) second = std::max(second, other.evidence.Score());
  }
  const double lead = (z_explains ? kLead : kLeadOfAny) * second;
  if (!(best->evidence.Score() > lead)) return {};
  if (!(best->evidence.up >= kLead * best->evidence.down)) return {};
  const Eigen::Vector3d up = Levelled(facings, best->up);
  const bool is_z = up.z() > std::cos(kLevelWithinDeg * kRadPerDeg);
  return {is_z ? Eigen::Vector3d::UnitZ() : up, true};
}

}  // namespace raylift
