// The references that continuous localization adds: queries that have been localized. The geometry
// of such a reference are the 3D points that its own keypoints were localized by. Its pose is
// uncertain: matches with it count the less, the farther the pose's error may move their points.

#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "raylift/lifting/geometry_source.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"
#include "raylift/scene/keypoints.h"
#include "raylift/scene/photographs.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

using PoseCovariance = Eigen::Matrix<double, 6, 6>;

// A keypoint and the point of the scene that it shows.
struct PointLink {
  Eigen::Vector2d pixel;
  Eigen::Vector3d point_in_world;
};

struct JoinedReference {
  PosedImage image;
  // The covariance of the step (w, v) in the camera's tangent frame (geometry/residuals.h); nullopt
  // where not known.
  std::optional<PoseCovariance> covariance;
  double distance = 0;  // from the camera to what it sees (median), scene units; 0: not known
  std::vector<PointLink> links;
};

// Returns the links of a localized query: its 2D-3D inliers; of several points of one keypoint the
// one of the median depth. They are in the order of their places.
std::vector<PointLink> LinksOfInliers(const QueryResult& result);

// Returns the median distance of the points of a localized query: of its 2D-3D inliers, or, where
// it has none, of the points in which the rays of its 2D-2D inliers meet. 0 where there are
// neither.
double SceneDistance(const QueryResult& result);

class JoinedReferences {
 public:
  // With `weigh` off joined references count as if their poses were exact.
  explicit JoinedReferences(bool weigh) : weigh_(weigh) {}

  void Add(const JoinedReference& reference);
  bool Contains(const std::string& name) const { return references_.contains(name); }
  size_t size() const { return references_.size(); }

  // Returns the point that a keypoint of a joined reference is linked to.
  std::optional<Eigen::Vector3d> LinkedPoint(const std::string& name,
                                             const Eigen::Vector2d& pixel) const;

  // Returns by how many pixels (standard deviation, isotropic) the pose of a joined reference moves
  // what it shows at a pixel, to first order: of the point that the pixel is linked to, or else of
  // one at the reference's distance. nullopt for other references, and where it is not known.
  std::optional<double> SigmaPx(const std::string& name, const Eigen::Vector2d& pixel) const;
  // Returns the same of a point.
  std::optional<double> SigmaPx(const std::string& name,
                                const Eigen::Vector3d& point_in_world) const;

  // Sets `reference_sigma_px` of the matches with joined references.
  void Weigh(QueryMatches& matches) const;

  // Returns what the uncertainty of joined references adds to the covariance of a query that rests
  // on them. The error of a reference is common to all matches with it, so that many do not average
  // it away: a reference that holds a share s of the inliers passes on s times its error. As
  // references may rest on each other, their errors may be alike in any way: the bound sum(s) *
  // sum(s * covariance) holds for all.
  PoseCovariance PassedOn(const QueryResult& result) const;

 private:
  struct Entry {
    JoinedReference reference;
    // The links by pixel, as sources of geometry are asked for pixels; a match with the reference
    // repeats the pixel of the keypoint that the link is of.
    KeypointsByPixel link_of_pixel;
  };
  const Entry* Find(const std::string& name) const;
  std::optional<double> SigmaPx(const JoinedReference& reference,
                                const Eigen::Vector3d& point_in_cam) const;

  bool weigh_;
  std::map<std::string, Entry> references_;
};

// Returns the matches of another source, those with joined references weighted.
class WeighedMatches final : public MatchSource {
 public:
  WeighedMatches(std::shared_ptr<const MatchSource> source,
                 std::shared_ptr<const JoinedReferences> joined)
      : source_(std::move(source)), joined_(std::move(joined)) {}
  QueryMatches Match(const Query& query) const override;
  QueryMatches MatchPhotograph(const Query& query, const Image& photograph) const override;
  QueryMatches MatchFeatures(const Query& query, const Features& features) const override;
  std::vector<std::string> Warnings() const override { return source_->Warnings(); }

 private:
  QueryMatches Weighed(QueryMatches matches) const;

  std::shared_ptr<const MatchSource> source_;
  std::shared_ptr<const JoinedReferences> joined_;
};

// A source of geometry for joined references, too: it gives their linked points, and elsewhere the
// source's points for the estimated pose (a mesh lifts from any), with the uncertainty of that
// pose.
class JoinedGeometry final : public GeometrySource {
 public:
  // Only the first of several sources should give the links.
  enum class Links { kGive, kLeaveOut };
  JoinedGeometry(std::shared_ptr<const GeometrySource> source,
                 std::shared_ptr<const JoinedReferences> joined, Links links)
      : source_(std::move(source)), joined_(std::move(joined)), links_(links) {}

  std::string Description() const override { return source_->Description(); }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override;

 private:
  std::shared_ptr<const GeometrySource> source_;
  std::shared_ptr<const JoinedReferences> joined_;
  Links links_;
};

}  // namespace raylift
