// No answer that meets a failing allocation ends the server: each allocation of the making of an
// answer is failed once, and the making must throw std::bad_alloc, or go on.

#include <cstdlib>
#include <functional>
#include <new>
#include <string>

#include "geometry/pose_json.h"
#include "io/text/json_document.h"
#include "localization/results/earth_exports.h"
#include "service/geopose.h"
#include "service/problem.h"
#include <gtest/gtest.h>

#include "raylift/localization/result_files.h"
#include "raylift/sequences/smooth_queries.h"

namespace {

thread_local long allocations_until_failure = -1;  // below 0: none fails

void* Allocate(size_t size) {
  if (allocations_until_failure >= 0 && allocations_until_failure-- == 0) throw std::bad_alloc();
  void* const memory = std::malloc(size);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}

}  // namespace

void* operator new(size_t size) { return Allocate(size); }
void* operator new[](size_t size) { return Allocate(size); }
void* operator new(size_t size, const std::nothrow_t&) noexcept { return std::malloc(size); }
void* operator new[](size_t size, const std::nothrow_t&) noexcept { return std::malloc(size); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, size_t) noexcept { std::free(memory); }

namespace raylift {
namespace {

// Returns how many allocations `make` has, each of which was failed.
long FailEachAllocation(const std::function<void()>& make) {
  for (long allocation = 0;; ++allocation) {
    allocations_until_failure = allocation;
    bool failed = true;
    try {
      make();
      failed = allocations_until_failure < 0;  // one that was caught
    } catch (const std::bad_alloc&) {
    }
    allocations_until_failure = -1;
    if (!failed) return allocation;
  }
}

LocalizedQuery FullQuery() {
  LocalizedQuery query;
  query.name = "a photograph whose name is long.jpg";
  PoseEstimate estimate;
  estimate.cam_from_world = Rigid3();
  estimate.covariance = Eigen::Matrix<double, 6, 6>::Identity();
  estimate.alternatives.push_back({Rigid3(), 0.25});
  query.TakeEstimate(std::move(estimate));
  return query;
}

TEST(AnswerMemory, OfAQuerysLine) {
  const LocalizedQuery query = FullQuery();
  EXPECT_GT(FailEachAllocation([&] { FormatQueryDiagnostics(query); }), 50);
}

TEST(AnswerMemory, OfAWalksLine) {
  WalkedQuery query{FullQuery()};
  query.time_s = 2;
  query.single_cam_from_world = Rigid3();
  EXPECT_GT(FailEachAllocation([&] { FormatQueryDiagnostics(query); }), 60);
}

TEST(AnswerMemory, OfAProblem) {
  const Problem problem(400, "matches[2].query_px", "matches[2]: query_px: expected two numbers");
  EXPECT_GT(FailEachAllocation([&] { ProblemJson(problem); }), 10);
}

TEST(AnswerMemory, OfAGeoPose) {
  const EarthFrame::Place place{Eigen::Vector3d(9, 48, 300), Eigen::Matrix3d::Identity(), 1};
  for (const GeoPoseForm form : {GeoPoseForm::kQuaternion, GeoPoseForm::kYawPitchRoll}) {
    const std::string geopose = JsonText(GeoPoseOf(Rigid3(), place, form));
    const auto make = [&] {
      auto json = GeoPoseOf(Rigid3(), place, form);
      Dismantle(json);
    };
    EXPECT_GT(FailEachAllocation(make), 5);
    const LocalizedQuery query = FullQuery();
    const auto answer = [&] {
      FormatGeoPoseAnswer({.id = "any", .photograph = {}}, "scene", query, {.geopose = geopose});
    };
    EXPECT_GT(FailEachAllocation(answer), 15);
  }
}

TEST(AnswerMemory, OfADocument) {
  const std::string text =
      R"({"references": [{"name": "a", "camera": {"width": 4, "ks": [1, 2]}}]})";
  EXPECT_GT(FailEachAllocation([&] { JsonDocument(text, "body").Root().IsNull(); }), 10);
}

}  // namespace
}  // namespace raylift
